"""Frequency witnesses: a point of the right half-plane where a port takes power out of nothing (THEORY 4).

Candidates come from a coarse sweep in floats, from the poles of the closed loop, and from the Hamiltonian matrix of
a level: the imaginary eigenvalues of H(eps) are the frequencies at which an eigenvalue of Z + Z* crosses -2 eps, so
between them the response is below the level everywhere or nowhere. All of it only proposes; the kernel disposes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any

from certify.kernel.model import LinearPort
from certify.search import exact
from certify.search.exact import Exact, to_fraction
from certify.search.roots import round_to_digits, square_root
from certify.search.spectral import Riccati, even_part, negative_roots

Complex = tuple[Fraction, Fraction]
LEVELS = (3, 8, 16, 40, 80, 160)  # minus the decimal exponents of the levels, relative to the size of the response
APPROACHES = (1, 2, 3, 4, 6, 8, 12, 20, 40, 80, 160)  # decimal digits by which s0 comes near the imaginary axis


@dataclass(frozen=True)
class Witness:
    """Data of the kernel's rule `frequency-witness`, and the power Re(u* Z(s0) u) in ohm."""

    s0: Complex
    u: tuple[Complex, ...]
    power: Fraction


@dataclass(frozen=True)
class Response:
    """A port, and its exact transfer function at rational points."""

    port: LinearPort
    F: Exact
    B: Exact
    C: Exact

    @staticmethod
    def of(port: LinearPort) -> Response:
        return Response(port, exact.to_flint(port.F), exact.to_flint(port.B), exact.to_flint(port.C))

    @cached_property
    def poles(self) -> list[Complex]:
        """Real and imaginary parts of the eigenvalues of F, as rationals of many digits."""
        return [(_middle(root.real), _middle(root.imag)) for root, _ in self.F.charpoly().numer().complex_roots()]

    def is_stable(self) -> bool:
        return all(x < 0 for x, _ in self.poles)

    def hermitian(self, s0: Complex) -> tuple[Fraction, ...] | None:
        """(a,) or (a, c, re b, im b) of (Z + Z*)/2 = [[a, b], [conj b, c]] at s0; None at an eigenvalue of F."""
        n, m = self.F.nrows(), self.C.nrows()
        sigma, omega = (exact.rational(x) for x in s0)
        one = exact.identity(n)
        inner, turn = one * sigma - self.F, one * omega
        try:
            x = exact.block([[inner, -turn], [turn, inner]]).solve(exact.block([[self.B], [self.B * 0]]))
        except ZeroDivisionError:
            return None
        rows = x.tolist()
        re, im = (self.C * exact.of_rows(part, m) for part in (rows[:n], rows[n:]))
        if m == 1:
            return (to_fraction(re[0, 0]),)
        if m != 2:
            raise ValueError("a port has one or two channels")
        entries = (re[0, 0], re[1, 1], (re[0, 1] + re[1, 0]) / 2, (im[0, 1] - im[1, 0]) / 2)
        return tuple(to_fraction(x) for x in entries)

    def witness_at(self, s0: Complex) -> Witness | None:
        """A direction u in which the port gives power away at s0, with few digits if possible."""
        if s0[0] <= 0:
            return None
        form = self.hermitian(s0)
        if form is None or is_semidefinite(form):
            return None
        for u in _directions(form):
            power = power_of(form, u)
            if power < 0:
                return Witness(s0, u, power)
        return None


def is_semidefinite(form: tuple[Fraction, ...]) -> bool:
    if len(form) == 1:
        return form[0] >= 0
    a, c, x, y = form
    return a >= 0 and c >= 0 and a * c >= x * x + y * y


def power_of(form: tuple[Fraction, ...], u: tuple[Complex, ...]) -> Fraction:
    """u* (Z + Z*)/2 u."""
    if len(form) == 1:
        return form[0] * (u[0][0] ** 2 + u[0][1] ** 2)
    a, c, x, y = form
    (p, q), (r, t) = u
    # conj(u0) b u1: real part of (p - jq)(x + jy)(r + jt)
    real, imaginary = p * x + q * y, p * y - q * x
    return a * (p * p + q * q) + c * (r * r + t * t) + 2 * (real * r - imaginary * t)


def _directions(form: tuple[Fraction, ...]) -> Iterator[tuple[Complex, ...]]:
    one, zero = (Fraction(1), Fraction(0)), (Fraction(0), Fraction(0))
    if len(form) == 1:
        yield (one,)
        return
    yield (one, zero)
    yield (zero, one)
    a, c, x, y = form
    if a > 0 or c > 0:
        best = (-x / c, y / c) if c > 0 else (-x / a, -y / a)
        for digits in (1, 2, 4, 8, 16, 40, 90):
            rounded = (round_to_digits(best[0], digits), round_to_digits(best[1], digits))
            yield (one, rounded) if c > 0 else (rounded, one)
        yield (one, best) if c > 0 else (best, one)
    else:
        yield from ((one, (p, q)) for p in (Fraction(1), Fraction(-1)) for q in (Fraction(1), Fraction(-1)))


def find_coarse_witness(response: Response) -> Witness | None:
    """A witness with small numbers from a sweep in floats: cheap, and enough for most ports that are not passive."""
    for omega in worst_frequencies(response.port)[:3]:
        rounded = round_to_digits(Fraction(omega), 1)
        for k in (0, 1, 2, 4):
            found = response.witness_at((rounded / 10**k, rounded))
            if found:
                return found
    return None


def find_witness(response: Response) -> Witness | None:
    """A witness that the kernel accepts, or None if none is found."""
    for s0 in _candidates(response):
        found = response.witness_at(s0)
        if found:
            return found
    return None


def worst_frequencies(port: LinearPort) -> list[float]:
    """Frequencies in rad/s where (Z + Z*)/2 is negative as far as floats tell, the worst first, by eigenvalues of F."""
    import numpy

    try:
        F, B, C = (numpy.array([[float(x) for x in row] for row in a]) for a in (port.F, port.B, port.C))
        with numpy.errstate(all="ignore"):
            poles, V = numpy.linalg.eig(F)
            left, right = C @ V, numpy.linalg.solve(V, B.astype(complex))
            sizes = [abs(p) for p in poles if p]
            low, high = min(sizes, default=1.0) / 1e3, max(sizes, default=1.0) * 1e3
            grid = numpy.geomspace(max(low, 1e-12), min(high, 1e15), 120)
            grid = numpy.unique(numpy.concatenate([grid, [s for s in sizes if low < s < high]]))
            Z = numpy.einsum("ik,wk,kj->wij", left, 1 / (1j * grid[:, None] - poles[None, :]), right)
            least = numpy.linalg.eigvalsh(Z + Z.conj().transpose(0, 2, 1))[:, 0]
            size = numpy.abs(Z).sum(axis=(1, 2))
    except (OverflowError, numpy.linalg.LinAlgError):
        return []
    ratio = least / numpy.maximum(size, 1e-300)
    order = numpy.argsort(ratio)
    return [float(grid[k]) for k in order if numpy.isfinite(ratio[k]) and ratio[k] < -1e-9]


def _candidates(response: Response) -> Iterator[Complex]:
    if not response.is_stable():  # else the levels tell all
        yield from _around_poles(response)
    for omega in _below_levels(response):
        size = omega or Fraction(1)
        for k in APPROACHES:
            yield size / 10**k, omega


def _middle(x: Any) -> Fraction:
    mantissa, exponent = x.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


# Directions from a pole, as (cos, sin).
_COMPASS = tuple(
    (Fraction(c), Fraction(s)) for c, s in ((1, 0), (0, 1), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
)


def _around_poles(response: Response) -> Iterator[Complex]:
    """Points around each pole that is not well inside the left half-plane: there Z turns to any direction."""
    poles = [(x, y) for x, y in response.poles if y >= 0]
    for k in (1, 2, 4, 8, 16, 40):
        for x, y in poles:
            size = max(abs(x), abs(y)) or Fraction(1)
            if x < -size / 10**k:
                continue
            for c, s in _COMPASS:
                point = (x + c * size / 10**k, y + s * size / 10**k)
                yield round_to_digits(point[0], k + 1), round_to_digits(point[1], k + 1)


def level_riccati(response: Response, level: Fraction) -> Riccati:
    """The inequality [[M, C' - P B], [., 2 eps I]] >= 0, eps being the level in ohm."""
    N = exact.identity(response.C.nrows()) * exact.rational(2 * level)
    return Riccati(response.F, response.B, N, -response.C, response.F * 0)


def crossings(H: Exact) -> list[Fraction]:
    """The frequencies omega > 0 of imaginary eigenvalues of H, in order, as rationals of many digits."""
    found = sorted(
        square_root(abs(_middle(x)), 30) for x, _ in negative_roots(even_part(H)) if not x.contains(0) and x < 0
    )
    return [x for x in found if x]


def between(frequencies: list[Fraction]) -> Iterator[Fraction]:
    """A frequency below the first, one in each gap, one above the last; with few digits where there is room."""
    if not frequencies:
        yield Fraction(1)
        return
    yield Fraction(0)
    ends = [frequencies[0] / 10**6, *frequencies, frequencies[-1] * 10]
    for low, high in pairwise(ends):
        middle = square_root(low * high, 20) if high > 2 * low else (low + high) / 2
        for digits in (1, 3, 6, 12, 25, 60):
            rounded = round_to_digits(middle, digits)
            if low < rounded < high:
                yield rounded
                break


def _below_levels(response: Response) -> Iterator[Fraction]:
    size = typical_size(response)
    for exponent in LEVELS:
        riccati = level_riccati(response, size / Fraction(10) ** exponent)
        yield from between(crossings(riccati.hamiltonian()))


def typical_size(response: Response) -> Fraction:
    """A power of ten near the largest |Z| at some frequencies, in ohm."""
    largest = Fraction(0)
    for k in range(-2, 7, 2):
        form = response.hermitian((Fraction(10) ** k, Fraction(10) ** k))
        if form:
            largest = max(largest, *(abs(x) for x in form))
    if not largest:
        return Fraction(1)
    bits = largest.numerator.bit_length() - largest.denominator.bit_length()
    return Fraction(10) ** math.ceil(bits * 0.30103)
