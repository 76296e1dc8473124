"""What a spec calls for: its model, the claims about it in order, and the ledger of what they assume."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple

from certify.kernel.balls import Ball
from certify.kernel.currents import CurrentLaw
from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix
from certify.kernel.model import (
    SIGNS,
    LinearPort,
    Pieces,
    at_corner,
    dgu_port,
    load_current,
    load_pieces,
    node_capacitances,
)
from certify.kernel.spec import ConstantVoltage, IdaPbc, Line, LinearLoop, Microgrid, Node, StateFeedback, components

Fact = tuple[str, Fraction, str]


@dataclass(frozen=True)
class Claim:
    """One statement about the spec. `facts` are exact numbers that the proof yields: (what, value, unit)."""

    id: str
    statement: str
    status: str  # "proved", "refuted", "unknown", or "conditional": if an assumption of the ledger holds
    rule: str | None = None
    facts: tuple[Fact, ...] = ()

    @property
    def kind(self) -> str:
        return self.id.split("/")[0]


@dataclass(frozen=True)
class Verdict:
    """What a certificate proves. `outcome` is "certified", "conditional", "refuted" or "unknown"."""

    outcome: str
    claims: tuple[Claim, ...]
    assumptions: tuple[tuple[str, str], ...]


def to_text(x: Fraction) -> str:
    """A rational for people and statements: a decimal if it has a short one, else its first twelve digits or so.

    >>> to_text(Fraction(1, 8)), to_text(Fraction(1, 3))
    ('0.125', 'about 0.333333333333')
    """
    for places in range(19):
        if (10**places) % x.denominator == 0:
            whole, digits = divmod(abs(x.numerator) * (10**places // x.denominator), 10**places)
            return f"{'-' if x < 0 else ''}{whole}" + (f".{digits:0{places}d}" if places else "")
    exponent = len(str(abs(x.numerator))) - len(str(x.denominator)) - 12
    digits = round(x / Fraction(10) ** exponent)
    near = to_text(digits * Fraction(10) ** exponent) if -18 <= exponent <= 0 else f"{digits}e{exponent}"
    return f"about {near}"


# A DGU by its node, or a mode of it under saturation: the node, and the axes "d", "q" or "dq" held at their limits.
Mode = str | tuple[str, str]


class Stored(NamedTuple):
    """What is proved of a DGU or a mode: all that it depends on, port and P at each corner of a box, M at the first."""

    key: Any
    forms: tuple[tuple[LinearPort, Matrix], ...]
    M: Matrix

    @property
    def port(self) -> LinearPort:
        return self.forms[0][0]


def split(mode: Mode) -> tuple[str, str]:
    """The node, and the axes that are held at their limits."""
    return (mode, "") if isinstance(mode, str) else mode


@dataclass(frozen=True)
class Rest:
    """A proved equilibrium: the balls of the node voltages and of the voltages at the terminals of inverters, in V."""

    voltages: dict[str, Ball]
    terminals: dict[str, Ball]


class Context:
    """The model of one spec, and what its claims have established so far."""

    def __init__(self, grid: Microgrid) -> None:
        self.grid = grid
        self.nodes = {node.name: node for node in grid.nodes}
        self.capacitances = {sign: node_capacitances(grid, sign) for sign in SIGNS}
        self.islands = components(self.nodes, grid.lines)
        self.lines_at: dict[str, list[Line]] = {name: [] for name in self.nodes}
        for line in grid.lines:
            self.lines_at[line.start].append(line)
            self.lines_at[line.end].append(line)
        self.status: dict[str, str] = {}
        self.strict_loads: set[str] = set()
        self.storages: dict[Mode, Stored] = {}
        self.shortages: dict[Mode, Fraction] = {}  # of the DGUs that are passive but for a shortage
        self.sampled: set[str] = set()  # the loads of which only evidence is given
        self.margins: dict[str, Fraction] = {}  # of the denominators of loads given by their currents
        self.moduli: dict[str, Fraction] = {}  # of strong monotonicity of the loads, as far as proved
        self.equilibria: dict[str, Rest] = {}  # by the first node of the island
        self.memo: dict[Any, Any] = {}

    def key(self, mode: Mode) -> Any:
        """What the port of the DGU at this node depends on."""
        name, held = split(mode)
        dgu = self.nodes[name].dgu
        caps = (self.capacitances[sign][name] for sign in SIGNS)
        return dgu and (dgu.filter, dgu.controller, held, held and dgu.anti_windup_second, *caps)

    def corners(self, mode: Mode) -> tuple[str, ...]:
        """The corners of the box of R, L and C at a DGU, one sign each; only "000" without tolerances."""
        name, _ = split(mode)
        dgu = self.nodes[name].dgu
        low, high = (self.capacitances[sign][name] for sign in "-+")
        off = dgu.filter.tolerance[:2] if dgu and dgu.filter else ()
        free = (*off, high - low) if off else (0, 0, high - low)
        return tuple("".join(signs) for signs in product(*("-+" if x else "0" for x in free)))

    def port(self, mode: Mode, signs: str = "000") -> LinearPort:
        """The port of a DGU at its values, or at a corner of its box."""
        name, held = split(mode)
        dgu = self.nodes[name].dgu
        if dgu is None:
            raise RuleFailure(f"there is no DGU at node {name}")
        if signs != "000" and signs not in self.corners(mode):
            raise RuleFailure("there is no such corner")
        if dgu.filter and not isinstance(dgu.controller, LinearLoop):
            dgu = replace(dgu, filter=at_corner(dgu.filter, signs))
        try:
            port: LinearPort = self.once(
                (self.key(mode), signs), lambda: dgu_port(dgu, self.capacitances[signs[2]][name], self.grid.w0, held)
            )
        except ZeroDivisionError:
            raise RuleFailure("the line legs make this linear loop algebraic: C B leaves no capacitance") from None
        return port

    def pieces(self, name: str) -> Pieces:
        """The law of the static loads at a node, on each part of its band."""
        pieces: Pieces = self.once(("load", name), lambda: load_pieces(self.nodes[name]))
        if not pieces:
            raise RuleFailure(f"there is no static load at node {name}")
        return pieces

    def disk(self, name: str) -> tuple[CurrentLaw, tuple[Fraction, Fraction], Fraction]:
        """The current of the static loads at a node, and the disk of the claim about it: centre and radius in volt."""
        node = self.nodes[name]
        if node.current is None:
            raise RuleFailure(f"no load at node {name} is given by its current")
        law: CurrentLaw = self.once(("current", name), lambda: load_current(node))
        return law, node.current.centre_volt, node.current.radius_volt

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Equal subsystems are computed once: the key holds all that the result depends on."""
        if key not in self.memo:
            self.memo[key] = compute()
        return self.memo[key]


Subject = tuple[str, Any]
BESIDE = ("mode", "saturated")  # claims that add to a verdict, and on which it does not depend
RESTS = ("equilibrium", "region")  # claims that become assumptions if they are not proved


def statements(context: Context) -> dict[str, tuple[Subject, str]]:
    """Every claim that the spec calls for, in order: id -> (its subject, what it says)."""
    claims: dict[str, tuple[Subject, str]] = {}
    grid = context.grid
    passive = "equilibrium-independent passive"

    def definite(node: Node) -> str:
        own = node.dgu.filter.tolerance if node.dgu and node.dgu.filter else ()
        box = _within(own, len(context.corners(node.name)) > 1)
        return f"{passive}, with a positive definite storage function{box}"

    for line in grid.lines:
        branch = f"{to_text(line.branch.resistance_ohm)} ohm, {to_text(line.branch.inductance_henry)} H"
        box = _within(line.branch.tolerance)
        claims[f"line/{line.name}"] = ("branch", line.branch), f"line {line.name} ({branch}) is strictly {passive}{box}"
    for node in grid.nodes:
        if node.dgu:
            text = f"the controlled DGU at node {node.name} is {definite(node)}"
            claims[f"dgu/{node.name}"] = ("dgu", node.name), text
        if node.band_volt:
            low, high = (to_text(v) for v in node.band_volt)
            box = _within([share for load in node.loads for share in load.tolerance])
            cut = any(load.cutoff_volt is not None for load in node.loads)
            box = ", where loads below their cut-off are impedances" * cut + box
            text = (
                f"the load current at node {node.name} is monotone in the voltage for {low} V <= |V| <= {high} V{box}"
            )
            claims[f"load/{node.name}"] = ("load", node.name), text
        if node.current:
            centre = " + j ".join(f"({to_text(x)})" for x in node.current.centre_volt)
            radius = to_text(node.current.radius_volt)
            text = f"the load current at node {node.name} is monotone in the voltage for |V - {centre}| <= {radius} V"
            claims[f"load/{node.name}"] = ("current", node.name), text
        for k, branch_ in enumerate(node.branches):
            text = f"series R-L load {k} at node {node.name} is strictly {passive}{_within(branch_.tolerance)}"
            claims[f"branch/{node.name}/{k}"] = ("branch", branch_), text
    text = f"nodes ({len(grid.nodes)}) and lines ({len(grid.lines)}) are interconnected without loss (skew-symmetric)"
    claims["interconnection"] = ("interconnection", None), text
    for island in context.islands:
        text = f"{_island(island)} nothing but rest is without dissipation"
        claims[f"invariant-set/{island[0]}"] = ("island", island), text
    places = "bands or disks" if any(node.current for node in grid.nodes) else "bands"
    limited = any(node.dgu and node.dgu.limits_volt for node in grid.nodes)
    inside = f"their {places}" + " and all inverters strictly inside their limits" * limited
    text = f"every equilibrium with all load voltages strictly inside {inside} is asymptotically stable"
    text += ", for all values within the tolerances" if any(", for all" in said for _, said in claims.values()) else ""
    claims["microgrid"] = ("microgrid", None), text
    for island in context.islands:
        claims |= _equilibrium_claims(context, island, text.endswith("tolerances"))
    for node in grid.nodes:
        if node.dgu and node.dgu.limits_volt and isinstance(node.dgu.controller, IdaPbc | StateFeedback):
            for held, axes in (("d", "its d axis"), ("q", "its q axis"), ("dq", "both axes")):
                text = f"with {axes} held at the limit the DGU at node {node.name} is {definite(node)}"
                claims[f"mode/{node.name}/{held}"] = ("dgu", (node.name, held)), text
    return claims


def held_at_limits(context: Context, island: Iterable[str]) -> dict[str, tuple[Fraction, Fraction]]:
    """The voltages of all inverters of an island that have limits, held at both of them as the references point.

    Empty if there is none, or if a reference has a component of zero: then it does not point to a corner. Inverters
    without feedback stay as they are; of linear loops nothing is known at their limits.
    """
    held = {}
    for name in island:
        dgu = context.nodes[name].dgu
        if dgu is None or dgu.limits_volt is None or isinstance(dgu.controller, ConstantVoltage):
            continue
        if not all(dgu.reference_volt) or isinstance(dgu.controller, LinearLoop):
            return {}
        (d, q), limits = dgu.reference_volt, dgu.limits_volt
        held[name] = (limits[0] if d > 0 else -limits[0], limits[1] if q > 0 else -limits[1])
    return held


def _island(island: tuple[str, ...]) -> str:
    return f"on the island of node {island[0]} (nodes: {len(island)})"


def _equilibrium_claims(context: Context, island: tuple[str, ...], box: bool) -> dict[str, tuple[Subject, str]]:
    """Of one island: that an equilibrium exists, from where it is reached, what if inverters are at their limits."""
    where = _island(island)
    within = ", for all values within the tolerances" if box else ""
    limited = [name for name in island for dgu in [context.nodes[name].dgu] if dgu and dgu.limits_volt]
    bands = "every load voltage strictly inside its band"
    inside = f"{bands} and every inverter strictly inside its limits" if limited else bands
    exists = f"{where} exactly one equilibrium has"
    claims: dict[str, tuple[Subject, str]] = {}
    claims[f"equilibrium/{island[0]}"] = ("equilibrium", island), f"{exists} {inside}{within}"
    text = f"{where} motion from below some level of the storage stays below it and tends to the equilibrium{within}"
    claims[f"region/{island[0]}"] = ("region", island), text
    if held_at_limits(context, island):
        held = "with both axes of all inverters that have limits held at them, in the direction of the references, "
        claims[f"saturated/{island[0]}"] = ("saturated", island), f"{held}{exists} {bands}{within}"
    return claims


def _within(shares: Iterable[Fraction], legs: bool = False) -> str:
    return ", for all values within the tolerances" if legs or any(shares) else ""


def but_for_others(statement: str) -> str:
    """What a claim about an equilibrium says if it is proved to exist, and nothing about the whole of the bands."""
    return f"{statement} - but for others: no other one is near it, and further away they are not excluded"


def but_for_a_shortage(statement: str, shortage: Fraction) -> str:
    """What a claim about a DGU says if it is proved with an index, eps in ohm."""
    return f"{statement} - but for a shortage: S' <= <z~, d~> + eps |d~|^2 with eps = {to_text(shortage)} ohm"


def grid_assumptions(grid: Microgrid) -> dict[str, str]:
    """What every proof about a microgrid takes as given, and the tool cannot discharge: name -> what is assumed."""
    ledger = {
        "balanced": "voltages and currents are balanced three-phase, without zero sequence",
        "synchronous-frame": f"all dq frames turn at w0 = {to_text(grid.w0)} rad/s (2 pi f to 40 digits) in phase",
        "parameters": "every R, L, C, gain and load coefficient has, and keeps, exactly the value in the spec, or one "
        "value within its tolerance where the spec states one: what a scenario changes is not covered",
        "averaged-inverter": "each inverter applies the voltage that its controller asks for, without delay or ripple",
    }
    if not grid.line_legs_at_dgus:
        ledger["line-legs"] = "the capacitance of the lines at nodes with a DGU is neglected, as the spec asks"
    if own := [node.name for node in grid.nodes if node.dgu and isinstance(node.dgu.controller, LinearLoop)]:
        text = "z is the voltage of the node and d the current into it; at rest without d it is the reference"
        ledger["linear-loop"] = f"{text}: nodes {', '.join(own)}"
    if any(load.cutoff_volt is not None for node in grid.nodes for load in node.loads):
        ledger["cut-off"] = "loads with a cut-off draw, below it, the current of the impedance that they are there"
    limited = [node.name for node in grid.nodes if node.dgu and node.dgu.limits_volt]
    if limited:
        text = "not covered is what inverters do beyond their limits: switching between modes, integrators that wind up"
        ledger["unsaturated"] = f"{text}: nodes {', '.join(limited)}"
    return ledger


def assumptions(context: Context) -> list[dict[str, str]]:
    """The ledger, after all claims have their status: what is taken as given, and what was not proved."""
    ledger = grid_assumptions(context.grid)
    for name in sorted(context.sampled):
        ledger[f"sampled/{name}"] = f"the load current at node {name} is monotone on its band: tried, and not proved"
    for island in context.islands:
        name, where = island[0], _island(island)
        rest, region, set_ = (context.status[f"{kind}/{name}"] for kind in (*RESTS, "invariant-set"))
        if rest == "unknown":
            ledger[f"equilibrium/{name}"] = (
                f"{where} an equilibrium exists, as it is claimed: neither proved nor refuted"
            )
        elif rest == "proved" and region == "unknown" and set_ != "unknown":
            ledger[f"region/{name}"] = f"{where} the motion starts near enough to the equilibrium: no level is proved"
    return [{"name": name, "statement": text} for name, text in ledger.items()]


def overall(statuses: dict[str, str]) -> str:
    """The verdict that follows from the status of every claim but those about what inverters do at their limits.

    That an equilibrium exists, and attracts, is an assumption if it is not proved: stability does not depend on it.
    """
    found = {
        "conditional" if status == "unknown" and name.split("/")[0] in RESTS else status
        for name, status in statuses.items()
        if name.split("/")[0] not in BESIDE
    }
    if "refuted" in found:
        return "refuted"
    if found == {"proved"}:
        return "certified"
    return "conditional" if found == {"proved", "conditional"} else "unknown"


def corner_facts(signs: str, quantities: Iterable[tuple[str, Fraction, str]]) -> tuple[Fact, ...]:
    """At which end of its tolerance each quantity is, and its value there."""
    ends = {"-": "lower", "+": "upper"}
    return tuple(
        (f"{name} at the {ends[sign]} end of its tolerance", value, unit)
        for sign, (name, value, unit) in zip(signs, quantities, strict=True)
        if sign != "0"
    )
