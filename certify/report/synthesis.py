"""Synthesised gains as text for a terminal and as JSON for machines."""

from __future__ import annotations

import argparse
import json
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

from certify.certificate import write_atomically
from certify.inputs import read
from certify.kernel.errors import Fault, SpecError
from certify.report.text import paint, table
from certify.search.prove import Progress
from certify.synthesis import SETTLED, Bracket, Synthesis, synthesize


def run(options: argparse.Namespace, progress: Progress | None, codes: dict[str, int]) -> int:
    """The command `certify synth`: synthesise, write the files if certified, print. Returns the exit code.

    Raises: SpecError for bad input, or for files that cannot be written; Rejected.
    """
    files = {"spec": options.output, "certificate": options.cert}
    _check_targets(options)
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
        for option, path, data in (
            ("-o", options.output, result.spec),
            ("--cert", options.cert, result.certificate.data),
        ):
            if path is not None:
                try:
                    write_atomically(Path(path), data)
                except OSError as error:
                    reason = f"cannot write {path}: {error.strerror}"
                    raise SpecError((Fault("U001", option, reason),)) from None
    code = codes["certified" if result.met else "unknown"]
    if options.json:
        print(json.dumps(synthesis_to_dict(result, files, code), indent=1, ensure_ascii=False))
    else:
        print(render_synthesis(result, options.spec, files, sys.stdout.isatty()))
    return code


def _check_targets(options: argparse.Namespace) -> None:
    """Faults of the two output files that can be told before any work is done. Raises: SpecError."""
    faults = []
    taken = {Path(options.spec).resolve(): "it is the spec itself"}
    for option, path in (("-o", options.output), ("--cert", options.cert)):
        if path is None:
            continue
        target = Path(path)
        reason = taken.get(target.resolve())
        if target.is_dir() or not target.parent.is_dir():
            reason = "there is no such folder, or it is a folder itself"
        if reason:
            faults.append(Fault("U001", option, f"cannot write {path}: {reason}"))
        taken[target.resolve()] = "the new spec goes there"
    if options.cert is not None and options.output is None:
        faults.append(Fault("U001", "--cert", "a certificate is about the new spec, so it needs -o too"))
    if faults:
        raise SpecError(tuple(faults))


def render_synthesis(result: Synthesis, spec: str, files: dict[str, str | None], colour: bool = False) -> str:
    """A fragment ready for a spec, then, as comments of TOML, what it achieves and whether it is certified."""
    lines = [result.fragment] if result.fragment and result.met else []
    rows = [("", "before", "after", "")]
    if result.rate_before is not None or result.rate is not None:
        rows.append(("slowest mode decays at", _low(result.rate_before), _low(result.rate), "1/s (proved)"))
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
        "verdict": result.certificate.verdict.outcome if result.certificate else None,
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
