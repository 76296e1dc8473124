"""What the events of a scenario do to the state of a microgrid.

Switching is ideal, and charge is conserved (FORMAT.md, scenarios):

- a line connects without current, its legs discharged; it takes its current and legs along when it disconnects;
- a DGU connects synchronised: its filter has the voltage of the node and carries no load, its integrator is such that
  the law asks for just the voltage that this takes; or discharged, with everything of it at zero;
- a series R-L load connects without current; new coefficients leave its current as it is;
- a new reference moves no state; a new controller takes over with an integrator that keeps the applied voltage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy

from certify.kernel.spec import Filter, LinearLoop, Microgrid
from certify.simulator.plant import Array, Inverter, Loop, Part, Plant, inverter_of, settled
from certify.simulator.scenario import Event, Target

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
    """What is on in a microgrid and how it is set, as events go by; `whole` has everything on, as it is at first.

    `branches`: which of the loads in the list of a node are series R-L loads. `law` gives the controller of a name as a
    DGU with a filter has it. `settings`: the references and controllers set so far.
    """

    def __init__(
        self,
        whole: Microgrid,
        branches: Mapping[str, Sequence[int]],
        law: Callable[[str, Filter | None], Any],
        off: Iterable[Target] = (),
        settings: Iterable[Event] = (),
    ) -> None:
        self.whole, self.off, self.branches, self.law = whole, set(off), branches, law
        self.nodes = {node.name: node for node in whole.nodes}
        self.dgus = {node.name: node.dgu for node in whole.nodes if node.dgu}
        self.lines = {line.name: line for line in whole.lines}
        self.lines_at: dict[str, list[str]] = {node.name: [] for node in whole.nodes}
        for line in whole.lines:
            self.lines_at[line.start].append(line.name)
            self.lines_at[line.end].append(line.name)
        for event in settings:
            self.set(event)

    def set(self, event: Event) -> None:
        """Another reference or controller of a DGU."""
        dgu = self.dgus[event.target]
        if event.reference_volt is not None:
            dgu = replace(dgu, reference_volt=event.reference_volt)
        if event.controller is not None:
            dgu = replace(dgu, controller=self.law(event.controller, dgu.filter))
        self.dgus[event.target] = dgu

    def loop(self, name: str) -> Loop | None:
        """The linear loop at a node as it is set now; None for an inverter."""
        dgu = self.dgus[name]
        if not isinstance(dgu.controller, LinearLoop):
            return None
        return Loop(dgu, dgu.controller, self.legs(name) + self.filter(name), float(self.whole.w0))

    def inverter(self, name: str) -> Inverter | None:
        """The inverter at a node as it is set now, on or off; None for a linear loop."""
        dgu = self.dgus[name]
        return None if isinstance(dgu.controller, LinearLoop) else inverter_of(dgu)

    def has_dgu(self, name: str) -> bool:
        return name in self.dgus and Target("DGU", name) not in self.off

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
    for event in events:
        name = event.target
        if event.action == "connect" and event.part == "line":
            line, legs = board.lines[name], {}
            for end in (line.start, line.end):
                legs[end] = board.legs(end)
            board.off.discard(event.switched)
            state["line", name] = numpy.zeros(2)
            for end, old in legs.items():
                _share_charge(board, state, end, old)
        elif event.action == "connect" and event.part == "DGU":
            old = board.legs(name)
            board.off.discard(event.switched)
            _connect_dgu(board, state, name, old, event.discharged)
        elif event.action == "disconnect":
            board.off.add(event.switched)
            for part in board.own_parts(event.switched):
                state.pop(part, None)
        elif event.action == "controller":
            _take_over(board, event, state)
        elif event.action == "reference":
            board.set(event)
            _keep_voltage(board, state, name)
        elif event.action == "connect":  # a load
            for part in board.own_parts(event.switched):
                state[part] = numpy.zeros(2)
            board.off.discard(event.switched)
    for part, at in after.slices.items():
        if part[0] == "branch":
            state.setdefault(part, numpy.zeros(2))
        elif part not in state:  # of a DGU that was never on
            state[part] = numpy.zeros(at.stop - at.start)
    return put_together(after, state)


def _keep_voltage(board: Switchboard, state: State, name: str) -> None:
    """The voltage of a linear loop is an output: what is new of it changes its states as little as it can."""
    loop = board.loop(name)
    if loop and ("loop", name) in state:
        missing = state["voltage", name] - loop.reference - loop.C @ state["loop", name]
        state["loop", name] = state["loop", name] + numpy.linalg.pinv(loop.C) @ missing


def _share_charge(board: Switchboard, state: State, name: str, old_legs: float) -> None:
    """Legs without charge have come to a node: C V stays as it is, and of a linear loop x + c B V."""
    legs, V = board.legs(name), state["voltage", name]
    loop = board.loop(name) if board.has_dgu(name) else None
    if loop:
        mass = numpy.eye(len(loop.F)) + legs * loop.raw @ loop.C
        right = state["loop", name] + loop.raw @ (old_legs * V - legs * loop.reference)
        state["loop", name] = numpy.linalg.solve(mass, right)
        state["voltage", name] = loop.reference + loop.C @ state["loop", name]
        return
    own = board.filter(name) if board.has_dgu(name) else 0.0
    if legs + own > 0:
        state["voltage", name] = V * (old_legs + own) / (legs + own)


def _connect_dgu(board: Switchboard, state: State, name: str, old_legs: float, discharged: bool) -> None:
    V, legs, loop, inverter = state["voltage", name], board.legs(name), board.loop(name), board.inverter(name)
    if loop:
        own = numpy.zeros(2) if discharged else V
        state["loop", name] = numpy.linalg.pinv(loop.C) @ (own - loop.reference)
        if discharged:
            state["voltage", name] = V  # of the legs, the charge of which the loop now has a share of
            _share_charge(board, state, name, old_legs)
        return
    if inverter is None:
        return
    voltage, w0 = complex(*V), float(board.whole.w0)
    current = 1j * w0 * inverter.capacitance_farad * voltage
    if discharged:
        state["voltage", name] = V * old_legs / (legs + inverter.capacitance_farad)
        current = 0j
    state["current", name] = numpy.array([current.real, current.imag])
    if inverter.rate:
        state["integrator", name] = numpy.zeros(2)
        if not discharged:
            wanted = voltage + complex(inverter.resistance_ohm, w0 * inverter.inductance_henry) * current
            state["integrator", name] = _settled(inverter, voltage, current, wanted)


def _settled(inverter: Inverter, V: complex, current: complex, wanted: complex) -> Array:
    try:
        return settled(inverter, V, current, wanted)
    except numpy.linalg.LinAlgError:  # an integral gain that does not reach every voltage
        return numpy.zeros(2)


def _take_over(board: Switchboard, event: Event, state: State) -> None:
    """A new controller: its integrator is such that the voltage applied, within the limits, does not jump."""
    name = event.target
    old = board.inverter(name)
    board.set(event)
    new = board.inverter(name)
    _keep_voltage(board, state, name)
    if old is None or new is None or ("current", name) not in state:  # a linear loop, or off
        return
    V, current = (complex(*state[kind, name]) for kind in ("voltage", "current"))
    u = old.law(V, current, complex(*state["integrator", name]) if old.rate else 0j)
    if old.limits_volt:
        d, q = old.limits_volt
        u = complex(min(max(u.real, -d), d), min(max(u.imag, -q), q))
    state.pop(("integrator", name), None)
    if new.rate:
        state["integrator", name] = _settled(new, V, current, u)
