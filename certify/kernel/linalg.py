"""Exact linear algebra over the rationals: products, elimination, LDL', rank, linear solves.

A matrix is a tuple of row tuples of `Fraction`. Everything here is exact; nothing rounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import lcm

Vector = tuple[Fraction, ...]
Matrix = tuple[Vector, ...]

ZERO, ONE = Fraction(0), Fraction(1)


def to_matrix(rows: Iterable[Iterable[int | Fraction | str]]) -> Matrix:
    """Rows of integers, rationals or strings such as "1/3" to an exact matrix.

    >>> to_matrix([[1, "1/2"]])
    ((Fraction(1, 1), Fraction(1, 2)),)
    """
    return tuple(tuple(Fraction(x) for x in row) for row in rows)


def zeros(rows: int, columns: int) -> Matrix:
    return ((ZERO,) * columns,) * rows


def identity(n: int) -> Matrix:
    return tuple(tuple(ONE if i == j else ZERO for j in range(n)) for i in range(n))


def transpose(a: Matrix) -> Matrix:
    return tuple(zip(*a, strict=True))


def add(a: Matrix, b: Matrix) -> Matrix:
    return tuple(tuple(x + y for x, y in zip(r, s, strict=True)) for r, s in zip(a, b, strict=True))


def scale(factor: Fraction | int, a: Matrix) -> Matrix:
    return tuple(tuple(factor * x for x in row) for row in a)


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product; skips zero entries, which most of ours are."""
    if a and len(a[0]) != len(b):
        raise ValueError("shapes disagree")
    width = len(b[0])
    sparse = [[(j, y) for j, y in enumerate(row) if y] for row in b]
    result = []
    for row in a:
        out = [ZERO] * width
        for x, terms in zip(row, sparse, strict=True):
            if x:
                for j, y in terms:
                    out[j] += x * y
        result.append(tuple(out))
    return tuple(result)


def apply(a: Matrix, x: Sequence[Fraction]) -> Vector:
    return tuple(sum((p * q for p, q in zip(row, x, strict=True) if p and q), ZERO) for row in a)


def block(rows: Sequence[Sequence[Matrix]]) -> Matrix:
    """One matrix out of a grid of blocks."""
    return tuple(tuple(x for part in parts for x in part) for line in rows for parts in zip(*line, strict=True))


def is_symmetric(a: Matrix) -> bool:
    n = len(a)
    return all(len(row) == n for row in a) and all(a[i][j] == a[j][i] for i in range(n) for j in range(i))


def ldl_pivots(a: Matrix) -> tuple[Vector, bool]:
    """The pivots of A = L D L', and whether A is positive semidefinite.

    Elimination without pivoting is complete for semidefiniteness: a zero pivot forces its whole remaining
    row to vanish, a negative one refutes. On a refutation the pivots found so far are returned.

    >>> ldl_pivots(to_matrix([[1, 1], [1, 1]]))
    ((Fraction(1, 1), Fraction(0, 1)), True)
    >>> ldl_pivots(to_matrix([[0, 1], [1, 5]]))[1]
    False
    """
    if not is_symmetric(a):
        raise ValueError("the matrix is not symmetric")
    rows, n, pivots = [list(row) for row in a], len(a), []
    for k in range(n):
        pivot = rows[k][k]
        pivots.append(pivot)
        if pivot < 0 or (pivot == 0 and any(rows[k][k + 1 :])):
            return tuple(pivots), False
        if pivot == 0:
            continue
        for i in range(k + 1, n):
            if rows[i][k]:
                factor = rows[i][k] / pivot
                for j in range(i, n):
                    if rows[k][j]:
                        rows[i][j] -= factor * rows[k][j]
                        rows[j][i] = rows[i][j]
    return tuple(pivots), True


def row_reduce(a: Iterable[Sequence[Fraction]], columns: int) -> tuple[list[list[Fraction]], list[int]]:
    """Reduced row echelon form of A, its zero rows dropped, pivots sought in the first `columns` columns."""
    rows = [list(row) for row in a]
    pivots: list[int] = []
    for column in range(columns):
        top = len(pivots)
        found = next((i for i in range(top, len(rows)) if rows[i][column]), None)
        if found is None:
            continue
        rows[top], rows[found] = rows[found], rows[top]
        lead = rows[top][column]
        rows[top] = [x / lead if x else x for x in rows[top]]
        terms = [(j, x) for j, x in enumerate(rows[top]) if x]
        for i, row in enumerate(rows):
            if i != top and row[column]:
                factor = row[column]
                for j, x in terms:
                    row[j] -= factor * x
        pivots.append(column)
    return [row for row in rows if any(row)], pivots


def rank(a: Iterable[Sequence[Fraction]], columns: int) -> int:
    return len(row_reduce(a, columns)[1])


def solve(a: Matrix, b: Matrix) -> Matrix:
    """The X with A X = B for a square nonsingular A.

    Fraction-free elimination (Bareiss): all divisions of integers below are exact, and no common divisors are sought.
    Raises: ZeroDivisionError if A is singular.

    >>> solve(to_matrix([[2, 1], [1, 3]]), to_matrix([[1], ["1/2"]]))
    ((Fraction(1, 2),), (Fraction(0, 1),))
    """
    n, rows = len(a), []
    for left, right in zip(a, b, strict=True):
        common = lcm(*(x.denominator for x in left + right))
        rows.append([x.numerator * (common // x.denominator) for x in left + right])
    width, before = len(rows[0]), 1
    for k in range(n):
        found = next((i for i in range(k, n) if rows[i][k]), None)
        if found is None:
            raise ZeroDivisionError("the matrix is singular")
        rows[k], rows[found] = rows[found], rows[k]
        top, pivot = rows[k], rows[k][k]
        for i in range(k + 1, n):
            factor = rows[i][k]
            rows[i][k + 1 :] = [(pivot * rows[i][j] - factor * top[j]) // before for j in range(k + 1, width)]
        before = pivot
    scaled: list[list[int]] = [[]] * n  # the last pivot times X, which is integer by Cramer's rule
    for i in reversed(range(n)):
        rest = [sum(rows[i][j] * scaled[j][c] for j in range(i + 1, n)) for c in range(width - n)]
        scaled[i] = [(before * x - y) // rows[i][i] for x, y in zip(rows[i][n:], rest, strict=True)]
    return tuple(tuple(Fraction(x, before) for x in row) for row in scaled)


def null_space(a: Iterable[Sequence[Fraction]], columns: int) -> tuple[Vector, ...]:
    """A basis of {x : A x = 0}.

    >>> null_space(to_matrix([[1, 2]]), 2)
    ((Fraction(-2, 1), Fraction(1, 1)),)
    """
    rows, pivots = row_reduce(a, columns)
    basis = []
    for free in (j for j in range(columns) if j not in set(pivots)):
        x = [ZERO] * columns
        x[free] = ONE
        for row, pivot in zip(rows, pivots, strict=True):
            x[pivot] = -row[free]
        basis.append(tuple(x))
    return tuple(basis)
