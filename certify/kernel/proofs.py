"""The proofs of a certificate, read strictly, and one handler for each rule: from data and model to its theorem."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import partial
from typing import Any

from certify.kernel import rules
from certify.kernel.claims import Context, Fact, to_text
from certify.kernel.linalg import Matrix, Vector, block, identity, scale, zeros
from certify.kernel.model import SIGNS, LinearPort, LoadLaw, at_corner, incidence, law_at, law_corners, less_conductance
from certify.kernel.quantity import shorten
from certify.kernel.spec import Filter, SeriesBranch

_RATIONAL = re.compile(r"-?(?:0|[1-9]\d*)(?:/[1-9]\d*)?", re.ASCII)
MAX_DIGITS = 1_000  # of one number of a proof
# What a proof may cost, where a box of tolerances multiplies it: corners times the size of the work at each of them.
MAX_LOAD_WORK = 1 << 21  # squared degree times bits of a coefficient
MAX_CELL_WORK = 1 << 17  # points times bits
MAX_STORAGE_WORK = 40_000  # characters of a storage matrix


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


def least_resistance(branch: SeriesBranch) -> Fraction:
    """In ohm, at the lower end of its tolerance."""
    return branch.resistance_ohm * (1 - branch.tolerance[0])


def _branch(_: Context, branch: SeriesBranch, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.series_branch(least_resistance(branch), branch.inductance_henry * (1 - branch.tolerance[1]))
    return (("dissipation per squared current", least_resistance(branch), "ohm"),)


def full_storage(port: LinearPort, given: Matrix) -> Matrix:
    """The storage matrix P: the given part, below the node's capacitor where P B = C' fixes it (THEORY 4, step 1)."""
    c, k = port.capacitance_farad, len(given)
    if c is None:
        return given
    rules.require(k + 2 == len(port.F), f"the storage matrix does not have size {len(port.F) - 2}")
    return block([[scale(c, identity(2)), zeros(2, k)], [zeros(k, 2), given]]) if k else scale(c, identity(2))


def _storage(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    (part,) = data.fields("storage")
    rules.require(context.corners(name) == ("000",), "with tolerances a shortage has to be stated")
    port = context.port(name)
    key = (context.key(name), tuple(row.text() for row in part.items()))
    found: rules.Storage = context.once(key, lambda: rules.quadratic_storage(port, full_storage(port, part.matrix())))
    context.storages[name] = (key, port, found.M)
    facts = [("smallest pivot of the storage matrix", min(found.storage_pivots), "")]
    damped = [p for p in found.dissipation_pivots if p]
    facts.append((f"dissipation matrix of rank {len(damped)}, smallest pivot", min(damped, default=Fraction(0)), ""))
    return tuple(facts)


def _index(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """Rule `index-storage`, at every corner of the box (THEORY 10); a witness tells how small a shortage can be."""
    witness, raw = _optional(data, "witness")
    shortage_text, part = Data(raw).fields("shortage", "storage")
    shortage = shortage_text.scalar()
    corners = context.corners(name)
    work = len(corners) * sum(len(row.text()) for row in part.items())
    rules.require(work <= MAX_STORAGE_WORK, "the storage matrix has too many digits")
    rules.require(
        corners == ("000",) or context.port(name).capacitance_farad is not None,
        "no rule covers the tolerance of the lines at a linear loop",
    )

    def prove() -> list[rules.Storage]:
        P0 = part.matrix()
        rules.require(len(P0) == len(context.port(name).F) == len(P0[0]), "the storage matrix has another size")
        ports = [context.port(name, signs) for signs in corners]
        return [rules.index_storage(port, rules.storage_at(port, P0), shortage) for port in ports]

    key = (context.key(name), shortage, tuple(row.text() for row in part.items()))
    found: list[rules.Storage] = context.once(key, prove)
    strict = all(min(storage.dissipation_pivots) > 0 for storage in found)
    rules.require(len(found) == 1 or strict, "the dissipation is not positive definite at every corner")
    context.storages[name] = (key, context.port(name, corners[0]), found[0].M)
    context.shortages[name] = shortage
    facts = [("shortage eps", shortage, "ohm")]
    if witness is not None:
        _, u, value = _point(context.port(name), Data(witness))
        least = -value / sum(x * x for entry in u for x in entry)
        facts.append(("no shortage is enough below", least, "ohm"))
    if len(found) > 1:
        facts.append(("corners of the box of tolerances", Fraction(len(found)), ""))
    smallest = min(min(storage.dissipation_pivots) for storage in found)
    return (*facts, ("smallest pivot of the dissipation matrix", smallest, ""))


Complex = tuple[Fraction, Fraction]


def _point(port: LinearPort, data: Data) -> tuple[Complex, list[Complex], Fraction]:
    """s0, u and Re(u* Z(s0) u) of a frequency witness."""
    s0, u = data.fields("s0", "u")
    point, *parts = (entry.vector() for entry in (s0, *u.items()))
    rules.require(all(len(x) == 2 for x in (point, *parts)), "a complex number has two parts")
    pairs = [(x[0], x[1]) for x in parts]
    return (point[0], point[1]), pairs, rules.frequency_witness(port, (point[0], point[1]), pairs)


def _optional(data: Data, name: str) -> tuple[Any, dict[str, Any]]:
    """A field that a proof may have, or None, and the other fields."""
    rules.require(isinstance(data.raw, dict), "a proof is a table")
    raw: dict[str, Any] = dict(data.raw)  # type: ignore[call-overload]
    return raw.pop(name, None), raw


def _corner(data: Data) -> tuple[str, dict[str, Any]]:
    """The corner of the box that a refutation is about ("" for the values themselves), and the other fields."""
    signs, raw = _optional(data, "corner")
    text = "" if signs is None else Data(signs).text()
    rules.require(set(text) <= set(SIGNS) and (signs is None or text != ""), "a corner is named by signs")
    return text, raw


def _frequency(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    signs, raw = _corner(data)
    s0, parts, value = _point(context.port(name, signs or "000"), Data(raw))
    facts = [("Re s0", s0[0], "1/s"), ("Im s0", s0[1], "rad/s")]
    facts += [
        (f"{part} u[{k}]", x, "A") for k, entry in enumerate(parts) for part, x in zip(("Re", "Im"), entry, strict=True)
    ]
    return (*_dgu_corner(context, name, signs), *facts, ("Re(u* Z(s0) u)", value, "ohm"))


def _corner_facts(signs: str, quantities: Iterable[tuple[str, Fraction, str]]) -> tuple[Fact, ...]:
    """At which end of its tolerance each quantity is, and its value there."""
    ends = {"-": "lower", "+": "upper"}
    return tuple(
        (f"{name} at the {ends[sign]} end of its tolerance", value, unit)
        for sign, (name, value, unit) in zip(signs, quantities, strict=True)
        if sign != "0"
    )


def _dgu_corner(context: Context, name: str, signs: str) -> tuple[Fact, ...]:
    dgu = context.nodes[name].dgu if signs else None
    if dgu is None:
        return ()
    own = at_corner(dgu.filter, signs) if dgu.filter else Filter(Fraction(0), Fraction(0), Fraction(0))
    total = context.capacitances[signs[2]][name]
    return _corner_facts(signs, [("R", own.resistance_ohm, "ohm"), ("L", own.inductance_henry, "H"), ("C", total, "F")])


def _contradiction(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    signs, raw = _corner(data)
    faces, W, Y, y = Data(raw).fields("faces", "W", "Y", "y")
    chain = []
    for face in faces.items():
        kind, weights, U, face_Y, face_y = face.fields("of", "weights", "U", "Y", "y")
        rules.require(kind.text() in ("storage", "dissipation"), "a face is of storage or of dissipation")
        of_storage = kind.text() == "storage"
        chain.append(rules.Face(of_storage, weights.vector(), U.matrix(), face_Y.matrix(), face_y.matrix()))
    port = context.port(name, signs or "000")
    rules.storage_contradiction(port, chain, W.matrix(), Y.matrix(), y.matrix())
    return (*_dgu_corner(context, name, signs), ("identities in the chain", Fraction(len(chain) + 1), ""))


def _load(rule: Callable[..., bool]) -> Callable[[Context, str, Data], tuple[Fact, ...]]:
    def handler(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
        """At every corner of the coefficients: the symmetric part of the Jacobian is linear in them (THEORY 5)."""
        law, band = context.law(name)
        modulus_text, raw = _optional(data, "modulus")
        modulus = Data(modulus_text).scalar() if modulus_text is not None else Fraction(0)
        rules.require(modulus > 0 or modulus_text is None, "the modulus is not positive")
        corners = law_corners(law)
        arguments: tuple[Any, ...] = ()
        if rule is rules.monotone_enclosure:
            points, bits = Data(raw).fields("points", "bits")
            arguments = (points.vector(), bits.scalar())
            work = len(corners) * len(arguments[0]) * arguments[1]
            rules.require(work <= MAX_CELL_WORK, "too many points, bits or corners")
        else:
            Data(raw).fields()
            rules.require(len(corners) * law_work(law) <= MAX_LOAD_WORK or len(corners) == 1, "too many corners")

        def prove() -> bool:
            laws = [law_at(law, signs) for signs in corners]
            laws = [less_conductance(x, modulus) if modulus else x for x in laws]
            strict = [rule(x, band, *arguments) for x in laws]  # a list: each corner must pass
            return all(strict)

        if context.once((rule, law, band, arguments, modulus), prove) or modulus:
            context.strict_loads.add(name)
        context.moduli[name] = modulus
        facts: tuple[Fact, ...] = (("strictly monotone", Fraction(int(name in context.strict_loads)), ""),)
        return (*facts, ("strongly monotone with modulus", modulus, "S")) if modulus else facts

    return handler


def law_work(law: LoadLaw) -> int:
    """What one Sturm sequence of a law costs, about: squared degree times bits."""
    terms = (*law.active, *law.reactive)
    degree = max((int(term.exponent) for term in terms), default=0)
    numbers = [x for t in terms for x in (t.coefficient, t.spread)]
    return degree**2 * max((x.numerator.bit_length() + x.denominator.bit_length() for x in numbers), default=0)


def _pair(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    signs, raw = _corner(data)
    v, pair, t = Data(raw).fields("v", "pair", "t")
    ends = pair.vector()
    rules.require(len(ends) == 2, "a pair has two voltages")
    law, band = context.law(name)
    terms = (*law.active, *law.reactive)
    signs = signs or "0" * len(terms)
    rules.require(len(signs) == len(terms), "a corner has one sign for each term")
    rules.require(all(sign == "0" or x.spread for sign, x in zip(signs, terms, strict=True)), "no tolerance there")
    corner = law_at(law, signs)
    rules.voltage_pair(corner, band, v.scalar(), (ends[0], ends[1]), t.scalar())
    quantities = [
        (f"{part} / (v / {to_text(x.base_volt)} V)^{to_text(x.exponent)}", x.coefficient, unit)
        for part, unit, side in (("P", "W", corner.active), ("Q", "var", corner.reactive))
        for x in side
    ]
    facts = [("linearisation not passive at", v.scalar(), "V"), *(("voltage of the pair", e, "V") for e in ends)]
    return (*_corner_facts(signs, quantities), *facts, ("tangent of half the angle between them", t.scalar(), ""))


def _interconnection(context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.skew_incidence(*incidence(context.grid))
    return ()


def _island(context: Context, island: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `invariant-set` (THEORY 6): V~ = 0 follows at the pin, hence everywhere, and then every DGU rests."""
    by, at = (part.text() for part in data.fields("by", "at"))
    members, claims = set(island), context.status
    shortages: dict[str, Fraction] = {}
    facts: tuple[Fact, ...] = ()
    rules.require(at in members, "the pin is not on this island")
    for name in island:
        node = context.nodes[name]
        needed = [
            *(f"line/{line.name}" for line in context.lines_at[name]),
            *(f"branch/{name}/{k}" for k in range(len(node.branches))),
        ]
        needed += [f"load/{name}"] if node.band_volt else []
        rules.require(all(claims[c] == "proved" for c in needed), f"a line or load at node {name} is not proved")
        if node.dgu:
            rules.require(name in context.storages, f"the DGU at node {name} is not proved")
            key, port, M = context.storages[name]
            context.once((rules.rests, key), partial(rules.rests, port, M))
        if name in context.shortages:
            shortages[name] = context.shortages[name]
            if node.band_volt:
                lipschitz = context.once(("lipschitz", *context.law(name)), partial(_lipschitz, context, name))
                shortages[name] = rules.shortage_with_load(shortages[name], context.moduli[name], lipschitz)
    if shortages:
        edges: list[tuple[Fraction, tuple[str, ...]]] = []
        for name in island:
            lines = (line for line in context.lines_at[name] if line.start == name)
            edges += [(least_resistance(line.branch), (line.start, line.end)) for line in lines]
            edges += [(least_resistance(branch), (name,)) for branch in context.nodes[name].branches]
        used = rules.covered_shortages([e for e in edges if any(node in shortages for node in e[1])], shortages)
        facts = (
            (
                "largest part of a branch's resistance that shortages take (at 1 all branches are weighed together)",
                used,
                "",
            ),
        )
    if by == "load":
        rules.require(at in context.strict_loads, "the load at the pin is not strictly monotone")
    elif by == "branch":
        rules.require(bool(context.nodes[at].branches), "there is no series R-L load at the pin")
    else:
        rules.require(by == "dgu" and at in context.storages, "the pin is neither a load, a branch nor a proved DGU")
        free_load = context.nodes[at].band_volt is not None and at not in shortages
        rules.pins(*context.storages[at][1:], with_load=free_load)
    return facts


def _lipschitz(context: Context, name: str) -> Fraction:
    return rules.lipschitz_bound(*context.law(name))


def _microgrid(context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    open_claims = [name for name, status in context.status.items() if status != "proved"]
    rules.require(not open_claims, f"{len(open_claims)} claims are not proved")
    return (("claims", Fraction(len(context.status)), ""),)


RULES: dict[tuple[str, str, str], Callable[[Context, Any, Data], tuple[Fact, ...]]] = {
    ("branch", "proved", "series-branch"): _branch,
    ("dgu", "proved", "quadratic-storage"): _storage,
    ("dgu", "proved", "index-storage"): _index,
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
