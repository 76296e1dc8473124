"""Sums of squares on the unit disk: sigma0 + (1 - x^2 - y^2) sigma1, found in floats, rounded, exact as an identity.

All Gram matrices for which the identity holds form an affine family, whose free entries are chosen by Clarabel and
rounded; the others follow exactly. Where the form vanishes at known points, the family has no interior until the Gram
matrices are cut down to the face that these points leave (facial reduction). Nothing here is trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from certify.kernel import linalg as la
from certify.kernel.disks import DiskSum, Form, monomials
from certify.kernel.linalg import Matrix, Vector
from certify.kernel.reader import Pair
from certify.search import exact
from certify.search.roots import magnitude
from certify.search.solvers import Block, largest_margin

ROUNDINGS = (2, 3, 4, 6, 9, 12)  # decimal places kept of the free entries, the form being scaled to about 1
BOUND = 1e4  # on them
_PARTS = [Fraction(k, 4) for k in range(-4, 5)]
_BORDER = [(a * s, b * t) for a, b in ((3, 4), (4, 3), (5, 0), (0, 5)) for s in (1, -1) for t in (1, -1)]
# where zeros of a form are looked for: simple rational points of the disk
POINTS = sorted(
    {(x, y) for x in _PARTS for y in _PARTS if x * x + y * y <= 1}
    | {(Fraction(a, 5), Fraction(b, 5)) for a, b in _BORDER}
)
Basis = list[Vector]  # of the space that the range of a Gram matrix lies in


def find_sum(
    form: Form, components: int, degree: int, accept: Callable[[DiskSum], bool], places: Sequence[Pair] = ()
) -> DiskSum | None:
    """Gram matrices of that degree which `accept` lets pass, with as few digits as it does, or None.

    `places`: more points of the disk where zeros of the form are to be looked for.
    """
    kernels = [(point, kernel(form, components, point)) for point in sorted({*POINTS, *places})]
    if any(vectors is None for _, vectors in kernels):
        return None  # the form is negative somewhere
    bases = []
    for top, closed in ((degree, True), (degree - 1, False)):
        powers = monomials(top)
        killed = [
            tuple(x**i * y**j * u for i, j in powers for u in vector)
            for (x, y), vectors in kernels
            if closed or x * x + y * y < 1
            for vector in vectors or ()
        ]
        width = components * len(powers)
        bases.append(list(la.null_space(killed, width) if killed else la.identity(width)))
    family = _family(form, components, degree, bases)
    for grams in family.candidates() if family else ():
        proof = DiskSum(degree, *grams)
        if accept(proof):
            return proof
    return None


def kernel(form: Form, components: int, point: Pair) -> list[Vector] | None:
    """Vectors w that span the kernel of the form at a point, exactly; None if it is not semidefinite there."""
    value = {(a, b): la.ZERO for a in range(components) for b in range(a, components)}
    for (i, j, a, b), x in form.items():
        value[a, b] += x * point[0] ** i * point[1] ** j
    rows = tuple(
        tuple(value[min(a, b), max(a, b)] / (1 if a == b else 2) for b in range(components)) for a in range(components)
    )
    return list(la.null_space(rows, components)) if la.ldl_pivots(rows)[1] else None


@dataclass(frozen=True)
class Family:
    """Gram matrices T' S T, for S with the entries `constants` + `slopes` x, all x: the identity holds throughout.

    Shapes: bases are T, one for each Gram matrix; entries (block, i, j) with i <= j; slopes as rows of (index, slope).
    """

    bases: tuple[Basis, Basis]
    widths: tuple[int, int]
    entries: list[tuple[int, int, int]]
    constants: list[Fraction]
    slopes: list[dict[int, Fraction]]
    free: int
    scale: Fraction

    def candidates(self) -> Iterator[tuple[Matrix, Matrix]]:
        if not self.free:
            yield self._grams([])
            return
        for point in largest_margin(self._blocks(), (BOUND,)):
            for digits in ROUNDINGS:
                unit = Fraction(1, 10**digits)
                yield self._grams([round(Fraction(float(x)) / unit) * unit for x in point[:-1]])

    def _blocks(self) -> list[Block]:
        import numpy

        sizes = [len(basis) for basis in self.bases]
        constants = [numpy.zeros((n, n)) for n in sizes]
        coefficients = [numpy.zeros((self.free, n, n)) for n in sizes]
        for (block, i, j), constant, slopes in zip(self.entries, self.constants, self.slopes, strict=True):
            for a, b in {(i, j), (j, i)}:
                constants[block][a, b] = float(constant)
                for k, slope in slopes.items():
                    coefficients[block][k, a, b] = float(slope)
        return [Block(c, s) for c, s, n in zip(constants, coefficients, sizes, strict=True) if n]

    def _grams(self, x: list[Fraction]) -> tuple[Matrix, Matrix]:
        small = [[[la.ZERO] * len(basis) for _ in basis] for basis in self.bases]
        for (block, i, j), constant, slopes in zip(self.entries, self.constants, self.slopes, strict=True):
            value = self.scale * (constant + sum((slope * x[k] for k, slope in slopes.items()), la.ZERO))
            small[block][i][j] = small[block][j][i] = value
        first, second = (
            _expanded(basis, rows, width) for basis, rows, width in zip(self.bases, small, self.widths, strict=True)
        )
        return first, second


def _expanded(basis: Basis, rows: list[list[Fraction]], width: int) -> Matrix:
    """T' S T."""
    if not basis:
        return la.zeros(width, width)
    T = exact.to_flint(basis)
    return exact.from_flint(T.transpose() * exact.to_flint(rows) * T)


def _family(form: Form, components: int, degree: int, bases: list[Basis]) -> Family | None:
    """The family in which no diagonal entry is forced to vanish, or None if there is none."""
    largest = max((abs(x) for x in form.values()), default=la.ONE)
    scale = Fraction(10) ** magnitude(largest)
    weights: list[dict[tuple[int, int], int]] = [{(0, 0): 1}, {(0, 0): 1, (2, 0): -1, (0, 2): -1}]
    layout = [[(i, j, a) for i, j in monomials(top) for a in range(components)] for top in (degree, degree - 1)]
    while True:
        # diagonal entries first: they become the dependent ones, which are rounded to nothing
        entries = [(block, i, i) for block in (0, 1) for i in range(len(bases[block]))]
        entries += [(block, i, j) for block in (0, 1) for i in range(len(bases[block])) for j in range(i)]
        equations: dict[tuple[int, int, int, int], dict[int, Fraction]] = {key: {} for key in form}
        for column, (block, s, t) in enumerate(entries):
            for key, x in _product_terms(layout[block], bases[block][s], bases[block][t], weights[block]):
                row = equations.setdefault(key, {})
                row[column] = row.get(column, la.ZERO) + x * (1 if s == t else 2)
        width = len(entries)
        table = [[la.ZERO] * (width + 1) for _ in equations]
        for line, (key, row) in zip(table, equations.items(), strict=True):
            for column, x in row.items():
                line[column] = x
            line[width] = form.get(key, la.ZERO) / scale
        reduced, rank = exact.to_flint(table, width + 1).rref()
        rows = [
            {column: exact.to_fraction(x) for column, x in enumerate(row) if x != 0} for row in reduced.tolist()[:rank]
        ]
        if any(min(row) == width for row in rows):
            return None
        vanishing: set[tuple[int, int]] = set()
        for row in rows:  # a sum of diagonal entries with positive factors that is zero
            if width not in row and min(row.values()) > 0 and all(entries[c][1] == entries[c][2] for c in row):
                vanishing |= {entries[c][:2] for c in row}
        if not vanishing:
            break
        bases = [[v for i, v in enumerate(basis) if (block, i) not in vanishing] for block, basis in enumerate(bases)]
    pivots = {min(row): row for row in rows}
    index = {column: k for k, column in enumerate(c for c in range(width) if c not in pivots)}
    constants = [pivots[c].get(width, la.ZERO) if c in pivots else la.ZERO for c in range(width)]
    slopes = [
        {index[k]: -x for k, x in pivots[c].items() if k in index} if c in pivots else {index[c]: la.ONE}
        for c in range(width)
    ]
    pair, widths = (bases[0], bases[1]), (len(layout[0]), len(layout[1]))
    return Family(pair, widths, entries, constants, slopes, len(index), scale)


def _product_terms(
    layout: list[tuple[int, int, int]], first: Vector, second: Vector, weight: dict[tuple[int, int], int]
) -> Iterator[tuple[tuple[int, int, int, int], Fraction]]:
    """The terms of weight (first . z)(second . z), z the monomials times components."""
    left, right = ([(key, x) for key, x in zip(layout, v, strict=True) if x] for v in (first, second))
    for (i, j, a), x in left:
        for (k, m, b), y in right:
            for (s, t), sign in weight.items():
                yield (i + k + s, j + m + t, min(a, b), max(a, b)), sign * x * y
