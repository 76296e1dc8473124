"""`certify prove`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from certify.commands.common import (
    add_method,
    add_stamp,
    bad_input,
    guarded,
    progress_bar,
    prove_file,
    rejected,
    report_verdict,
)
from certify.kernel.errors import Fault, Rejected, SpecError

SUMMARY = "search for proofs and write a certificate"
EXAMPLE = (
    "certify prove specs/cigre-mv.toml -o cigre.cert.json\n"
    "certify prove specs/cigre-mv.toml --scenario plug-in -o plug-in"
)


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    parser.add_argument(
        "-o",
        "--output",
        metavar="CERT",
        help="where to write the certificate; with --scenario a folder for the spec and the certificate of each phase",
    )
    parser.add_argument(
        "--scenario",
        metavar="NAME",
        help="prove what there is between the events of a scenario of the spec, phase by phase; the exit code is the "
        "worst of all: 4, then 2, 1, 3, 0",
    )
    parser.add_argument("--all", action="store_true", help="list every claim")
    parser.add_argument(
        "--reuse",
        metavar="OLD_CERT",
        help="a certificate of an older state of the spec: its proofs are tried first. If this machine has checked it "
        "and only a few filters and controllers have changed, what they do not touch is taken over unchecked",
    )
    parser.add_argument(
        "--simulate",
        action="store_true",
        help="then simulate it, compare with the certificate, and try to break what that claims; 4 is the exit code of "
        "a contradiction (`certify simulate --check` has more to choose)",
    )
    add_stamp(parser)
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    if options.scenario is not None:
        from certify.report import scenario

        if options.reuse is not None:
            reason = "does not go with --scenario, whose phases are proved from nothing"
            return bad_input(options, (Fault("U001", "--reuse", reason),))
        return guarded(options, lambda: scenario.run(options, progress_bar))
    output = Path(options.output) if options.output is not None else None
    if output is not None:
        same = output.exists() and Path(options.spec).exists() and output.samefile(options.spec)
        if same or output.is_dir() or not output.parent.is_dir():
            reason = "it is the spec itself" if same else "there is no such folder, or it is a folder itself"
            return bad_input(options, (Fault("U001", "--output", f"cannot write {options.output}: {reason}"),))
    more: dict[str, Any] = {"certificate": options.output}
    try:
        certificate, spec, reproved = prove_file(options.spec, options.method, options.reuse, options.stamp)
    except SpecError as error:
        return bad_input(options, error.faults)
    except Rejected as rejection:  # a defect of the search, stopped by the kernel
        return rejected(options, rejection)
    if output is not None:
        from certify.accepted import remember
        from certify.certificate import write_atomically

        try:
            write_atomically(output, certificate.data)
        except OSError as error:
            return bad_input(options, (Fault("U001", "--output", f"cannot write {output}: {error.strerror}"),))
        remember(spec, certificate.data)
    if reproved is not None:
        more["reuse"] = {"older": options.reuse, **reproved.summary()}
    if not options.simulate:
        return report_verdict(options, certificate.verdict, certificate.notes, more)
    return _cross_checked(options, spec, certificate, more)


def _cross_checked(options: argparse.Namespace, spec: bytes, certificate: Any, more: dict[str, Any]) -> int:
    """Report a proof and, after it, what a simulation says of it: a contradiction is the worst of all outcomes."""
    from certify.report.crosscheck import CONTRADICTED, after_proof, render, to_dict

    try:
        checked, kept = after_proof(options, spec, {1: certificate.data}, progress_bar)
    except SpecError as error:
        return bad_input(options, error.faults)
    found = to_dict(checked, kept)
    if options.json:
        more["cross_check"] = found
    worst = CONTRADICTED if found["contradicted"] else None
    code = report_verdict(options, certificate.verdict, certificate.notes, more, worst)
    if not options.json:
        print("\n" + "\n".join(render(checked, kept, sys.stdout.isatty())))
    return code
