"""`certify report`."""

from __future__ import annotations

import argparse
import contextlib
import json
from pathlib import Path
from typing import Any

from certify.commands.common import add_method, bad_input, guarded, progress_bar, prove_file
from certify.exits import EXIT_CODES
from certify.kernel.errors import Fault, SpecError

SUMMARY = "write a report of a certificate: one HTML page that needs no network, and a Markdown summary"
EXAMPLE = (
    "certify report specs/cigre-mv.toml -o report                     proves first, and keeps the certificate there\n"
    "certify report specs/cigre-mv.toml cigre.cert.json -o report     checks the certificate, and reports on it"
)
EXITS = (
    "exit codes of this command: those of the verdict, 0 certified, 1 refuted, 3 unknown or conditional; 2 usage or\n"
    "bad input, 4 the certificate is rejected (nothing is written) or contradicted by the simulation (it says so)"
)


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    parser.add_argument(
        "certificate", metavar="CERT", nargs="?", help="its certificate; without one the spec is proved first"
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", required=True, help="the folder to write index.html and report.md to"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--no-simulate", action="store_true", help="leave the simulated cross-check out")
    which.add_argument(
        "--scenario",
        metavar="NAME",
        help="simulate this scenario of the spec, its phases proved one by one (default: from the edge of the proved "
        "region, else a small disturbance)",
    )
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    return guarded(options, lambda: _report(options))


def _keep_what_is_foreign(folder: Path) -> None:
    """A page of something else is not written over. Raises: SpecError."""
    page = folder / "index.html"
    with contextlib.suppress(OSError):
        if page.is_file() and b'name="generator" content="certify' not in page.read_bytes():
            message = f"cannot write to the folder {folder}: index.html is there, and no page of certify"
            raise SpecError((Fault("U001", "-o", message),))


def _report(options: argparse.Namespace) -> int:
    from certify.inputs import decode_all, read
    from certify.kernel.check import check
    from certify.report.files import check_folder, write_folder
    from certify.report.page.build import CERTIFICATE, names_of_files
    from certify.report.page.subject import Subject
    from certify.verdicts import read_notes

    proved_here = options.certificate is None
    names = names_of_files(proved_here)
    check_folder(options.output, names, options.spec)
    _keep_what_is_foreign(Path(options.output))
    if not proved_here and options.method is not None:
        raise SpecError((Fault("U001", "--method", "nothing is proved if a certificate is given; leave one out"),))
    if not proved_here:
        check_folder(options.output, names, options.certificate)
    if proved_here:
        certificate, spec, _ = prove_file(options.spec, options.method)
        data, verdict = certificate.data, certificate.verdict
        grid = decode_all(spec)
    else:
        spec = read(options.spec)
        grid = decode_all(spec)
        try:
            data = read(options.certificate)
        except SpecError as error:
            return bad_input(options, error.faults, options.certificate)
        verdict = check(spec, data)
    subject = Subject(grid, spec, data, verdict, read_notes(data), options.spec, options.certificate)
    motion: Any = None
    if options.scenario is not None or not options.no_simulate:
        from certify.report.page.motion import show_motion

        with progress_bar(f"simulating {options.spec}", "s") as progress:
            motion = show_motion(subject, options.scenario, progress)
    from certify.report.page.build import build_report

    written = build_report(subject, motion)
    if proved_here:
        written[CERTIFICATE] = data
    write_folder(options.output, written)
    contradicted = bool(motion and motion.contradictions)
    code = EXIT_CODES["rejected"] if contradicted else EXIT_CODES[verdict.outcome]
    _print(options, verdict, written, motion, code)
    return code


def _print(options: argparse.Namespace, verdict: Any, written: dict[str, bytes], motion: Any, code: int) -> None:
    if options.json:
        sizes = {name: len(content) for name, content in written.items()}
        result = {
            "spec": options.spec,
            "certificate": options.certificate,
            "outcome": verdict.outcome,
            "folder": options.output,
            "files": sizes,
            "simulated": motion is not None and not motion.left_out,
            "contradictions": list(motion.contradictions) if motion else [],
            "exit_code": code,
        }
        print(json.dumps(result, indent=1, ensure_ascii=False))
        return
    how = "proved just now" if options.certificate is None else f"by {options.certificate}, which the kernel accepts"
    print(f"{verdict.outcome}: {options.spec}, {how}")
    if motion and motion.contradictions:
        print(f"CONTRADICTED by the simulation: {motion.contradictions[0]}")
    print(f"written to {options.output}: {', '.join(written)}")
