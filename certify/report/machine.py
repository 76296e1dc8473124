"""Verdicts as JSON for machines: exact numbers as text."""

from __future__ import annotations

import math
from typing import Any

from certify.diagnostics import IN_FLOATS
from certify.kernel.claims import Verdict
from certify.kernel.errors import Fault


def verdict_to_dict(verdict: Verdict, notes: dict[str, str]) -> dict[str, Any]:
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
