"""From a microgrid to the claims and proofs of a certificate: propose, let the kernel's rules accept, go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from certify.kernel.check import RULES, Context, Data, assumptions, overall, proof_key, statements
from certify.kernel.errors import RuleFailure
from certify.kernel.spec import Microgrid
from certify.search.dgu import propose_dgu
from certify.search.loads import propose_load
from certify.search.proposal import Proposal

# Why a claim of this kind stays open, as a code of `certify explain`.
REASONS = {
    "dgu": "P201",
    "load": "P202",
    "island": "P203",
    "microgrid": "P204",
    "branch": "P205",
    "interconnection": "P205",
}
Progress = Callable[[int, int], None]


def find_claims(grid: Microgrid, progress: Progress | None = None) -> dict[str, Any]:
    """The claims, proofs, ledger and verdict for a microgrid, as a certificate holds them; and notes on open claims."""
    context = Context(grid)
    known: dict[Any, Proposal | None] = {}
    claims, notes = [], {}
    proofs: dict[str, Any] = {}
    expected = statements(context)
    for count, (name, (subject, text)) in enumerate(expected.items()):
        accepted = _decide(context, subject, known)
        entry: dict[str, Any] = {"id": name, "statement": text, "status": "unknown", "rule": None, "proof": None}
        if accepted:
            key = proof_key(accepted.data)
            proofs[key] = accepted.data
            entry |= {"status": accepted.status, "rule": accepted.rule, "proof": key}
        else:
            notes[name] = _reason(context, subject)
        context.status[name] = entry["status"]
        claims.append(entry)
        if progress:
            progress(count + 1, len(expected))
    return {
        "claims": claims,
        "proofs": proofs,
        "assumptions": assumptions(grid),
        "verdict": overall(context.status),
        "notes": notes,
    }


def _decide(context: Context, subject: tuple[str, Any], known: dict[Any, Proposal | None]) -> Proposal | None:
    """The first proposal that the kernel's rule accepts. Equal subsystems share the search."""
    kind, what = subject
    key = _content(context, kind, what)
    if key in known:
        proposals = iter([] if known[key] is None else [known[key]])
    else:
        proposals = propose(context, kind, what)
    result = None
    for proposal in _until_exhausted(proposals):
        try:
            RULES[kind, proposal.status, proposal.rule](context, what, Data(proposal.data))
        except RuleFailure:
            continue
        result = proposal
        break
    if key is not None:
        known[key] = result
    return result


def _until_exhausted(proposals: Iterator[Proposal | None]) -> Iterator[Proposal]:
    """The proposals up to the first that numbers out of the range of floats prevent: the claim stays open then."""
    try:
        yield from (proposal for proposal in proposals if proposal is not None)
    except (ArithmeticError, ValueError):
        return


def _reason(context: Context, subject: tuple[str, Any]) -> str:
    """Why a claim stays open, as far as one can tell."""
    if subject[0] == "dgu":
        try:
            context.port(subject[1])
        except RuleFailure:
            return "P206"
    return REASONS[subject[0]]


def _content(context: Context, kind: str, what: Any) -> Any:
    """What the answer depends on, for kinds of which there are many; None if there is nothing to share."""
    if kind == "dgu":
        return context.key(what)
    return context.law(what) if kind == "load" else None


def propose(context: Context, kind: str, what: Any) -> Iterator[Proposal]:
    """Proposals for one claim, by the kind of its subject."""
    if kind == "branch":
        yield Proposal("proved", "series-branch")
    elif kind == "dgu":
        try:
            port = context.port(what)
        except RuleFailure:
            return
        yield from propose_dgu(port)
    elif kind == "load":
        yield from propose_load(*context.law(what))
    elif kind == "interconnection":
        yield Proposal("proved", "skew-incidence")
    elif kind == "island":
        yield from _pins(context, what)
    else:
        yield Proposal("proved", "passive-interconnection")


def _pins(context: Context, island: tuple[str, ...]) -> Iterator[Proposal]:
    """Where V~ = 0 may follow: a strictly monotone load, a series branch, then the DGUs."""
    by_kind = (
        ("load", (name for name in island if name in context.strict_loads)),
        ("branch", (name for name in island if context.nodes[name].branches)),
        ("dgu", (name for name in island if name in context.storages)),
    )
    for by, names in by_kind:
        for name in names:
            yield Proposal("proved", "invariant-set", {"by": by, "at": name})
            if by != "dgu":
                break  # the other conditions do not depend on the pin
