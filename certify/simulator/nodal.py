"""Shifted systems (shift - J) z = r of a network, reduced to its nodes: what is local is eliminated in small blocks.

J is the Jacobian of a flow, A with the slopes of the loads. Currents of lines and branches (2 states each), and those
of inverters with their integrators (2 or 4), touch each other only within their element; what is left has two unknowns
a node (all states of a linear loop), and the pattern of the network's graph.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from certify.simulator.compiled import COMPILED, compiled
from certify.simulator.flow import Flow
from certify.simulator.loads import straight_and_turned
from certify.simulator.plant import Array, Part, Phasors, to_phasors

Numbers = NDArray[Any]  # real or complex
Places = NDArray[numpy.intp]
PIVOT = 0.01  # of the largest in its column: an entry of the diagonal that is taken, for the sake of the ordering


@dataclass(frozen=True)
class Loads:
    """The static loads of a flow beside their slopes at one voltage each: R(V) = I(V) - a V - b conj(V), in ampere."""

    flow: Flow
    straight: Phasors
    turned: Phasors
    slopes: csr_matrix  # their part of the Jacobian, among the kept states

    def remainder(self, V: Phasors) -> Phasors:
        """Shape (m, k) of voltages at m times to the same."""
        return self.flow.plant.loads.currents(V) - self.straight * V - self.turned * numpy.conj(V)


class Nodal:
    """A flow's equations, parted into states that are kept, at nodes, and states that are eliminated.

    `kept` (p,) and `local` (e,) are places in a state; `local` has elements of equal size next to each other.
    """

    def __init__(self, flow: Flow) -> None:
        plant = flow.plant
        self.flow, self.size = flow, plant.size
        groups = _elements(plant.slices)
        kept = [numpy.arange(at.start, at.stop) for part, at in plant.slices.items() if part[0] in ("voltage", "loop")]
        self.kept: Places = numpy.concatenate(kept)
        self.local: Places = numpy.concatenate([numpy.empty(0, dtype=int), *(group.reshape(-1) for group in groups)])
        A = csr_matrix(flow.A)
        rows = A[self.kept]
        self.own, self.entering = csr_matrix(rows[:, self.kept]), csr_matrix(rows[:, self.local])
        rows = A[self.local]
        self.reading, self.blocks = csr_matrix(rows[:, self.kept]), _blocks(csr_matrix(rows[:, self.local]), groups)
        self.D, self.S = csr_matrix(plant.D[self.kept]), csr_matrix(plant.S[:, self.kept])
        self.s = plant.s
        columns = csc_matrix(abs(self.D))
        self._pushed = columns.indices, columns.data, columns.indptr[:-1]
        ones = self.S.nnz == self.S.shape[0] and (self.S.data == 1).all() and (numpy.diff(self.S.indptr) == 1).all()
        # without linear loops voltages are states, and currents enter just these
        alike = ones and columns.nnz == columns.shape[1] and numpy.array_equal(columns.indices, self.S.indices)
        self._read = self.S.indices if alike else None
        # the places of the blocks in a sparse matrix, and those of the matrix that is left
        widths = numpy.concatenate([numpy.empty(0, dtype=int), *(numpy.full(g.size, g.shape[1]) for g in groups)])
        self._starts = numpy.concatenate([[0], numpy.cumsum(widths)])
        places, first = [numpy.empty(0, dtype=int)], 0
        for group in groups:
            own = first + numpy.arange(group.size).reshape(group.shape)
            places.append(numpy.repeat(own[:, None, :], group.shape[1], axis=1).reshape(-1))
            first += group.size
        self._columns = numpy.concatenate(places)
        self._diagonal = csr_matrix(coo_matrix((numpy.ones(len(self.kept)), 2 * (numpy.arange(len(self.kept)),))))

    def voltages(self, kept: Array) -> Phasors:
        """Voltages at the nodes with static loads, from the kept states at several times. Shape (m, p) to (m, k)."""
        return to_phasors((self.S @ kept.T).T + self.s)

    def read(self, waves: Numbers) -> Numbers:
        """What kept states add to the voltages at the nodes with static loads. Shape (m, p) to (m, 2 k)."""
        return waves.take(self._read, axis=1) if self._read is not None else (self.S @ waves.T).T

    def push(self, currents: Numbers) -> Numbers:
        """What currents drawn by static loads do to the rates of kept states. Shape (m, 2 k) to (m, p)."""
        result = numpy.zeros((len(currents), len(self.kept)), dtype=currents.dtype)
        if self._read is not None:
            result[:, self._read] = currents * self._pushed[1]
        else:
            for row, own in zip(result, currents, strict=True):
                row[:] = self.D @ own
        return result

    def seen(self, sizes: Array) -> Array:
        """The sizes of those voltages, from those of the kept states. Shape (p,) to (2 k,)."""
        return abs(self.S) @ sizes

    def pushes(self, sizes: Array) -> Array:
        """By how much of their size a current of 1 A moves the rates of kept states at most. (p,) to (2 k,)."""
        places, entries, starts = self._pushed
        return numpy.maximum.reduceat(entries / sizes[places], starts) if len(starts) else numpy.empty(0)

    def loads(self, kept: Array) -> Loads:
        """The static loads with their slopes at a state, of which (p,) is kept."""
        loads = self.flow.plant.loads
        J = loads.slopes(self.voltages(kept[None, :])[0]) if self.S.shape[0] else numpy.empty((0, 2, 2))
        k = len(J)
        blocks = csr_matrix((J.reshape(-1), _pairs(k), 2 * numpy.arange(2 * k + 1)), shape=(2 * k, 2 * k))
        return Loads(self.flow, *straight_and_turned(J), csr_matrix(self.D @ (blocks @ self.S)))

    def shifted(self, shift: complex, loads: Loads) -> Shifted:
        """The factors of shift - J, real arithmetic for a real shift. Raises: RuntimeError if it is singular."""
        s: Any = shift if shift.imag else shift.real
        inverses = [numpy.linalg.inv(s * numpy.eye(group.shape[1]) - group).reshape(-1) for group in self.blocks]
        data = numpy.concatenate([numpy.empty(0), *inverses])
        inverse = csr_matrix((data, self._columns, self._starts), shape=(len(self.local), len(self.local)))
        following = csr_matrix(inverse @ self.reading)
        left = csc_matrix(s * self._diagonal - self.own + loads.slopes - self.entering @ following)
        return Shifted(left, inverse, following, csr_matrix(self.entering @ inverse))


class Shifted:
    """The factors of one shifted system."""

    def __init__(self, left: csc_matrix, inverse: csr_matrix, following: csr_matrix, gathering: csr_matrix) -> None:
        self.inverse, self.following, self.gathering = inverse, following, gathering
        self.diagonal = left.diagonal()
        # the pattern is symmetric, and minimum degree on it fills in less than column orderings do
        options = {"SymmetricMode": True}
        self.factors = splu(left, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT, options=options)
        if COMPILED:
            lower, upper = self.factors.L, self.factors.U
            lower.sort_indices()
            upper.sort_indices()
            self._lower = lower.indptr, lower.indices, lower.data
            self._upper = upper.indptr, upper.indices, upper.data
            self._rows = numpy.argsort(self.factors.perm_r)
            self._columns = self.factors.perm_c

    def nodes(self, r: Numbers) -> Numbers:
        """The kept part of z when nothing is on the right of the local equations. Shape (p,) to (p,)."""
        if not COMPILED:
            return self.factors.solve(r)
        return _substitute(*self._lower, *self._upper, self._rows, self._columns, r)

    def solve(self, kept: Numbers, local: Numbers) -> tuple[Numbers, Numbers]:
        """Both parts of z, of both parts of r."""
        z = self.nodes(kept + self.gathering @ local)
        return z, self.inverse @ local + self.following @ z


@compiled
def _substitute(
    starts: Places,
    rows: Places,
    lower: Numbers,
    ends: Places,
    above: Places,
    upper: Numbers,
    order: Places,
    columns: Places,
    r: Numbers,
) -> Numbers:
    """z of L U z[columns] = r[order], with sorted columns of L and U; faster than SuperLU, which goes by supernodes."""
    z = r[order]
    n = len(z)
    for j in range(n):
        value = z[j]
        for k in range(starts[j] + 1, starts[j + 1]):
            z[rows[k]] -= lower[k] * value
    for j in range(n - 1, -1, -1):
        last = ends[j + 1] - 1
        value = z[j] / upper[last]
        z[j] = value
        for k in range(ends[j], last):
            z[above[k]] -= upper[k] * value
    return z[columns]


def _elements(slices: dict[Part, slice]) -> list[Places]:
    """The places of the states of each element that is eliminated, elements of one size together: (g, size) each."""
    own: dict[Part, list[int]] = {}
    for part, at in slices.items():
        if part[0] not in ("voltage", "loop"):
            name = ("inverter", part[1]) if part[0] in ("current", "integrator") else part
            own.setdefault(name, []).extend(range(at.start, at.stop))
    sizes = sorted({len(places) for places in own.values()})
    return [numpy.array([places for places in own.values() if len(places) == size]) for size in sizes]


def _blocks(A: csr_matrix, groups: list[Places]) -> list[Array]:
    """The dense diagonal blocks of the local equations. Raises: ValueError if anything is outside of them."""
    entries, first = coo_matrix(A), 0
    result: list[Array] = []
    inside = numpy.zeros(entries.nnz, dtype=bool)
    for group in groups:
        count, size = group.shape
        mine = (entries.row >= first) & (entries.row < first + group.size)
        rows, columns = entries.row[mine] - first, entries.col[mine] - first
        inside[mine] = rows // size == columns // size
        block = numpy.zeros((count, size, size))
        rows, columns, values = rows[inside[mine]], columns[inside[mine]], entries.data[mine][inside[mine]]
        block[rows // size, rows % size, columns % size] = values
        result.append(block)
        first += group.size
    if not inside.all():
        raise ValueError("elements of the network touch each other beside its nodes")
    return result


def _pairs(count: int) -> Places:
    """The columns of a matrix of 2x2 blocks on the diagonal, row by row."""
    return numpy.repeat(numpy.arange(2 * count).reshape(-1, 2), 2, axis=0).reshape(-1)
