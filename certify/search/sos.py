"""Sums of squares on an interval: p = sigma0 + (1 - x^2) sigma1 with exact Gram matrices (rule `monotone-sos`).

Zeros of p on the interval leave Gram matrices no interior, so they are divided out first: p = s^2 (1 + x)^i (1 - x)^j q
with q > 0. The identity for q is solved for one entry in each antidiagonal, which makes it hold exactly for
any choice of the other entries; Clarabel chooses those, and rounding them costs nothing but margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from certify.kernel import poly
from certify.kernel.linalg import Matrix, ldl_pivots
from certify.kernel.poly import Polynomial, to_polynomial

Grams = tuple[Matrix, Matrix]
ONE, PLUS, MINUS = (to_polynomial(c) for c in ([1], [1, 1], [1, -1]))


def find_gram_matrices(p: Polynomial) -> Grams | None:
    """Gram matrices of sigma0 and sigma1 in 1, x, x^2, ...; None if none are found, as for a p that is negative."""
    if not p:
        return ((Fraction(0),),), ()
    square, ends, q = _split(p)
    inner = _find_interior(q)
    if inner is None:
        return None
    first, second = inner
    if ends == (1, 1):  # (1 - x^2) q: the two sums change places
        first, second = _product(second, poly.multiply(PLUS, MINUS)), first
    elif 1 in ends:  # with e = 1 + x or 1 - x: 2 e = e^2 + (1 - x^2)
        e = PLUS if ends[0] else MINUS
        first, second = (
            _sum(_product(first, e), _product(second, poly.multiply(PLUS, MINUS))),
            _sum(first, _product(second, e)),
        )
        first, second = (tuple(tuple(x / 2 for x in row) for row in gram) for gram in (first, second))
    return _product(first, square), _product(second, square)


def _split(p: Polynomial) -> tuple[Polynomial, tuple[int, int], Polynomial]:
    """s, (i, j) and q with p = s^2 (1 + x)^i (1 - x)^j q; q has no repeated root, and none at the ends."""
    q = poly.odd_part(p)  # every factor of odd multiplicity, once
    square_of, _ = poly.divide(p, q)  # a square, up to a constant
    square = ONE
    while len(square_of) > 1:  # its factors, each with half its multiplicity
        radical = poly.divide(square_of, poly.greatest_common_divisor(square_of, poly.derivative(square_of)))[0]
        square_of = poly.divide(square_of, poly.multiply(radical, radical))[0]
        square = poly.multiply(square, radical)
    q = poly.divide(p, poly.multiply(square, square))[0]
    ends = []
    for end in (PLUS, MINUS):
        quotient, rest = poly.divide(q, end)
        ends.append(0 if rest else 1)
        q = q if rest else quotient
    return square, (ends[0], ends[1]), q


def _find_interior(q: Polynomial) -> Grams | None:
    """Positive definite Gram matrices for a q that is positive on [-1, 1]."""
    size = len(q) // 2 + 1
    if size == 1:
        return (((q[0],),), ()) if q[0] > 0 else None
    import numpy

    from certify.search.solvers import Block, largest_margin

    unit = max(abs(c) for c in q)
    target = [c / unit for c in q] + [Fraction(0)] * (2 * size - 1 - len(q))
    second_entries = [(i, j) for i in range(size - 1) for j in range(i, size - 1)]
    free = [(i, j) for i in range(size) for j in range(i, size) if j - i > 1]  # the others are solved for

    def grams(values: Sequence[Fraction]) -> Grams:
        second = _symmetric(size - 1, dict(zip(second_entries, values, strict=False)))
        given = dict(zip(free, values[len(second_entries) :], strict=True))
        for k in range(2 * size - 1):
            rest = target[k] - sum(second[i][k - i] for i in range(size - 1) if 0 <= k - i < size - 1)
            rest += sum(second[i][k - 2 - i] for i in range(size - 1) if 0 <= k - 2 - i < size - 1)
            rest -= 2 * sum(value for (i, j), value in given.items() if i + j == k)
            given_pair = (k // 2, k - k // 2)
            solved = rest if k % 2 == 0 else rest / 2
            given = given | {given_pair: solved}
        return _symmetric(size, given), second

    count = len(second_entries) + len(free)
    zero = grams([Fraction(0)] * count)
    units = [grams([Fraction(int(k == n)) for k in range(count)]) for n in range(count)]
    blocks = []
    for part in (0, 1):
        constant = numpy.array([[float(x) for x in row] for row in zero[part]])
        slopes = numpy.array([[[float(x) for x in row] for row in unit_[part]] for unit_ in units]) - constant
        blocks.append(Block(constant, slopes))
    for point in largest_margin(blocks):
        for digits in (2, 4, 8, 12):
            step = Fraction(1, 10**digits)
            values = [round(Fraction(float(x)) / step) * step for x in point[:-1]]
            found = grams(values)
            if all(min(ldl_pivots(gram)[0]) > 0 and ldl_pivots(gram)[1] for gram in found):
                first, second = (tuple(tuple(x * unit for x in row) for row in gram) for gram in found)
                return first, second
    return None


def _symmetric(n: int, entries: dict[tuple[int, int], Fraction]) -> Matrix:
    return tuple(tuple(entries.get((min(i, j), max(i, j)), Fraction(0)) for j in range(n)) for i in range(n))


def _product(gram: Matrix, factor: Polynomial) -> Matrix:
    """The Gram matrix of factor^2 times a sum of squares: row k of the map takes x^k to factor x^k."""
    if not gram:
        return gram
    shift = [[Fraction(0)] * k + list(factor) + [Fraction(0)] * (len(gram) - 1 - k) for k in range(len(gram))]
    n = len(shift[0])
    rows = [[sum(g * shift[k][j] for k, g in enumerate(row)) for j in range(n)] for row in gram]
    return tuple(
        tuple(sum((shift[k][i] * rows[k][j] for k in range(len(gram))), Fraction(0)) for j in range(n))
        for i in range(n)
    )


def _sum(a: Matrix, b: Matrix) -> Matrix:
    n = max(len(a), len(b))

    def entry(gram: Matrix, i: int, j: int) -> Fraction:
        return gram[i][j] if i < len(gram) and j < len(gram) else Fraction(0)

    return tuple(tuple(entry(a, i, j) + entry(b, i, j) for j in range(n)) for i in range(n))
