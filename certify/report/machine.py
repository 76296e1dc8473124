"""Verdicts as JSON for machines: exact numbers as text."""

from __future__ import annotations

import math
from typing import Any

from certify.kernel.errors import Fault
from certify.report.text import places
from certify.verdicts import verdict_to_dict as verdict_to_dict


def faults_to_dict(faults: tuple[Fault, ...], data: bytes | None = None) -> dict[str, Any]:
    """Every fault; with the `data` of the spec also its line and column, where they are known."""
    listed: list[dict[str, Any]] = []
    for fault, place in zip(faults, places(faults, data), strict=True):
        where = {"line": place.line, "column": place.column} if place else {}
        listed.append({"code": fault.code, "path": fault.path, "message": fault.message, **where})
    return {"outcome": "bad input", "faults": listed}


def finite(value: Any) -> Any:
    """The same for JSON, which has no infinity and no NaN: they become null."""
    if isinstance(value, dict):
        return {key: finite(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [finite(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
