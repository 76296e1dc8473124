"""How far an event throws a microgrid from where it will rest: the storage H right after the event, in joule.

H is the sum of the storage functions of the new phase's certificate, at the state in which the old phase rests and
which the events have changed. If H is below the level c of the storage that the new phase's certificate proves to be
attracted, the microgrid settles again. That is a computed figure, no proof: the rest states are those of the two
certificates (proved to a radius that is left out here), the old phase is taken to have come to rest, and switching
is ideal, as FORMAT.md has it:

- a line connects without current, its legs discharged: the charge of each end is conserved, and its voltage drops;
- a DGU connects synchronised: its filter has the voltage of the node, carries no load, and its integrator is such that
  its control law asks for just the voltage that this takes; or discharged: without current, its integrator at zero,
  and the charge of the node is shared;
- a series R-L load connects without current;
- what disconnects takes its states along;
- with a new reference no state jumps, and with a new controller its integrator takes over the voltage that is applied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.certificate import Certificate
from certify.kernel.claims import Context, Verdict
from certify.kernel.linalg import ZERO, Matrix, Vector, add, apply, identity, scale, solve
from certify.kernel.model import J, node_capacitances, to_state_feedback
from certify.kernel.reader import read_document
from certify.kernel.spec import (
    ConstantVoltage,
    Dgu,
    Filter,
    IdaPbc,
    Line,
    LinearLoop,
    Microgrid,
    Node,
    SeriesBranch,
    StateFeedback,
    decode_document,
    integrates,
)
from certify.phases import Phase, series_loads
from certify.simulator.scenario import Event, Target, law_reader
from certify.storages import proved_storages

# What a state is of: ("voltage", node), ("line", name), ("branch", node, index in the spec's list of loads),
# ("current", node of a DGU), and ("integrator", node of a DGU), which is K13 v. Values are (d, q) in V and A.
Part = tuple[str | int, ...]
State = dict[Part, Vector]
Places = dict[str, list[int]]  # for each node the indices of its series R-L loads in the spec's list of loads
Proved = tuple[Phase, Certificate]
ROUNDING = Fraction(1, 1 << 200)  # joule


@dataclass(frozen=True)
class Jump:
    """One island right after the events at the start of a phase.

    `island` is its first node; `level_joule` is None if it is not known, and if everything is attracted (`everything`).
    `parts`: the contributions to H by name, largest first. `reason` says why H or the level is not known.
    """

    island: str
    storage_joule: Fraction | None
    level_joule: Fraction | None
    everything: bool
    parts: tuple[tuple[str, Fraction], ...]
    reason: str = ""

    @property
    def share(self) -> Fraction | None:
        """H / c."""
        return None if self.storage_joule is None or not self.level_joule else self.storage_joule / self.level_joule

    @property
    def status(self) -> str:
        """ "inside" or "outside" of what the new phase is proved to attract, or "unknown"."""
        if self.storage_joule is None or (self.level_joule is None and not self.everything):
            return "unknown"
        return "inside" if self.level_joule is None or self.storage_joule < self.level_joule else "outside"


def find_jumps(whole: Microgrid, before: Proved, after: Proved) -> tuple[Jump, ...]:
    """The jumps at the start of the phase `after`, one for each of its islands.

    `whole` is the microgrid with everything on; `before` and `after` are consecutive phases with their certificates.
    """
    (old, old_certificate), (new, new_certificate) = before, after
    documents = [read_document(phase.spec) for phase in (old, new)]
    grids = [decode_document(document) for document in documents]
    context = Context(grids[1])
    was, places = (series_loads(document, phase.gone) for document, phase in zip(documents, (old, new), strict=True))
    start = _rest(grids[0], was, _facts(old_certificate.verdict))
    course = _Course(whole, old, law_reader(documents[1]), start)
    for event in new.events:
        course.follow(event)
    goal = _rest(context.grid, places, _facts(new_certificate.verdict))
    # in the states (V, I, v): a linear loop has states of its own, and is not looked at
    proved = proved_storages(context, new_certificate.data)
    storages = {name: P for name, (P, _) in proved.items() if context.port(name).capacitance_farad is not None}
    jumps = []
    for island in context.islands:
        level, everything = _level(new_certificate.verdict, island[0])
        reason = "" if level is not None or everything else f"phase {new.number} has no proved region there"
        found = dict(_contributions(context, places, island, storages, course.state, goal))
        known = [(name, value) for name, value in found.items() if value is not None]
        storage = None
        if len(known) == len(found):  # rounded, because thousands of denominators of their own explode in a sum
            storage = sum((round(value / ROUNDING) * ROUNDING for _, value in known), Fraction(0))
        elif missing := [phase for phase, rest in ((new, goal), (old, start)) if not _voltages_known(island, rest)]:
            reason = f"phase {missing[0].number} has no proved equilibrium there"
        else:
            reason = f"the state of the {next(name for name in found if found[name] is None)} is not known"
        parts = tuple(sorted(known, key=lambda part: -part[1])) if storage is not None else ()
        jumps.append(Jump(island[0], storage, level, everything, parts, reason))
    return tuple(jumps)


def _voltages_known(island: Iterable[str], rest: State) -> bool:
    return all(("voltage", name) in rest for name in island)


def _facts(verdict: Verdict) -> dict[str, Fraction]:
    """What the proved equilibria of all islands say, by name: nodes and lines have theirs, whatever the island."""
    claims = (claim for claim in verdict.claims if claim.id.startswith("equilibrium/") and claim.status == "proved")
    return {name: value for claim in claims for name, value, _ in claim.facts}


def _level(verdict: Verdict, island: str) -> tuple[Fraction | None, bool]:
    """The level c in joule of the storage on an island up to which it is attracted; or that everything is."""
    claims = (claim for claim in verdict.claims if claim.id == f"region/{island}" and claim.status == "proved")
    facts = {name: value for claim in claims for name, value, _ in claim.facts}
    return facts.get("level c of the storage"), facts.get("global") == 1


def _rest(grid: Microgrid, places: Places, facts: Mapping[str, Fraction]) -> State:
    """The equilibrium of a phase as far as it is proved: what is not is left out."""
    state: State = {}

    def pair(name: str) -> Vector | None:
        d, q = facts.get(f"{name}, d"), facts.get(f"{name}, q")
        return None if d is None or q is None else (d, q)

    def note(key: Part, value: Vector | None) -> None:
        if value is not None:
            state[key] = value

    for line in grid.lines:
        note(("line", line.name), pair(f"current in line {line.name}"))
    for node in grid.nodes:
        V = pair(f"voltage at node {node.name}")
        note(("voltage", node.name), V)
        for k, branch in enumerate(node.branches if V else ()):
            note(("branch", node.name, places[node.name][k]), V and _current(branch, V, grid.w0))
        if node.dgu:
            note(("current", node.name), pair(f"current of the DGU at node {node.name}"))
            terminal = pair(f"terminal voltage of the DGU at node {node.name}")
            note(("integrator", node.name), _integrator(node.name, node.dgu, state, terminal))
    return state


def _current(branch: SeriesBranch, voltage: Vector, w0: Fraction) -> Vector:
    """The steady current of a resistance and an inductance: I = V / (R + j w0 L)."""
    R, X = branch.resistance_ohm, w0 * branch.inductance_henry
    return apply(scale(1 / (R * R + X * X), add(scale(R, identity(2)), scale(-X, J))), voltage)


def _law(dgu: Dgu) -> tuple[StateFeedback, Vector] | None:
    """K11, K12, K13 and c of the control law u = K11 V + K12 I + K13 v + c of a DGU; None for a linear loop.

    For IDA-PBC v = -xi, and c = nu V* + ki L V* - (alpha / nu) j w0 C V* (THEORY 4), with the values of its design.
    """
    law, reference = dgu.controller, dgu.reference_volt
    if isinstance(law, LinearLoop):
        return None
    constant: Vector = reference if isinstance(law, ConstantVoltage) else (ZERO, ZERO)
    if isinstance(law, IdaPbc):
        own = law.design
        charge = apply(scale(law.design_w0 * own.capacitance_farad, J), reference)
        axes = zip(law.alpha, law.nu, law.ki, reference, charge, strict=True)
        constant = tuple((nu + ki * own.inductance_henry) * V - alpha / nu * i for alpha, nu, ki, V, i in axes)
    return to_state_feedback(law), constant


def _asked(name: str, dgu: Dgu, state: State) -> Vector | None:
    """What the law of a DGU asks for apart from its integrator: K11 V + K12 I + c, in a given state."""
    V, I, law = state.get(("voltage", name)), state.get(("current", name)), _law(dgu)  # noqa: E741
    if V is None or I is None or law is None:
        return None
    return _sum(_sum(apply(law[0].K11, V), apply(law[0].K12, I)), law[1])


def _integrator(name: str, dgu: Dgu, state: State, terminal: Vector | None) -> Vector | None:
    """What the integrator of a DGU adds to the voltage u at its terminals: K13 v, in a given state."""
    asked = _asked(name, dgu, state)
    return None if asked is None or terminal is None else _sum(terminal, asked, -1)


def _sum(a: Vector, b: Vector, sign: int = 1) -> Vector:
    return tuple(x + sign * y for x, y in zip(a, b, strict=True))


class _Course:
    """What there is, and in which state, from one event to the next; it begins where the phase before is at rest."""

    def __init__(
        self, whole: Microgrid, before: Phase, read_law: Callable[[str, Filter | None], Any], rest: State
    ) -> None:
        self.whole, self.read_law, self.state = whole, read_law, dict(rest)
        self.gone = set(before.gone)
        self.nodes = {node.name: node for node in whole.nodes}
        self.lines = {line.name: line for line in whole.lines}
        self.lines_at: dict[str, list[Line]] = {}
        for line in whole.lines:
            for end in (line.start, line.end):
                self.lines_at.setdefault(end, []).append(line)
        for event in before.settings:
            self._set(event)

    def follow(self, event: Event) -> None:
        """Go on to right after an event."""
        name, state, kind = event.target, self.state, (event.part, event.action)
        if kind == ("load", "connect"):
            state["branch", name, event.index or 0] = (ZERO, ZERO)  # that of a static load is not asked for
        elif kind == ("line", "connect"):
            self._connect(event, (self.lines[name].start, self.lines[name].end))
            state["line", name] = (ZERO, ZERO)
        elif kind == ("DGU", "connect"):
            self._connect(event, (name,) if event.discharged else ())
            self._start(name, event.discharged)
        elif event.action == "controller":
            self._exchange(event)
        elif event.action == "reference":
            self._set(event)
        elif event.action == "disconnect":
            self.gone.add(event.switched)
            own: dict[str, tuple[Part, ...]] = {"DGU": (("current", name), ("integrator", name))}
            own |= {"line": (("line", name),), "load": (("branch", name, event.index or 0),)}
            for part in own[event.part]:
                state.pop(part, None)

    def _connect(self, event: Event, ends: tuple[str, ...]) -> None:
        """Switch on; at these nodes the charge C V is conserved, what connects being discharged."""
        before = {end: self._capacitance(end) for end in ends}
        self.gone.discard(event.switched)
        for end, farad in before.items():
            V, after = self.state.get(("voltage", end)), self._capacitance(end)
            if V is not None and after:
                self.state["voltage", end] = tuple(farad / after * x for x in V)

    def _capacitance(self, name: str) -> Fraction:
        """Farad at a node, with what is on."""
        lines = tuple(x for x in self.lines_at.get(name, ()) if Target("line", x.name) not in self.gone)
        names = dict.fromkeys((name, *(end for line in lines for end in (line.start, line.end))))
        nodes = (replace(self.nodes[n], dgu=self._dgu(n)) for n in names)
        return node_capacitances(replace(self.whole, nodes=tuple(nodes), lines=lines))[name]

    def _dgu(self, name: str) -> Dgu | None:
        """The DGU at a node as it is now, if it is on."""
        return None if Target("DGU", name) in self.gone else self.nodes[name].dgu

    def _start(self, name: str, discharged: bool) -> None:
        """The states of a DGU that connects: zero, or synchronised: I = j w0 C V and u = V + (R + j w0 L) I."""
        dgu, V, w0 = self._dgu(name), self.state.get(("voltage", name)), self.whole.w0
        if V is None or dgu is None or dgu.filter is None or isinstance(dgu.controller, LinearLoop):
            return
        own = dgu.filter
        I = (ZERO, ZERO) if discharged else apply(scale(w0 * own.capacitance_farad, J), V)  # noqa: E741
        self.state["current", name] = I
        if discharged:
            self.state["integrator", name] = (ZERO, ZERO)
        else:
            impedance = add(scale(own.resistance_ohm, identity(2)), scale(w0 * own.inductance_henry, J))
            self._take_over(name, dgu, _sum(V, apply(impedance, I)))

    def _take_over(self, name: str, dgu: Dgu, terminal: Vector | None) -> None:
        """Set the integrator of a DGU so that its law asks for this voltage; it is not known if it cannot be set so."""
        found = _integrator(name, dgu, self.state, terminal) if integrates(dgu.controller) else None
        if found is None:
            self.state.pop(("integrator", name), None)
        else:
            self.state["integrator", name] = found

    def _exchange(self, event: Event) -> None:
        """Another controller: the voltage that is applied does not jump."""
        name, dgu = event.target, self._dgu(event.target)
        applied = self._applied(name, dgu) if dgu else None
        self._set(event)
        new = self._dgu(name)
        if new is not None:
            self._take_over(name, new, applied)

    def _applied(self, name: str, dgu: Dgu) -> Vector | None:
        """The voltage at the terminals of an inverter, within its limits."""
        law, asked = _law(dgu), _asked(name, dgu, self.state)
        added = self.state.get(("integrator", name)) if law and law[0].K13 is not None else (ZERO, ZERO)
        if asked is None or added is None:
            return None
        limits = dgu.limits_volt or (None, None)
        pairs = zip(_sum(asked, added), limits, strict=True)
        return tuple(u if limit is None else max(-limit, min(u, limit)) for u, limit in pairs)

    def _set(self, event: Event) -> None:
        """A reference or a controller, of what is on or off."""
        node = self.nodes[event.target]
        if node.dgu and event.reference_volt:
            self.nodes[node.name] = replace(node, dgu=replace(node.dgu, reference_volt=event.reference_volt))
        elif node.dgu and event.controller and (law := self.read_law(event.controller, node.dgu.filter)):
            self.nodes[node.name] = replace(node, dgu=replace(node.dgu, controller=law))


def _contributions(
    context: Context, places: Places, island: Iterable[str], storages: Mapping[str, Matrix], state: State, goal: State
) -> Iterator[tuple[str, Fraction | None]]:
    """The share of each part of an island in H, in joule; None if a state of the part is not known."""

    def deviation(*key: str | int) -> Vector | None:
        return _sum(state[key], goal[key], -1) if key in state and key in goal else None

    def stored(size: Fraction, *key: str | int) -> Fraction | None:
        x = deviation(*key)
        return None if x is None else size * sum(y * y for y in x) / 2

    for name in island:
        node = context.nodes[name]
        if node.dgu:
            yield f"DGU at node {name}", _dgu_storage(node, storages.get(name), deviation)
        else:
            yield f"node {name}", stored(context.capacitances["0"][name], "voltage", name)
        for k, branch in enumerate(node.branches):
            yield (
                f"series R-L load {k} at node {name}",
                stored(branch.inductance_henry, "branch", name, places[name][k]),
            )
        for line in context.lines_at[name]:
            if line.start == name:
                yield f"line {line.name}", stored(line.branch.inductance_henry, "line", line.name)


def _dgu_storage(node: Node, P: Matrix | None, deviation: Any) -> Fraction | None:
    """x~'P x~/2 with x = (V, I, v), or (V, I) without integrator."""
    parts = [deviation("voltage", node.name), deviation("current", node.name)]
    if P is not None and len(P) > 4:
        law, added = node.dgu and _law(node.dgu), deviation("integrator", node.name)
        if not law or law[0].K13 is None or added is None:
            return None
        try:
            parts.append(tuple(x for (x,) in solve(law[0].K13, tuple((x,) for x in added))))
        except ZeroDivisionError:
            return None
    if P is None or None in parts:
        return None
    x: Vector = tuple(y for part in parts for y in part)
    return sum((a * b for a, b in zip(x, apply(P, x), strict=True)), Fraction(0)) / 2
