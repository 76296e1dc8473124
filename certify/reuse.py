"""Proving a changed spec with the certificate of an older one: only what has changed, if that can be told.

There are two ways. The *whole* one is right for any two files: the older proofs are tried first, the rest is searched
as usual, and the kernel checks the certificate from its bytes. The *short* one neither decodes nor checks what has not
changed. It is taken only if the kernel of this machine has accepted the older certificate, byte for byte and of a spec
that is still known (`accepted`), and a change to filters and controllers leaves all claims but those about a few DGUs
as they are. The argument:

1.  Everything was proved, and `decode` accepted the older spec. The two specs are compared as trees in which any
    difference shows, also that of a number from a text, of the order of keys, of a key that is given twice. If they
    differ in more than `filter`, `controller` and which of them a DGU has, the whole way is taken.
2.  The *affected* nodes are those whose DGU has another filter or controller, by name or content. They, their lines,
    and bare nodes in place of their neighbours make a small spec of its own; the kernel's `decode` reads it, strictly.
    What it does not hold was read the same way before: no part of a spec is read differently for what stands in a
    filter or controller that it does not name. Only linear loops are looked at beyond that; with those at an affected
    node the whole way is taken. So the new spec is well formed.
3.  The small spec has the affected nodes' own capacitances, and all their lines. So a DGU there has the port that it
    has in the whole network, and the kernel's rule, run on it, says what it would say there. The kernel's statements
    and ledger of the small spec are the same before and after: no tolerance, limit or order of claims has changed.
4.  A rule about a line, a load, a branch, another DGU or the interconnection sees only what its subject holds, and the
    model of that is the same as before. So it accepts what it accepted.
5.  `invariant-set` sees of a DGU that it is proved, its shortage, that it rests, and the pin if it is there. At the
    affected nodes there was no shortage, a new proof that has one is not taken, and rest and pin are checked again.
    Lines, loads and shortages elsewhere are as before. `passive-interconnection` sees that all claims are proved.
6.  Claims of any other kind: see `_others_stand`.
"""

from __future__ import annotations

import contextlib
import gc
import json
from collections.abc import Iterator, Set
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.accepted import MIN_BYTES, recall
from certify.certificate import Certificate, prove, write_certificate
from certify.kernel import rules
from certify.kernel.check import FORMAT, proof_key, read_certificate
from certify.kernel.claims import Claim, Context, Fact, Verdict, grid_assumptions, statements
from certify.kernel.data import Data
from certify.kernel.equilibrium import regulates
from certify.kernel.errors import Fault, Rejected, RuleFailure, SpecError
from certify.kernel.proofs import RULES
from certify.kernel.quantity import NumberText, shorten
from certify.kernel.reader import MAX_BYTES, unique
from certify.kernel.spec import Dgu, LinearLoop, Node, decode_document
from certify.search.earlier import Earlier
from certify.search.prove import Progress, Search

PARTS = frozenset({"line", "dgu", "load", "branch", "interconnection", "invariant-set", "microgrid"})  # kinds of claims
Table = dict[str, Any]


@dataclass(frozen=True)
class Reproved:
    """A certificate that was made from an older one.

    `again`: the claims that were decided anew. `reused`: how many have a proof of the older certificate that was
    checked now. `taken_over`: how many were not checked now, because the kernel of this machine has accepted them
    before. `whole`: why all claims were decided and checked, None if only those that a change touches were.
    """

    certificate: Certificate
    again: tuple[str, ...]
    reused: int
    taken_over: int
    whole: str | None

    def summary(self) -> dict[str, Any]:
        """What was done, for a report: which claims were proved again, how many were checked and how many were not."""
        checked = len(self.certificate.verdict.claims) - self.taken_over
        return {
            "decided_again": list(self.again),
            "checked": checked,
            "by_older_proofs": self.reused,
            "taken_over": self.taken_over,
            "why_all": self.whole,
        }


class _WholeError(Exception):
    """Why the short way cannot be taken."""


def prove_again(
    spec: bytes, old: bytes, progress: Progress | None = None, method: str | None = None, stamp: bool = False
) -> Reproved:
    """Prove a spec with what an older certificate, of any spec, has.

    Raises: SpecError if the spec is not well formed, or `old` is no certificate (U003); Rejected as `prove` does.
    """
    try:
        with _no_collection():
            return _prove_changes(spec, old, progress, method, stamp)
    except _WholeError as reason:
        whole = str(reason)
    except RecursionError:
        whole = "a spec is nested deeply"
    document = _read_old(old)
    certificate = prove(spec, progress, method=method, earlier=Earlier(document), stamp=stamp)
    before = {_decision(entry) for entry in document["claims"] if isinstance(entry, dict)}
    claims = json.loads(certificate.data)["claims"]
    again = tuple(entry["id"] for entry in claims if entry["proof"] is None or _decision(entry) not in before)
    return Reproved(certificate, again, len(claims) - len(again), 0, whole)


def _decision(entry: Table) -> str:
    """How a claim is decided, as text that can be compared whatever a file has there."""
    return repr([entry.get(key) for key in ("id", "status", "rule", "proof")])


def _read_old(old: bytes) -> Table:
    try:
        document = read_certificate(old)
    except Rejected as error:
        raise SpecError((Fault("U003", "--reuse", error.reason),)) from None
    if document["format"] != FORMAT or not isinstance(document["claims"], list):
        found = shorten(document["format"])
        raise SpecError((Fault("U003", "--reuse", f"not a certificate of format {FORMAT}, but {found}"),))
    return document


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Documents of a hundred thousand parts are read twice as fast if nobody looks for cycles among them meanwhile."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


# --- the short way ----------------------------------------------------------------------------------------------


def _prove_changes(spec: bytes, old: bytes, progress: Progress | None, method: str | None, stamp: bool) -> Reproved:
    """The certificate of a spec, from one that was accepted, by the argument above. Raises: _WholeError."""
    document, before = _accepted(old)
    if method:
        raise _WholeError("a method is asked for")
    affected, changed, trees = _compare(_tree(before), _tree(spec))
    try:
        was, now = (Context(decode_document(_part(tree, affected, changed))) for tree in trees)
    except (SpecError, ValueError):
        raise _WholeError("what has changed is not well formed") from None
    _require_same_claims(was, now, affected)
    _others_stand({entry["id"].split("/", 1)[0] for entry in document["claims"]}, was, now, affected)
    entries = {entry["id"]: entry for entry in document["claims"]}
    older = Earlier({"claims": [entries[f"dgu/{name}"] for name in affected], "proofs": document["proofs"]})
    search = Search(now.grid, earlier=older)
    facts = {}
    for count, name in enumerate(affected):
        facts[f"dgu/{name}"] = _prove_dgu(search, now, name, entries[f"dgu/{name}"], document["proofs"])
        if progress:
            progress(count + 1, len(affected))
    _require_pins(now, document)

    used = {entry["proof"] for entry in document["claims"]}
    proofs = {key: data for key, data in document["proofs"].items() if key in used}
    found = {key: document[key] for key in ("claims", "assumptions", "verdict")} | {"proofs": proofs}
    taken_over = len(entries) - len(affected)
    data = write_certificate(spec, found, {}, stamp, taken_over=f"{taken_over} claims, as accepted before")
    return Reproved(Certificate(data, _verdict(found, facts), {}, spec), tuple(facts), 0, taken_over, None)


def _accepted(old: bytes) -> tuple[Table, bytes]:
    """The document of an older certificate that this kernel has accepted here, everything proved, and its spec."""
    try:
        document = json.loads(old)
        spec = recall(str(document["spec_sha256"]), old)
    except (ValueError, RecursionError, KeyError, TypeError):
        spec = None
    if spec is None:
        least = f"none is made for specs below {MIN_BYTES // 1000} kB"
        raise _WholeError(f"this machine has no note that its kernel accepted that certificate ({least})")
    if document["verdict"] != "certified" or any(entry["status"] != "proved" for entry in document["claims"]):
        raise _WholeError("not everything was proved before")
    return document, spec


def _tree(spec: bytes) -> Table:
    """The top level of a JSON spec: objects as tuples of pairs, numbers as bytes, so that `==` tells any difference."""
    try:
        text = spec.decode("utf-8-sig")
        if len(spec) > MAX_BYTES or not text.lstrip().startswith("{"):
            raise _WholeError("only specs in JSON are compared")
        tree = json.loads(
            text, parse_float=str.encode, parse_int=str.encode, parse_constant=str.encode, object_pairs_hook=tuple
        )
    except ValueError:
        raise _WholeError("the spec is not valid JSON") from None
    return _table(tree)


def _table(value: object) -> Table:
    """The entries of an object of a tree, if it has each key once."""
    table = dict(value) if isinstance(value, tuple) else None
    if table is None or len(table) != len(value):  # type: ignore[arg-type]
        raise _WholeError("a table has another shape, or a key twice")
    return table


def _plain(value: Any) -> Any:
    """A part of a tree as the kernel's reader would give it. Raises: ValueError if it has a key twice."""
    if isinstance(value, tuple):
        return unique([(key, _plain(entry)) for key, entry in value])
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return NumberText(value.decode()) if isinstance(value, bytes) else value


def _names(names: Set[str]) -> set[str | bytes]:
    """Names as a tree may have them where something refers to them: the reader takes the number 5 for the name "5"."""
    return {*names, *(name.encode(errors="surrogatepass") for name in names)}


def _text(name: object) -> str:
    return name.decode() if isinstance(name, bytes) else str(name)


def _compare(before: Table, after: Table) -> tuple[list[str], dict[str, set[str]], tuple[Table, Table]]:
    """The affected nodes, the changed filters and controllers, and both trees by section; see the argument above, 1."""
    if list(before) != list(after):
        raise _WholeError("the spec has other keys at its top")
    for key in before:
        if key not in ("filter", "controller", "node") and before[key] != after[key]:
            raise _WholeError(f"{key} has changed")
    trees: list[Table] = []
    for tree in (before, after):
        trees.append(tree | {key: _table(tree.get(key, ())) for key in ("filter", "controller", "node")})
    was, now = trees
    changed = {
        # What is null is there, and a fault: so a missing name must not look like it.
        key: {name for name in {**was[key], **now[key]} if was[key].get(name, ...) != now[key].get(name, ...)}
        for key in ("filter", "controller")
    }
    if list(was["node"]) != list(now["node"]):
        raise _WholeError("there are other nodes")
    filters, controllers = (_names(changed[key]) for key in ("filter", "controller"))
    affected = []
    for name, raw in now["node"].items():
        if raw != was["node"][name]:
            if _but_for_choice(raw) != _but_for_choice(was["node"][name]):
                raise _WholeError(f"node {name} has changed in more than the filter and controller of its DGU")
            affected.append(name)
        else:
            dgu = _dgu(raw)
            if dgu.get("filter") in filters or dgu.get("controller") in controllers:
                affected.append(name)
    # With none there is nothing to prove again, but what has changed must be read all the same.
    affected = affected or [next(name for name, raw in now["node"].items() if _dgu(raw))]
    return affected, changed, (was, now)


def _dgu(node: Any) -> Table:
    """The DGU of a node of a tree, empty if it has none."""
    return dict(dict(node).get("dgu", ()))


def _but_for_choice(node: Any) -> tuple[Any, ...]:
    """A node of a tree without the names of its DGU's filter and controller."""
    entries = _table(node)
    if "dgu" in entries:
        dgu = _table(entries["dgu"])
        entries["dgu"] = tuple(entry for entry in dgu.items() if entry[0] not in ("filter", "controller"))
    return tuple(entries.items())


def _part(tree: Table, affected: list[str], changed: dict[str, set[str]]) -> Table:
    """The small spec of the affected nodes, as the kernel's reader would give it; see the argument above, 2.

    A neighbour has a capacitance in place of all else, so that its voltage is a state; nothing is claimed of it.
    """
    sections = ("filter", "controller", "node", "line", "scenario")
    part: Table = {key: _plain(value) for key, value in tree.items() if key not in sections}
    dgus = [_dgu(tree["node"][name]) for name in affected]
    for key, names in changed.items():
        wanted = names | {_text(dgu[key]) for dgu in dgus if key in dgu}
        part[key] = {name: _plain(value) for name, value in tree[key].items() if name in wanted}
    part["node"] = {name: _plain(tree["node"][name]) for name in affected}
    part["line"] = []
    here = _names(set(affected))
    for raw in tree.get("line", ()):
        ends = dict(raw)
        if ends["from"] in here or ends["to"] in here:
            part["line"].append(_plain(raw))
            for end in ("from", "to"):
                part["node"].setdefault(_text(ends[end]), {"capacitance": "1 F"})
    return part


def _require_same_claims(was: Context, now: Context, affected: list[str]) -> None:
    """Only what the DGUs at the affected nodes are has changed, and nothing that is said; see the argument above, 3."""
    said = [[(name, text) for name, (_, text) in statements(context).items()] for context in (was, now)]
    if said[0] != said[1] or grid_assumptions(was.grid) != grid_assumptions(now.grid):
        raise _WholeError("the claims or assumptions read differently")
    if replace(was.grid, nodes=()) != replace(now.grid, nodes=()):
        raise _WholeError("lines have changed")
    for name in affected:
        dgus = _dgus(was.nodes[name], now.nodes[name])
        other = replace(dgus[0], filter=dgus[1].filter, controller=dgus[1].controller)
        if replace(was.nodes[name], dgu=other) != now.nodes[name]:
            raise _WholeError(f"node {name} has changed in more than the filter and controller of its DGU")
        if any(isinstance(dgu.controller, LinearLoop) for dgu in dgus):
            raise _WholeError(f"the DGU at node {name} is a linear loop")
        if any(context.corners(name) != ("000",) for context in (was, now)):
            raise _WholeError(f"there are tolerances at the DGU of node {name}")


def _dgus(*nodes: Node) -> list[Dgu]:
    dgus = [node.dgu for node in nodes if node.dgu]
    if len(dgus) < len(nodes):
        raise _WholeError(f"node {nodes[0].name} has no DGU")
    return dgus


def _others_stand(kinds: set[str], was: Context, now: Context, affected: list[str]) -> None:
    """Of claims that are not about a part, its island or the microgrid, which ones a change leaves as they are.

    An equilibrium has the voltages V* where a controller integrates V* - V with gains of full rank, and what lines,
    loads and other DGUs make of them elsewhere: neither the gains nor the filter of such a DGU enter. They do enter
    what its inverter has to apply, but that is compared with limits only, and it has none. A region needs room at the
    equilibrium and proofs of the parts; how much energy the room is worth is no part of the claim. Nothing is known
    here of any other kind.
    """
    others = kinds - PARTS
    if not others:
        return
    if others - {"equilibrium", "region"}:
        raise _WholeError(f"there are claims of kind {', '.join(sorted(others - {'equilibrium', 'region'}))}")
    for name in affected:
        before, after = _dgus(was.nodes[name], now.nodes[name])
        regulated = regulates(was, name) and regulates(now, name)
        if before.limits_volt or after.limits_volt or not regulated:
            raise _WholeError(f"the equilibrium may depend on what has changed at node {name}")


def _prove_dgu(search: Search, now: Context, name: str, entry: Table, proofs: Table) -> tuple[Fact, ...]:
    """Prove the claim about an affected DGU, put the proof in place, and check it and what its island needs of it.

    `now` is a context of the small spec for the kernel, apart from that of the search; it learns what is proved.
    Returns the facts of the claim.
    """
    if entry["rule"] != "quadratic-storage":
        raise _WholeError(f"the DGU at node {name} was not passive")
    found = search.passivity(name)
    if found is None or (found.status, found.rule) != ("proved", "quadratic-storage"):
        raise _WholeError(f"no storage function is found for the DGU at node {name}")
    data = json.loads(json.dumps(found.data))  # as it will stand in the certificate
    try:
        facts = RULES["dgu", found.status, found.rule](now, name, Data(data))
        rules.rests(now.storages[name].port, now.storages[name].M)
    except RuleFailure as failure:
        raise _WholeError(f"at node {name}: {failure}") from None
    key = proof_key(data)
    proofs[key] = data
    entry |= {"status": found.status, "rule": found.rule, "proof": key}
    return facts


def _require_pins(now: Context, document: Table) -> None:
    """Where a DGU whose proof is new pins the voltages of its island, it still does."""
    for entry in document["claims"]:
        if entry["rule"] == "invariant-set":
            pin = document["proofs"][entry["proof"]]
            if pin["by"] == "dgu" and pin["at"] in now.storages:
                try:
                    stored = now.storages[pin["at"]]
                    rules.pins(stored.port, stored.M, with_load=now.nodes[pin["at"]].has_static_load)
                except RuleFailure as failure:
                    raise _WholeError(f"at node {pin['at']}: {failure}") from None


def _verdict(found: Table, facts: dict[str, tuple[Fact, ...]]) -> Verdict:
    """What the certificate says. Of claims that are taken over only a shortage is told, which is part of the claim."""
    claims = []
    for entry in found["claims"]:
        known = facts.get(entry["id"], ())
        if entry["rule"] == "index-storage":
            known = (("shortage eps", Fraction(found["proofs"][entry["proof"]]["shortage"]), "ohm"),)
        claims.append(Claim(entry["id"], entry["statement"], entry["status"], entry["rule"], known))
    ledger = tuple((entry["name"], entry["statement"]) for entry in found["assumptions"])
    return Verdict(found["verdict"], tuple(claims), ledger)
