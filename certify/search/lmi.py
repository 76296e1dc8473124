"""What facial reduction leaves of the storage LMI: solved in floats, rounded to rationals, accepted by the kernel.

The unknowns are X of the Riccati inequality if nothing else constrains P, else the coordinates of the affine family.
States are balanced and time is scaled before a solver sees numbers; what it cannot do is left to high precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import chain
from typing import Any

from certify.kernel.linalg import Matrix, ldl_pivots
from certify.search import exact
from certify.search.exact import Exact
from certify.search.facial import Family
from certify.search.solvers import BOUNDS, Block, largest_margin, symmetric_units
from certify.search.spectral import Reduced, Riccati, riccati_candidates

ROUNDINGS = (3, 6, 10, 14)  # decimal digits kept of a solver's point, the fewest first: short certificates
LONG_ROUNDINGS = (8, 16, 24, 40, 60, 100, 200)  # of a point known in high precision
Accept = Callable[[Matrix], bool]


def solve_free(reduced: Reduced, accept: Accept) -> Matrix | None:
    """A storage matrix for a family in which only X is free, or None."""
    if reduced.K.ncols() and reduced.a.det() == 0:
        return None  # P is singular all over the family
    if not reduced.R.ncols():
        P = exact.from_flint(reduced.storage(reduced.riccati.Q))
        return P if accept(P) else None
    return find_solution(reduced, lambda X: exact.from_flint(reduced.storage(X)), accept)


def find_solution(reduced: Reduced, storage: Callable[[Exact], Matrix], accept: Accept) -> Matrix | None:
    """The storage matrix of a solution X with as few digits as `accept` lets pass, or None.

    First Clarabel, whose points have room around them; then high precision; then SCS for a second opinion.
    """

    def shortest(X: Exact, digits: Iterable[int], scales: list[Fraction] | None = None) -> Matrix | None:
        if not looks_definite(exact.from_flint(reduced.storage(X))):
            return None
        candidates = (storage(rounded(X, count, scales)) for count in digits)
        return next((P for P in candidates if accept(P)), None)

    def solver_points(bounds: Sequence[float], second_opinion: bool = False) -> Iterator[Matrix | None]:
        for X, scales in balanced_candidates(reduced, bounds, second_opinion):
            yield shortest(X, ROUNDINGS, scales)

    def precise_points() -> Iterator[Matrix | None]:
        for X in riccati_candidates(reduced.riccati):
            yield shortest(X, LONG_ROUNDINGS) if accept(storage(X)) else None

    results = chain(
        solver_points(BOUNDS[:1]), precise_points(), solver_points(BOUNDS[1:]), solver_points(BOUNDS[1:2], True)
    )
    return next((P for P in results if P is not None), None)


def looks_definite(P: Matrix) -> bool:
    """Whether P is positive definite as far as floats tell, with its diagonal scaled to one: a cheap filter."""
    import numpy

    n = len(P)
    if any(P[i][i] <= 0 for i in range(n)):
        return False
    exponents = [(P[i][i].numerator.bit_length() - P[i][i].denominator.bit_length()) // 2 for i in range(n)]
    scaled = [[float(P[i][j] / Fraction(2) ** (exponents[i] + exponents[j])) for j in range(n)] for i in range(n)]
    return bool(numpy.linalg.eigvalsh(numpy.array(scaled))[0] > -1e-9)


def rounded(X: Exact, digits: int, scales: list[Fraction] | None = None) -> Exact:
    """X with so many digits of each entry, relative to its row and column; `scales` are known sizes of the states."""
    n = X.nrows()
    rows = exact.from_flint(X)
    size = [_power_of_ten(abs(rows[i][i])) for i in range(n)] if scales is None else [1 / (d * d) for d in scales]
    result = []
    for i in range(n):
        for j in range(n):
            unit = _root_of_ten(size[i] * size[j]) / Fraction(10) ** digits
            result.append(round(rows[i][j] / unit) * unit)
    return exact.to_flint([result[i * n : (i + 1) * n] for i in range(n)])


def _power_of_ten(x: Fraction) -> Fraction:
    if not x:
        return Fraction(1)
    bits = x.numerator.bit_length() - x.denominator.bit_length()
    return Fraction(10) ** round(bits * 0.30103)


def _root_of_ten(x: Fraction) -> Fraction:
    """A power of ten near the square root of x."""
    bits = x.numerator.bit_length() - x.denominator.bit_length()
    return Fraction(10) ** round(bits * 0.150515)


def to_float(a: Exact) -> Any:
    """As a numpy array; numbers out of the range of floats raise OverflowError."""
    import numpy

    flat = [float(x) for x in sum(exact.from_flint(a), ())]
    return numpy.array(flat).reshape(a.nrows(), a.ncols())


def balance(riccati: Riccati) -> list[Fraction]:
    """Powers of two d with x = diag(d) x' in which rows and columns of A, G and S have like sizes."""
    r = riccati.A.nrows()
    A, G, S = (abs(to_float(a)) for a in (riccati.A, riccati.G, riccati.S))
    exponents = [0] * r
    if riccati.N.nrows():
        weight = abs(to_float(riccati.N)).diagonal() ** 0.5
        G, S = G / weight[None, :], S / weight[:, None]
    for _ in range(30):
        moved = False
        for i in range(r):
            out = sum(A[j, i] * 2.0 ** (exponents[i] - exponents[j]) for j in range(r) if j != i)
            out += float(S[:, i].sum()) * 2.0 ** exponents[i]
            into = sum(A[i, j] * 2.0 ** (exponents[j] - exponents[i]) for j in range(r) if j != i)
            into += float(G[i, :].sum()) * 2.0 ** -exponents[i]
            if out > 0 and into > 0:
                step = round(math.log2(into / out) / 2)
                exponents[i] += step
                moved = moved or bool(step)
        if not moved:
            break
    return [Fraction(2) ** e for e in exponents]


def balanced_candidates(
    reduced: Reduced, bounds: Sequence[float], second_opinion: bool = False
) -> Iterator[tuple[Exact, list[Fraction]]]:
    """Points of a solver for [[N, -(G'X + S)], [., -(A'X + XA + Q)]] >= 0 and P > 0, with the scales of the states."""
    import numpy

    riccati = reduced.riccati
    try:
        d = balance(riccati)
        D = exact.diagonal(d)
        inverse = D.inv()
        A, G = to_float(inverse * riccati.A * D), to_float(inverse * riccati.G)
        S, Q, N = to_float(riccati.S * D), to_float(D * riccati.Q * D), to_float(riccati.N)
        floor = to_float(D * reduced.least() * D)
    except OverflowError:
        return
    r, w = len(A), len(N)
    if w:
        factor = numpy.linalg.inv(numpy.linalg.cholesky(N))
        G, S = G @ factor.T, factor @ S
    rate = max(numpy.abs(A).max(), (numpy.abs(G) ** 2).max() if w else 0.0, numpy.abs(S).max() if w else 0.0, 1e-300)
    A, G, S, Q = A / rate, G / rate**0.5, S / rate**0.5, Q / rate
    pairs, units = symmetric_units(r)
    dissipated = -(numpy.einsum("ji,kjl->kil", A, units) + numpy.einsum("kij,jl->kil", units, A))
    coefficients = numpy.zeros((len(pairs), w + r, w + r))
    coefficients[:, w:, w:] = dissipated
    constant = numpy.zeros((w + r, w + r))
    constant[:w, :w], constant[w:, w:] = numpy.eye(w), -Q
    if w:
        cross = -numpy.einsum("ia,kij->kaj", G, units)
        coefficients[:, :w, w:], coefficients[:, w:, :w] = cross, cross.transpose(0, 2, 1)
        constant[:w, w:], constant[w:, :w] = -S, -S.T
    blocks = [Block(constant, coefficients), Block(-floor, units)]
    for point in largest_margin(blocks, bounds, second_opinion):
        X = numpy.einsum("k,kij->ij", point[:-1], units)
        exact_X = exact.to_flint([[Fraction(float(x)) for x in row] for row in X])
        yield inverse * exact_X * inverse, d


def solve_family(family: Family, accept: Accept) -> Matrix | None:
    """A storage matrix of a family with equations between its unknowns, or None."""
    if family.point is None:
        return None
    if not family.free:
        P = exact.from_flint(family.point)
        return P if accept(P) else None
    for P in chain(_along_lossless_directions(family), _coordinates(family)):
        storage = exact.from_flint(P)
        if accept(storage):
            return storage
    return None


def _along_lossless_directions(family: Family) -> Iterator[Exact]:
    """Far along directions that are >= 0 and dissipate nothing, if there are any: M stays, P only grows."""

    def is_free(D: Exact) -> bool:
        return all(x == 0 for x in family.dissipation(D).entries()) and ldl_pivots(exact.from_flint(D))[1]

    free = [D * sign for D in family.directions for sign in (1, -1) if is_free(D * sign)]
    for exponent in range(-3, 16, 3) if free else ():
        P = family.point
        for D in free:
            P = P + D * exact.rational(Fraction(10) ** exponent)
        yield P


def _coordinates(family: Family) -> Iterator[Exact]:
    """Points of a solver in the coordinates of the family, M cut to where it is not forced to vanish."""
    import numpy

    directions = family.directions
    parts = [family.point, *directions]
    try:
        storages = [to_float(P) for P in parts]
        losses = [to_float(family.dissipation(P)) for P in parts]
        F = to_float(family.F)
    except OverflowError:
        return
    size = numpy.array([max((abs(P[i, i]) for P in storages if P[i, i]), default=1.0) for i in range(family.n)])
    d = 1 / numpy.sqrt(size)
    rate = max(1e-300, float(numpy.abs(F / d[:, None] * d).max()))
    storages = [P * d[:, None] * d for P in storages]
    losses = [M * d[:, None] * d / rate for M in losses]
    _, values, rows = numpy.linalg.svd(numpy.vstack(losses))
    keep = rows[: int((values > 1e-9 * max(values.max(), 1e-300)).sum())]
    losses = [keep @ M @ keep.T for M in losses]
    unit = [
        max(float(numpy.abs(P).max()), float(numpy.abs(M).max()) if len(keep) else 0.0, 1e-300)
        for P, M in zip(storages[1:], losses[1:], strict=True)
    ]
    blocks = [
        Block(values[0], numpy.array([a / u for a, u in zip(values[1:], unit, strict=True)]))
        for values in ([storages, losses] if len(keep) else [storages])
    ]
    for point in chain(largest_margin(blocks), largest_margin(blocks, BOUNDS[1:2], second_opinion=True)):
        for digits in ROUNDINGS:
            P = family.point
            for value, u, direction in zip(point[:-1], unit, directions, strict=True):
                P = P + direction * exact.rational(round_float(float(value) / u, digits))
            yield P


def round_float(x: float, digits: int) -> Fraction:
    """A float to a rational of so many significant digits: the one place where precision is lost.

    >>> round_float(0.123456, 2)
    Fraction(3, 25)
    """
    return Fraction(f"{x:.{digits - 1}e}")
