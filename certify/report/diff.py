"""What a change of a spec does, as text for a terminal and as JSON for machines."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from typing import Any

from certify.certificate import Certificate
from certify.comparison import CHANGES, Comparison, Moved
from certify.report.layout import table
from certify.report.machine import verdict_to_dict
from certify.report.text import kind_of, open_claims, paint

SHOWN = 8  # claims named for each kind of change
FINEST = 1e-9  # degrees: a smaller turn is what is left of rounding


def report(
    options: argparse.Namespace, comparison: Comparison, before: Certificate, after: Certificate, code: int
) -> int:
    """Print the result of `certify diff`; returns the exit code as given: that of the new spec."""
    if options.json:
        print(json.dumps(diff_to_dict(options, comparison, before, after, code), indent=1, ensure_ascii=False))
    else:
        print(render_diff(options, comparison, before, after, sys.stdout.isatty()))
    return code


def render_diff(
    options: argparse.Namespace, comparison: Comparison, before: Certificate, after: Certificate, colour: bool = False
) -> str:
    """A table of claims by kind and change, the touched ones by name, what is open now and why, and both verdicts."""
    counts = Counter((kind_of(change.id), change.what) for change in comparison.changes)
    kinds = dict.fromkeys(kind for kind, _ in counts)
    columns = [what for what in CHANGES if any(counts[kind, what] for kind in kinds)]
    rows = [("claims", *columns)]
    rows += [(kind, *(str(counts[kind, what] or "-") for what in columns)) for kind in kinds]
    lines = [f"{options.old} -> {options.new}", "", table(rows)]
    for what in columns:
        names = [change.id for change in comparison.changes if change.what == what]
        if what != "kept":
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            lines += ["", f"{what} ({CHANGES[what]}):", f"  {', '.join(names[:SHOWN])}{more}"]
    lines += _moved("nodes whose voltage moves most", comparison.voltages, "V")
    lines += _moved("lines whose current changes most", comparison.currents, "A")
    lines += open_claims(after.verdict, after.notes, colour)
    lines.append("")
    for word, name, certificate in (("before", options.old, before), ("after", options.new, after)):
        outcome = certificate.verdict.outcome
        lines.append(f"{word + ':':8}{paint(outcome, colour, outcome.upper())}: {name}")
    return "\n".join(lines)


def _moved(title: str, moved: tuple[Moved, ...], unit: str) -> list[str]:
    if not moved:
        return []
    rows = [
        (
            x.name,
            f"{abs(x.before):.6g} {unit}",
            "->",
            f"{abs(x.after):.6g} {unit}",
            f"{x.change:+.4g} {unit}",
            f"{x.degrees if abs(x.degrees) > FINEST else 0.0:+.4g} deg",
        )
        for x in moved
    ]
    return ["", f"{title}:", table(rows)]


def diff_to_dict(
    options: argparse.Namespace, comparison: Comparison, before: Certificate, after: Certificate, code: int
) -> dict[str, Any]:
    """Every claim with what became of it; the new verdict in full, as `prove --json` has it."""
    counts = Counter(change.what for change in comparison.changes)
    claims = [
        {
            "id": change.id,
            "change": change.what,
            "before": change.before and change.before.status,
            "after": change.after and change.after.status,
        }
        for change in comparison.changes
    ]
    moved = {
        key: [
            {"name": x.name, "before": [x.before.real, x.before.imag], "after": [x.after.real, x.after.imag]}
            for x in listed
        ]
        for key, listed in (("voltages", comparison.voltages), ("currents", comparison.currents))
    }
    return {
        "old": options.old,
        "new": options.new,
        "outcome_before": before.verdict.outcome,
        "outcome": after.verdict.outcome,
        "counts": {what: counts[what] for what in CHANGES},
        "changes": claims,
        "moved": moved,
        "verdict": verdict_to_dict(after.verdict, after.notes),
        "exit_code": code,
    }
