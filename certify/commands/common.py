"""What the commands share: reading and checking, a progress bar, verdicts and faults told, exit codes."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from certify.exits import EXIT_CODES, USAGE
from certify.kernel.errors import Fault, Rejected, SpecError
from certify.search.methods import METHODS


def add_method(parser: argparse.ArgumentParser) -> None:
    """The option --method."""
    text = "how loads are proved; by default the cheapest way that decides. `sampled` is evidence, never a proof"
    parser.add_argument("--method", choices=METHODS, help=text)


def add_stamp(parser: argparse.ArgumentParser) -> None:
    """The option --stamp."""
    text = "let the certificate say when it was made, for `certify gate --max-age`. Nothing proves that time"
    parser.add_argument("--stamp", action="store_true", help=text)


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """The options -o and --cert of commands that make a new spec."""
    parser.add_argument("-o", "--output", metavar="OUT_SPEC", help="where to write the new spec, if it is certified")
    parser.add_argument("--cert", metavar="CERT", help="where to write the certificate of the new spec; needs -o")


def guarded(options: argparse.Namespace, action: Callable[[], int]) -> int:
    """The exit code of an action, or of what is wrong with its input."""
    try:
        return action()
    except SpecError as error:
        return bad_input(options, error.faults)
    except Rejected as rejection:  # a certificate from elsewhere, or a defect of the search, stopped by the kernel
        return rejected(options, rejection)


def designed(options: argparse.Namespace, run: Callable[[argparse.Namespace, Any], int]) -> int:
    """A command that makes new specs out of one: it proves more than once, and reports for itself."""

    def action() -> int:
        with progress_bar(f"proving {options.spec}") as progress:
            return run(options, progress)

    return guarded(options, action)


def prove_file(path: str, method: str | None, older: str | None = None, stamp: bool = False) -> tuple[Any, bytes, Any]:
    """The certificate of a spec, the bytes of the spec, and what was made of an older certificate, if there is one."""
    from certify.certificate import prove
    from certify.inputs import read

    data, reproved = read(path), None
    with progress_bar(f"proving {path}") as progress:
        if older is None:
            return prove(data, progress, method=method, stamp=stamp), data, None
        from certify.reuse import prove_again

        reproved = prove_again(data, _read_older(older), progress, method, stamp)
        return reproved.certificate, data, reproved


def _read_older(path: str) -> bytes:
    """The bytes of an older certificate. Raises: SpecError U003."""
    from certify.inputs import read

    try:
        return read(path)
    except SpecError as error:
        raise SpecError((Fault("U003", "--reuse", f"{path}: {error.faults[0].message}"),)) from None


def checked(
    options: argparse.Namespace, certificate: str, then: Callable[[Any, dict[str, str]], int], note: bool = False
) -> int:
    """Read both files, check, and report faults under the name of the file that has them.

    With `note` the machine remembers what was accepted.
    """
    from certify.inputs import read
    from certify.kernel.check import check

    file = certificate
    try:
        data = read(certificate)
        file = options.spec
        spec = read(options.spec)
        verdict = check(spec, data)
    except SpecError as error:
        return bad_input(options, error.faults, file)
    except Rejected as rejection:
        return rejected(options, rejection)
    if note:
        from certify.accepted import remember

        remember(spec, data)
    from certify.verdicts import read_notes

    return then(verdict, read_notes(data))


def is_about_loads(certificate: str) -> bool:
    """Whether a certificate is one about a table of loads, by its first line."""
    try:
        with Path(certificate).open("rb") as file:
            return b'"format":"certify/loads@' in file.readline(2000)
    except OSError:
        return False


@contextlib.contextmanager
def progress_bar(title: str, unit: str = "") -> Any:
    """A progress bar on a terminal, but only for what takes longer than a second; with a unit it tells how much."""
    if not sys.stderr.isatty():
        yield None
        return
    started = time.perf_counter()
    bar: Any = None

    def progress(done: float, total: float) -> None:
        nonlocal bar
        if bar is None and time.perf_counter() - started > 1:
            from rich.console import Console
            from rich.progress import Progress, TextColumn

            columns = [*Progress.get_default_columns()]
            if unit:
                columns.append(TextColumn(f"{{task.completed:.3g}} of {{task.total:.6g}} {unit}"))
            bar = Progress(*columns, console=Console(stderr=True), transient=True)
            bar.start()
            bar.add_task(title, total=total)
        if bar is not None:
            bar.update(bar.task_ids[0], completed=done)

    try:
        yield progress
    finally:
        if bar is not None:
            bar.stop()


def report_verdict(
    options: argparse.Namespace, verdict: Any, notes: dict[str, str], more: dict[str, Any], worse: int | None = None
) -> int:
    code = EXIT_CODES[verdict.outcome] if worse is None else worse
    if options.json:
        from certify.report.machine import verdict_to_dict

        result = {"spec": options.spec, **more, **verdict_to_dict(verdict, notes), "exit_code": code}
        print(json.dumps(result, indent=1, ensure_ascii=False))
    else:
        from certify.report.text import render_verdict

        print(render_verdict(verdict, options.spec, notes, options.all, sys.stdout.isatty()))
        if more.get("certificate"):
            print(f"certificate: {more['certificate']}")
        if "reuse" in more:
            from certify.report.text import render_reuse

            print(render_reuse(more["reuse"]))
    return code


def bad_input(options: argparse.Namespace, faults: tuple[Fault, ...], file: str | None = None) -> int:
    name = file or getattr(options, "spec", None) or options.command
    data = read_again(name)
    if options.json:
        from certify.report.machine import faults_to_dict

        print(json.dumps({"file": name, **faults_to_dict(faults, data), "exit_code": USAGE}, indent=1))
    else:
        from certify.report.text import render_faults

        print(render_faults(faults, name, sys.stderr.isatty(), data=data), file=sys.stderr)
    return USAGE


def read_again(file: str) -> bytes | None:
    """The bytes of a file that a message is about, to tell lines by; None if they are not at hand."""
    from certify.inputs import read

    try:
        return read(file) if os.path.isfile(file) else None
    except (SpecError, OSError, ValueError):
        return None


def rejected(options: argparse.Namespace, rejection: Rejected) -> int:
    code = EXIT_CODES["rejected"]
    if options.json:
        entry = {"code": rejection.code, "where": rejection.where, "reason": rejection.reason}
        print(json.dumps({"spec": options.spec, "outcome": "rejected", **entry, "exit_code": code}, indent=1))
    else:
        from certify.diagnostics import DIAGNOSTICS
        from certify.report.text import paint

        head = paint("rejected", sys.stderr.isatty())
        file = getattr(options, "certificate", None)
        where = f"{file}: {rejection.where}" if isinstance(file, str) else rejection.where
        print(f"{head}[{rejection.code}]: {rejection.reason}\n --> {where}", file=sys.stderr)
        print(f"  = help: {DIAGNOSTICS[rejection.code].remedy}", file=sys.stderr)
    return code
