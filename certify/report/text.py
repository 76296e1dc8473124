"""Verdicts and faults as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from certify.diagnostics import DIAGNOSTICS, IN_FLOATS
from certify.kernel.claims import BESIDE, Claim, Verdict
from certify.kernel.errors import Fault
from certify.locations import Locations, Position, locate
from certify.report.layout import table
from certify.report.network import story, summary

_COLOURS = {
    "proved": "32",
    "certified": "32;1",
    "refuted": "31;1",
    "unknown": "33;1",
    "conditional": "33;1",
    "rejected": "31;1",
    "failed": "31;1",
    "bad input": "31;1",
    "error": "31;1",
}
_KINDS = {
    "line": "lines",
    "dgu": "DGUs",
    "load": "loads",
    "branch": "series R-L loads",
    "interconnection": "interconnection",
    "invariant-set": "LaSalle, by island",
    "microgrid": "microgrid",
    "equilibrium": "equilibrium, by island",
    "region": "region of attraction, by island",
    "mode": "aside: DGUs at their limits",
    "saturated": "aside: equilibrium at the limits",
}
# Claims that follow from others: if one of those is open, they are not told of by themselves.
_PARTS = {"line", "dgu", "load", "branch", "interconnection"}
_CAUSES = {"invariant-set": _PARTS, "microgrid": _PARTS, "region": {*_PARTS, "invariant-set", "equilibrium"}}
_REFUTED = "  This refutes the claim about this part, not the stability of the network: others may make up for it."
_NO_STORAGE = "  so no storage function of any kind exists for this DGU with its controller."
_NO_EQUILIBRIUM = "  so no equilibrium is as it is claimed; where the network goes instead is not said."
# What a refutation means, by its rule.
_MEANING = {
    "frequency-witness": (_NO_STORAGE, _REFUTED),
    "storage-contradiction": (_NO_STORAGE, _REFUTED),
    "limits-exceeded": (_NO_EQUILIBRIUM,),
    "reference-outside-band": (_NO_EQUILIBRIUM,),
}
_PAIR = "  so for these two voltages <V - U, I(V) - I(U)> < 0: a disturbance gains power from the load."
SHOWN_FACTS = 12  # of one claim, where all are told
SHOWN_ALONE = 12  # open claims listed one by one


def paint(word: str, colour: bool, text: str | None = None) -> str:
    """A status word, coloured if asked for."""
    text = word if text is None else text
    return f"\033[{_COLOURS[word]}m{text}\033[0m" if colour and word in _COLOURS else text


def approximate(x: Fraction) -> str:
    """Six significant digits of an exact number.

    >>> approximate(Fraction(1, 3)), approximate(Fraction(1, 10**400))
    ('0.333333', '1.00000e-400')
    """
    try:
        value = float(x)
    except OverflowError:
        value = 0.0
    if value or not x:
        return f"{value:g}"
    from decimal import Context

    ratio = Context(prec=6, Emax=999_999, Emin=-999_999).divide(
        *(Context(prec=40).create_decimal(n) for n in x.as_integer_ratio())
    )
    return f"{ratio:.5e}"


def render_verdict(
    verdict: Verdict, spec: str, notes: dict[str, str], every_claim: bool = False, colour: bool = False
) -> str:
    """The verdict, a table of claims by kind (or all of them), and what is open or refuted with its reason."""
    lines = [f"{paint(verdict.outcome, colour, verdict.outcome.upper())}: {spec}", ""]
    if every_claim:
        lines.append(table((c.status, c.id, c.rule or "-", c.statement) for c in verdict.claims))
    else:
        lines.append(table(_summary(verdict.claims)))
    short = [
        f"{c.id} ({approximate(value)} ohm)"
        for c in verdict.claims
        for what, value, _ in c.facts
        if what == "shortage eps" and c.kind not in BESIDE
    ]
    if short:
        more = f" and {len(short) - 6} more" if len(short) > 6 else ""
        lines += [
            "",
            f"passive but for a shortage, which lines and loads have to make up for: {', '.join(short[:6])}{more}",
        ]
    lines += open_claims(verdict, notes, colour)
    if told := summary(verdict, notes):
        lines += ["", *told]
    lines += ["", *stability(verdict)]
    ledger = ", ".join(name for name, _ in verdict.assumptions)
    lines.append(f"assumed, not proved: {ledger} (`certify explain CERT SPEC` says how)")
    return "\n".join(lines)


def stability(verdict: Verdict) -> list[str]:
    """What is said about the network, if its stability is proved, and what that rests on."""
    claim = next(c for c in verdict.claims if c.id == "microgrid")
    if claim.status == "unknown" or verdict.outcome == "refuted":
        return []
    named = [name for name, _ in verdict.assumptions if "/" in name]
    only = (
        f", if what the ledger says of {', '.join(named[:4])}{', ...' if len(named) > 4 else ''} holds" if named else ""
    )
    return [f"proved{only}: {claim.statement}."]


def render_reuse(reuse: Mapping[str, Any]) -> str:
    """What was made of an older certificate, plainly: what was checked now, and what was not."""
    again = reuse["decided_again"]
    head = f"reused: {reuse['older']}; decided again: {len(again):,}"
    head += f" ({', '.join(again[:4])}{', ..' if len(again) > 4 else ''})" if again else ""
    if reuse["why_all"] is None:
        return (
            f"{head}, and checked; taken over: {reuse['taken_over']:,}, as accepted before\n"
            "by this kernel on this machine (`certify check` verifies all of them)"
        )
    return (
        f"{head}; by its proofs: {reuse['by_older_proofs']:,}; all {reuse['checked']:,} claims were checked, because\n"
        f"{reuse['why_all']}"
    )


def open_claims(verdict: Verdict, notes: dict[str, str], colour: bool = False) -> list[str]:
    """The claims that are not proved, each with its reason, those about parts first."""
    lines: list[str] = []
    unsettled = [c for c in verdict.claims if c.status != "proved" and c.kind not in BESIDE]
    open_kinds = {c.kind for c in unsettled}
    alone = [c for c in unsettled if not _CAUSES.get(c.kind, set()) & open_kinds]
    following = [c.id for c in unsettled if c not in alone and c.status != "conditional"]
    unsettled = alone
    for claim in unsettled[:SHOWN_ALONE]:
        lines += ["", *claim_lines(claim, notes, colour)]
    if len(unsettled) > SHOWN_ALONE:
        lines += ["", f"and {len(unsettled) - SHOWN_ALONE} more claims that are not proved (--all lists every claim)"]
    if following:
        more = f" and {len(following) - 4} more" if len(following) > 4 else ""
        lines += ["", f"not decided because of the above: {', '.join(following[-4:])}{more}"]
    return lines


def kind_of(claim: str) -> str:
    """What a claim of this id is about, in the plural; for a kind without a name of its own the start of the id."""
    kind = claim.split("/", 1)[0]
    return _KINDS.get(kind, kind)


def _summary(claims: tuple[Claim, ...]) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, str], dict[str, int]] = {}
    for claim in claims:
        rules = groups.setdefault((claim.kind, claim.status), {})
        rules[claim.rule or "-"] = rules.get(claim.rule or "-", 0) + 1
    rows: list[tuple[str, ...]] = [("claims", "", "status", "by rule")]
    order = list(_KINDS)
    for (kind, status), rules in sorted(groups.items(), key=lambda group: (order.index(group[0][0]), group[0][1])):
        shown = ", ".join(rule if len(rules) == 1 else f"{rule} ({count})" for rule, count in rules.items())
        rows.append((_KINDS[kind], str(sum(rules.values())), status, shown))
    return rows


def claim_lines(claim: Claim, notes: dict[str, str], colour: bool = False) -> list[str]:
    """A claim that is not proved, with its reason and its numbers."""
    lines = [
        f"{paint(claim.status, colour)}[{claim.rule or notes.get(claim.id, 'P205')}] {claim.id}: {claim.statement}"
    ]
    if claim.status == "refuted":
        lines += [f"  {name}: {approximate(value)} {unit}".rstrip() for name, value, unit in claim.facts]
        lines += _MEANING.get(claim.rule or "", (_PAIR, _REFUTED))
        if claim.id in notes:
            lines.append(f"  {DIAGNOSTICS[notes[claim.id]].why}")
    elif claim.rule == "sampled":
        lines += [f"  {name}: {approximate(value)}" for name, value, _ in claim.facts]
        lines.append("  That is evidence and no proof: the verdict rests on an assumption of the ledger.")
    elif claim.id in notes:
        lines.append(f"  {DIAGNOSTICS[notes[claim.id]].why}")
        if detail := notes.get(f"{claim.id} {IN_FLOATS}"):
            lines.append(f"  {IN_FLOATS}: {detail}")
        lines.append(f"  = help: {DIAGNOSTICS[notes[claim.id]].remedy}")
    return lines


def render_faults(
    faults: tuple[Fault, ...], file: str, colour: bool = False, limit: int = 40, data: bytes | None = None
) -> str:
    """Every fault with its code, its place and what to try. With the `data` of the file, a spec, also with its line."""
    blocks = []
    lines = places(faults[:limit], data)
    for fault, line in zip(faults[:limit], lines, strict=True):
        place = f"{file}{f':{line}' if line else ''}" + (f": {fault.path}" if fault.path else "")
        block = f"{paint('error', colour)}[{fault.code}]: {fault.message}\n --> {place}"
        if fault.code in DIAGNOSTICS:
            block += f"\n  = help: {DIAGNOSTICS[fault.code].remedy}"
        blocks.append(block)
    if len(faults) > limit:
        blocks.append(f"and {len(faults) - limit} more faults")
    return "\n".join(blocks)


def places(faults: tuple[Fault, ...], data: bytes | None) -> list[Position | None]:
    """Where each fault of a spec is; None where that is not known, or the fault is not one of the spec's text."""
    found: list[Position | None] = [None] * len(faults)
    if data is not None and any(is_about_text(fault) for fault in faults):
        locations = Locations(data)
        found = [locate(locations, fault) if is_about_text(fault) else None for fault in faults]
    return found


def is_about_text(fault: Fault) -> bool:
    """Whether a fault is one of what stands in a spec."""
    return fault.code.startswith("S") and fault.code != "S000"


def tell(verdict: Verdict, title: str, limit: int = 200, advice: Mapping[str, list[str]] | None = None) -> str:
    """A certificate in words: each claim, by which rule, with which margin, and what is assumed.

    `advice` has further lines for some claims, by their ids.
    """
    lines = [title, "", *story(verdict), "", "Claim by claim:", ""]
    for claim in verdict.claims[:limit]:
        by = f", by rule {claim.rule}" if claim.rule else ""
        lines.append(f"- {claim.id}: {claim.status}{by}. {claim.statement[0].upper()}{claim.statement[1:]}.")
        lines += [f"    {name}: {_fact(name, value, unit)}" for name, value, unit in claim.facts[:SHOWN_FACTS]]
        if len(claim.facts) > SHOWN_FACTS:
            lines.append(f"    and {len(claim.facts) - SHOWN_FACTS} more numbers (--json has them all)")
        lines += [f"    {line}".rstrip() for line in (advice or {}).get(claim.id, ())]
    if len(verdict.claims) > limit:
        lines.append(f"- and {len(verdict.claims) - limit} more claims (--json has them all)")
    lines += ["", "Assumed, and not proved:"]
    lines += [f"- {name}: {text}." for name, text in verdict.assumptions]
    return "\n".join(lines)


def _fact(name: str, value: Fraction, unit: str) -> str:
    if name == "strictly monotone":
        return "yes" if value else "no, only monotone"
    return f"{approximate(value)} {unit}".rstrip()
