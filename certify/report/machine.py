"""Verdicts as JSON for machines: exact numbers as text."""

from __future__ import annotations

import math
from typing import Any

from certify.kernel.errors import Fault
from certify.verdicts import verdict_to_dict as verdict_to_dict


def faults_to_dict(faults: tuple[Fault, ...]) -> dict[str, Any]:
    listed = [{"code": f.code, "path": f.path, "message": f.message} for f in faults]
    return {"outcome": "bad input", "faults": listed}


def finite(value: Any) -> Any:
    """The same for JSON, which has no infinity and no NaN: they become null."""
    if isinstance(value, dict):
        return {key: finite(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [finite(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
