"""`certify loads`: decide a table or a spec, write what the options ask for, and sum it up for a terminal."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any

from certify.certificate import open_atomically
from certify.diagnostics import DIAGNOSTICS
from certify.exits import EXIT_CODES, worst_of
from certify.inputs import decode_all, read
from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import read_document
from certify.kernel.table import MAX_TABLE_BYTES, LoadTable, parse_band
from certify.load_tables import Result, decide_spec, decide_table, footer, header
from certify.report import load_figures
from certify.report.layout import table
from certify.report.load_results import Writer, decimal, to_exact
from certify.report.text import approximate, paint, render_faults

SHOWN = 12  # refuted or undecided loads listed one by one
SHARES = tuple(Fraction(k, 100) for k in (50, 60, 70, 80, 85, 90, 95, 100))
MAX_FAULTS = 39  # kept, so that they and the number of the others are what a message shows
MAX_JOBS = 1000
DEFAULT_BAND = ("0.9 pu", "1.1 pu")


class Summary:
    """What is kept of many results: counts, the first that are not proved, how many hold from which voltage on."""

    def __init__(self, keep: bool) -> None:
        self.verdicts: Counter[str] = Counter()
        self.rules: Counter[tuple[str, str]] = Counter()
        self.open: list[Result] = []
        self.faults: list[Fault] = []
        self.fault_count = 0
        self.from_voltage: Counter[int] = Counter()  # by the position of a share
        self.with_base = self.never = 0
        self.top = Fraction(0)  # of all bands, in pu
        self.keep, self.own_bands = keep, False
        self.results: list[Result] = []

    def add(self, result: Result) -> None:
        self.verdicts[result.verdict] += 1
        self.rules[result.verdict, result.rule or ""] += 1
        self.fault_count += len(result.faults)
        self.faults += result.faults[: MAX_FAULTS - len(self.faults)]
        if result.verdict not in ("proved", "bad input") and len(self.open) < SHOWN:
            self.open.append(result)
        if result.base is not None and result.critical is not None:
            self.with_base += 1
            self.top = max(self.top, result.band[1] / result.base)
            self.never += result.critical == ()
            if result.critical:
                per_unit = result.critical[1] / result.base
                self.from_voltage.update(k for k, share in enumerate(SHARES) if per_unit <= share)
        if self.keep:
            self.results.append(result)


def run(options: Any, progress: Any) -> int:
    """Decide the table or spec that the options name, write what they ask for, print the summary; the exit code.

    Raises: SpecError for a file that is neither, or for options that do not fit.
    """
    data = read(options.table, MAX_TABLE_BYTES)
    is_spec = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{" or (options.table.endswith(".toml"))
    _check_outputs(options, is_spec)
    summary = Summary(keep=options.json or options.plot is not None)
    with ExitStack() as stack:
        writer = Writer(stack, options.output) if options.output else None
        if is_spec:
            base = read_document(data).get("base_voltage")
            for result in decide_spec(decode_all(data), options.method, str(base) if base else None):
                summary.add(result)
                if writer:
                    writer.add(result)
        else:
            rows = LoadTable(data)
            summary.own_bands = rows.is_json or bool({"v_min", "v_max"}.intersection(rows.columns))
            certificate = stack.enter_context(open_atomically(Path(options.cert))) if options.cert else None
            if certificate:
                certificate.write((header(data, options.band) + "\n").encode())
            for decided in decide_table(rows, options.band, options.method, progress, options.jobs, options.keep_going):
                summary.add(decided.result)
                if writer:
                    writer.add(decided.result)
                if certificate:
                    certificate.write((decided.line + "\n").encode())
            if summary.faults and not options.keep_going:
                raise SpecError(_listed(summary))
            if certificate:
                certificate.write((footer(summary.verdicts) + "\n").encode())
        if writer:
            writer.end()
    files = [path for path in (options.output, options.cert) if path]
    if options.plot is not None:
        files += load_figures.draw_figures(options, summary.results)
    code = _code(summary)
    if options.json:
        print(json.dumps(_as_dict(options.table, summary, files, code), indent=1, ensure_ascii=False))
    else:
        print(render(options.table, summary, None if is_spec else options.band, files, sys.stdout.isatty()))
        if summary.faults:
            print(render_faults(_listed(summary), options.table, sys.stderr.isatty()), file=sys.stderr)
    return code


def _check_outputs(options: Any, is_spec: bool) -> None:
    """What can be refused before the work is done. Raises: SpecError."""
    faults = []
    for option, path in (("-o", options.output), ("--cert", options.cert)):
        if path is None:
            continue
        target = Path(path)
        if target.exists() and Path(options.table).exists() and target.samefile(options.table):
            faults.append(Fault("U001", option, f"cannot write {path}: it is the table itself"))
        elif target.is_dir() or not target.parent.is_dir():
            faults.append(Fault("U001", option, f"cannot write {path}: no such folder, or it is a folder itself"))
    if options.output and options.cert and Path(options.output).resolve() == Path(options.cert).resolve():
        faults.append(Fault("U001", "--cert", f"cannot write {options.cert}: -o names the same file"))
    if options.output and not options.output.lower().endswith((".csv", ".json")):
        faults.append(Fault("U001", "-o", f"{options.output} ends neither in .csv nor in .json"))
    if is_spec and options.cert:
        faults.append(Fault("U001", "--cert", "the certificate of a spec is written by `certify prove`"))
    if is_spec and options.band is not None:
        faults.append(Fault("U001", "--band", "the loads of a spec have the bands that it states"))
    if options.plot is None and (options.power_factor or options.cells is not None):
        faults.append(Fault("U001", "--plot", "--power-factor and --cells are about figures, and none is asked for"))
    if options.jobs is not None and not 0 < options.jobs <= MAX_JOBS:
        faults.append(Fault("U001", "--jobs", f"expected a number from 1 to {MAX_JOBS}, got {options.jobs}"))
    if options.plot is not None:
        faults += load_figures.find_faults(options)
    if faults:
        raise SpecError(tuple(faults))
    options.band = options.band or DEFAULT_BAND
    parse_band(options.band)


def _code(summary: Summary) -> int:
    names = {"proved": "certified"}
    return worst_of(EXIT_CODES[names.get(verdict, verdict)] for verdict in summary.verdicts)


def _listed(summary: Summary) -> tuple[Fault, ...]:
    more = summary.fault_count - len(summary.faults)
    rest = (Fault("S108", "", f"and {more} more faults"),) if more else ()
    return (*summary.faults, *rest)


def _as_dict(name: str, summary: Summary, files: list[str], code: int) -> dict[str, Any]:
    counts = {**summary.verdicts}
    rows = [to_exact(result) for result in summary.results]
    return {"table": name, "counts": counts, "files": files, "rows": rows, "exit_code": code}


def render(name: str, summary: Summary, band: Sequence[str] | None, files: list[str], colour: bool = False) -> str:
    """The summary for a terminal."""
    total = sum(summary.verdicts.values())
    where = f" from {band[0]} to {band[1]}" + " or on bands of their own" * summary.own_bands if band else ""
    loads = "load" if total == 1 else "loads"
    lines = [f"{name}: {total:,} {loads}{where}", ""]
    order = ("proved", "refuted", "conditional", "unknown", "bad input")
    words = {"proved": "monotone", "refuted": "not monotone", "conditional": "sampled only", "unknown": "undecided"}
    rows = []
    for verdict in order:
        if count := summary.verdicts[verdict]:
            rules = ", ".join(
                f"{rule} ({n:,})" for (v, rule), n in sorted(summary.rules.items()) if v == verdict and rule
            )
            rows.append((paint(verdict, colour, f"{verdict:11}"), f"{count:,}", words.get(verdict, "not read"), rules))
    lines.append(table(rows))
    if summary.with_base > 1:
        counts = [summary.from_voltage[k] for k in range(len(SHARES))]
        shown = [
            f"{count:,} from {approximate(share)} pu"
            for count, before, share in zip(counts, [0, *counts], SHARES, strict=False)
            if count > before and share <= summary.top
        ]
        shown.append(f"{summary.never:,} not even at the top of the band")
        lines += ["", f"monotone up to the top of the band, of {summary.with_base:,} loads: {', '.join(shown)}"]
    if summary.open:
        lines.append("")
    lines += [_open(result) for result in summary.open]
    more = sum(summary.verdicts[v] for v in ("refuted", "conditional", "unknown")) - len(summary.open)
    if more > 0:
        lines.append(f"  and {more:,} more that are not proved (-o FILE.csv lists every load)")
    if files:
        lines += ["", f"written: {', '.join(files)}"]
    return "\n".join(lines)


def _open(result: Result) -> str:
    name = f"row {result.number}" + (f" ({result.name})" if result.name else "")
    if result.verdict != "refuted":
        why = f" [{result.reason}]: {DIAGNOSTICS[result.reason].title}" if result.reason else ""
        return f"  {name}: {result.verdict}{why}"
    if result.violation is None:
        return f"  {name}: fails between two voltages of its disk"
    at = f"fails at {_volts(result.violation, result.base)}"
    if result.critical == () and result.violation == result.band[1]:
        return f"  {name}: {at}, the top of its band"
    if result.critical == ():
        return f"  {name}: {at}, and it is not monotone at the top of its band either"
    if result.critical:
        at += f"; monotone from {_volts(result.critical[1], result.base, up=True)} on"
    return f"  {name}: {at}"


def _volts(x: Fraction, base: Fraction | None, up: bool = False) -> str:
    return f"{decimal(x / base, up, 6)} pu" if base else f"{decimal(x, up, 6)} V"
