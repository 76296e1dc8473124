"""What the kernel says of a microgrid, as floats in the order of the simulator's states.

Every number comes from the kernel's own functions: ports, incidence, admittances, load currents, storage matrices. The
states of a DGU are (V, I, v) there; an IDA-PBC law of the simulator integrates xi = -v.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from certify.kernel import equilibrium, rules
from certify.kernel.balls import BITS, Ball, ball
from certify.kernel.claims import Context, Mode, Verdict, split
from certify.kernel.linalg import Matrix
from certify.kernel.model import feedback, incidence
from certify.kernel.spec import NO_TOLERANCE, IdaPbc, LinearLoop, Node, SeriesBranch
from certify.rests import Region, Rest, read_region, read_rest
from certify.simulator.plant import Array, Part, Plant
from certify.simulator.stamps import Stamps
from certify.storages import proved_storages

STEP = Fraction(1, 64)  # volt, for the slopes of load currents: their curvature is nothing beside it
Places = NDArray[numpy.intp]


@dataclass(frozen=True)
class Subsystem:
    """A part with a port: where its states are in the simulator, and their signs there (n,).

    x' = F x + B d, z = C x in deviations. `P`, `M`: of its storage x'P x/2 and of what it dissipates, x'M x/2, if
    proved; `shortage` in ohm.
    """

    name: str
    at: Places
    sign: Array
    F: Array
    B: Array
    C: Array
    P: Array | None = None
    M: Array | None = None
    shortage: float = 0.0


class Claimed:
    """A certificate that the kernel has accepted, beside the plant of the same spec.

    `parts` by name: "dgu/NODE", "node/NODE" (a node without a DGU), "line/NAME", "branch/NODE/K". `rests`, `saturated`
    (with inverters at their limits) and `regions` are what is proved, by the first node of each island; `settling` the
    islands on which the storage falls.
    """

    def __init__(self, plant: Plant, certificate: bytes, verdict: Verdict) -> None:
        self.plant, self.verdict = plant, verdict
        self.context = Context(plant.grid)
        self.status = {claim.id: claim.status for claim in verdict.claims}
        self.storages = proved_storages(self.context, certificate)
        proved = [claim for claim in verdict.claims if claim.status in ("proved", "conditional")]
        names = {claim.id: claim.id.partition("/")[2] for claim in proved}
        self.rests: dict[str, Rest] = {names[c.id]: read_rest(c) for c in proved if c.kind == "equilibrium"}
        self.saturated: dict[str, Rest] = {names[c.id]: read_rest(c) for c in proved if c.kind == "saturated"}
        self.regions: dict[str, Region] = {names[c.id]: read_region(c) for c in proved if c.kind == "region"}
        self.settling = {names[c.id] for c in proved if c.kind == "invariant-set"}
        self.parts = {part.name: part for part in self._parts()}

    def island(self, first: str) -> tuple[str, ...]:
        """The nodes of the island that has this first one."""
        return next(island for island in self.context.islands if island[0] == first)

    def _parts(self) -> Iterator[Subsystem]:
        for node in self.plant.grid.nodes:
            yield self._dgu(node) if node.dgu else self._lone(node)
        for line in self.plant.grid.lines:
            yield self._branch(f"line/{line.name}", ("line", line.name), line.branch)
        for node in self.plant.grid.nodes:
            own = [part for part in self.plant.branches if part[:2] == ("branch", node.name)]
            for k, (part, branch) in enumerate(zip(own, node.branches, strict=True)):
                yield self._branch(f"branch/{node.name}/{k}", part, branch)

    def _dgu(self, node: Node) -> Subsystem:
        port = self.context.port(node.name)
        at, sign = self.places(node.name)
        P = M = None
        shortage = Fraction(0)
        if node.name in self.storages:
            exact, shortage = self.storages[node.name]
            P, M = floats(exact), floats(rules.dissipation(port.F, exact))
        matrices = (floats(port.F), floats(port.B), floats(port.C))
        return Subsystem(f"dgu/{node.name}", at, sign, *matrices, P, M, float(shortage))

    def places(self, mode: Mode) -> tuple[Places, Array]:
        """Where the states of a DGU's port are in the simulator, and their signs there; of a mode the kept ones."""
        name, held = split(mode)
        dgu, slices = self.context.nodes[name].dgu, self.plant.slices
        if dgu is None or isinstance(dgu.controller, LinearLoop):
            at = _places(slices["loop", name])
            return at, numpy.ones(len(at))
        _, axes = feedback(dgu.controller, held)
        kept = [_places(slices["integrator", name])[list(axes)]] if axes else []
        at = numpy.concatenate([_places(slices["voltage", name]), _places(slices["current", name]), *kept])
        turned = -1.0 if isinstance(dgu.controller, IdaPbc) else 1.0
        return at, numpy.concatenate([numpy.ones(4), numpy.full(len(axes), turned)])

    def _lone(self, node: Node) -> Subsystem:
        """C V' = -j w0 C V + d."""
        c, one = float(self.context.capacitances["0"][node.name]), numpy.eye(2)
        own = _real(_complex(equilibrium.susceptance(self.context, node.name)))
        at = _places(self.plant.slices["voltage", node.name])
        nothing = numpy.zeros((2, 2))
        return Subsystem(f"node/{node.name}", at, numpy.ones(2), -own / c, one / c, one, c * one, nothing)

    def _branch(self, name: str, part: Part, branch: SeriesBranch) -> Subsystem:
        """L I' = -(R + j w0 L) I + d, with the storage L |I|^2 / 2."""
        L, one = float(branch.inductance_henry), numpy.eye(2)
        as_given = replace(branch, tolerance=NO_TOLERANCE[:2])
        impedance = _real(1 / _complex(equilibrium.admittance(self.context, as_given)))
        damping = 2 * float(branch.resistance_ohm) * one
        at = _places(self.plant.slices[part])
        return Subsystem(name, at, numpy.ones(2), -impedance / L, one / L, one, L * one, damping)

    def at_node(self, name: str) -> Subsystem:
        return self.parts[f"dgu/{name}"] if self.context.nodes[name].dgu else self.parts[f"node/{name}"]

    def couplings(self) -> Iterator[tuple[Subsystem, Subsystem, int]]:
        """Whose output enters whose input, with which sign: by the kernel's incidence, and loads to ground."""
        injection, drop = incidence(self.plant.grid)
        for (name, line), sign in injection.items():
            yield self.at_node(name), self.parts[f"line/{line}"], sign
        for (name, line), sign in drop.items():
            yield self.parts[f"line/{line}"], self.at_node(name), sign
        for node in self.plant.grid.nodes:
            for k in range(len(node.branches)):
                load = self.parts[f"branch/{node.name}/{k}"]
                yield self.at_node(node.name), load, -1
                yield load, self.at_node(node.name), 1

    def network(self, voltages: dict[str, complex]) -> csr_matrix:
        """The Jacobian of the whole network by the kernel's model, with its loads at these voltages. Shape (n, n).

        Of a load outside its band the kernel says nothing: its node's rows go without it.
        """
        matrix = Stamps(self.plant.size, self.plant.size)

        def add(to: Subsystem, of: Subsystem, block: Array) -> None:
            matrix.add(to.at, of.at, to.sign[:, None] * block * of.sign[None, :])

        for part in self.parts.values():
            add(part, part, part.F)
        for to, of, sign in self.couplings():
            add(to, of, sign * to.B @ of.C)
        for name in self.plant.loaded:
            part = self.at_node(name)
            if self.speaks_of(name, voltages[name]):
                add(part, part, -part.B @ self.load_slope(name, voltages[name]) @ part.C)
        return matrix.matrix()

    def speaks_of(self, name: str, V: complex) -> bool:
        """Whether the kernel says what the static loads of a node draw around a voltage: not outside their band."""
        low, high = self.context.nodes[name].band_volt or (0, None)
        return float(low + STEP) < abs(V) and (high is None or abs(V) < float(high - STEP))

    def load_current(self, name: str, V: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
        """What the kernel takes the static loads of a node to draw, in ampere: the middle of its ball.

        One given by its current is exact; a ball of it would need the margin of its denominator, from its proof.
        """
        if self.context.nodes[name].current is not None:
            return self.context.disk(name)[0].current(V)
        drawn = equilibrium.load_current(self.context, name, ball(V))
        return Fraction(drawn.x, 1 << BITS), Fraction(drawn.y, 1 << BITS)

    def load_slope(self, name: str, V: complex) -> Array:
        """d (I_d, I_q) / d (V_d, V_q) of the kernel's load current, by differences in exact arithmetic."""
        d, q = Fraction(V.real), Fraction(V.imag)
        columns = []
        for x, y in ((STEP, Fraction(0)), (Fraction(0), STEP)):
            up, down = self.load_current(name, (d + x, q + y)), self.load_current(name, (d - x, q - y))
            columns.append([float((a - b) / (2 * STEP)) for a, b in zip(up, down, strict=True)])
        return numpy.array(columns).T


def _places(at: slice) -> Places:
    return numpy.arange(at.start, at.stop)


def floats(a: Matrix) -> Array:
    return numpy.array([[float(x) for x in row] for row in a])


def _complex(z: Ball) -> complex:
    return complex(float(Fraction(z.x, 1 << BITS)), float(Fraction(z.y, 1 << BITS)))


def _real(z: complex) -> Array:
    """Multiplication by a complex number as a real matrix."""
    return numpy.array([[z.real, -z.imag], [z.imag, z.real]])
