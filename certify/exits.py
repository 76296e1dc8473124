"""Exit codes, the same for every command."""

from __future__ import annotations

from collections.abc import Iterable

EXIT_CODES = {"certified": 0, "refuted": 1, "bad input": 2, "unknown": 3, "conditional": 3, "rejected": 4}
USAGE, INTERNAL = 2, 70
# Of many outcomes the worst is reported: what cannot be trusted, then what cannot be read, then the verdicts.
WORST_FIRST = (4, 2, 1, 3, 0)


def worst_of(codes: Iterable[int]) -> int:
    """The exit code of many: the worst, and 0 if there are none.

    >>> worst_of([0, 3, 1]), worst_of([])
    (1, 0)
    """
    found = {0, *codes}
    return next(code for code in WORST_FIRST if code in found)
