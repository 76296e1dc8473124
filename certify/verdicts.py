"""A verdict of the kernel as plain data, and what is raised where something is asked for that is not proved."""

from __future__ import annotations

import difflib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.diagnostics import DIAGNOSTICS, IN_FLOATS
from certify.kernel.claims import Claim, Fact, Verdict
from certify.kernel.errors import CertifyError

# Facts that say how far a proved claim is from failing, by how their names begin.
_MARGINS = ("dissipation", "smallest pivot", "level c of the storage", "limited by ")


class NotProved(CertifyError):
    """What was asked for is part of a proof, and there is none: nothing takes its place.

    >>> import certify
    >>> try:
    ...     certify.prove("specs/cigre-mv-as-printed.toml").storage("1")
    ... except certify.NotProved as error:
    ...     print(str(error)[:46])
    no storage function is proved at node '1': the
    """


@dataclass(frozen=True, repr=False)
class CertifiedClaim(Claim):
    """A claim of an accepted certificate, its facts at hand by name. `note`: why it is open, as the search said.

    >>> import certify
    >>> claim = certify.prove("specs/two-inverters.toml")["line/a-b"]
    >>> claim
    <Claim line/a-b: proved by series-branch; 1 fact>
    >>> claim.values["dissipation per squared current"]
    Fraction(1, 5)
    """

    note: str = ""

    @property
    def values(self) -> dict[str, Fraction]:
        """The exact numbers that the proof yields, in the units of `facts`, by what they are."""
        return {name: value for name, value, _ in self.facts}

    def __repr__(self) -> str:
        why = f" by {self.rule}" if self.rule else f" ({self.note})" if self.note else ""
        numbers = f"; {len(self.facts)} fact{'s' if len(self.facts) > 1 else ''}" if self.facts else ""
        return f"<Claim {self.id}: {self.status}{why}{numbers}>"


class Claims(Mapping[str, CertifiedClaim]):
    """The claims of a verdict by their ids, in the order of the spec."""

    def __init__(self, verdict: Verdict, notes: Mapping[str, str]) -> None:
        self._by_id = {
            c.id: CertifiedClaim(c.id, c.statement, c.status, c.rule, c.facts, notes.get(c.id, ""))
            for c in verdict.claims
        }

    def __getitem__(self, name: str) -> CertifiedClaim:
        """Raises: KeyError, naming what is alike, if the spec calls for no such claim."""
        try:
            return self._by_id[name]
        except KeyError:
            near = difflib.get_close_matches(str(name), self._by_id, 3) or list(self._by_id)[:8]
            raise KeyError(f"no claim {name!r}; there are {', '.join(near)}, ..") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_id)

    def __len__(self) -> int:
        return len(self._by_id)

    def __repr__(self) -> str:
        return f"<{len(self):,} claims: {count(self.values())}>"


def margins(claims: Iterable[Claim]) -> dict[str, tuple[Fact, ...]]:
    """Of each claim that holds the exact numbers that say by how much: (what, value, unit), by the id of the claim."""
    found = {}
    for claim in claims:
        own = tuple(fact for fact in claim.facts if fact[0].startswith(_MARGINS))
        if own and claim.status in ("proved", "conditional"):
            found[claim.id] = own
    return found


def count(claims: Iterable[Claim]) -> str:
    """How many claims have which status.

    >>> count([Claim("line/1", "", "proved"), Claim("dgu/1", "", "refuted"), Claim("dgu/2", "", "proved")])
    '2 proved, 1 refuted'
    """
    return ", ".join(f"{number:,} {status}" for status, number in Counter(claim.status for claim in claims).items())


def verdict_to_dict(verdict: Verdict, notes: Mapping[str, str]) -> dict[str, Any]:
    """Outcome, claims and ledger; each fact as name, exact value and unit."""
    claims = []
    for claim in verdict.claims:
        entry: dict[str, Any] = {
            "id": claim.id,
            "statement": claim.statement,
            "status": claim.status,
            "rule": claim.rule,
        }
        entry["facts"] = [{"name": name, "value": str(value), "unit": unit} for name, value, unit in claim.facts]
        if claim.id in notes:
            entry["reason"] = notes[claim.id]
        if f"{claim.id} {IN_FLOATS}" in notes:
            entry[IN_FLOATS] = notes[f"{claim.id} {IN_FLOATS}"]
        claims.append(entry)
    ledger = [{"name": name, "statement": text} for name, text in verdict.assumptions]
    return {"outcome": verdict.outcome, "claims": claims, "assumptions": ledger}


def read_notes(certificate: bytes) -> dict[str, str]:
    """Why open claims are open, as the search noted it: not trusted, and kept only if it is a known code.

    `certificate` is one that the kernel has accepted.
    """
    provenance = json.loads(certificate)["provenance"]
    notes = provenance.get("notes") if isinstance(provenance, dict) else None
    if not isinstance(notes, dict):
        return {}
    return {key: note for key, note in notes.items() if isinstance(note, str) and note in DIAGNOSTICS}
