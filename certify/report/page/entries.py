"""The claims of a verdict as a page lists them: by kind, those first that are not proved, equal ones together if many.

The numbers of a proof are those of the certificate, which the kernel has checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.diagnostics import DIAGNOSTICS
from certify.kernel.claims import BESIDE, Claim
from certify.report.page.subject import Subject
from certify.report.page.words import KINDS, STATUSES, decimal, margin_of, name_of

ALONE = 150  # claims of a kind that are listed one by one
OPEN = 200  # of the ones that are not proved, in any case
MEMBERS = 12  # names of a group that are told
FACTS = 60  # of one claim
EXACT = 1000  # characters of an exact number
PROOF_ROWS = 24  # of one matrix of a proof
PROOF_COLUMNS = 12
DETAILED = 300  # claims on a page with the numbers of their proofs


@dataclass(frozen=True)
class FactRow:
    name: str
    near: str
    exact: str
    unit: str


@dataclass(frozen=True)
class Table:
    """One entry of a proof: its name, rows of decimals, and how many rows or columns are left out."""

    name: str
    rows: tuple[tuple[str, ...], ...]
    left_out: str


@dataclass(frozen=True)
class Entry:
    """One claim, or several that are proved by the same rule, `members` being the others' ids."""

    claim: Claim
    anchor: str
    name: str
    margin: str
    rule_title: str
    rule_why: str
    note: str
    note_why: str
    remedy: str
    facts: tuple[FactRow, ...]
    facts_left_out: int
    proof: tuple[Table, ...]
    proof_key: str
    members: tuple[str, ...] = ()
    count: int = 1


@dataclass(frozen=True)
class Kind:
    """All claims of one kind; `counts` by status. `left_out` proved ones are counted, but not listed one by one."""

    kind: str
    title: str
    says: str
    aside: bool
    counts: tuple[tuple[str, int], ...]
    entries: tuple[Entry, ...]
    left_out: int

    @property
    def total(self) -> int:
        return sum(count for _, count in self.counts)


def list_kinds(subject: Subject) -> tuple[Kind, ...]:
    """Every claim by its kind, parts first."""
    by_kind: dict[str, list[Claim]] = {}
    for claim in subject.verdict.claims:
        by_kind.setdefault(claim.kind, []).append(claim)
    detailed = len(subject.verdict.claims) <= DETAILED
    return tuple(
        _kind(subject, kind, by_kind[kind], detailed)
        for kind in [*(k for k in KINDS if k in by_kind), *(k for k in by_kind if k not in KINDS)]
    )


def _kind(subject: Subject, kind: str, claims: Sequence[Claim], detailed: bool) -> Kind:
    title, says = KINDS.get(kind, (kind, ""))
    counts = tuple((s, n) for s in STATUSES if (n := sum(c.status == s for c in claims)))
    ordered = [c for s in STATUSES for c in claims if c.status == s]
    left_out = 0
    if len(claims) <= ALONE:
        entries = [_entry(subject, claim, detailed) for claim in ordered]
    else:
        shown = [c for c in ordered if c.status != "proved"][:OPEN]
        entries = [_entry(subject, claim, True) for claim in shown]
        groups = list(_groups(subject, [c for c in ordered if c not in set(shown)]))
        entries += [_entry(subject, group[0], detailed, group) for group in groups[:ALONE]]
        left_out = sum(len(group) for group in groups[ALONE:])
    return Kind(kind, title, says, kind in BESIDE, counts, tuple(entries), left_out)


def _groups(subject: Subject, claims: Sequence[Claim]) -> Iterator[list[Claim]]:
    """Claims of the same status by the same rule and proof, and for those with facts the same margin."""
    groups: dict[object, list[Claim]] = {}
    for claim in claims:
        key = (claim.status, claim.rule, subject.proof_keys.get(claim.id), margin_of(claim))
        groups.setdefault(key, []).append(claim)
    yield from sorted(groups.values(), key=lambda group: -len(group))


def _entry(subject: Subject, claim: Claim, detailed: bool, group: Sequence[Claim] = ()) -> Entry:
    rule = DIAGNOSTICS.get(claim.rule or "")
    code = subject.notes.get(claim.id, "") if claim.status in ("unknown", "refuted") else ""
    note = DIAGNOSTICS.get(code)
    facts = tuple(fact_row(*fact) for fact in claim.facts[:FACTS]) if detailed or claim.status != "proved" else ()
    return Entry(
        claim=claim,
        anchor=subject.anchors[claim.id],
        name=name_of(claim.id),
        margin=margin_of(claim),
        rule_title=rule.title if rule else "",
        rule_why=rule.why if rule else "",
        note=code if note else "",
        note_why=note.why if note else "",
        remedy=note.remedy if note else "",
        facts=facts,
        facts_left_out=len(claim.facts) - len(facts),
        proof=tuple(_tables(subject.proofs.get(claim.id))) if detailed else (),
        proof_key=subject.proof_keys.get(claim.id, ""),
        members=tuple(other.id for other in group[1 : MEMBERS + 1]),
        count=max(len(group), 1),
    )


def fact_row(name: str, value: Fraction, unit: str) -> FactRow:
    if name == "strictly monotone":
        return FactRow(name, "yes" if value else "no, only monotone", "", "")
    near, exact = decimal(value), str(value)
    return FactRow(name, near, _cut(exact) if near.startswith("≈") else "", unit)


def _cut(text: str) -> str:
    if len(text) <= EXACT:
        return text
    return f"{text[: EXACT // 2]} … {text[-EXACT // 4 :]} ({len(text):,} characters)"


def _tables(data: Any, name: str = "") -> Iterator[Table]:
    """The entries of a proof as matrices of decimals. Its texts are rows of rational numbers, or words."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _tables(value, f"{name}.{key}" if name else str(key))
    elif isinstance(data, list) and any(not isinstance(row, str) for row in data):
        for k, row in enumerate(data[:PROOF_ROWS]):
            yield from _tables(row, f"{name}[{k}]")
    else:
        lines = [data] if isinstance(data, str) else data if isinstance(data, list) else [str(data)]
        rows = tuple(tuple(_cell(x) for x in line.split(" ")[:PROOF_COLUMNS]) for line in lines[:PROOF_ROWS])
        wide = max((line.count(" ") + 1 for line in lines), default=0)
        missing = [f"{len(lines) - PROOF_ROWS:,} rows"] if len(lines) > PROOF_ROWS else []
        missing += [f"{wide - PROOF_COLUMNS:,} columns"] if wide > PROOF_COLUMNS else []
        yield Table(name, rows, " and ".join(missing))


def _cell(text: str) -> str:
    try:
        return decimal(Fraction(text), 8)
    except (ValueError, ZeroDivisionError):
        return text[:40]
