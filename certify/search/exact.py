"""Exact matrices in FLINT for the search: the same numbers as the kernel's, much faster. Nothing here is trusted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

from flint import fmpq, fmpq_mat

from certify.kernel.linalg import Matrix, Vector

Exact = Any  # a flint.fmpq_mat


def to_flint(a: Sequence[Sequence[Fraction]], columns: int | None = None) -> Exact:
    """A matrix of rationals; `columns` gives the width of one without rows."""
    width = len(a[0]) if a else columns or 0
    return fmpq_mat(len(a), width, [fmpq(x.numerator, x.denominator) for row in a for x in row])


def from_flint(a: Exact) -> Matrix:
    """
    >>> from_flint(to_flint(((Fraction(1, 3), Fraction(2)),)))
    ((Fraction(1, 3), Fraction(2, 1)),)
    """
    width = a.ncols()
    flat = [Fraction(int(x.p), int(x.q)) for x in a.entries()]
    return tuple(tuple(flat[i * width : (i + 1) * width]) for i in range(a.nrows()))


def of_rows(rows: Sequence[Sequence[Any]], width: int) -> Exact:
    """A matrix from rows of exact numbers."""
    return fmpq_mat(len(rows), width, [x for row in rows for x in row])


def rational(x: Fraction) -> Any:
    """A number in FLINT."""
    return fmpq(x.numerator, x.denominator)


def to_fraction(x: Any) -> Fraction:
    return Fraction(int(x.p), int(x.q))


def identity(n: int) -> Exact:
    return fmpq_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def diagonal(values: Sequence[Fraction]) -> Exact:
    n = len(values)
    zero = Fraction(0)
    return to_flint([[values[i] if i == j else zero for j in range(n)] for i in range(n)])


def block(rows: Sequence[Sequence[Exact]]) -> Exact:
    """One matrix out of a grid of blocks."""
    height, width = sum(line[0].nrows() for line in rows), sum(a.ncols() for a in rows[0])
    entries: list[Any] = []
    for line in rows:
        lists = [a.tolist() if a.ncols() else [[]] * a.nrows() for a in line]
        entries += [x for parts in zip(*lists, strict=True) for row in parts for x in row]
    return fmpq_mat(height, width, entries)


def columns(a: Exact, chosen: Iterable[int]) -> Exact:
    """The matrix of some columns."""
    picked, rows = list(chosen), a.tolist() if a.ncols() else [[]] * a.nrows()
    return fmpq_mat(a.nrows(), len(picked), [row[j] for row in rows for j in picked])


def null_space(a: Exact) -> Exact:
    """Columns that span {x : a x = 0}."""
    n = a.ncols()
    reduced, rank = a.rref()
    rows = reduced.tolist() if n else []
    pivots = [next(j for j in range(n) if rows[i][j] != 0) for i in range(rank)]
    free = [j for j in range(n) if j not in set(pivots)]
    result = [[fmpq(0)] * len(free) for _ in range(n)]
    for k, j in enumerate(free):
        result[j][k] = fmpq(1)
        for i, pivot in enumerate(pivots):
            result[pivot][k] = -rows[i][j]
    return fmpq_mat(n, len(free), [x for row in result for x in row])


def complement(a: Exact) -> Exact:
    """Unit vectors (as columns) that complete the columns of `a`, which are independent, to a basis."""
    n, k = a.nrows(), a.ncols()
    reduced, rank = block([[a, identity(n)]]).rref()
    rows = reduced.tolist()
    pivots = [next(j for j in range(k + n) if rows[i][j] != 0) for i in range(rank)]
    return columns(identity(n), [j - k for j in pivots if j >= k])


def independent(a: Exact) -> Exact:
    """The first columns that span the column space."""
    reduced, rank = a.rref()
    rows = reduced.tolist()
    return columns(a, [next(j for j in range(a.ncols()) if rows[i][j] != 0) for i in range(rank)])


def spanned(F: Exact, B: Exact) -> Exact:
    """A basis (columns) of the smallest F-invariant subspace that contains the columns of B."""
    found = independent(B)
    while True:
        grown = independent(block([[found, F * found]]))
        if grown.ncols() == found.ncols():
            return found
        found = grown


def quotient(F: Exact, subspace: Exact) -> Exact:
    """What is left of F beside an invariant subspace, given by independent columns."""
    T = block([[subspace, complement(subspace)]])
    inner, n, k = T.inv() * F * T, F.nrows(), subspace.ncols()
    return of_rows([[inner[i, j] for j in range(k, n)] for i in range(k, n)], n - k)


def solve_columns(V: Exact, right: Exact) -> Exact:
    """The A with V A = right, for independent columns V whose span contains those of `right`."""
    return (V.transpose() * V).solve(V.transpose() * right)


def solve_any(a: Exact, b: Exact) -> Exact | None:
    """Some x with a x = b (one column), or None."""
    n = a.ncols()
    reduced, rank = block([[a, b]]).rref()
    rows = reduced.tolist()
    x = [fmpq(0)] * n
    for i in range(rank):
        pivot = next(j for j in range(n + 1) if rows[i][j] != 0)
        if pivot == n:
            return None
        x[pivot] = rows[i][n]
    return fmpq_mat(n, 1, x)


def column_vectors(a: Exact) -> list[Vector]:
    return list(zip(*from_flint(a), strict=True)) if a.ncols() else []
