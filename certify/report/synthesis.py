"""Synthesised gains as text for a terminal and as JSON for machines."""

from __future__ import annotations

import argparse
import json
import sys
from fractions import Fraction
from typing import Any

from certify.exits import EXIT_CODES
from certify.inputs import read
from certify.report.files import check_targets, write_results
from certify.report.layout import table
from certify.report.text import paint
from certify.search.prove import Progress
from certify.synthesis import SETTLED, Bracket, Synthesis, synthesize


def run(options: argparse.Namespace, progress: Progress | None) -> int:
    """The command `certify synth`: synthesise, write the files if certified, print. Returns the exit code.

    Raises: SpecError for bad input, or for files that cannot be written; Rejected.
    """
    files = {"spec": options.output, "certificate": options.cert}
    check_targets(options)
    result = synthesize(
        read(options.spec),
        options.node,
        settle=options.settle,
        decay=options.decay,
        max_gain=options.max_gain,
        tolerance=options.tolerance,
        kind=options.kind,
        progress=progress,
    )
    if result.met and result.spec is not None and result.certificate is not None:
        write_results(options, result.spec, result.certificate.data)
    code = EXIT_CODES["certified" if result.met else "unknown"]
    if options.json:
        print(json.dumps(synthesis_to_dict(result, files, code), indent=1, ensure_ascii=False))
    else:
        print(render_synthesis(result, options.spec, files, sys.stdout.isatty()))
    return code


def render_synthesis(result: Synthesis, spec: str, files: dict[str, str | None], colour: bool = False) -> str:
    """A fragment ready for a spec, then, as comments of TOML, what it achieves and whether it is certified."""
    lines = [result.fragment] if result.fragment else []
    if lines and not result.met:
        lines = ["# NOT CERTIFIED, the best that was found:", *lines]
    rows = [("", "before", "after", "")]
    nominal = " with the filter's own values" if result.wish.tolerance else ""
    if result.rate_before is not None or result.rate is not None:
        rows.append(("slowest mode decays at", _low(result.rate_before), _low(result.rate), "1/s (proved)" + nominal))
        rows.append(("settles to 2 % in", _time(result.rate_before), _time(result.rate), "s"))
    if result.gain_before is not None or result.gain is not None:
        rows.append(("largest gain", _number(result.gain_before), _number(result.gain), "SI"))
    if result.design is not None:
        lines.append(table(rows, "# "))
    if result.plain is not None:
        lines.append(
            f"# the rotation g in H pays: without it {_low(result.rate_plain)} 1/s, "
            f"largest gain {_number(result.gain_plain)}"
        )
    if result.met:
        lines.append(f"# {paint('certified', colour, 'CERTIFIED')}: {spec} with these gains at node {result.node}")
    else:
        lines.append(f"# {paint('unknown', colour, 'NOT MET')}: {spec}, node {result.node}")
        lines += [f"#   {text}" for text in result.limits]
    names = {"spec": "new spec", "certificate": "certificate"}
    lines += [f"# {names[kind]}: {path}" for kind, path in files.items() if path and result.met]
    return "\n".join(lines)


def synthesis_to_dict(result: Synthesis, files: dict[str, str | None], code: int) -> dict[str, Any]:
    """The same for machines: exact numbers as text, rates in 1/s as [proved, refuted]."""
    design, wish = result.design, result.wish
    return {
        "outcome": "certified" if result.met else "not met",
        "node": result.node,
        "wish": {
            "kind": wish.kind,
            "rate": _exact(wish.rate),
            "max_gain": _exact(wish.max_gain),
            "tolerance": wish.tolerance,
        },
        "limits": list(result.limits),
        "controller": result.controller,
        "fragment": result.fragment,
        "design": {key: str(getattr(design, key)) for key in "xbhg"} if design else None,
        "rate_before": _pair(result.rate_before),
        "rate": _pair(result.rate),
        "largest_gain_before": _exact(result.gain_before),
        "largest_gain": _exact(result.gain),
        "without_rotation": {"rate": _pair(result.rate_plain), "largest_gain": _exact(result.gain_plain)}
        if result.plain
        else None,
        "verdict": result.certificate.verdict.outcome if result.certificate is not None else None,
        "files": {kind: path if result.met else None for kind, path in files.items()},
        "exit_code": code,
    }


def _exact(x: Fraction | None) -> str | None:
    return None if x is None else str(x)


def _pair(bracket: Bracket | None) -> list[str] | None:
    return None if bracket is None else [str(x) for x in bracket]


def _number(x: Fraction | None) -> str:
    return "-" if x is None else f"{float(x):.6g}"


def _low(bracket: Bracket | None) -> str:
    return _number(bracket[0] if bracket else None)


def _time(bracket: Bracket | None) -> str:
    if bracket is None or bracket[0] <= 0:
        return "-"
    return f"{float(SETTLED / bracket[0]):.4g}"
