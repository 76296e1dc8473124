"""The checker: rebuilds every claim from the spec and accepts a certificate only if each proof holds.

Nothing that the spec determines is read from the certificate: it states claims, and for each one a rule with the
numbers that the rule needs. Provenance is ignored. FORMAT.md has the grammar and the theorems.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

from certify.kernel import rules
from certify.kernel.errors import Rejected, RuleFailure
from certify.kernel.linalg import Matrix, Vector, block, identity, scale, zeros
from certify.kernel.model import LinearPort, LoadLaw, dgu_port, incidence, load_law, node_capacitances
from certify.kernel.quantity import shorten
from certify.kernel.reader import unique
from certify.kernel.spec import LinearLoop, Microgrid, SeriesBranch, components, decode

FORMAT = "certify/certificate@1"
_RATIONAL = re.compile(r"-?(?:0|[1-9]\d*)(?:/[1-9]\d*)?", re.ASCII)
MAX_DIGITS = 1_000  # of one number of a proof
Fact = tuple[str, Fraction, str]


@dataclass(frozen=True)
class Claim:
    """One statement about the spec. `facts` are exact numbers that the proof yields: (what, value, unit)."""

    id: str
    statement: str
    status: str  # "proved", "refuted" or "unknown"
    rule: str | None = None
    facts: tuple[Fact, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """What a certificate proves. `outcome` is "certified", "refuted" or "unknown"."""

    outcome: str
    claims: tuple[Claim, ...]
    assumptions: tuple[tuple[str, str], ...]


def to_text(x: Fraction) -> str:
    """A rational for people and statements: a decimal if it has a short one, else its first twelve digits or so.

    >>> to_text(Fraction(1, 8)), to_text(Fraction(1, 3))
    ('0.125', 'about 333333333333e-12')
    """
    for places in range(19):
        if (10**places) % x.denominator == 0:
            whole, digits = divmod(abs(x.numerator) * (10**places // x.denominator), 10**places)
            return f"{'-' if x < 0 else ''}{whole}" + (f".{digits:0{places}d}" if places else "")
    exponent = len(str(abs(x.numerator))) - len(str(x.denominator)) - 12
    return f"about {round(x / Fraction(10) ** exponent)}e{exponent}"


class Context:
    """The model of one spec, and what its claims have established so far."""

    def __init__(self, grid: Microgrid) -> None:
        self.grid = grid
        self.nodes = {node.name: node for node in grid.nodes}
        self.capacitances = node_capacitances(grid)
        self.islands = components(self.nodes, grid.lines)
        self.lines_from: dict[str, list[str]] = {name: [] for name in self.nodes}
        for line in grid.lines:
            self.lines_from[line.start].append(f"line/{line.name}")
        self.status: dict[str, str] = {}
        self.strict_loads: set[str] = set()
        self.storages: dict[str, tuple[Any, LinearPort, Matrix]] = {}  # what it depends on, the port, M
        self.memo: dict[Any, Any] = {}

    def key(self, name: str) -> Any:
        """What the port of the DGU at this node depends on."""
        dgu = self.nodes[name].dgu
        return dgu and (dgu.filter, dgu.controller, self.capacitances[name])

    def port(self, name: str) -> LinearPort:
        dgu = self.nodes[name].dgu
        if dgu is None:
            raise RuleFailure(f"there is no DGU at node {name}")
        try:
            port: LinearPort = self.once(self.key(name), lambda: dgu_port(dgu, self.capacitances[name], self.grid.w0))
        except ZeroDivisionError:
            raise RuleFailure("the line legs make this linear loop algebraic: C B leaves no capacitance") from None
        return port

    def law(self, name: str) -> tuple[LoadLaw, tuple[Fraction, Fraction]]:
        node = self.nodes[name]
        if node.band_volt is None:
            raise RuleFailure(f"there is no static load at node {name}")
        return self.once(("law", name), lambda: load_law(node)), node.band_volt

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Equal subsystems are computed once: the key holds all that the result depends on."""
        if key not in self.memo:
            self.memo[key] = compute()
        return self.memo[key]


Subject = tuple[str, Any]


def statements(context: Context) -> dict[str, tuple[Subject, str]]:
    """Every claim that the spec calls for, in order: id -> (its subject, what it says)."""
    claims: dict[str, tuple[Subject, str]] = {}
    grid = context.grid
    passive = "equilibrium-independent passive"
    for line in grid.lines:
        branch = f"{to_text(line.branch.resistance_ohm)} ohm, {to_text(line.branch.inductance_henry)} H"
        claims[f"line/{line.name}"] = ("branch", line.branch), f"line {line.name} ({branch}) is strictly {passive}"
    for node in grid.nodes:
        if node.dgu:
            text = f"the controlled DGU at node {node.name} is {passive}, with a positive definite storage function"
            claims[f"dgu/{node.name}"] = ("dgu", node.name), text
        if node.band_volt:
            low, high = (to_text(v) for v in node.band_volt)
            text = f"the load current at node {node.name} is monotone in the voltage for {low} V <= |V| <= {high} V"
            claims[f"load/{node.name}"] = ("load", node.name), text
        for k, branch_ in enumerate(node.branches):
            text = f"series R-L load {k} at node {node.name} is strictly {passive}"
            claims[f"branch/{node.name}/{k}"] = ("branch", branch_), text
    text = f"nodes ({len(grid.nodes)}) and lines ({len(grid.lines)}) are interconnected without loss (skew-symmetric)"
    claims["interconnection"] = ("interconnection", None), text
    for island in context.islands:
        text = f"on the island of node {island[0]} (nodes: {len(island)}) nothing but rest is without dissipation"
        claims[f"invariant-set/{island[0]}"] = ("island", island), text
    text = "every equilibrium with all load voltages strictly inside their bands is asymptotically stable"
    claims["microgrid"] = ("microgrid", None), text
    return claims


def assumptions(grid: Microgrid) -> list[dict[str, str]]:
    """The ledger: what the proof takes as given. None of these can be discharged by the tool."""
    ledger = {
        "balanced": "voltages and currents are balanced three-phase, without zero sequence",
        "synchronous-frame": f"all dq frames turn at w0 = {to_text(grid.w0)} rad/s (2 pi f to 40 digits) in phase",
        "parameters": "every R, L, C, gain and load coefficient has, and keeps, exactly the value in the spec: "
        "what a scenario changes is not covered",
        "averaged-inverter": "each inverter applies the voltage that its controller asks for, without delay or ripple",
        "equilibrium": "the statement is about every equilibrium; not claimed: that one exists, how far it attracts",
    }
    if not grid.line_legs_at_dgus:
        ledger["line-legs"] = "the capacitance of the lines at nodes with a DGU is neglected, as the spec asks"
    if own := [node.name for node in grid.nodes if node.dgu and isinstance(node.dgu.controller, LinearLoop)]:
        ledger["linear-loop"] = f"z is the voltage of the node and d the current into it, at nodes {', '.join(own)}"
    limited = [node.name for node in grid.nodes if node.dgu and node.dgu.limits_volt]
    if limited:
        ledger["unsaturated"] = f"the inverters with limits do not saturate: nodes {', '.join(limited)}"
    return [{"name": name, "statement": text} for name, text in ledger.items()]


def overall(statuses: dict[str, str]) -> str:
    """The verdict that follows from the status of every claim."""
    if "refuted" in statuses.values():
        return "refuted"
    return "certified" if set(statuses.values()) == {"proved"} else "unknown"


def proof_key(data: object) -> str:
    """The name of a shared proof: a hash of its canonical text."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def check(spec: bytes, certificate: bytes) -> Verdict:
    """Check a certificate against the spec that it is about.

    Raises: SpecError if the spec is not well formed; Rejected if the certificate does not prove what it says.
    """
    grid = decode(spec)
    document = _read(certificate)
    if document["format"] != FORMAT:
        raise Rejected("K102", "format", f"this checker reads {FORMAT}")
    if document["spec_sha256"] != hashlib.sha256(spec).hexdigest():
        raise Rejected("K103", "spec_sha256", "the certificate is about another spec, or the spec has changed")
    try:
        return _check_claims(grid, document)
    except RecursionError:
        raise Rejected("K101", "file", "nested too deeply") from None


def _check_claims(grid: Microgrid, document: dict[str, Any]) -> Verdict:
    context = Context(grid)
    expected, proofs = statements(context), document["proofs"]
    listed = document["claims"]
    if not isinstance(proofs, dict) or not isinstance(listed, list):
        raise Rejected("K101", "file", "expected a table of proofs and a list of claims")
    for key, data in proofs.items():
        if proof_key(data) != key:
            raise Rejected("K104", f"proofs.{shorten(key)}", "the proof does not have the content that its key names")
    results, used = [], set()
    for (name, (subject, text)), entry in zip(expected.items(), listed, strict=False):
        _keys(entry, {"id", "statement", "status", "rule", "proof"}, name)
        if (entry["id"], entry["statement"]) != (name, text):
            raise Rejected("K105", name, f"the spec calls for another claim here than {shorten(entry['id'])}")
        rule, key = entry["rule"], entry["proof"]
        if entry["status"] == "unknown":
            if (rule, key) != (None, None):
                raise Rejected("K106", name, "an unknown claim has neither rule nor proof")
            facts: tuple[Fact, ...] = ()
        else:
            texts = isinstance(rule, str) and isinstance(entry["status"], str)
            handler = RULES.get((subject[0], entry["status"], rule)) if texts else None
            if handler is None:
                shown = f"{shorten(entry['status'])} by {shorten(rule)}"
                raise Rejected("K107", name, f"a claim about this kind of thing cannot be {shown}")
            if not isinstance(key, str) or key not in proofs:
                raise Rejected("K108", name, "its proof is missing")
            used.add(key)
            try:
                facts = handler(context, subject[1], Data(proofs[key]))
            except RuleFailure as failure:
                raise Rejected("K201", name, f"rule {rule}: {failure}") from None
        context.status[name] = entry["status"]
        results.append(Claim(name, text, entry["status"], rule, facts))
    if len(listed) != len(expected):
        raise Rejected("K105", "claims", f"{len(listed)} claims, but the spec calls for {len(expected)}")
    if used != set(proofs):
        raise Rejected("K109", "proofs", "there is a proof that no claim uses")
    ledger = assumptions(grid)
    if document["assumptions"] != ledger:
        raise Rejected("K110", "assumptions", "the ledger is not the one that this spec calls for")
    outcome = overall(context.status)
    if document["verdict"] != outcome:
        raise Rejected("K111", "verdict", f"the claims make it {outcome}")
    return Verdict(outcome, tuple(results), tuple((entry["name"], entry["statement"]) for entry in ledger))


# --- reading ------------------------------------------------------------------------------------------------


def _read(certificate: bytes) -> dict[str, Any]:
    def no_number(text: str) -> object:
        raise ValueError(f"a bare number {shorten(text)}; rationals are written as text")

    try:
        document = json.loads(
            certificate.decode(), parse_float=no_number, parse_constant=no_number, object_pairs_hook=unique
        )
    except (ValueError, RecursionError) as error:
        raise Rejected("K101", "file", f"not a certificate: {error}") from None
    _keys(document, {"format", "spec_sha256", "claims", "proofs", "assumptions", "verdict", "provenance"}, "file")
    return document  # type: ignore[no-any-return]


def _keys(value: object, keys: set[str], where: str) -> None:
    if not isinstance(value, dict) or set(value) != keys:
        raise Rejected("K101", where, f"expected a table with exactly the keys {', '.join(sorted(keys))}")


class Data:
    """The numbers of one proof, read strictly: canonical rationals only."""

    def __init__(self, raw: object) -> None:
        self.raw = raw

    def fields(self, *names: str) -> list[Data]:
        rules.require(
            isinstance(self.raw, dict) and set(self.raw) == set(names), f"the proof needs {names or 'no data'}"
        )
        return [Data(self.raw[name]) for name in names]  # type: ignore[index]

    def items(self) -> list[Data]:
        rules.require(isinstance(self.raw, list), "expected a list in the proof")
        return [Data(entry) for entry in self.raw]  # type: ignore[attr-defined]

    def text(self) -> str:
        rules.require(isinstance(self.raw, str), "expected text in the proof")
        return str(self.raw)

    def vector(self) -> Vector:
        """Rationals in one string, separated by single spaces."""
        return tuple(_rational(part) for part in self.text().split(" "))

    def scalar(self) -> Fraction:
        return _rational(self.text())

    def matrix(self) -> Matrix:
        rules.require(sum(len(row.text()) for row in self.items()) <= 100 * MAX_DIGITS, "a matrix has too many digits")
        rows = tuple(row.vector() for row in self.items())
        rules.require(len({len(row) for row in rows}) <= 1, "the rows of a matrix differ in length")
        return rows


def _rational(text: str) -> Fraction:
    rules.require(len(text) <= MAX_DIGITS, "a number has too many digits")
    rules.require(bool(_RATIONAL.fullmatch(text)), f"not a rational number: {shorten(text)}")
    value = Fraction(text)
    rules.require(str(value) == text, f"not in lowest terms: {shorten(text)}")
    return value


# --- one handler for each rule ------------------------------------------------------------------------------


def _branch(_: Context, branch: SeriesBranch, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.series_branch(branch.resistance_ohm, branch.inductance_henry)
    return (("dissipation per squared current", branch.resistance_ohm, "ohm"),)


def full_storage(port: LinearPort, given: Matrix) -> Matrix:
    """The storage matrix P: the given part, below the node's capacitor where P B = C' fixes it (THEORY 4, step 1)."""
    c, k = port.capacitance_farad, len(given)
    if c is None:
        return given
    rules.require(k + 2 == len(port.F), f"the storage matrix does not have size {len(port.F) - 2}")
    return block([[scale(c, identity(2)), zeros(2, k)], [zeros(k, 2), given]]) if k else scale(c, identity(2))


def _storage(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    (part,) = data.fields("storage")
    port = context.port(name)
    key = (context.key(name), tuple(row.text() for row in part.items()))
    found: rules.Storage = context.once(key, lambda: rules.quadratic_storage(port, full_storage(port, part.matrix())))
    context.storages[name] = (key, port, found.M)
    facts = [("smallest pivot of the storage matrix", min(found.storage_pivots), "")]
    damped = [p for p in found.dissipation_pivots if p]
    facts.append((f"dissipation matrix of rank {len(damped)}, smallest pivot", min(damped, default=Fraction(0)), ""))
    return tuple(facts)


def _frequency(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    s0, u = data.fields("s0", "u")
    point = s0.vector()
    parts = [entry.vector() for entry in u.items()]
    rules.require(all(len(x) == 2 for x in (point, *parts)), "a complex number has two parts")
    value = rules.frequency_witness(context.port(name), (point[0], point[1]), [(x[0], x[1]) for x in parts])
    facts = [("Re s0", point[0], "1/s"), ("Im s0", point[1], "rad/s")]
    facts += [
        (f"{part} u[{k}]", x, "A") for k, entry in enumerate(parts) for part, x in zip(("Re", "Im"), entry, strict=True)
    ]
    return (*facts, ("Re(u* Z(s0) u)", value, "ohm"))


def _contradiction(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    faces, W, Y, y = data.fields("faces", "W", "Y", "y")
    chain = []
    for face in faces.items():
        kind, u, face_Y, face_y = face.fields("of", "u", "Y", "y")
        rules.require(kind.text() in ("storage", "dissipation"), "a face is of storage or of dissipation")
        vectors = tuple(v.vector() for v in face_y.items())
        chain.append(rules.Face(kind.text() == "storage", u.vector(), face_Y.matrix(), vectors))
    rules.storage_contradiction(context.port(name), chain, W.matrix(), Y.matrix(), [v.vector() for v in y.items()])
    return (("identities in the chain", Fraction(len(chain) + 1), ""),)


def _load(rule: Callable[..., bool]) -> Callable[[Context, str, Data], tuple[Fact, ...]]:
    def handler(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
        law, band = context.law(name)
        arguments: tuple[Any, ...] = ()
        if rule is rules.monotone_enclosure:
            points, bits = data.fields("points", "bits")
            arguments = (points.vector(), bits.scalar())
        else:
            data.fields()
        if context.once((rule, law, band, arguments), lambda: rule(law, band, *arguments)):
            context.strict_loads.add(name)
        return (("strictly monotone", Fraction(int(name in context.strict_loads)), ""),)

    return handler


def _pair(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    v, pair, t = data.fields("v", "pair", "t")
    ends = pair.vector()
    rules.require(len(ends) == 2, "a pair has two voltages")
    rules.voltage_pair(*context.law(name), v.scalar(), (ends[0], ends[1]), t.scalar())
    facts = [("linearisation not passive at", v.scalar(), "V"), *(("voltage of the pair", e, "V") for e in ends)]
    return (*facts, ("tangent of half the angle between them", t.scalar(), ""))


def _interconnection(context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.skew_incidence(*incidence(context.grid))
    return ()


def _island(context: Context, island: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `invariant-set` (THEORY 6): V~ = 0 follows at the pin, hence everywhere, and then every DGU rests."""
    by, at = (part.text() for part in data.fields("by", "at"))
    members, claims = set(island), context.status
    rules.require(at in members, "the pin is not on this island")
    for name in island:
        node = context.nodes[name]
        needed = [*context.lines_from[name], *(f"branch/{name}/{k}" for k in range(len(node.branches)))]
        needed += [f"load/{name}"] if node.band_volt else []
        rules.require(all(claims[c] == "proved" for c in needed), f"a line or load at node {name} is not proved")
        if node.dgu:
            rules.require(name in context.storages, f"the DGU at node {name} is not proved")
            key, port, M = context.storages[name]
            context.once((rules.rests, key), partial(rules.rests, port, M))
    if by == "load":
        rules.require(at in context.strict_loads, "the load at the pin is not strictly monotone")
    elif by == "branch":
        rules.require(bool(context.nodes[at].branches), "there is no series R-L load at the pin")
    else:
        rules.require(by == "dgu" and at in context.storages, "the pin is neither a load, a branch nor a proved DGU")
        rules.pins(*context.storages[at][1:], with_load=context.nodes[at].band_volt is not None)
    return ()


def _microgrid(context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    open_claims = [name for name, status in context.status.items() if status != "proved"]
    rules.require(not open_claims, f"{len(open_claims)} claims are not proved")
    return (("claims", Fraction(len(context.status)), ""),)


RULES: dict[tuple[str, str, str], Callable[[Context, Any, Data], tuple[Fact, ...]]] = {
    ("branch", "proved", "series-branch"): _branch,
    ("dgu", "proved", "quadratic-storage"): _storage,
    ("dgu", "refuted", "frequency-witness"): _frequency,
    ("dgu", "refuted", "storage-contradiction"): _contradiction,
    ("load", "proved", "monotone-polynomial"): _load(rules.monotone_polynomial),
    ("load", "proved", "monotone-exponential"): _load(rules.monotone_exponential),
    ("load", "proved", "monotone-enclosure"): _load(rules.monotone_enclosure),
    ("load", "refuted", "voltage-pair"): _pair,
    ("interconnection", "proved", "skew-incidence"): _interconnection,
    ("island", "proved", "invariant-set"): _island,
    ("microgrid", "proved", "passive-interconnection"): _microgrid,
}
