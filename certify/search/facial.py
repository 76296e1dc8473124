"""Exact facial reduction of the storage LMI: P B = C', M = -(F'P + PF) >= 0, in the entries of P (THEORY 4).

The LMI never has an interior here, so equations come first. On the vectors whose image under P is known, M is a
constant form: it must be >= 0, and where it vanishes M u = 0 follows, which makes further images known. When that
comes to rest, frequencies are left at which nothing dissipates: `spectral` finds them, and they bring faces of
higher rank.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq_mat

from certify.kernel.linalg import Matrix, Vector, ldl_pivots
from certify.kernel.model import LinearPort
from certify.search import exact
from certify.search.exact import Exact

SAMPLES = 3


@dataclass(frozen=True)
class Vectors:
    """A face: M u = 0 (or P u = 0 if `of_storage`) for the columns u of U, because tr(M U diag(weights) U') = 0."""

    of_storage: bool
    weights: Vector
    U: Exact


class Family:
    """All symmetric P that satisfy the equations found so far: `point` plus any combination of `directions`."""

    def __init__(self, port: LinearPort) -> None:
        self.port = port
        self.n, self.m = len(port.F), len(port.C)
        self.F, self.B, self.C = exact.to_flint(port.F), exact.to_flint(port.B), exact.to_flint(port.C)
        self.index = {pair: k for k, pair in enumerate((i, j) for i in range(self.n) for j in range(i, self.n))}
        self.faces: list[Vectors] = []
        self.obstacle: tuple[bool, Vector] | None = None  # of storage or not, and the direction
        self.crosses = False  # set if some frequency shows that no storage matrix is left
        self.point: Exact | None = None
        self._known: tuple[Exact, Exact] | None = None  # kept until the equations change
        self.free: list[int] = []  # entries of P that the equations leave free
        self.samples: list[Exact] = []  # combinations of the directions at random: what holds for them holds for all
        # What is left of the equations: rows of a reduced echelon form, the right side last.
        self.reduced = exact.to_flint((), len(self.index) + 1)
        self._impose([(self.B, self.C.transpose())])

    def _image_rows(self, x: list[object]) -> list[list[object]]:
        """The n rows of the map from the entries of P to P x."""
        rows: list[list[object]] = [[0] * len(self.index) for _ in range(self.n)]
        for (i, j), k in self.index.items():
            rows[i][k] = x[j]
            if i != j:
                rows[j][k] = x[i]
        return rows

    def _impose(self, images: Sequence[tuple[Exact, Exact]], dissipation: Exact | None = None) -> None:
        """Add P X = Y for each (X, Y), and M u = 0 for each column u of `dissipation`."""
        size = len(self.index)
        entries: list[object] = []
        count = 0
        for X, Y in images:
            for column, right in zip(X.transpose().tolist(), Y.transpose().tolist(), strict=True):
                for row, value in zip(self._image_rows(column), right, strict=True):
                    entries += [*row, value]
                    count += 1
        if dissipation is not None:
            lifted = self.F * dissipation
            for u, v in zip(dissipation.transpose().tolist(), lifted.transpose().tolist(), strict=True):
                total = self.F.transpose() * exact.of_rows(self._image_rows(u), size)
                total += exact.of_rows(self._image_rows(v), size)
                for row in total.tolist():
                    entries += [*row, 0]
                count += self.n
        stacked = fmpq_mat(self.reduced.nrows() + count, size + 1, [*self.reduced.entries(), *entries])
        echelon, rank = stacked.rref()
        rows = echelon.tolist()[:rank]
        self.reduced = fmpq_mat(rank, size + 1, [x for row in rows for x in row])
        pivots = [next(j for j in range(size + 1) if row[j] != 0) for row in rows]
        self.point, self.samples, self.free, self._known = None, [], [], None
        if size in pivots:
            return
        self.free = [j for j in range(size) if j not in set(pivots)]
        self.rows, self.pivots = rows, pivots
        self.point = self._matrix({p: row[size] for p, row in zip(pivots, rows, strict=True)})
        rng = random.Random(size)  # a fixed stream: the search is deterministic
        for _ in range(SAMPLES if self.free else 0):
            self.samples.append(self._direction({j: rng.randint(-99, 99) for j in self.free}))

    def _direction(self, values: dict[int, int]) -> Exact:
        """The member of the family, less the point, with these free entries."""
        chosen = values.items()
        rest = {
            p: -sum((row[j] * x for j, x in chosen if row[j] != 0), 0)
            for p, row in zip(self.pivots, self.rows, strict=True)
        }
        return self._matrix({**values, **rest})

    @property
    def directions(self) -> list[Exact]:
        """A basis: the family is the point plus any combination of these."""
        return [self._direction({j: 1}) for j in self.free]

    def _matrix(self, entries: dict[int, object]) -> Exact:
        n = self.n
        flat = [entries.get(self.index[min(i, j), max(i, j)], 0) for i in range(n) for j in range(n)]
        return fmpq_mat(n, n, flat)

    def dissipation(self, P: Exact) -> Exact:
        half = P * self.F
        return -(half + half.transpose())

    def known(self) -> tuple[Exact, Exact]:
        """A basis K (columns) of the vectors whose image P K is the same all over the family, and that image."""
        if self.point is None:
            raise ValueError("the family is empty")
        if self._known is None:
            flat = [x for D in self.samples for x in D.entries()]
            K = exact.null_space(fmpq_mat(self.n * len(self.samples), self.n, flat))
            self._known = K, self.point * K
        return self._known

    def reduce_known(self) -> bool:
        """Impose what the constant parts of M and P force, to the end. False if no storage matrix is left."""
        while self.point is not None:
            K, image = self.known()
            form = exact.from_flint(K.transpose() * self.dissipation(self.point) * K)
            for of_storage, known in ((False, form), (True, exact.from_flint(K.transpose() * image))):
                negative = find_negative_direction(known)
                if negative is not None:
                    u = exact.column_vectors(K * exact.to_flint([[x] for x in negative]))[0]
                    self.obstacle = (of_storage, u)
                    return False
            if not K.ncols() or not self.impose_face(K * exact.null_space(exact.to_flint(form))):
                return True
        return False

    def impose_face(self, U: Exact, weights: Vector | None = None, of_storage: bool = False) -> bool:
        """Add M u = 0 (P u = 0) for the columns of U that do not satisfy it yet, if there are any.

        Without weights each column is a face of its own; with them the columns are one face together.
        """
        if self.point is None:
            return False
        members = [self.point, *self.samples]
        images = [P * U if of_storage else self.dissipation(P) * U for P in members]
        fresh = [j for j in range(U.ncols()) if any(image[i, j] != 0 for image in images for i in range(self.n))]
        if not fresh:
            return False
        if weights is None:
            chosen = exact.columns(U, fresh)
            self.faces += [Vectors(of_storage, (Fraction(1),), exact.columns(U, [j])) for j in fresh]
        else:
            chosen = U
            self.faces.append(Vectors(of_storage, weights, U))
        if of_storage:
            zero = chosen * 0
            self._impose([(chosen, zero)])
        else:
            self._impose([], chosen)
        return True

    def choose(self, V: Exact, image: Exact) -> None:
        """Restrict the family to P V = image: a choice, not a consequence."""
        self._impose([(V, image)])

    def is_free(self) -> bool:
        """Whether the family is all P with the known images: then what is left is one Riccati inequality."""
        if self.point is None:
            return False
        rest = self.n - self.known()[0].ncols()
        return bool(len(self.free) == rest * (rest + 1) // 2)


def find_negative_direction(A: Matrix) -> Vector | None:
    """An x with x' A x < 0, or None if A is positive semidefinite. Exact elimination, then back substitution."""
    if ldl_pivots(A)[1]:
        return None
    n = len(A)
    rows = [list(row) for row in A]
    basis = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]  # congruence: rows = basis A basis'
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
