"""Exact facial reduction of the storage LMI: P B = C', M = -(F'P + PF) >= 0, in the entries of P (THEORY 4).

The LMI never has an interior here, so equations come first. Each equation is kept with what it is made of, so that
a contradiction between them can be handed to the kernel as an identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from certify.kernel.linalg import (
    Matrix,
    Vector,
    add,
    apply,
    identity,
    is_positive_semidefinite,
    multiply,
    null_space,
    row_reduce,
    scale,
    transpose,
    zeros,
)
from certify.kernel.model import LinearPort
from certify.kernel.rules import dissipation

ZERO = Fraction(0)


def outer(a: Vector, b: Vector) -> Matrix:
    return tuple(tuple(x * y for y in b) for x in a)


def symmetric_part_twice(a: Matrix) -> Matrix:
    return add(a, transpose(a))


@dataclass(frozen=True)
class Contradiction:
    """Data of the kernel's rule `storage-contradiction`."""

    faces: tuple[tuple[Vector, Matrix, tuple[Vector, ...]], ...]
    W: Matrix
    Y: Matrix
    y: tuple[Vector, ...]


@dataclass
class Family:
    """All symmetric P that satisfy the equations found so far: `point` plus any combination of `directions`."""

    port: LinearPort
    faces: list[tuple[Vector, Matrix, tuple[Vector, ...]]] = field(default_factory=list)
    point: Matrix | None = None
    directions: tuple[Matrix, ...] = ()

    def __post_init__(self) -> None:
        n, m = len(self.port.F), len(self.port.C)
        self.unit = identity(n)
        self.index = {pair: k for k, pair in enumerate((i, j) for i in range(n) for j in range(i, n))}
        # One equation tr(P A) = b for each entry of Y, then for each entry of each face's multiplier.
        self.equations: list[tuple[Matrix, Fraction]] = []
        columns = transpose(self.port.B)
        for a in range(n):
            for k in range(m):
                self.equations.append((symmetric_part_twice(outer(columns[k], self.unit[a])), 2 * self.port.C[k][a]))
        self._solve()

    def functional(self, A: Matrix) -> list[Fraction]:
        """Coefficients of P -> tr(P A) in the entries of P on and above the diagonal."""
        return [A[i][j] if i == j else A[i][j] + A[j][i] for i, j in self.index]

    def _solve(self) -> None:
        size = len(self.index)
        rows, pivots = row_reduce([(*self.functional(A), b) for A, b in self.equations], size + 1)
        if size in pivots:
            self.point, self.directions = None, ()
            return
        point = [ZERO] * size
        for row, pivot in zip(rows, pivots, strict=True):
            point[pivot] = row[-1]
        self.point = self._matrix(point)
        self.directions = tuple(self._matrix(v) for v in null_space([row[:-1] for row in rows], size))

    def _matrix(self, entries: list[Fraction] | Vector) -> Matrix:
        n = len(self.port.F)
        return tuple(tuple(entries[self.index[min(i, j), max(i, j)]] for j in range(n)) for i in range(n))

    def is_face(self, u: Vector) -> bool:
        """Whether u' M(P) u vanishes for every P of the family."""
        if self.point is None:
            return False
        image = apply(self.port.F, u)
        return all(
            not sum((x * y for x, y in zip(apply(P, u), image, strict=True) if x and y), ZERO)
            for P in (self.point, *self.directions)
        )

    def is_implied(self, u: Vector) -> bool:
        """Whether M(P) u = 0 holds on the family already."""
        return self.point is not None and all(
            not any(apply(dissipation(self.port.F, P), u)) for P in (self.point, *self.directions)
        )

    def impose(self, u: Vector) -> None:
        """Add the equations M u = 0, with the identity that forces them."""
        image = apply(self.port.F, u)
        found = self.combination(symmetric_part_twice(outer(image, u)), ZERO)
        if found is None:
            raise ArithmeticError("the face is not implied by the equations")
        self.faces.append((u, *found))
        for e in self.unit:
            A = add(outer(image, e), outer(u, apply(self.port.F, e)))
            self.equations.append((symmetric_part_twice(A), ZERO))
        self._solve()

    def combination(self, target: Matrix, b: Fraction | None) -> tuple[Matrix, tuple[Vector, ...]] | None:
        """Multipliers (Y, y) of the equations whose sum is the matrix `target` and the right side b (any if None)."""
        columns = [self.functional(A) + ([value] if b is not None else []) for A, value in self.equations]
        right = self.functional(target) + ([b] if b is not None else [])
        rows = [(*row, r) for row, r in zip(zip(*columns, strict=True), right, strict=True)]
        reduced, pivots = row_reduce(rows, len(columns) + 1)
        if len(columns) in pivots:
            return None
        values = [ZERO] * len(columns)
        for row, pivot in zip(reduced, pivots, strict=True):
            values[pivot] = row[-1]
        n, m = len(self.port.F), len(self.port.C)
        Y = tuple(tuple(values[a * m + k] for k in range(m)) for a in range(n))
        y = tuple(tuple(values[n * m + f * n : n * m + (f + 1) * n]) for f in range((len(values) - n * m) // n))
        return Y, y

    def candidates(self) -> Iterator[Vector]:
        """Directions that may be faces: integral action, the port itself, coordinates and their small sums."""
        F, B, C = self.port.F, self.port.B, self.port.C
        n = len(F)
        outside = null_space(transpose(B), n)  # rows r with r B = 0
        yield from null_space((*C, *(multiply(outside, F) if outside else ())), n)
        yield from transpose(B)
        yield from self.unit
        for known, _, _ in tuple(self.faces):
            yield from (tuple(x + y for x, y in zip(known, e, strict=True)) for e in self.unit)

    def reduce(self) -> None:
        """Impose faces until no candidate gives a new equation or the equations contradict each other."""
        progress = True
        while progress and self.point is not None:
            progress = False
            for u in self.candidates():
                if any(u) and self.is_face(u) and not self.is_implied(u):
                    self.impose(u)
                    progress = True
                    break

    def contradiction(self) -> Contradiction | None:
        """Why no P >= 0 of the family has M(P) >= 0, if the equations or a unique P show it."""
        n = len(self.port.F)
        nothing = zeros(n, n)
        if self.point is None:
            found = self.combination(nothing, Fraction(-1))
            return Contradiction(tuple(self.faces), nothing, *found) if found else None
        if self.directions:
            return None
        M = dissipation(self.port.F, self.point)
        for form, is_storage in ((self.point, True), (M, False)):
            x = find_negative_direction(form)
            if x is None:
                continue
            square = outer(x, x)
            if is_storage:
                target, W = square, nothing
            else:
                product = multiply(self.port.F, square)
                target, W = scale(-1, symmetric_part_twice(product)), square
            found = self.combination(target, None)
            if found:
                return Contradiction(tuple(self.faces), W, *found)
        return None


def find_negative_direction(A: Matrix) -> Vector | None:
    """An x with x' A x < 0, or None if A is positive semidefinite. Exact elimination, then back substitution."""
    if is_positive_semidefinite(A):
        return None
    n = len(A)
    rows = [list(row) for row in A]
    basis = [list(row) for row in identity(n)]  # congruence: rows = basis A basis'
    for k in range(n):
        if rows[k][k] < 0:
            return tuple(basis[k])
        if rows[k][k] == 0:
            j = next((j for j in range(k + 1, n) if rows[k][j]), None)
            if j is None:
                continue
            # a zero diagonal entry with coupling c: (t, 1) gives 2 t c + d < 0 for t of the right sign and size
            t = -(abs(rows[j][j]) + 1) / rows[k][j]
            return tuple(t * a + b for a, b in zip(basis[k], basis[j], strict=True))
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            if factor:
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
                basis[i] = [x - factor * y for x, y in zip(basis[i], basis[k], strict=True)]
                for r in rows:
                    r[i] -= factor * r[k]
    return None
