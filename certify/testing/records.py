"""What was proved while a test ran, noted for whoever listens; without a listener nothing is kept."""

from __future__ import annotations

import hashlib
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from certify.kernel.claims import BESIDE, Claim, Verdict


@dataclass(frozen=True)
class Record:
    """One verdict of the kernel on one spec. `how`: proved, or checked from a file; `source`: its path, if any."""

    spec_sha256: str
    source: str
    how: str
    verdict: Verdict

    @property
    def open_claims(self) -> tuple[Claim, ...]:
        return tuple(c for c in self.verdict.claims if c.status != "proved" and c.kind not in BESIDE)

    @property
    def counts(self) -> dict[str, int]:
        """How many claims, of those that decide the verdict, have which status."""
        return dict(Counter(c.status for c in self.verdict.claims if c.kind not in BESIDE))


_listening: list[list[Record]] = []
_lock = threading.Lock()


@contextmanager
def listening() -> Iterator[list[Record]]:
    """The records from here to the end of the block, in order."""
    mine: list[Record] = []
    with _lock:
        _listening.append(mine)
    try:
        yield mine
    finally:
        with _lock:
            _listening[:] = [kept for kept in _listening if kept is not mine]


def note(spec: bytes, verdict: Verdict, how: str = "proved", source: str = "") -> None:
    """Tell the listeners of a verdict."""
    with _lock:
        if _listening:
            record = Record(hashlib.sha256(spec).hexdigest(), source, how, verdict)
            for kept in _listening:
                kept.append(record)
