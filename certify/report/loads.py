"""What `certify loads` writes: a row of results for each load, a summary, and figures."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from decimal import ROUND_CEILING, ROUND_HALF_EVEN, Context
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

from certify.certificate import open_atomically
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_decimal, shorten
from certify.kernel.reader import Pair
from certify.kernel.table import LoadTable, parse_band
from certify.load_tables import Result, decide_spec, decide_table, footer, header
from certify.report.text import approximate, paint, render_faults, table
from certify.search.maps import exponents_hold, fractions_hold

COLUMNS = (
    *("row", "name", "verdict", "rule", "from_V", "to_V", "critical_V", "critical_pu", "strict", "margin_pu"),
    *("modulus_S", "lipschitz_S", "violation_V", "pair_a_V", "pair_b_V", "pair_angle_deg", "product_W", "faults"),
)
DIGITS = 12
SHOWN = 12  # refuted or undecided loads listed one by one
SHARES = tuple(Fraction(k, 100) for k in (50, 60, 70, 80, 85, 90, 95, 100))
POWER_FACTORS = ("0.8", "0.95", "1")
MAX_FAULTS = 39  # kept, so that they and the number of the others are what a message shows
MAX_BITS = 10_000  # of a number as text
MAX_CELLS = 1000  # of a map, in each direction
MAX_JOBS = 1000


@lru_cache
def _contexts(up: bool, digits: int) -> tuple[Context, Context]:
    """Of the result, and of the division before it is rounded."""
    rounding = ROUND_CEILING if up else ROUND_HALF_EVEN
    precisions = (digits, max(60, digits))
    first, second = (Context(prec=p, rounding=rounding, Emax=999_999, Emin=-999_999) for p in precisions)
    return first, second


def decimal(x: Fraction | None, up: bool = False, digits: int = DIGITS) -> str:
    """So many significant digits, rounded to the nearest, or up.

    >>> decimal(Fraction(2, 3)), decimal(Fraction(1, 3), up=True, digits=3), decimal(Fraction(20000))
    ('0.666666666667', '0.334', '20000')
    """
    if x is None:
        return ""
    context, exact = _contexts(up, digits)
    value = context.plus(exact.divide(*(exact.create_decimal(n) for n in x.as_integer_ratio())))
    text = f"{value:f}" if -7 < value.adjusted() < 15 else str(value)
    return text.rstrip("0").rstrip(".") if "." in text and "E" not in text else text


def to_cells(result: Result) -> dict[str, str]:
    """A result as text: decimals of twelve digits, a bound rounded to its safe side."""
    top = None if not result.critical else result.critical[1]
    per_unit = None if top is None or not result.base else top / result.base
    never = "none" if result.critical == () else ""
    angle = "" if result.tangent is None else f"{math.degrees(2 * math.atan(float(result.tangent))):.9g}"
    a, b = result.pair or (None, None)
    ends = result.band or (None, None)
    values = (
        str(result.number),
        result.name,
        result.verdict,
        result.rule or "",
        decimal(ends[0]),
        decimal(ends[1]),
        never or decimal(top, up=True),
        never or decimal(per_unit, up=True),
        ("yes" if result.strict else "no") if result.verdict == "proved" else "",
        "" if result.margin is None else f"{result.margin:.6g}",
        decimal(result.modulus),
        decimal(result.lipschitz, up=True),
        decimal(result.violation),
        decimal(a),
        decimal(b),
        angle,
        decimal(result.product, up=True),
        "; ".join(f"{fault.path}: {fault.message}" for fault in result.faults),
    )
    return dict(zip(COLUMNS, values, strict=True))


def to_exact(result: Result) -> dict[str, Any]:
    """A result for machines: exact rationals as text."""

    def text(values: Sequence[Fraction] | Fraction | None) -> Any:
        if values is None or isinstance(values, Fraction):
            return None if values is None else _rational(values)
        return [_rational(x) for x in values]

    entry = {"row": result.number, "name": result.name, "verdict": result.verdict, "rule": result.rule}
    entry |= {"band": text(result.band), "critical": "none" if result.critical == () else text(result.critical)}
    entry |= {"strict": result.strict, "margin": result.margin, "modulus": text(result.modulus)}
    entry |= {"lipschitz": text(result.lipschitz), "violation": text(result.violation), "pair": text(result.pair)}
    entry |= {"tangent": text(result.tangent), "product": text(result.product)}
    faults = [{"code": f.code, "path": f.path, "message": f.message} for f in result.faults]
    return {key: value for key, value in entry.items() if value not in (None, [])} | (
        {"faults": faults} if faults else {}
    )


def _rational(x: Fraction) -> str:
    """Exact, unless it has more digits than Python writes: then it is a bound from above, and rounded up."""
    size = max(x.numerator.bit_length(), x.denominator.bit_length())
    return str(x) if size <= MAX_BITS else decimal(x, up=True, digits=40)


class Writer:
    """Results as they come, to a CSV or JSON file that appears only when it is whole."""

    def __init__(self, stack: ExitStack, path: str) -> None:
        self.file = stack.enter_context(open_atomically(Path(path)))
        self.is_json = path.lower().endswith(".json")
        self.count = 0
        self.write("[" if self.is_json else ",".join(COLUMNS) + "\n")

    def write(self, text: str) -> None:
        self.file.write(text.encode())

    def add(self, result: Result) -> None:
        if self.is_json:
            self.write((",\n" if self.count else "\n") + json.dumps(to_exact(result), ensure_ascii=False))
        else:
            line = io.StringIO()
            csv.DictWriter(line, COLUMNS, lineterminator="\n").writerow(to_cells(result))
            self.write(line.getvalue())
        self.count += 1

    def end(self) -> None:
        if self.is_json:
            self.write("\n]\n")


class Summary:
    """What is kept of many results: counts, the first that are not proved, how many hold from which voltage on."""

    def __init__(self, keep: bool) -> None:
        self.verdicts: Counter[str] = Counter()
        self.rules: Counter[tuple[str, str]] = Counter()
        self.open: list[Result] = []
        self.faults: list[Fault] = []
        self.fault_count = 0
        self.from_voltage: Counter[int] = Counter()  # by the position of a share
        self.with_base = self.anywhere = self.never = 0
        self.keep = keep
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
            self.never += result.critical == ()
            if result.critical:
                per_unit = result.critical[1] / result.base
                self.from_voltage.update(k for k, share in enumerate(SHARES) if per_unit <= share)
        if self.keep:
            self.results.append(result)


def run(options: Any, progress: Any, exit_codes: dict[str, int], worst_first: Iterable[int]) -> int:
    """Decide the table or spec that the options name, write what they ask for, print the summary; the exit code.

    Raises: SpecError for a file that is neither, or for options that do not fit.
    """
    from certify.inputs import decode_all, read
    from certify.kernel.reader import read_document
    from certify.kernel.table import MAX_TABLE_BYTES

    data = read(options.table, MAX_TABLE_BYTES)
    is_spec = data[:4096].lstrip()[:1] == b"{" or (options.table.endswith(".toml"))
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
        files += _plot(options, summary)
    code = next(c for c in worst_first if c in _codes(summary, exit_codes))
    if options.json:
        print(json.dumps(_as_dict(options.table, summary, files, code), indent=1, ensure_ascii=False))
    else:
        import sys

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
    if options.jobs is not None and not 0 < options.jobs <= MAX_JOBS:
        faults.append(Fault("U001", "--jobs", f"expected a number from 1 to {MAX_JOBS}, got {options.jobs}"))
    if options.plot is not None:
        faults += _of_figures(options)
    if faults:
        raise SpecError(tuple(faults))
    parse_band(options.band)


def _of_figures(options: Any) -> list[Fault]:
    faults, folder = [], Path(options.plot)
    if (folder.exists() and not folder.is_dir()) or not folder.absolute().parent.is_dir():
        faults.append(
            Fault("U001", "--plot", f"cannot write to {folder}: no such folder to make it in, or it is a file")
        )
    for text in options.power_factor or ():
        try:
            good = 0 < parse_decimal(text) <= 1
        except QuantityError:
            good = False
        if not good:
            faults.append(
                Fault("U001", "--power-factor", f"expected a number above 0 and at most 1, got {shorten(text)}")
            )
    if not 2 <= options.cells <= MAX_CELLS:
        faults.append(Fault("U001", "--cells", f"expected a number from 2 to {MAX_CELLS}, got {options.cells}"))
    return faults


def _codes(summary: Summary, exit_codes: dict[str, int]) -> set[int]:
    names = {"proved": "certified"}
    return {exit_codes[names.get(verdict, verdict)] for verdict in summary.verdicts} or {0}


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
    where = f" from {band[0]} to {band[1]}" if band else ""
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
        counts = [(summary.from_voltage[k], share) for k, share in enumerate(SHARES)]
        shares = [f"{count:,} from {approximate(share)} pu" for count, share in counts if count]
        never = f"{summary.never:,} not even at the top of the band"
        lines += ["", f"monotone up to the top of the band: {', '.join([*shares, never])}"]
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
        return f"  {name}: {result.verdict}"
    if result.violation is None:
        return f"  {name}: fails between two voltages of its disk"
    at = f"fails at {_volts(result.violation, result.base)}"
    if result.critical == ():
        return f"  {name}: {at}, and not even monotone around the top of its band"
    if result.critical:
        at += f"; monotone from {_volts(result.critical[1], result.base, up=True)} on"
    return f"  {name}: {at}"


def _volts(x: Fraction, base: Fraction | None, up: bool = False) -> str:
    return f"{decimal(x / base, up, 6)} pu" if base else f"{decimal(x, up, 6)} V"


# --- figures ------------------------------------------------------------------------------------------------


def _plot(options: Any, summary: Summary) -> list[str]:
    """Margins over voltage, and the maps of the kinds of loads that there are. Raises: SpecError."""
    from certify.report.load_plots import exponent_map, fraction_map, margin_figure, save

    band = _per_unit(options.band)
    known = [r for r in summary.results if r.law is not None and r.base]
    folder = Path(options.plot)
    factors = [Fraction(text) for text in options.power_factor or POWER_FACTORS]
    figures: dict[str, Any] = {}
    if known:
        laws = [(r.name or f"row {r.number}", r.law, r.base) for r in known if r.law is not None and r.base is not None]
        statuses = [r.verdict if r.verdict in ("proved", "refuted") else "unknown" for r in known]
        figures["margins"] = margin_figure(laws, band, statuses)
    figures["exponents"] = exponent_map(
        factors, band, lambda np, nq, square: _word(exponents_hold(np, nq, square, band)), cells=options.cells
    )
    figures["fractions"] = fraction_map(
        factors, band, lambda Zp, Pp, square: _word(fractions_hold(Zp, Pp, square, band)), cells=options.cells
    )
    written = []
    try:
        folder.mkdir(exist_ok=True)
        for name, figure in figures.items():
            for suffix in ("svg", "png"):
                path = folder / f"{name}.{suffix}"
                save(figure, path)
                written.append(str(path))
    except OSError as error:
        raise SpecError((Fault("U001", "--plot", f"cannot write to {folder}: {error.strerror}"),)) from None
    return written


def _per_unit(band: Sequence[str]) -> Pair:
    from certify.kernel.quantity import parse_quantity

    low, high = (parse_quantity(text, "V", {"V": Fraction(1)}) for text in band)
    return low, high


def _word(holds: bool | None) -> str:
    return "unknown" if holds is None else "proved" if holds else "refuted"
