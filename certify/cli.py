"""The command line: call, render, exit code. Heavy imports are inside the commands that need them."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from certify.kernel.claims import BESIDE
from certify.kernel.errors import Fault, Rejected, SpecError
from certify.options import build_parser

EXIT_CODES = {"certified": 0, "refuted": 1, "bad input": 2, "unknown": 3, "conditional": 3, "rejected": 4}
USAGE, INTERNAL = 2, 70
# Of many outcomes the gate reports the worst: what cannot be trusted, then what cannot be read, then the verdicts.
WORST_FIRST = (4, 2, 1, 3, 0)


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; never a traceback."""
    options = build_parser().parse_args(arguments)
    try:
        with contextlib.redirect_stdout(_Pipe(sys.stdout)), contextlib.redirect_stderr(_Pipe(sys.stderr)):
            code = COMMANDS[options.command](options)
            sys.stdout.flush()
            sys.stderr.flush()
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if os.environ.get("CERTIFY_DEBUG"):
            raise
        print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
        print("this is a defect of certify; CERTIFY_DEBUG=1 shows where", file=sys.stderr)
        return INTERNAL


class _Pipe(io.TextIOBase):
    """An output stream that may be closed, full or unable to show a letter: the exit code is still the command's."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    def isatty(self) -> bool:
        return self.stream is not None and bool(self.stream.isatty())

    def fileno(self) -> int:
        return int(self.stream.fileno())

    def write(self, text: str) -> int:
        self._attempt(lambda: self.stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._attempt(lambda: self.stream.flush())

    def _attempt(self, action: Callable[[], Any]) -> None:
        if self.stream is None:
            return
        try:
            action()
        except OSError:  # nobody reads, or there is no room: nothing more can be said here
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())


def run_prove(options: argparse.Namespace) -> int:
    if options.scenario is not None:
        from certify.report.scenario import run

        if options.reuse is not None:
            reason = "does not go with --scenario, whose phases are proved from nothing"
            return _bad_input(options, (Fault("U001", "--reuse", reason),))
        return _guarded(options, lambda: run(options, _progress, EXIT_CODES, WORST_FIRST))
    output = Path(options.output) if options.output is not None else None
    if output is not None:
        same = output.exists() and Path(options.spec).exists() and output.samefile(options.spec)
        if same or output.is_dir() or not output.parent.is_dir():
            reason = "it is the spec itself" if same else "there is no such folder, or it is a folder itself"
            return _bad_input(options, (Fault("U001", "--output", f"cannot write {options.output}: {reason}"),))
    more: dict[str, Any] = {"certificate": options.output}
    try:
        certificate, spec, reproved = _prove(options.spec, options.method, options.reuse)
    except SpecError as error:
        return _bad_input(options, error.faults)
    except Rejected as rejection:  # a defect of the search, stopped by the kernel
        return _rejected(options, rejection)
    if output is not None:
        from certify.accepted import remember
        from certify.certificate import write_atomically

        try:
            write_atomically(output, certificate.data)
        except OSError as error:
            return _bad_input(options, (Fault("U001", "--output", f"cannot write {output}: {error.strerror}"),))
        remember(spec, certificate.data)
    if reproved is not None:
        more["reuse"] = {"older": options.reuse, **reproved.summary()}
    if not options.simulate:
        return _report(options, certificate.verdict, certificate.notes, more)
    return _cross_checked(options, spec, certificate, more)


def _cross_checked(options: argparse.Namespace, spec: bytes, certificate: Any, more: dict[str, Any]) -> int:
    """Report a proof and, after it, what a simulation says of it: a contradiction is the worst of all outcomes."""
    from certify.report.crosscheck import CONTRADICTED, after_proof, render, to_dict

    try:
        checked, kept = after_proof(options, spec, {1: certificate.data}, _progress)
    except SpecError as error:
        return _bad_input(options, error.faults)
    found = to_dict(checked, kept)
    if options.json:
        more["cross_check"] = found
    worst = CONTRADICTED if found["contradicted"] else None
    code = _report(options, certificate.verdict, certificate.notes, more, worst)
    if not options.json:
        print("\n" + "\n".join(render(checked, kept, sys.stdout.isatty())))
    return code


def run_check(options: argparse.Namespace) -> int:
    if _is_about_loads(options.certificate):
        return _check_table(options)
    return _checked(options, options.certificate, lambda verdict, notes: _report(options, verdict, notes, {}), True)


def _is_about_loads(certificate: str) -> bool:
    """Whether a certificate is one about a table of loads, by its first line."""
    try:
        with Path(certificate).open("rb") as file:
            return b'"format":"certify/loads@' in file.readline(2000)
    except OSError:
        return False


def _check_table(options: argparse.Namespace) -> int:
    from collections import Counter

    from certify.inputs import read
    from certify.kernel.check_loads import check_table
    from certify.kernel.table import MAX_TABLE_BYTES

    counts: Counter[str] = Counter()
    try:
        table, certificate = read(options.spec, MAX_TABLE_BYTES), read(options.certificate, 4 * MAX_TABLE_BYTES)
        with _progress(f"checking {options.certificate}") as progress:
            total = max(table.count(b"\n"), 1)
            for row in check_table(table, certificate):
                counts[row.verdict.status if row.verdict else "bad input"] += 1
                if progress:
                    progress(min(sum(counts.values()), total), total)
    except SpecError as error:
        return _bad_input(options, error.faults)
    except Rejected as rejection:
        return _rejected(options, rejection)
    found = {EXIT_CODES["certified" if verdict == "proved" else verdict] for verdict in counts} or {0}
    code = next(c for c in WORST_FIRST if c in found)
    band = json.loads(certificate.split(b"\n", 1)[0])["band"]  # part of what is proved, and in no other file
    if options.json:
        print(json.dumps({"table": options.spec, "band": band, "counts": counts, "exit_code": code}, indent=1))
    else:
        told = ", ".join(f"{count:,} {verdict}" for verdict, count in counts.items())
        where = f"from {band[0]} to {band[1]}, where a row has no band of its own"
        print(f"accepted: {options.certificate} about {options.spec}, {where}: {told}")
    return code


def _checked(
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
        return _bad_input(options, error.faults, file)
    except Rejected as rejection:
        return _rejected(options, rejection)
    if note:
        from certify.accepted import remember

        remember(spec, data)
    return then(verdict, _notes(data))


def run_diff(options: argparse.Namespace) -> int:
    from certify.certificate import prove
    from certify.comparison import compare
    from certify.inputs import decode_all, read
    from certify.report.diff import report
    from certify.search.earlier import Earlier

    file = options.old
    certificates: list[Any] = []
    grids: list[Any] = []
    try:
        for file in (options.old, options.new):
            spec = read(file)
            # What the change does not touch is proved by the same proofs.
            earlier = Earlier(json.loads(certificates[0].data)) if certificates else None
            with _progress(f"proving {file}") as progress:
                certificates.append(prove(spec, progress, method=options.method, earlier=earlier))
            grids.append(decode_all(spec))
    except SpecError as error:
        return _bad_input(options, error.faults, file)
    except Rejected as rejection:
        options.spec = file
        return _rejected(options, rejection)
    before, after = certificates
    comparison = compare((grids[0], grids[1]), (before.verdict, after.verdict))
    return report(options, comparison, before, after, EXIT_CODES[after.verdict.outcome])


def run_gate(options: argparse.Namespace) -> int:
    results: list[dict[str, Any]] = []
    for spec in options.specs:
        started = time.perf_counter()
        allowed = False
        entry: dict[str, Any] = {"spec": spec}
        try:
            certificate, _, _ = _prove(spec, options.method)
        except SpecError as error:
            entry |= {
                "outcome": "bad input",
                "detail": [f"{f.code} {f.path}: {f.message}".replace(" : ", ": ") for f in error.faults],
            }
        except Rejected as error:
            entry |= {"outcome": "rejected", "detail": [str(error)]}
        else:
            claims = (c for c in certificate.verdict.claims if c.kind not in BESIDE)
            open_claims = [c for c in claims if c.status != "proved"]
            detail = [f"{c.status} {c.id} ({c.rule or certificate.notes.get(c.id)})" for c in open_claims]
            names = [name for name, _ in certificate.verdict.assumptions if "/" in name]
            detail += [f"to pass, it needs --allow {name}" for name in names if name not in options.allow]
            entry |= {"outcome": certificate.verdict.outcome, "detail": detail}
            allowed = entry["outcome"] == "conditional" and set(names) <= set(options.allow)
        entry |= {
            "exit_code": 0 if allowed else EXIT_CODES[entry["outcome"]],
            "milliseconds": round(1000 * (time.perf_counter() - started)),
        }
        results.append(entry)
        if not options.json:
            _print_gate_line(entry)
    codes = {entry["exit_code"] for entry in results}
    worst = next(code for code in WORST_FIRST if code in codes)
    if options.json:
        print(json.dumps({"exit_code": worst, "results": results}, indent=1))
    else:
        passed = sum(entry["exit_code"] == 0 for entry in results)
        print(f"{passed} of {len(results)} passed" if options.allow else f"{passed} of {len(results)} certified")
    return worst


def run_explain(options: argparse.Namespace) -> int:
    from certify.diagnostics import DIAGNOSTICS, explain

    subject = options.subject
    if subject in DIAGNOSTICS:
        print(json.dumps(vars(DIAGNOSTICS[subject]), indent=1) if options.json else explain(subject))
        return 0
    if not Path(subject).exists():
        import difflib

        near = {code for text in (subject, subject.upper()) for code in difflib.get_close_matches(text, DIAGNOSTICS, 3)}
        known = f"did you mean {' or '.join(sorted(near))}?" if near else f"codes and rules: {', '.join(DIAGNOSTICS)}"
        message = f"{subject!r} is neither a file nor a code; {known}"
        return _bad_input(options, (Fault("U001", "CODE|CERT", message),), "explain")
    if options.spec is None:
        message = "a certificate is told with its spec, because nothing in it is believed unchecked"
        return _bad_input(options, (Fault("U001", "SPEC", message),), "explain")
    if _is_about_loads(subject):
        message = "a certificate of a table is told by `certify check TABLE CERT`; `certify loads TABLE` decides again"
        return _bad_input(options, (Fault("U001", "CODE|CERT", message),), "explain")
    from certify.report.text import tell

    def told(verdict: Any, notes: dict[str, str]) -> int:
        advice: dict[str, list[str]] = {}
        more: dict[str, Any] = {}
        dgus = (claim for claim in verdict.claims if claim.id.startswith("dgu/"))
        if any(claim.status == "refuted" or claim.rule == "index-storage" for claim in dgus):
            from certify.report.nearest import advise  # numpy and scipy, only for this

            advice, more = advise(options.spec, verdict)
        if options.json:
            return _report(options, verdict, notes, {"certificate": subject, **more})
        title = f"{subject}, checked against {options.spec}: {verdict.outcome}"
        print(tell(verdict, title, advice=advice))
        return EXIT_CODES[verdict.outcome]

    return _checked(options, subject, told)


def run_synth(options: argparse.Namespace) -> int:
    from certify.report.synthesis import run

    return _designed(options, run)


def run_tolerance(options: argparse.Namespace) -> int:
    from certify.report.tolerance import run

    return _designed(options, run)


def run_loads(options: argparse.Namespace) -> int:
    from certify.report.loads import run

    options.band = tuple(options.band) if options.band else None
    try:
        with _progress(f"deciding {options.table}") as progress:
            return run(options, progress, EXIT_CODES, WORST_FIRST)
    except SpecError as error:
        return _bad_input(options, error.faults, options.table)
    except Rejected as rejection:
        return _rejected(options, rejection)
    except OSError as error:
        return _bad_input(options, (Fault("U001", "-o", f"cannot write: {error.strerror}"),), options.table)


def run_simulate(options: argparse.Namespace) -> int:
    from certify.report.simulation import run

    return _guarded(options, lambda: run(options, _progress))


def _designed(options: argparse.Namespace, run: Callable[[argparse.Namespace, Any, dict[str, int]], int]) -> int:
    """A command that makes new specs out of one: it proves more than once, and reports for itself."""

    def action() -> int:
        with _progress(f"proving {options.spec}") as progress:
            return run(options, progress, EXIT_CODES)

    return _guarded(options, action)


def _guarded(options: argparse.Namespace, action: Callable[[], int]) -> int:
    """The exit code of an action, or of what is wrong with its input."""
    try:
        return action()
    except SpecError as error:
        return _bad_input(options, error.faults)
    except Rejected as rejection:  # a certificate from elsewhere, or a defect of the search, stopped by the kernel
        return _rejected(options, rejection)


def _prove(path: str, method: str | None, older: str | None = None) -> tuple[Any, bytes, Any]:
    """The certificate of a spec, the bytes of the spec, and what was made of an older certificate, if there is one."""
    from certify.certificate import prove
    from certify.inputs import read

    data, reproved = read(path), None
    with _progress(f"proving {path}") as progress:
        if older is None:
            return prove(data, progress, method=method), data, None
        from certify.reuse import prove_again

        reproved = prove_again(data, _read_older(older), progress, method)
        return reproved.certificate, data, reproved


def _read_older(path: str) -> bytes:
    """The bytes of an older certificate. Raises: SpecError U003."""
    from certify.inputs import read

    try:
        return read(path)
    except SpecError as error:
        raise SpecError((Fault("U003", "--reuse", f"{path}: {error.faults[0].message}"),)) from None


@contextlib.contextmanager
def _progress(title: str, unit: str = "") -> Any:
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


def _notes(certificate: bytes) -> dict[str, str]:
    """Why open claims are open, as the search noted it: not trusted, and shown only if it is a known code."""
    from certify.diagnostics import DIAGNOSTICS

    provenance = json.loads(certificate)["provenance"]
    notes = provenance.get("notes") if isinstance(provenance, dict) else None
    return (
        {k: v for k, v in notes.items() if isinstance(v, str) and v in DIAGNOSTICS} if isinstance(notes, dict) else {}
    )


def _report(
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


def _bad_input(options: argparse.Namespace, faults: tuple[Fault, ...], file: str | None = None) -> int:
    name = file or getattr(options, "spec", None) or options.command
    if options.json:
        from certify.report.machine import faults_to_dict

        print(json.dumps({"file": name, **faults_to_dict(faults), "exit_code": USAGE}, indent=1))
    else:
        from certify.report.text import render_faults

        print(render_faults(faults, name, sys.stderr.isatty()), file=sys.stderr)
    return USAGE


def _rejected(options: argparse.Namespace, rejection: Rejected) -> int:
    code = EXIT_CODES["rejected"]
    if options.json:
        entry = {"code": rejection.code, "where": rejection.where, "reason": rejection.reason}
        print(json.dumps({"spec": options.spec, "outcome": "rejected", **entry, "exit_code": code}, indent=1))
    else:
        from certify.diagnostics import DIAGNOSTICS
        from certify.report.text import paint

        head = paint("rejected", sys.stderr.isatty())
        print(f"{head}[{rejection.code}]: {rejection.reason}\n --> {rejection.where}", file=sys.stderr)
        print(f"  = help: {DIAGNOSTICS[rejection.code].remedy}", file=sys.stderr)
    return code


def _print_gate_line(entry: dict[str, Any]) -> None:
    from certify.report.text import paint

    word = entry["outcome"]
    print(f"{paint(word, sys.stdout.isatty(), f'{word:10}')} {entry['milliseconds']:>6} ms  {entry['spec']}")
    for text in entry["detail"][:8]:
        print(f"{'':21}{text}")
    if len(entry["detail"]) > 8:
        print(f"{'':21}and {len(entry['detail']) - 8} more")


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "prove": run_prove,
    "check": run_check,
    "diff": run_diff,
    "gate": run_gate,
    "explain": run_explain,
    "synth": run_synth,
    "tolerance": run_tolerance,
    "loads": run_loads,
    "simulate": run_simulate,
}


def run() -> NoReturn:
    """Entry point of the `certify` command."""
    sys.exit(main())


if __name__ == "__main__":
    run()
