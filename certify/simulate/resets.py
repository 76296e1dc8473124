"""What the events of a scenario do to the state of a microgrid.

Switching is ideal, and charge is conserved (FORMAT.md, scenarios):

- a line connects without current, its legs discharged; it takes its current and legs along when it disconnects;
- a DGU connects synchronised: its filter has the voltage of the node and carries no load, its integrator is such that
  the law asks for just the voltage that this takes; or discharged, with everything of it at zero;
- a series R-L load connects without current; new coefficients leave its current as it is;
- a new reference moves no state; a new controller takes over with an integrator that keeps the applied voltage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy

from certify.kernel.spec import Microgrid
from certify.simulate.plant import Array, Inverter, Part, Plant, settled
from certify.simulate.scenario import Event, Target

State = dict[Part, Array]  # of each part its own states: two, or those of a linear loop


def take_apart(plant: Plant, x: Array) -> State:
    """A state by its parts."""
    return {part: x[at] for part, at in plant.slices.items()}


def put_together(plant: Plant, state: State) -> Array:
    """The state of a plant from its parts; those that it does not have are left out. Raises: KeyError."""
    x = numpy.empty(plant.size)
    for part, at in plant.slices.items():
        x[at] = state[part]
    return x


class Switchboard:
    """What is on in a microgrid, of which `whole` has everything on; its nodes' capacitances as things are switched.

    `branches`: which of the loads in the list of a node are series R-L loads.
    """

    def __init__(self, whole: Microgrid, off: Iterable[Target], branches: Mapping[str, Sequence[int]]) -> None:
        self.whole, self.off, self.branches = whole, set(off), branches
        self.nodes = {node.name: node for node in whole.nodes}
        self.lines = {line.name: line for line in whole.lines}
        self.lines_at: dict[str, list[str]] = {node.name: [] for node in whole.nodes}
        for line in whole.lines:
            self.lines_at[line.start].append(line.name)
            self.lines_at[line.end].append(line.name)

    def has_dgu(self, name: str) -> bool:
        return self.nodes[name].dgu is not None and Target("DGU", name) not in self.off

    def legs(self, name: str) -> float:
        """Farad of the node's own shunt and of its lines' legs, without the filter's."""
        node, total = self.nodes[name], float(self.nodes[name].capacitance_farad)
        if self.has_dgu(name) and not self.whole.line_legs_at_dgus:
            return float(node.capacitance_farad)
        on = (self.lines[x] for x in self.lines_at[name] if Target("line", x) not in self.off)
        return total + sum(float(line.capacitance_farad) / 2 for line in on)

    def own_parts(self, target: Target) -> tuple[Part, ...]:
        """The states that go with what is switched off."""
        if target.part == "line":
            return (("line", target.name),)
        if target.part == "DGU":
            return tuple((kind, target.name) for kind in ("current", "integrator", "loop"))
        where = self.branches.get(target.name, ())
        return (("branch", target.name, str(where.index(target.index))),) if target.index in where else ()

    def filter(self, name: str) -> float:
        dgu = self.nodes[name].dgu
        return float(dgu.filter.capacitance_farad) if dgu and dgu.filter else 0.0


def after_events(board: Switchboard, before: Plant, after: Plant, events: Iterable[Event], x: Array) -> Array:
    """The state of the plant `after` these events, in their order, from that of the plant before them.

    `board` is what was on before them, and is switched as they say.
    """
    state = take_apart(before, x)
    for name in before.nodes:
        state["voltage", name] = numpy.array([(V := before.voltage(x, name)).real, V.imag])
    kept = dict(state)
    for event in events:
        name = event.target
        if event.action == "connect" and event.part == "line":
            line, legs = board.lines[name], {}
            for end in (line.start, line.end):
                legs[end] = board.legs(end)
            board.off.discard(event.switched)
            state["line", name] = numpy.zeros(2)
            for end, old in legs.items():
                _share_charge(board, after, state, end, old)
        elif event.action == "connect" and event.part == "DGU":
            old = board.legs(name)
            board.off.discard(event.switched)
            _connect_dgu(board, after, state, name, old, event.discharged)
        elif event.action == "disconnect":
            board.off.add(event.switched)
            for part in board.own_parts(event.switched):
                state.pop(part, None)
        elif event.action == "controller":
            _take_over(before, after, kept, state, name)
    for name, loop in after.loops.items():  # their voltage is an output, and does not jump with their reference
        if ("loop", name) in state:
            missing = state["voltage", name] - loop.reference - loop.C @ state["loop", name]
            state["loop", name] = state["loop", name] + numpy.linalg.pinv(loop.C) @ missing
    for part, at in after.slices.items():
        if part[0] == "branch":
            state.setdefault(part, numpy.zeros(2))
        elif part not in state:  # of a DGU that was never on
            state[part] = numpy.zeros(at.stop - at.start)
    return put_together(after, state)


def _share_charge(board: Switchboard, after: Plant, state: State, name: str, old_legs: float) -> None:
    """Legs without charge have come to a node: C V stays as it is, and of a linear loop x + c B V."""
    legs, V = board.legs(name), state["voltage", name]
    if name in after.loops and ("loop", name) in state:
        loop = after.loops[name]
        mass = numpy.eye(len(loop.F)) + legs * loop.raw @ loop.C
        right = state["loop", name] + loop.raw @ (old_legs * V - legs * loop.reference)
        state["loop", name] = numpy.linalg.solve(mass, right)
        state["voltage", name] = loop.reference + loop.C @ state["loop", name]
        return
    own = board.filter(name) if board.has_dgu(name) else 0.0
    if legs + own > 0:
        state["voltage", name] = V * (old_legs + own) / (legs + own)


def _connect_dgu(board: Switchboard, after: Plant, state: State, name: str, old_legs: float, discharged: bool) -> None:
    V, legs = state["voltage", name], board.legs(name)
    if name in after.loops:
        loop = after.loops[name]
        own = numpy.zeros(2) if discharged else V
        state["loop", name] = numpy.linalg.pinv(loop.C) @ (own - loop.reference)
        if discharged:
            state["voltage", name] = V  # of the legs, the charge of which the loop now has a share of
            _share_charge(board, after, state, name, old_legs)
        return
    inverter = after.inverters[name]
    voltage = complex(*V)
    current = 1j * after.w0 * inverter.capacitance_farad * voltage
    if discharged:
        state["voltage", name] = V * old_legs / (legs + inverter.capacitance_farad)
        current = 0j
    state["current", name] = numpy.array([current.real, current.imag])
    if inverter.rate:
        state["integrator", name] = numpy.zeros(2)
        if not discharged:
            wanted = voltage + complex(inverter.resistance_ohm, after.w0 * inverter.inductance_henry) * current
            state["integrator", name] = _settled(inverter, voltage, current, wanted)


def _settled(inverter: Inverter, V: complex, current: complex, wanted: complex) -> Array:
    try:
        return settled(inverter, V, current, wanted)
    except numpy.linalg.LinAlgError:  # an integral gain that does not reach every voltage
        return numpy.zeros(2)


def _take_over(before: Plant, after: Plant, kept: State, state: State, name: str) -> None:
    """A new controller: its integrator is such that the voltage applied does not jump."""
    if name not in before.inverters or name not in after.inverters or not after.inverters[name].rate:
        return
    V, current = (complex(*kept[kind, name]) for kind in ("voltage", "current"))
    old = before.inverters[name]
    u = old.law(V, current, complex(*kept["integrator", name]) if old.rate else 0j)
    if old.limits_volt:
        (d, q) = old.limits_volt
        u = complex(min(max(u.real, -d), d), min(max(u.imag, -q), q))
    state["integrator", name] = _settled(after.inverters[name], V, current, u)
