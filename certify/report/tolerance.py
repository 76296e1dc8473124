"""The largest certified tolerance as text for a terminal and as JSON for machines."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from certify.exits import EXIT_CODES
from certify.inputs import read
from certify.report.files import check_targets, write_results
from certify.report.text import open_claims, paint
from certify.search.prove import Progress
from certify.search.synthesis import to_percent
from certify.tolerance import PARTS, LargestTolerance, largest_tolerance


def run(options: argparse.Namespace, progress: Progress | None) -> int:
    """The command `certify tolerance`. Returns the exit code: that of the spec without any tolerance.

    Raises: SpecError for bad input, or for files that cannot be written; Rejected.
    """
    check_targets(options)
    of = tuple(dict.fromkeys(options.of.split(","))) if options.of is not None else PARTS
    result = largest_tolerance(read(options.spec), of, progress)
    if result.low is not None:
        write_results(options, result.spec, result.certificate.data)
    code = EXIT_CODES[result.certificate.verdict.outcome]
    if options.json:
        print(json.dumps(tolerance_to_dict(result, options, code), indent=1, ensure_ascii=False))
    else:
        print(render_tolerance(result, options, sys.stdout.isatty()))
    return code


def render_tolerance(result: LargestTolerance, options: argparse.Namespace, colour: bool = False) -> str:
    """What is proved, what is not, and why."""
    parts = " and ".join(f"{kind}s" for kind in result.of)
    if result.low is None:
        outcome = result.certificate.verdict.outcome
        head = paint(outcome, colour, outcome.upper())
        lines = [f"{head}: {options.spec} with no tolerance of {parts} at all, so there is none to look for"]
    else:
        head = paint("certified", colour, "CERTIFIED")
        lines = [
            f"{head}: {options.spec} with all {parts} off by {to_percent(result.low)}",
            f"not certified with {to_percent(result.high)}",
        ]
    if result.kept:
        more = f" and {len(result.kept) - 6} more" if len(result.kept) > 6 else ""
        lines.append(f"with a tolerance of their own, which they keep: {', '.join(result.kept[:6])}{more}")
    if result.replaced is not None:
        lines.append(f"in place of the spec's tolerance = {result.replaced}")
    if result.failing is not None:
        lines += open_claims(result.failing.verdict, result.failing.notes, colour)
    if result.low is not None and options.output is not None:
        lines += ["", f"new spec: {options.output}", *([f"certificate: {options.cert}"] if options.cert else [])]
    return "\n".join(lines)


def tolerance_to_dict(result: LargestTolerance, options: argparse.Namespace, code: int) -> dict[str, Any]:
    """Shares as exact text; the claims that are open at the upper end."""
    open_ = result.failing.verdict.claims if result.failing is not None else ()
    return {
        "spec": options.spec,
        "of": list(result.of),
        "kept": list(result.kept),
        "replaced": result.replaced,
        "certified": None if result.low is None else str(result.low),
        "not_certified": str(result.high),
        "open": [
            {"id": c.id, "status": c.status, "facts": [[name, str(value), unit] for name, value, unit in c.facts]}
            for c in open_
            if c.status != "proved"
        ],
        "exit_code": code,
    }
