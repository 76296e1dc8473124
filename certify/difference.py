"""Two specs side by side, proved and compared, for use from Python."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass

from certify.certificate import Certificate, prove
from certify.comparison import Change, Comparison, compare
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.search.earlier import Earlier


@dataclass(frozen=True, repr=False)
class Difference:
    """What a change of a spec does, as `diff` returns it: certificates before and after, what became of each claim."""

    before: Certificate
    after: Certificate
    comparison: Comparison

    @property
    def lost(self) -> tuple[Change, ...]:
        """Claims that held before and do no more."""
        return tuple(change for change in self.comparison.changes if change.what == "lost")

    def __repr__(self) -> str:
        counts = Counter(change.what for change in self.comparison.changes)
        told = ", ".join(f"{number} {what}" for what, number in counts.items())
        return f"<Difference: {self.before.outcome} -> {self.after.outcome}; claims: {told}>"


def diff(old: SpecSource, new: SpecSource) -> Difference:
    """Prove two specs and compare them, claim by claim, and where their equilibria lie.

    For `old` and `new` see `certify.inputs.to_bytes`; certificates are not taken, since each names one spec only.
    Raises: SpecError if a spec is not well formed.

    >>> diff("specs/cigre-mv.toml", "specs/cigre-mv-as-printed.toml").lost[0].id
    'dgu/1'
    """
    texts = to_bytes(old), to_bytes(new)
    before = prove(texts[0])
    # What the change does not touch is proved by the same proofs.
    after = prove(texts[1], earlier=Earlier(json.loads(before.data)))
    grids = decode_all(texts[0]), decode_all(texts[1])
    return Difference(before, after, compare(grids, (before.verdict, after.verdict)))
