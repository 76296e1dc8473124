"""The storage of a certificate along the simulator's motion: H falls, every part dissipates, and the balance closes.

For a part with x' = F x + B d, z = C x and the storage S = x'P x/2 the certificate says S' <= <z, d> + eps |d|^2, in
deviations from the equilibrium. S' is taken from the simulator's rates here, d from its currents. What parts and loads
dissipate is taken from the certificate's matrices: H' = -psi then closes only if both models are one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy
from numpy.polynomial import legendre
from scipy.sparse import csr_matrix

from certify.crosscheck.claimed import Claimed, Subsystem
from certify.crosscheck.findings import Finding
from certify.simulator.motion import Piece
from certify.simulator.plant import Array
from certify.simulator.stamps import Stamps

LOOKS = 8  # at a piece
NODES = 12  # of Gauss quadrature on an interval
MAX_INTERVALS = 4000
INEQUALITY = 1e-9  # of all terms of a dissipation inequality: what rounding may leave
GROWTH = 20.0  # of what the tolerance of the integrator may be worth of H
CLOSED = 1e-13  # of H: intervals are halved until what they dissipate changes by less


class Storage:
    """H of a certificate around a rest state of the simulator, its parts, and what they dissipate.

    `first` names the islands, by their first nodes, all DGUs of which have a storage. States are (t, n).
    """

    def __init__(self, claimed: Claimed, rest: Array) -> None:
        self.claimed, self.rest, self.plant = claimed, rest, claimed.plant
        has = [all(x in claimed.storages for x in i if claimed.context.nodes[x].dgu) for i in claimed.context.islands]
        self.islands = [island for island, whole in zip(claimed.context.islands, has, strict=True) if whole]
        self.first = [island[0] for island in self.islands]
        where = {name: k for k, island in enumerate(self.islands) for name in island}
        self.parts = [part for part in claimed.parts.values() if part.P is not None]
        index = {part.name: k for k, part in enumerate(self.parts)}
        n, m = self.plant.size, len(self.parts)
        P, M, gap, Z, d = Stamps(n, n), Stamps(n, n), Stamps(n, 2 * m), Stamps(2 * m, n), Stamps(2 * m, n)
        self.part_of = numpy.full(n, -1)
        for k, part in enumerate(self.parts):
            ports = numpy.array([2 * k, 2 * k + 1])
            self.part_of[part.at] = k
            P.add(part.at, part.at, _turned(part.P, part))
            M.add(part.at, part.at, _turned(part.M, part))
            Z.add(ports, part.at, part.C * part.sign)
            if part.P is not None:
                gap.add(part.at, ports, part.sign[:, None] * (part.C.T - part.P @ part.B))
        for to, of, sign in claimed.couplings():
            if to.name in index:
                k = index[to.name]
                d.add(numpy.array([2 * k, 2 * k + 1]), of.at, sign * of.C * of.sign)
        self.P, self.M, self.gap, self.Z, self.d = (x.matrix() for x in (P, M, gap, Z, d))
        self.sizes = abs(self.plant.A) + abs(self.plant.G) @ abs(self.plant.K)
        self.shortage = numpy.array([part.shortage for part in self.parts])
        # loads take what they draw off the input of their node
        names = self.plant.loaded
        self.load_part = numpy.array([index.get(claimed.at_node(name).name, -1) for name in names], dtype=int)
        self.load_island = numpy.array([where.get(name, -1) for name in names], dtype=int)
        self.drawn = self.plant.drawn(rest)
        self.volts = self.plant.loaded_voltages(rest)
        nodes = [self._node_of(part) for part in self.parts]
        self.island_of = numpy.array([where.get(name, -1) for name in nodes], dtype=int)
        self.inverter_part = numpy.array([index.get(f"dgu/{name}", -1) for name in self.plant.inverters], dtype=int)
        held = ("proved", "conditional")
        self.load_proved = numpy.array([claimed.status.get(f"load/{name}") in held for name in names], dtype=bool)
        self.bands = numpy.array([self._band(name) for name in names]).reshape(-1, 4)
        ports = numpy.stack([2 * self.load_part, 2 * self.load_part + 1], axis=1).reshape(-1)
        self.to_inputs = _members(numpy.where(ports >= 0, ports, -1), 2 * m)
        self.states_of_part = _members(self.part_of, m)
        self.parts_of_island = _members(self.island_of, len(self.islands))
        self.loads_of_island = _members(self.load_island, len(self.islands))

    def _node_of(self, part: Subsystem) -> str:
        kind, _, name = part.name.partition("/")
        if kind == "line":
            return self.plant.branches["line", name][0]
        return name.rpartition("/")[0] if kind == "branch" else name

    def _band(self, name: str) -> tuple[float, ...]:
        """Where the claim about a load holds: a centre, and the least and largest distance from it, in volt."""
        node = self.claimed.context.nodes[name]
        if node.current is not None:
            return *map(float, node.current.centre_volt), 0.0, float(node.current.radius_volt)
        low, high = node.band_volt or (0, 0)
        return 0.0, 0.0, float(low), float(high)

    def of(self, x: Array) -> Array:
        """H in joule on each island, (t, islands)."""
        off = x - self.rest
        return self._by_island(self._by_part(off * (self.P @ off.T).T / 2))

    def uncertainty(self, x: Array, sizes: Array) -> Array:
        """What errors of the states of these sizes, (n,), are worth of H at most, (t, islands)."""
        return self._by_island(self._by_part(numpy.abs((self.P @ (x - self.rest).T).T) * sizes))

    def least(self, sizes: Array) -> Array:
        """H of deviations that are a millionth of the sizes of the states, (n,) to (islands,)."""
        return self._by_island(self._by_part(self.P.diagonal()[None, :] * (1e-6 * sizes) ** 2 / 2))[0]

    def claimed_of(self, x: Array) -> tuple[Any, Any]:
        """Whether the claims speak of these states: of each part, inverters inside limits; of each load, in its band.

        Shapes (t, parts) and (t, loads).
        """
        V = self.plant.loaded_voltages(x)
        distance = numpy.hypot(V[:, ::2] - self.bands[:, 0], V[:, 1::2] - self.bands[:, 1])
        loads = (distance > self.bands[:, 2]) & (distance < self.bands[:, 3]) & self.load_proved
        parts = numpy.ones((len(x), len(self.parts)), dtype=bool)
        free: Any = (numpy.abs(self.plant.asked(x)) < self.plant.limits).reshape(len(x), -1, 2).all(axis=2)
        known = self.inverter_part >= 0
        parts[:, self.inverter_part[known]] = free[:, known]
        return parts, loads

    def covered(self, parts: Any, loads: Any) -> Any:
        """Whether they speak of all of an island, (t, islands)."""
        result = numpy.ones((len(parts), len(self.islands)), dtype=bool)
        for k in range(len(self.islands)):
            result[:, k] = parts[:, self.island_of == k].all(axis=1) & loads[:, self.load_island == k].all(axis=1)
        return result

    def _inputs(self, off: Array, drawn: Array) -> Array:
        """What flows into each port beside the part's own, in deviations. (t, 2 parts)."""
        inputs = (self.d @ off.T).T
        return inputs - (self.to_inputs @ (drawn - self.drawn).T).T

    def excess(self, x: Array) -> tuple[Array, Array]:
        """S' - <z, d> - eps |d|^2 of each part, and of each load -<V~, I~>, by the simulator's rates; and a scale.

        Watt, of shape (t, parts + loads) twice; the scale is the sum of the sizes of all terms.
        """
        off, rates, drawn = x - self.rest, self.plant.rates(x), self.plant.drawn(x)
        stored = (self.P @ off.T).T
        inputs, outputs = self._inputs(off, drawn), (self.Z @ off.T).T
        paired = outputs * inputs
        lost = self.shortage * (inputs**2).reshape(len(x), -1, 2).sum(axis=2)
        supply = paired.reshape(len(x), -1, 2).sum(axis=2)
        loads = ((self.plant.loaded_voltages(x) - self.volts) * (drawn - self.drawn)).reshape(len(x), -1, 2)
        terms = (self.sizes @ numpy.abs(x).T).T + numpy.abs(self.plant.b)
        scale = self._by_part(numpy.abs(stored) * (numpy.abs(rates) + 1e-4 * terms))
        scale = scale + numpy.abs(paired).reshape(len(x), -1, 2).sum(axis=2)
        rounding = 1e-6 * numpy.abs(self.volts * self.drawn).reshape(-1, 2).sum(axis=1)
        return (
            numpy.hstack([self._by_part(stored * rates) - supply - lost, -loads.sum(axis=2)]),
            numpy.hstack([scale, numpy.abs(loads).sum(axis=2) + rounding]),
        )

    def dissipated(self, x: Array) -> Array:
        """psi in watt on each island by the certificate's matrices and the loads, so that H' = -psi. (t, islands)."""
        off, drawn = x - self.rest, self.plant.drawn(x)
        own = off * (self.M @ off.T).T / 2 + off * (self.gap @ self._inputs(off, drawn).T).T
        loads = ((self.plant.loaded_voltages(x) - self.volts) * (drawn - self.drawn)).reshape(len(x), -1, 2).sum(axis=2)
        total = self._by_island(self._by_part(own))
        return total + (self.loads_of_island @ loads.T).T

    def _by_part(self, values: Array) -> Array:
        """Sums over the states of each part, (t, n) to (t, parts)."""
        return (self.states_of_part @ values.T).T

    def _by_island(self, values: Array) -> Array:
        return (self.parts_of_island @ values.T).T


def _members(groups: Any, count: int) -> csr_matrix:
    """Which columns belong to which of `count` groups, as a matrix of ones; -1 is none."""
    known = numpy.flatnonzero(groups >= 0)
    return csr_matrix((numpy.ones(len(known)), (groups[known], known)), shape=(count, len(groups)))


def _turned(a: Array | None, part: Subsystem) -> Array:
    """A symmetric matrix of a part in the signs of the simulator."""
    return numpy.zeros((len(part.at),) * 2) if a is None else part.sign[:, None] * a * part.sign[None, :]


@dataclass
class Watch:
    """Looks at H and the dissipation along pieces of motion in one phase, `first` to last.

    `times`, `values`: H on each island, as looked at; `findings` the worst of each kind so far.
    """

    storage: Storage
    tolerance: float
    sizes: Array
    balance: bool = True

    def __post_init__(self) -> None:
        self.times: list[Array] = []
        self.values: list[Array] = []
        self.final: tuple[Array, Array] = numpy.zeros(0), numpy.zeros((0, 0))
        islands = len(self.storage.islands)
        self.worst: dict[tuple[str, str], Finding] = {}
        self.first = self.started = numpy.full(islands, numpy.nan)
        self.lost = numpy.zeros(islands)
        self.covered_seconds = numpy.zeros(islands)
        self.names = [part.name for part in self.storage.parts]
        self.names += [f"load/{name}" for name in self.storage.plant.loaded]
        self.most = numpy.full(len(self.names), -numpy.inf)  # of each dissipation inequality so far
        self.seconds = 0.0

    def see(self, piece: Piece) -> None:
        """Take in the next piece of the motion."""
        storage = self.storage
        times = numpy.linspace(piece.start, piece.end, LOOKS + 1)
        x = piece.states(times)
        H, counted = storage.of(x), storage.claimed_of(x)
        covered = storage.covered(*counted)
        slack = GROWTH * self.tolerance * storage.uncertainty(x, self.sizes) + 1e-12 * H
        self.times.append(times[:-1])
        self.values.append(H[:-1])
        self.final = times[-1:], H[-1:]
        for k, first in enumerate(storage.first):
            if first not in storage.claimed.settling:
                continue
            rise = numpy.where(covered[:-1, k] & covered[1:, k], numpy.diff(H[:, k]), 0.0)
            worst = int(numpy.argmax(rise - slack[1:, k]))
            self._note(
                "storage", first, rise[worst], max(slack[worst + 1, k], 1e-300), "J", times[worst + 1], x[worst + 1]
            )
            self.covered_seconds[k] += covered[:-1, k].mean() * (piece.end - piece.start)
        self.seconds += piece.end - piece.start
        excess, scale = storage.excess(x)
        share = numpy.where(numpy.hstack(counted), excess / numpy.maximum(scale, 1e-300), -numpy.inf)
        for j in numpy.flatnonzero(~(share.max(axis=0) <= self.most)):  # no number is the worst of all
            t = int(numpy.argmax(share[:, j]))
            self.most[j] = share[t, j]
            self._note("dissipation", self.names[j], share[t, j], INEQUALITY, "", times[t], x[t])
        if self.balance:
            self._balance(piece, H, x)

    def _balance(self, piece: Piece, H: Array, x: Array) -> None:
        storage = self.storage
        if numpy.isnan(self.started).all():  # below the least that can be told from nothing, a share says nothing
            self.first = H[0].copy()
            self.started = numpy.maximum(self.first, storage.least(self.sizes))
        if piece.flow.held.any():  # psi is that of free inverters
            self.started, self.balance = numpy.full(len(storage.islands), numpy.nan), False
            return
        self.lost += integrate(piece, storage, self.started)
        for k, first in enumerate(storage.first):
            residual = abs(H[-1, k] + self.lost[k] - self.first[k]) / self.started[k]
            allowed = max(1e-10, 1e3 * self.tolerance)
            slack = storage.uncertainty(x[:1], 1e-15 * numpy.abs(storage.rest))[0, k] / self.started[k]
            self._note("energy balance", first, residual, allowed + 1e3 * slack, "", piece.end, x[-1])

    def _note(self, kind: str, where: str, value: float, limit: float, unit: str, time: float, state: Array) -> None:
        found = Finding(kind, where, float(value), float(limit), unit, float(time), state)
        known = self.worst.get((kind, where))
        if known is None or found.value / found.limit > known.value / known.limit or found.value != found.value:
            self.worst[kind, where] = found

    @property
    def findings(self) -> list[Finding]:
        return list(self.worst.values())

    def storages(self) -> tuple[Array, Array]:
        """When H was looked at, and H on each island. (t,), (t, islands)."""
        if not self.times:
            return numpy.zeros(0), numpy.zeros((0, len(self.storage.islands)))
        return numpy.concatenate([*self.times, self.final[0]]), numpy.concatenate([*self.values, self.final[1]])


def integrate(piece: Piece, storage: Storage, scale: Array) -> Array:
    """What each island dissipates in a piece, in joule, to about `CLOSED` of `scale`, by halving intervals."""
    nodes, weights = legendre.leggauss(NODES)
    nodes, weights = (nodes + 1) / 2, weights / 2

    def quadrature(starts: Array, lengths: Array) -> Array:
        times = (starts[:, None] + lengths[:, None] * nodes).reshape(-1)
        psi = storage.dissipated(piece.states(times)).reshape(len(starts), NODES, -1)
        return lengths[:, None] * numpy.einsum("k,ikj->ij", weights, psi)

    starts, lengths = numpy.array([piece.start]), numpy.array([piece.end - piece.start])
    coarse = quadrature(starts, lengths)
    total = numpy.zeros(len(storage.islands))
    count = 1
    while len(starts):
        halves = numpy.concatenate([lengths, lengths]) / 2
        both = numpy.concatenate([starts, starts + lengths / 2])
        fine = quadrature(both, halves)
        pairs = fine.reshape(2, len(starts), -1).sum(axis=0)
        done = (numpy.abs(pairs - coarse) <= CLOSED * scale + 1e-15 * numpy.abs(pairs)).all(axis=1)
        count += 2 * len(starts)
        if count > MAX_INTERVALS:
            done[:] = True
        total += pairs[done].sum(axis=0)
        open_ = numpy.concatenate([~done, ~done])
        starts, lengths, coarse = both[open_], halves[open_], fine[open_]
    return total
