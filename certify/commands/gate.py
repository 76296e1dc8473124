"""`certify gate`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from certify.commands.common import add_method, add_stamp, bad_input, progress_bar, read_again
from certify.exits import USAGE, worst_of
from certify.gating.baseline import Baseline
from certify.gating.committed import certificate_path
from certify.gating.judge import judge
from certify.gating.policy import Policy, parse_age
from certify.gating.results import Decision, GateResult, Problem, SpecResult
from certify.kernel.errors import Fault, SpecError
from certify.locations import Locations, locate
from certify.report.text import is_about_text

SUMMARY = "decide whether specs may pass: by their committed certificates, or by proving them"
EXAMPLE = (
    "certify gate specs/cigre-mv.toml specs/two-inverters.toml\n"
    "certify gate --write specs/*.toml                    (then commit the certificates)\n"
    "certify gate --require-certificate --sarif gate.sarif --junit gate.xml specs/*.toml"
)
EXITS = (
    "A committed certificate is NAME.cert.json beside NAME.toml or NAME.json. If it is about this very spec and the\n"
    "kernel accepts it, its verdict counts and nothing is proved. If the spec has changed since, or there is none,\n"
    "the spec is proved. One that is rejected, cannot be read, or is of another format fails the gate.\n\n"
    "exit code: the worst of all specs: 4 certificate rejected, then 2 usage or bad input, 1 refuted, 3 unknown,\n"
    "conditional, or no certificate where one is required, 0 all may pass; with --baseline, 0 if nothing got worse"
)
SARIF_KINDS = "fail,open,review,pass,informational,notApplicable"
MAX_JOBS = 1000


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument(
        "specs", metavar="SPEC", nargs="+", help="microgrids, TOML or JSON, or certificates beside them"
    )
    add = parser.add_argument
    add(
        "--allow",
        metavar="NAME",
        action="append",
        default=[],
        help="an assumption of the ledger that a verdict may rest on, such as sampled/9 or equilibrium/9, or a "
        "pattern, such as 'sampled/*'; may be given again",
    )
    add(
        "--baseline",
        metavar="PATH",
        help="fail only on what got worse than in these certificates (a folder, such as "
        "that of the base branch) or in this output of `certify gate --json`: proved is better than conditional or "
        "unknown, and these than refuted; claims that are new must be proved. What is excused is listed",
    )
    add(
        "--certificates",
        metavar="DIR",
        help="where the committed certificates are (default: beside each spec): by the "
        "path of the spec if DIR has its folders, else by its name",
    )
    add(
        "--write",
        action="store_true",
        help="keep each new certificate where the committed one is looked for, "
        "whatever its verdict; replaces those of an earlier state of the spec, and never one that is rejected",
    )
    add_stamp(parser)
    add(
        "--require-certificate",
        action="store_true",
        help="never prove: a spec without a certificate of its present state fails",
    )
    add(
        "--max-age",
        metavar="AGE",
        help="fail if a committed certificate says that it is older, such as 90d or 12h; it "
        "says so if it was made with --stamp, and nothing proves what it says",
    )
    add("--junit", metavar="FILE", help="write JUnit XML: a suite for each spec, a case for each claim")
    add("--sarif", metavar="FILE", help="write SARIF 2.1.0: each claim and fault with the line of the spec")
    add(
        "--sarif-kinds",
        metavar="KINDS",
        default=SARIF_KINDS,
        help="which results it has (default: all). GitHub's code "
        "scanning takes every result for an alert: give it fail,open,review",
    )
    add(
        "--statement",
        metavar="PATH",
        help="write an in-toto statement of the test results, unsigned; into a folder one for each spec",
    )
    add("--times", action="store_true", help="let --json and --junit tell how long each spec took")
    add("--jobs", metavar="N", type=int, help="processes (default: all cores for many specs)")
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    from certify.gating.run import decide_specs, select
    from certify.report.gate import render_spec, render_sum
    from certify.report.gate_files import check_targets, write_files

    try:
        policy = _policy(options)
        specs, stray, warnings = select(options.specs, options.certificates)
        check_targets(options, specs)
        baseline = Baseline(options.baseline) if options.baseline is not None else None
        before = {spec: _before(baseline, spec, options.certificates) for spec in specs} if baseline else {}
    except SpecError as error:
        return bad_input(options, error.faults, "gate")
    colour = sys.stdout.isatty()
    places = _Places()
    results: list[SpecResult] = []
    unwritten: tuple[Fault, ...] = ()

    def decisions() -> Iterator[Decision]:
        yield from stray
        yield from decide_specs(specs, policy, progress_bar, options.jobs)

    for decision in decisions():
        result = _kept(judge(decision, policy, before.get(decision.spec)), options)
        results.append(result)
        if not options.json:
            print(render_spec(result, policy, places.shown, colour), flush=True)
    warnings += _unknown_names(results, policy)
    found = GateResult(tuple(results), tuple(warnings), options.baseline)
    try:
        found = replace(found, warnings=(*warnings, *write_files(options, found)))
    except SpecError as error:
        unwritten += error.faults
    exit_code = worst_of([found.exit_code, *([USAGE] if unwritten else [])])
    if options.json:
        from certify.report.gate import to_dict

        told = to_dict(found, policy, places.position, options.times)
        print(json.dumps({**told, "exit_code": exit_code}, indent=1))
    else:
        print(render_sum(found, policy))
    for warning in found.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if unwritten:
        from certify.report.text import render_faults

        print(render_faults(unwritten, "gate", sys.stderr.isatty()), file=sys.stderr)
    return exit_code


def _policy(options: argparse.Namespace) -> Policy:
    """What the options ask for. Raises: SpecError."""
    from certify.report.gate_files import parse_kinds

    faults = []
    if options.max_age is not None:
        try:
            parse_age(options.max_age)
        except ValueError as error:
            faults.append(Fault("U001", "--max-age", str(error)))
    try:
        options.sarif_kinds = parse_kinds(options.sarif_kinds, SARIF_KINDS.split(","))
    except ValueError as error:
        faults.append(Fault("U001", "--sarif-kinds", str(error)))
    if options.jobs is not None and not 0 < options.jobs <= MAX_JOBS:
        faults.append(Fault("U001", "--jobs", f"expected a number from 1 to {MAX_JOBS}, got {options.jobs}"))
    if options.require_certificate and options.write:
        faults.append(Fault("U001", "--write", "with --require-certificate nothing is proved, so nothing is written"))
    if options.stamp and not options.write:
        faults.append(Fault("U001", "--stamp", "certificates are only kept with --write"))
    if options.certificates is not None and not os.path.isdir(options.certificates):
        faults.append(Fault("U001", "--certificates", f"there is no folder {options.certificates}"))
    if faults:
        raise SpecError(tuple(faults))
    return Policy(
        allow=tuple(options.allow),
        certificates=options.certificates,
        max_age=options.max_age,
        require=options.require_certificate,
        method=options.method,
        stamp=options.stamp,
    )


def _before(baseline: Baseline, spec: str, certificates: str | None) -> Any:
    committed = certificate_path(spec, certificates)
    return baseline.of(spec, str(committed) if os.path.exists(committed) else None)


def _kept(result: SpecResult, options: argparse.Namespace) -> SpecResult:
    """The result, its new certificate written if that is asked for; if it cannot be, the spec fails in every report."""
    from certify.report.gate_files import write_certificate

    if not options.write or result.decision.proof is None:
        return result
    path = str(certificate_path(result.decision.spec, options.certificates))
    try:
        write_certificate(Path(path), result.decision.proof)
    except SpecError as error:
        failed = tuple(Problem("certificate", path, fault, USAGE) for fault in error.faults)
        return replace(result, decision=replace(result.decision, problems=(*result.decision.problems, *failed)))
    return replace(result, written=path)


def _unknown_names(results: list[SpecResult], policy: Policy) -> list[str]:
    """What is allowed and no ledger has: perhaps misspelt, perhaps proved by now. Silent if a ledger is not known."""
    if any(result.decision.verdict is None for result in results):
        return []
    names = {name for result in results for name, _ in result.decision.verdict.assumptions}  # type: ignore[union-attr]
    unused = [pattern for pattern in policy.allow if not any(fnmatchcase(name, pattern) for name in names)]
    return [f"--allow {pattern}: no verdict rests on such an assumption" for pattern in unused]


class _Places:
    """Lines and columns of what is wrong in specs; each file is scanned once."""

    def __init__(self) -> None:
        self.known: dict[str, Locations | None] = {}

    def position(self, problem: Problem) -> dict[str, int]:
        """Line and column, as far as they are known."""
        if problem.kind != "bad input" or not is_about_text(problem.fault):
            return {}
        if problem.file not in self.known:
            data = read_again(problem.file)
            self.known[problem.file] = None if data is None else Locations(data)
        where = self.known[problem.file]
        found = locate(where, problem.fault) if where else None
        return {"line": found.line, "column": found.column} if found else {}

    def shown(self, problem: Problem) -> str:
        """The file and the line, as editors and terminals take them."""
        found = self.position(problem)
        return f"{problem.file}:{found['line']}" if found else problem.file
