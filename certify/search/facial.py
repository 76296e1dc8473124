"""Exact facial reduction of the storage LMI: P B = C', M = -(F'P + PF) >= 0, in the entries of P (THEORY 4).

The LMI never has an interior here, so equations come first. Each equation is kept with what it is made of, so that
a contradiction between them can be handed to the kernel as an identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from certify.kernel.linalg import (
    ZERO,
    Matrix,
    Vector,
    add,
    apply,
    identity,
    ldl_pivots,
    multiply,
    null_space,
    row_reduce,
    scale,
    transpose,
    zeros,
)
from certify.kernel.model import LinearPort
from certify.kernel.rules import Face, dissipation, face_equation, outer


def symmetric_part_twice(a: Matrix) -> Matrix:
    return add(a, transpose(a))


@dataclass(frozen=True)
class Contradiction:
    """Data of the kernel's rule `storage-contradiction`."""

    faces: tuple[Face, ...]
    W: Matrix
    Y: Matrix
    y: tuple[Vector, ...]


@dataclass
class Family:
    """All symmetric P that satisfy the equations found so far: `point` plus any combination of `directions`."""

    port: LinearPort
    faces: list[Face] = field(default_factory=list)
    point: Matrix | None = None
    directions: tuple[Matrix, ...] = ()

    def __post_init__(self) -> None:
        n, m = len(self.port.F), len(self.port.C)
        self.unit, self.F_transposed = identity(n), transpose(self.port.F)
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

    def members(self) -> tuple[Matrix, ...]:
        """The point and the directions: what vanishes on all of them vanishes on the family."""
        return () if self.point is None else (self.point, *self.directions)

    def is_face(self, u: Vector, of_storage: bool = False) -> bool:
        """Whether u' M(P) u, or u' P u, vanishes for every P of the family, and M u or P u does not yet."""
        if not any(u) or self.point is None:
            return False
        image = u if of_storage else apply(self.port.F, u)
        if any(sum((x * y for x, y in zip(apply(P, u), image, strict=True)), ZERO) for P in self.members()):
            return False
        if of_storage:
            return any(any(apply(P, u)) for P in self.members())
        # M u = -(F' P u + P F u)
        pairs = ((apply(self.F_transposed, apply(P, u)), apply(P, image)) for P in self.members())
        return any(x + y for parts in pairs for x, y in zip(*parts, strict=True))

    def impose(self, u: Vector, of_storage: bool = False) -> None:
        """Add the equations M u = 0, or P u = 0, with the identity that forces them."""
        square = outer(u if of_storage else apply(self.port.F, u), u)
        found = self.combination(symmetric_part_twice(square), ZERO)
        if found is None:
            raise ArithmeticError("the face is not implied by the equations")
        self.faces.append(Face(of_storage, u, *found))
        for e in self.unit:
            A = symmetric_part_twice(face_equation(self.port.F, self.faces[-1], e))
            self.equations.append((A, ZERO))
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
        for face in tuple(self.faces):
            yield from (tuple(x + y for x, y in zip(face.u, e, strict=True)) for e in self.unit)

    def reduce(self, with_storage: bool = False) -> None:
        """Impose faces until no candidate gives a new equation or the equations contradict each other.

        Faces of the storage leave only singular P: they are of use for contradictions, not for proofs.
        """
        kinds = (False, True) if with_storage else (False,)
        while self.point is not None:
            faces = ((u, kind) for kind in kinds for u in self.candidates() if self.is_face(u, kind))
            first = next(faces, None)
            if first is None:
                return
            self.impose(*first)

    def contradiction(self) -> Contradiction | None:
        """Why no P >= 0 of the family has M(P) >= 0, if the equations or a form with a fixed sign show it."""
        n = len(self.port.F)
        nothing = zeros(n, n)
        if self.point is None:
            found = self.combination(nothing, Fraction(-1))
            return Contradiction(tuple(self.faces), nothing, *found) if found else None
        M = dissipation(self.port.F, self.point)
        for form, is_storage in ((self.point, True), (M, False)):
            for x in (find_negative_direction(form), *self.unit) if not self.directions else self.unit:
                if x is None or sum((a * b for a, b in zip(x, apply(form, x), strict=True)), ZERO) >= 0:
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
    if ldl_pivots(A)[1]:
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
