"""The proofs of a certificate, read strictly, and one handler for each rule: from data and model to its theorem."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

from certify.kernel import equilibrium, load_proofs, region, rules
from certify.kernel.claims import Context, Fact, Mode, Stored, corner_facts, split
from certify.kernel.data import Data
from certify.kernel.errors import require
from certify.kernel.linalg import Matrix, block, identity, scale, zeros
from certify.kernel.model import LinearPort, at_corner, incidence
from certify.kernel.spec import Filter, SeriesBranch

HOLDS = ("proved", "conditional")
MAX_FACT_BITS = 4_096
MAX_STORAGE_WORK = 40_000  # characters of a storage matrix times the corners of a box of tolerances


def least_resistance(branch: SeriesBranch) -> Fraction:
    """In ohm, at the lower end of its tolerance."""
    return branch.resistance_ohm * (1 - branch.tolerance[0])


def _branch(_: Context, branch: SeriesBranch, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.series_branch(least_resistance(branch), branch.inductance_henry * (1 - branch.tolerance[1]))
    return (("dissipation per squared current", least_resistance(branch), "ohm"),)


def _short(x: Fraction) -> Fraction:
    """A pivot for people to read, rounded down if it is so long that it could hardly be printed."""
    return x if x.numerator.bit_length() + x.denominator.bit_length() <= MAX_FACT_BITS else rules.lowered(x)


def full_storage(port: LinearPort, given: Matrix) -> Matrix:
    """The storage matrix P: the given part, below the node's capacitor where P B = C' fixes it (THEORY 4, step 1)."""
    c, k = port.capacitance_farad, len(given)
    if c is None:
        return given
    require(k + 2 == len(port.F), f"the storage matrix does not have size {len(port.F) - 2}")
    return block([[scale(c, identity(2)), zeros(2, k)], [zeros(k, 2), given]]) if k else scale(c, identity(2))


def _storage(context: Context, name: Mode, data: Data) -> tuple[Fact, ...]:
    (part,) = data.fields("storage")
    require(context.corners(name) == ("000",), "with tolerances a shortage has to be stated")
    port = context.port(name)
    key = (context.key(name), tuple(row.text() for row in part.items()))
    P: Matrix = context.once(("P", key), lambda: full_storage(port, part.matrix()))
    found: rules.Storage = context.once(key, lambda: rules.quadratic_storage(port, P))
    context.storages[name] = Stored(key, ((port, P),), found.M)
    facts = [("smallest pivot of the storage matrix", _short(min(found.storage_pivots)), "")]
    damped = [p for p in found.dissipation_pivots if p]
    least = _short(min(damped, default=Fraction(0)))
    facts.append((f"dissipation matrix of rank {len(damped)}, smallest pivot", least, ""))
    return tuple(facts)


def _index(context: Context, name: Mode, data: Data) -> tuple[Fact, ...]:
    """Rule `index-storage`, at every corner of the box (THEORY 10); a witness tells how small a shortage can be."""
    witness, rest = data.optional("witness")
    shortage_text, part = rest.fields("shortage", "storage")
    shortage = shortage_text.scalar()
    corners = context.corners(name)
    work = len(corners) * sum(len(row.text()) for row in part.items())
    require(work <= MAX_STORAGE_WORK, "the storage matrix has too many digits")
    require(
        corners == ("000",) or context.port(name).capacitance_farad is not None,
        "no rule covers the tolerance of the lines at a linear loop",
    )

    def prove() -> tuple[tuple[tuple[LinearPort, Matrix], ...], list[rules.Storage]]:
        P0 = part.matrix()
        require(len(P0) == len(context.port(name).F) == len(P0[0]), "the storage matrix has another size")
        forms = tuple((port, rules.storage_at(port, P0)) for port in (context.port(name, signs) for signs in corners))
        return forms, [rules.index_storage(port, P, shortage) for port, P in forms]

    key = (context.key(name), shortage, tuple(row.text() for row in part.items()))
    forms, found = context.once(key, prove)
    strict = all(min(storage.dissipation_pivots) > 0 for storage in found)
    require(len(found) == 1 or strict, "the dissipation is not positive definite at every corner")
    context.storages[name] = Stored(key, forms, found[0].M)
    context.shortages[name] = shortage
    facts = [("shortage eps", shortage, "ohm")]
    if witness is not None:
        _, u, value = _point(context.port(name), witness)
        least = -value / sum(x * x for entry in u for x in entry)
        facts.append(("no shortage is enough below", least, "ohm"))
    if len(found) > 1:
        facts.append(("corners of the box of tolerances", Fraction(len(found)), ""))
    smallest = _short(min(min(storage.dissipation_pivots) for storage in found))
    return (*facts, ("smallest pivot of the dissipation matrix", smallest, ""))


Complex = tuple[Fraction, Fraction]


def _point(port: LinearPort, data: Data) -> tuple[Complex, list[Complex], Fraction]:
    """s0, u and Re(u* Z(s0) u) of a frequency witness."""
    s0, u = data.fields("s0", "u")
    point, *parts = (entry.vector() for entry in (s0, *u.items()))
    require(all(len(x) == 2 for x in (point, *parts)), "a complex number has two parts")
    pairs = [(x[0], x[1]) for x in parts]
    return (point[0], point[1]), pairs, rules.frequency_witness(port, (point[0], point[1]), pairs)


def _frequency(context: Context, name: Mode, data: Data) -> tuple[Fact, ...]:
    signs, rest = data.corner()
    s0, parts, value = _point(context.port(name, signs or "000"), rest)
    facts = [("Re s0", s0[0], "1/s"), ("Im s0", s0[1], "rad/s")]
    facts += [
        (f"{part} u[{k}]", x, "A") for k, entry in enumerate(parts) for part, x in zip(("Re", "Im"), entry, strict=True)
    ]
    return (*_dgu_corner(context, name, signs), *facts, ("Re(u* Z(s0) u)", value, "ohm"))


def _dgu_corner(context: Context, mode: Mode, signs: str) -> tuple[Fact, ...]:
    name, _ = split(mode)
    dgu = context.nodes[name].dgu if signs else None
    if dgu is None:
        return ()
    own = at_corner(dgu.filter, signs) if dgu.filter else Filter(Fraction(0), Fraction(0), Fraction(0))
    total = context.capacitances[signs[2]][name]
    return corner_facts(signs, [("R", own.resistance_ohm, "ohm"), ("L", own.inductance_henry, "H"), ("C", total, "F")])


def _contradiction(context: Context, name: Mode, data: Data) -> tuple[Fact, ...]:
    signs, rest = data.corner()
    faces, W, Y, y = rest.fields("faces", "W", "Y", "y")
    chain = []
    for face in faces.items():
        kind, weights, U, face_Y, face_y = face.fields("of", "weights", "U", "Y", "y")
        require(kind.text() in ("storage", "dissipation"), "a face is of storage or of dissipation")
        of_storage = kind.text() == "storage"
        chain.append(rules.Face(of_storage, weights.vector(), U.matrix(), face_Y.matrix(), face_y.matrix()))
    port = context.port(name, signs or "000")
    rules.storage_contradiction(port, chain, W.matrix(), Y.matrix(), y.matrix())
    return (*_dgu_corner(context, name, signs), ("identities in the chain", Fraction(len(chain) + 1), ""))


def _interconnection(context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    rules.skew_incidence(*incidence(context.grid))
    return ()


def _island(status: str, context: Context, island: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `invariant-set` (THEORY 6): V~ = 0 follows at the pin, hence everywhere, and then every DGU rests."""
    _require_status(status, any(name in context.sampled for name in island))
    by, at = (part.text() for part in data.fields("by", "at"))
    members, claims = set(island), context.status
    shortages: dict[str, Fraction] = {}
    facts: tuple[Fact, ...] = ()
    require(at in members, "the pin is not on this island")
    for name in island:
        node = context.nodes[name]
        needed = [
            *(f"line/{line.name}" for line in context.lines_at[name]),
            *(f"branch/{name}/{k}" for k in range(len(node.branches))),
        ]
        needed += [f"load/{name}"] if node.has_static_load else []
        require(all(claims[c] in HOLDS for c in needed), f"a line or load at node {name} is not proved")
        if node.dgu:
            require(name in context.storages, f"the DGU at node {name} is not proved")
            stored = context.storages[name]
            context.once((rules.rests, stored.key), partial(rules.rests, stored.port, stored.M))
        if name in context.shortages:
            shortages[name] = context.shortages[name]
            if node.has_static_load:
                lipschitz = load_proofs.lipschitz(context, name)
                modulus = context.moduli.get(name, Fraction(0))  # nothing is known of a load that is only sampled
                shortages[name] = rules.shortage_with_load(shortages[name], modulus, lipschitz)
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
        require(at in context.strict_loads, "the load at the pin is not strictly monotone")
    elif by == "branch":
        require(bool(context.nodes[at].branches), "there is no series R-L load at the pin")
    else:
        require(by == "dgu" and at in context.storages, "the pin is neither a load, a branch nor a proved DGU")
        free_load = context.nodes[at].has_static_load and at not in shortages
        rules.pins(context.storages[at].port, context.storages[at].M, with_load=free_load)
    return facts


def _require_status(status: str, sampled: bool) -> None:
    """What rests on a load that is only sampled is conditional itself."""
    require(status == ("conditional" if sampled else "proved"), "the claim rests on a load that is only sampled")


def _microgrid(status: str, context: Context, _: None, data: Data) -> tuple[Fact, ...]:
    data.fields()
    _require_status(status, bool(context.sampled))
    open_claims = [name for name, status in context.status.items() if status not in HOLDS]
    require(not open_claims, f"{len(open_claims)} claims are not proved")
    return (("claims", Fraction(len(context.status)), ""),)


RULES: dict[tuple[str, str, str], Callable[[Context, Any, Data], tuple[Fact, ...]]] = {
    ("branch", "proved", "series-branch"): _branch,
    ("dgu", "proved", "quadratic-storage"): _storage,
    ("dgu", "proved", "index-storage"): _index,
    ("dgu", "refuted", "frequency-witness"): _frequency,
    ("dgu", "refuted", "storage-contradiction"): _contradiction,
    **{("load", "proved", name): load_proofs.monotone(name) for name in load_proofs.METHODS if name != "sampled"},
    ("load", "conditional", "sampled"): load_proofs.sampled,
    ("current", "proved", "monotone-disk"): load_proofs.disk,
    ("current", "conditional", "sampled"): load_proofs.sampled_disk,
    ("current", "refuted", "current-pair"): load_proofs.current_pair,
    ("load", "refuted", "voltage-pair"): load_proofs.pair,
    ("interconnection", "proved", "skew-incidence"): _interconnection,
    **{("island", status, "invariant-set"): partial(_island, status) for status in HOLDS},
    **{("microgrid", status, "passive-interconnection"): partial(_microgrid, status) for status in HOLDS},
    **{
        (kind, "proved", rule): partial(equilibrium.equilibrium, only_one, kind == "saturated")
        for kind in ("equilibrium", "saturated")
        for rule, only_one in (("strong-monotonicity", True), ("local-monotonicity", False))
    },
    ("equilibrium", "refuted", "limits-exceeded"): equilibrium.limits_exceeded,
    ("equilibrium", "refuted", "reference-outside-band"): equilibrium.reference_outside,
    **{("region", status, "sublevel-set"): partial(region.sublevel_set, status) for status in HOLDS},
}
