"""Loads given by rational functions of (Vd, Vq), on a disk |V - centre| <= radius: what proves or refutes monotonicity.

The theorems are in FORMAT.md. In the disk x = (Vd - centre_d)/radius and y alike, so that it is x^2 + y^2 <= 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import isqrt, lcm

from certify.kernel import linalg as la
from certify.kernel.currents import (
    UNIT,
    Bivariate,
    CurrentLaw,
    add,
    derivative,
    evaluate,
    multiply,
    recentred,
    total_degree,
)
from certify.kernel.errors import require
from certify.kernel.linalg import Matrix
from certify.kernel.powers import radical_inverse
from certify.kernel.reader import Pair

MAX_SUM_DEGREE = 6  # of the monomials in a sum of squares
MAX_GRAM_WORK = 1 << 14  # size of a Gram matrix times bits of its common denominator


@dataclass(frozen=True)
class DiskSum:
    """sigma0 + (1 - x^2 - y^2) sigma1, both sums of squares by their Gram matrices.

    `gram` is over the monomials up to `degree`, `disk` over those up to `degree` - 1 (none for 0), in the order of
    `monomials`, each times the components w1, w2 if it is a form in w.
    """

    degree: int
    gram: Matrix
    disk: Matrix


def monomials(degree: int) -> list[tuple[int, int]]:
    """1, x, y, x^2, x y, y^2, .. as exponents, up to a total degree.

    >>> monomials(1)
    [(0, 0), (1, 0), (0, 1)]
    """
    return [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]


Form = dict[tuple[int, int, int, int], Fraction]  # of x^i y^j w_a w_b with a <= b; w = 1 for a polynomial


def sum_of_squares(form: Form, components: int, proof: DiskSum) -> bool:
    """The form is nonnegative on the unit disk for every w: proof by an identity. True if `gram` is definite."""
    require(0 <= proof.degree <= MAX_SUM_DEGREE, f"the degree of a sum of squares is not from 0 to {MAX_SUM_DEGREE}")
    total: Form = {}
    definite = False
    one_minus_square = (((0, 0), 1), ((2, 0), -1), ((0, 2), -1))
    for gram, degree, weight in ((proof.disk, proof.degree - 1, one_minus_square), (proof.gram, proof.degree, UNIT)):
        basis = [(i, j, a) for i, j in monomials(degree) for a in range(components)]
        require(
            len(gram) == len(basis) and la.is_symmetric(gram), f"a Gram matrix is not symmetric of size {len(basis)}"
        )
        for row, (i, j, a) in zip(gram, basis, strict=True):
            for x, (k, m, b) in zip(row, basis, strict=True):
                for (s, t), sign in weight if x else ():
                    key = (i + k + s, j + m + t, min(a, b), max(a, b))
                    total[key] = total.get(key, la.ZERO) + sign * x
    # the identity first, because it is cheap
    require({key: x for key, x in total.items() if x} == form, "the sum of squares is not the form it should be")
    for gram in (proof.disk, proof.gram):
        common = lcm(*(x.denominator for row in gram for x in row))
        require(len(gram) * common.bit_length() <= MAX_GRAM_WORK, "a Gram matrix has too many digits for its size")
        pivots, semidefinite = la.ldl_pivots(gram)
        require(semidefinite, "a Gram matrix is not positive semidefinite")
        definite = all(pivots)
    return definite


def jacobian_numerators(q: Bivariate, numerators: tuple[Bivariate, Bivariate]) -> list[list[Bivariate]]:
    """q^2 times the Jacobian of numerators / q, in the variables of these polynomials."""
    return [[add(multiply(q, derivative(p, k)), multiply(p, derivative(q, k)), -1) for k in (0, 1)] for p in numerators]


def jacobian_form(law: CurrentLaw, centre: Pair, radius: Fraction, modulus: Fraction = la.ZERO) -> Form:
    """radius q^2 w'(J - modulus) w in the coordinates of the disk, J the Jacobian in siemens."""
    q, *parts = (recentred(p, centre, radius) for p in (law.denominator, *law.numerators))
    J = jacobian_numerators(q, (parts[0], parts[1]))
    square = multiply(q, q)
    entries = {(a, a): add(J[a][a], square, -modulus * radius) for a in (0, 1)} | {(0, 1): add(J[0][1], J[1][0])}
    return {(i, j, a, b): x for (a, b), p in entries.items() for (i, j), x in p}


def denominator_form(law: CurrentLaw, centre: Pair, radius: Fraction, margin: Fraction) -> Form:
    """|q| - margin in the coordinates of the disk, with the sign that q has at the centre."""
    q = recentred(law.denominator, centre, radius)
    value = evaluate(law.denominator, centre)
    shifted = add(add((), q, 1 if value > 0 else -1), UNIT, -margin)
    return {(i, j, 0, 0): x for (i, j), x in shifted}


def monotone_disk(
    law: CurrentLaw,
    centre: Pair,
    radius: Fraction,
    form: DiskSum,
    denominator: tuple[Fraction, DiskSum] | None = None,
    modulus: Fraction = la.ZERO,
) -> bool:
    """Rule `monotone-disk`: <V - U, I(V) - I(U)> >= modulus |V - U|^2 on the disk. True if > 0 for U != V is proved.

    `denominator`: a margin and the proof that |q| is at least that; None if it is constant. Units: volt, siemens.
    """
    require(radius > 0, "the radius of the disk is not positive")
    require(modulus >= 0, "the modulus is negative")
    if denominator is None:
        require(total_degree(law.denominator) == 0, "the denominator is not constant and not proved positive")
    else:
        margin, proof = denominator
        require(margin > 0, "the margin of the denominator is not positive")
        sum_of_squares(denominator_form(law, centre, radius, margin), 1, proof)
    definite = sum_of_squares(jacobian_form(law, centre, radius, modulus), 2, form)
    return definite or modulus > 0


def current_pair(law: CurrentLaw, centre: Pair, radius: Fraction, U: Pair, V: Pair) -> Fraction:
    """Rule `current-pair`: two voltages of the disk with <V - U, I(V) - I(U)> < 0. Returns that number, in watt."""
    require(radius > 0, "the radius of the disk is not positive")
    for point in (U, V):
        distance = sum((x - c) ** 2 for x, c in zip(point, centre, strict=True))
        require(distance <= radius**2, "a voltage is outside the disk")
    ends = zip(U, V, law.current(U), law.current(V), strict=True)
    product = sum(((v - u) * (i_v - i_u) for u, v, i_u, i_v in ends), la.ZERO)
    require(product < 0, "the product of the two voltages is not negative")
    return product


def sampled_disk(law: CurrentLaw, centre: Pair, radius: Fraction, count: int) -> None:
    """Rule `sampled` on a disk: no violation at points of the Halton sequence in the bases 2 and 3. Proves nothing."""
    form = jacobian_form(law, centre, radius)
    q = recentred(law.denominator, centre, radius)
    for k in range(count):
        x, y = (2 * radical_inverse(k, base) - 1 for base in (2, 3))
        if x * x + y * y > 1 or not evaluate(q, (x, y)):
            continue
        M = dict.fromkeys(((0, 0), (0, 1), (1, 1)), la.ZERO)
        for (i, j, a, b), c in form.items():
            M[a, b] += c * x**i * y**j
        fine = min(M[0, 0], M[1, 1], 4 * M[0, 0] * M[1, 1] - M[0, 1] ** 2) >= 0
        require(fine, "a sample shows that the load is not monotone")


def lipschitz_bound_disk(law: CurrentLaw, centre: Pair, radius: Fraction, margin: Fraction = la.ZERO) -> Fraction:
    """A Lambda in siemens with |I(V) - I(U)| <= Lambda |V - U| on the disk, where |q| >= margin is known, if anything.

    On each cell of a grid, polynomials in coordinates from -1 to 1 are bounded by their coefficients.
    """
    require(radius > 0 and margin >= 0, "the radius is not positive or the margin is negative")
    cells = min(8, max(2, 12 - sum(max(map(total_degree, part)) for part in (law.numerators, [law.denominator]))))
    size, worst = radius / cells, la.ZERO  # half the width of a cell: the larger the degrees, the fewer there are
    steps = range(1 - cells, cells, 2)
    for a, b in ((a, b) for a in steps for b in steps):
        if max(abs(a) - 1, 0) ** 2 + max(abs(b) - 1, 0) ** 2 > cells**2:
            continue  # all of it is outside the disk
        middle = (centre[0] + a * size, centre[1] + b * size)
        q, *parts = (recentred(p, middle, size) for p in (law.denominator, *law.numerators))
        J = [dict(p) for row in jacobian_numerators(q, (parts[0], parts[1])) for p in row]
        keys = {key for p in J for key in p}
        top = sum((_norm_above(*(p.get(key, la.ZERO) for p in J)) for key in keys), la.ZERO)
        spread = sum(abs(c) for key, c in q if key != (0, 0))
        least = max(margin, abs(dict(q).get((0, 0), la.ZERO)) - spread)
        require(least > 0, "the denominator may vanish")
        worst = max(worst, top / (size * least**2))
    return worst


def _norm_above(a: Fraction, b: Fraction, c: Fraction, d: Fraction) -> Fraction:
    """At least the largest singular value of [[a, b], [c, d]]: its parts that commute and anticommute with j."""
    return (_root_above((a + d) ** 2 + (c - b) ** 2) + _root_above((a - d) ** 2 + (b + c) ** 2)) / 2


def _root_above(x: Fraction) -> Fraction:
    """A dyadic number at least the square root of x >= 0, to about 32 bits."""
    shift = 32 - (x.numerator.bit_length() - x.denominator.bit_length()) // 2
    return Fraction(isqrt((x * Fraction(4) ** shift).__floor__()) + 1) / Fraction(2) ** shift if x else x
