"""How far an event throws a microgrid from where it will rest: the storage H right after the event, in joule.

H is the sum of the storage functions of the new phase's certificate, at the state in which the old phase rests and
which the events have changed. If H is below the level c of the storage that the new phase's certificate proves to be
attracted, the microgrid settles again. That is a computed figure, no proof: the rest states are those of the two
certificates (proved to a radius that is left out here), the old phase is taken to have come to rest, and switching
is ideal:

- a line connects without current, its legs discharged: the charge of each end is conserved, and its voltage drops;
- a DGU connects synchronised: its filter has the voltage of the node, carries no load, and its integrator is such that
  its control law asks for just the voltage that this takes;
- what disconnects takes its states along.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.certificate import Certificate
from certify.kernel.claims import Context, Verdict
from certify.kernel.data import Data
from certify.kernel.linalg import Matrix, Vector, add, apply, identity, scale, solve
from certify.kernel.model import J, node_capacitances, to_state_feedback
from certify.kernel.proofs import full_storage
from certify.kernel.rules import storage_at
from certify.kernel.spec import IdaPbc, Microgrid, Node, SeriesBranch, StateFeedback, decode
from certify.phases import Phase
from certify.simulate.scenario import Event

# What a state is of: ("voltage", node), ("line", name), ("branch", node, k), ("current", node of a DGU), and
# ("integrator", node of a DGU), which is K13 v + const = u - K11 V - K12 I. Values are (d, q) in V and A.
Part = tuple[str | int, ...]
State = dict[Part, Vector]
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
    context = Context(decode(new.spec))
    start = _rest(decode(old.spec), _facts(old_certificate.verdict))
    state = _after(whole, old.off, new.events, start)
    goal = _rest(context.grid, _facts(new_certificate.verdict))
    storages = _storages(context, new_certificate)
    jumps = []
    for island in context.islands:
        level, everything = _level(new_certificate.verdict, island[0])
        reason = "" if level is not None or everything else f"phase {new.number} has no proved region there"
        found = dict(_contributions(context, island, storages, state, goal))
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


def _rest(grid: Microgrid, facts: Mapping[str, Fraction]) -> State:
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
            note(("branch", node.name, k), V and _current(branch, V, grid.w0))
        if node.dgu:
            note(("current", node.name), pair(f"current of the DGU at node {node.name}"))
            note(
                ("integrator", node.name),
                _integrator(node, state, pair(f"terminal voltage of the DGU at node {node.name}")),
            )
    return state


def _current(branch: SeriesBranch, voltage: Vector, w0: Fraction) -> Vector:
    """The steady current of a resistance and an inductance: I = V / (R + j w0 L)."""
    R, X = branch.resistance_ohm, w0 * branch.inductance_henry
    return apply(scale(1 / (R * R + X * X), add(scale(R, identity(2)), scale(-X, J))), voltage)


def _gains(node: Node) -> StateFeedback | None:
    """The control law u = K11 V + K12 I + K13 v of the DGU at a node, if it has one of this form."""
    law = node.dgu and node.dgu.controller
    return to_state_feedback(law) if isinstance(law, IdaPbc | StateFeedback) else None


def _integrator(node: Node, state: State, terminal: Vector | None) -> Vector | None:
    """What the integrator of a DGU adds to the voltage u at its terminals: u - K11 V - K12 I, in a given state."""
    V, I = state.get(("voltage", node.name)), state.get(("current", node.name))  # noqa: E741
    gains = _gains(node)
    if V is None or I is None or terminal is None or gains is None:
        return None
    return _sum(terminal, _sum(apply(gains.K11, V), apply(gains.K12, I)), -1)


def _sum(a: Vector, b: Vector, sign: int = 1) -> Vector:
    return tuple(x + sign * y for x, y in zip(a, b, strict=True))


def _after(whole: Microgrid, off: Iterable[str], events: Iterable[Event], rest: State) -> State:
    """The state after events at one time, in their order; `off` is what is off before them."""
    state, gone = dict(rest), set(off)
    for event in events:
        if event.action == "connect":
            (_connect_dgu if event.part == "DGU" else _connect_line)(whole, gone, event.target, state)
            gone.discard(event.target)
        elif event.action == "disconnect":
            gone.add(event.target)
            kinds = ("current", "integrator") if event.part == "DGU" else ("line",)
            for kind in kinds:
                state.pop((kind, event.target), None)
    return state


def _connect_dgu(whole: Microgrid, _: set[str], name: str, state: State) -> None:
    """A DGU connects at the voltage V of its node, without load: I = j w0 C V and u = V + (R + j w0 L) I."""
    node = next(node for node in whole.nodes if node.name == name)
    V = state.get(("voltage", name))
    if V is None or node.dgu is None or node.dgu.filter is None:
        return
    own, w0 = node.dgu.filter, whole.w0
    I = apply(scale(w0 * own.capacitance_farad, J), V)  # noqa: E741
    state["current", name] = I
    impedance = add(scale(own.resistance_ohm, identity(2)), scale(w0 * own.inductance_henry, J))
    integrator = _integrator(node, state, _sum(V, apply(impedance, I)))
    if integrator is not None:
        state["integrator", name] = integrator


def _connect_line(whole: Microgrid, off: set[str], name: str, state: State) -> None:
    """A line connects without current, its legs discharged: C V is conserved at both ends."""
    line = next(line for line in whole.lines if line.name == name)
    state["line", name] = (Fraction(0), Fraction(0))
    before, after = (node_capacitances(_switched(whole, gone)) for gone in (off, off - {name}))
    for end in (line.start, line.end):
        V = state.get(("voltage", end))
        if V is not None and after[end]:
            state["voltage", end] = tuple(before[end] / after[end] * x for x in V)


def _switched(whole: Microgrid, off: set[str]) -> Microgrid:
    nodes = tuple(replace(node, dgu=None) if node.name in off else node for node in whole.nodes)
    return replace(whole, nodes=nodes, lines=tuple(line for line in whole.lines if line.name not in off))


def _storages(context: Context, certificate: Certificate) -> dict[str, Matrix]:
    """The storage matrix P of each DGU that the certificate proves, in the states (V, I, v)."""
    document: dict[str, Any] = json.loads(certificate.data)
    found = {}
    for entry in document["claims"]:
        kind, _, name = entry["id"].partition("/")
        if kind == "dgu" and name in context.nodes and entry["rule"] in ("quadratic-storage", "index-storage"):
            port, given = context.port(name), Data(document["proofs"][entry["proof"]]["storage"]).matrix()
            if port.capacitance_farad is not None:  # a linear loop has states of its own
                exact = entry["rule"] == "quadratic-storage"
                found[name] = full_storage(port, given) if exact else storage_at(port, given)
    return found


def _contributions(
    context: Context, island: Iterable[str], storages: Mapping[str, Matrix], state: State, goal: State
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
            yield f"series R-L load {k} at node {name}", stored(branch.inductance_henry, "branch", name, k)
        for line in context.lines_at[name]:
            if line.start == name:
                yield f"line {line.name}", stored(line.branch.inductance_henry, "line", line.name)


def _dgu_storage(node: Node, P: Matrix | None, deviation: Any) -> Fraction | None:
    """x~'P x~/2 with x = (V, I, v), or (V, I) without integrator."""
    parts = [deviation("voltage", node.name), deviation("current", node.name)]
    if P is not None and len(P) > 4:
        gains, integrator = _gains(node), deviation("integrator", node.name)
        if gains is None or gains.K13 is None or integrator is None:
            return None
        try:  # K13 v~ = u~ - K11 V~ - K12 I~, of the voltages and currents before the jump: v itself does not jump
            parts.append(tuple(x for (x,) in solve(gains.K13, tuple((x,) for x in integrator))))
        except ZeroDivisionError:
            return None
    if P is None or None in parts:
        return None
    x: Vector = tuple(y for part in parts for y in part)
    return sum((a * b for a, b in zip(x, apply(P, x), strict=True)), Fraction(0)) / 2
