"""Columns of text."""

from __future__ import annotations

from collections.abc import Iterable


def table(rows: Iterable[tuple[str, ...]], indent: str = "  ") -> str:
    """Columns wide enough for their longest entry."""
    listed = list(rows)
    widths = [max((len(row[k]) for row in listed), default=0) for k in range(max(map(len, listed), default=0))]
    return "\n".join(
        (indent + "  ".join(f"{x:<{w}}" for x, w in zip(row, widths, strict=False))).rstrip() for row in listed
    )
