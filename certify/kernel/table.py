"""Tables of loads: CSV or JSON to exact loads, one in each row, with every fault by row and column.

A row is a ZIP load in fractions of P0 and Q0 at V0, a ZIP load in absolute coefficients, or an exponential load.
FORMAT.md, section 5, has the columns.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import isqrt
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.model import Pieces, load_law
from certify.kernel.quantity import NumberText, QuantityError, parse_quantity, shorten, unit_factor
from certify.kernel.reader import Pair, unique
from certify.kernel.spec import ExpLoad, ZipLoad

MAX_TABLE_BYTES = 1 << 29
MAX_JSON_BYTES = 1 << 27
MAX_LINE = 20_000
POWER_FACTOR_DIGITS = 40
HUGE = Fraction(10**30)
FAR = 20  # times V0 or a part of it: a band there is in the wrong unit

UNITS = {"P0": "W", "Q0": "var", "V0": "V", "v_min": "V", "v_max": "V"}
UNITS |= {"Yp": "S", "Yq": "S", "Ip": "A", "Iq": "A", "Pp": "W", "Pq": "var"}  # of absolute coefficients
# What a row of each kind needs, by the columns that tell the kinds apart.
KINDS = {
    "ZIP in fractions": ("P0", "V0", "Zp", "Ip", "Pp", "Zq", "Iq", "Pq"),
    "ZIP in absolute coefficients": ("V0", "Yp", "Ip", "Pp", "Yq", "Iq", "Pq"),
    "exponential": ("P0", "V0", "np", "nq"),
}
FRACTIONS = KINDS["ZIP in fractions"][2:]
PER_UNIT = {"V": Fraction(1)}
REACTIVE = ("Zq", "Iq", "Pq", "nq")
MARKS = {"Zp": 0, "Zq": 0, "Yp": 1, "Yq": 1, "np": 2, "nq": 2}
COLUMNS = tuple(dict.fromkeys(("name", "pf", *UNITS, *MARKS)))
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d", re.ASCII)
_HEADER = re.compile(r"\s*(\w+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", re.ASCII)

Cells = dict[str, Any]  # column -> raw value; empty cells are left out


@dataclass(frozen=True)
class Row:
    """One load of a table; `number` is its line in a CSV file, its position in a JSON list."""

    number: int
    name: str
    kind: str
    load: ZipLoad | ExpLoad
    V0_volt: Fraction
    band_volt: Pair

    @cached_property
    def pieces(self) -> Pieces:
        return ((self.band_volt, load_law((self.load,))),)


class LoadTable:
    """The rows of a table file, raw: (number, cells), or (number, fault) for a line that has no cells to speak of.

    Raises: SpecError, at once, if the file as a whole is not a table of loads.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) > MAX_TABLE_BYTES:
            raise _refusal("T001", f"more than {MAX_TABLE_BYTES} bytes")
        self.data = data.removeprefix(b"\xef\xbb\xbf")
        self.units: dict[str, str] = {}
        self.is_json = self.data[:64].lstrip()[:1] in (b"[", b"{")
        self.columns = () if self.is_json else self._header()

    def __iter__(self) -> Iterator[tuple[int, Cells | Fault]]:
        return self._json_rows() if self.is_json else self._csv_rows()

    def _lines(self) -> Iterator[tuple[int, list[str] | Fault]]:
        """The cells of each line, blank lines left out; a line is never read beyond what one may hold."""
        file, number = io.BytesIO(self.data), 0
        while line := file.readline(MAX_LINE + 1):
            number += 1
            if len(line) > MAX_LINE:
                yield number, Fault("T002", f"row {number}", f"a line of more than {MAX_LINE} bytes")
                while line and not line.endswith(b"\n"):
                    line = file.readline(1 << 20)
                continue
            try:
                cells = next(csv.reader([line.decode()], strict=True), [])
            except (UnicodeDecodeError, csv.Error) as error:
                told = "save the table as UTF-8" if isinstance(error, UnicodeDecodeError) else str(error)
                yield number, Fault("T002", f"row {number}", f"cannot be read as UTF-8 CSV: {told}")
                continue
            if any(cell.strip() for cell in cells):
                yield number, cells

    def _header(self) -> tuple[str, ...]:
        for number, cells in self._lines():
            if isinstance(cells, Fault):
                raise SpecError((cells,))
            faults, names = [], []
            if len(cells) == 1 and any(part.strip() in COLUMNS for part in re.split("[;\t]", cells[0])[1:]):
                raise _refusal("T001", "its columns are not separated by commas: save it with commas")
            for cell in cells:
                match = _HEADER.fullmatch(cell)
                name, unit = (match[1], match[2]) if match else (cell.strip(), None)
                names.append(name)
                if name not in COLUMNS:
                    near = [column for column in COLUMNS if column.lower() == name.lower()]
                    told = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(COLUMNS)}"
                    faults.append(Fault("T101", f"row {number}, column {shorten(cell)}", f"unknown column; {told}"))
                elif names.count(name) > 1:
                    faults.append(Fault("T101", f"row {number}, column {name}", "the column is given twice"))
                elif unit:
                    self.units[name] = unit
                    share = unit == "%" and name in FRACTIONS
                    try:
                        unit_factor(unit, "" if share else UNITS.get(name, ""), {} if name == "V0" else PER_UNIT)
                    except QuantityError as error:
                        faults.append(Fault(error.code, f"row {number}, column {name}", error.message))
            if not faults and ("V0" not in names or not MARKS.keys() & names):
                missing = "V0" if "V0" not in names else " or ".join(dict.fromkeys(MARKS))
                faults.append(Fault("T102", f"row {number}", f"there is no column {missing}"))
            if faults:
                raise SpecError(tuple(faults[:100]))
            return tuple(names)
        raise _refusal("T001", "the table is empty")

    def _csv_rows(self) -> Iterator[tuple[int, Cells | Fault]]:
        lines, number = self._lines(), 0
        next(lines)
        for number, cells in lines:
            if isinstance(cells, Fault):
                yield number, cells
            elif len(cells) != len(self.columns):
                yield number, Fault("T002", f"row {number}", f"{len(cells)} cells, but {len(self.columns)} columns")
            else:
                pairs = zip(self.columns, cells, strict=True)
                yield number, {column: text for column, cell in pairs if (text := cell.strip())}
        if not number:
            raise _refusal("T001", "the table has a header, but no rows")

    def _json_rows(self) -> Iterator[tuple[int, Cells | Fault]]:
        if len(self.data) > MAX_JSON_BYTES:
            raise _refusal("T001", f"more than {MAX_JSON_BYTES} bytes of JSON; use CSV")
        number: Any = NumberText
        hooks = {"parse_float": number, "parse_int": number, "parse_constant": number, "object_pairs_hook": unique}
        try:
            document = json.loads(self.data, **hooks)
        except (ValueError, RecursionError) as error:
            raise _refusal("T001", f"not valid JSON: {error}") from None
        if not isinstance(document, list) or not document:
            told = "the list is empty" if document == [] else "expected a list of rows, each a table of columns"
            raise _refusal("T001", told)
        for position, cells in enumerate(document, 1):
            if isinstance(cells, dict):
                yield position, {key: value for key, value in cells.items() if value is not None}
            else:
                yield position, Fault("T002", f"row {position}", f"expected a table of columns, got {shorten(cells)}")


def _refusal(code: str, message: str) -> SpecError:
    return SpecError((Fault(code, "", message),))


def parse_band(texts: tuple[str, str]) -> tuple[str, str]:
    """The ends of the default band of voltages, checked once. Raises: SpecError."""
    faults, sizes = [], []
    for text in texts:
        try:
            value = parse_quantity(text, "V", PER_UNIT)
            sizes.append((value, parse_quantity(text, "V", {"V": Fraction(2)}) / value if value else None))
        except QuantityError as error:
            faults.append(Fault(error.code, "--band", error.message))
        else:
            if value <= 0:
                faults.append(Fault("S208", "--band", f"must be positive, got {shorten(text)}"))
            elif not text.rstrip().endswith(("V", "pu")):  # 0.9 is no voltage that anyone means
                faults.append(Fault("S203", "--band", f"{shorten(text)} has no unit: write 0.9pu or 207V"))
    if not faults and sizes[0][1] == sizes[1][1] and sizes[0] >= sizes[1]:  # both in pu, or both in volt
        faults.append(Fault("S307", "--band", f"{shorten(texts[0])} is not below {shorten(texts[1])}"))
    if faults:
        raise SpecError(tuple(faults))
    return texts


def decode_row(number: int, cells: Cells, units: Mapping[str, str], band: tuple[str, str]) -> Row:
    """One load. `units`: of the columns whose header names one. Raises: SpecError with every fault of the row."""
    faults: list[Fault] = []
    values: dict[str, Fraction] = {}

    def fault(code: str, column: str, message: str) -> None:
        faults.append(Fault(code, f"row {number}, column {shorten(column).strip(chr(39))}", message))

    kinds = {MARKS[column] for column in cells if column in MARKS}
    if len(kinds) != 1:
        code, told = ("T104", "columns of more than one kind") if kinds else ("T102", "columns of no kind")
        options = "; or ".join(f"{kind}: {', '.join(columns)}" for kind, columns in KINDS.items())
        raise SpecError((Fault(code, f"row {number}", f"{told}; a row has those of one: {options}"),))
    kind = tuple(KINDS)[kinds.pop()]
    absolute = kind == "ZIP in absolute coefficients"
    given = [c for c in ("Q0", "pf") if c in cells]
    wanted = (*(("Q0",) if not (given or absolute) else given), *KINDS[kind])
    per_unit: dict[str, Fraction] = {}
    for column in (*wanted, *(c for c in ("v_min", "v_max") if c in cells)):
        if column in REACTIVE and column not in cells and (values.get("Q0") == 0 or abs(values.get("pf", 0)) == 1):
            values[column] = Fraction(0)  # of nothing
            continue
        if column not in cells:
            fault("T102", column, f"no value; a load that is {kind} needs one" + " (Q0 or pf)" * (column == "Q0"))
            continue
        unit = UNITS.get(column, "") if absolute or column in ("P0", "Q0", "V0", "v_min", "v_max") else ""
        try:
            values[column] = _number(cells[column], unit, units.get(column, ""), per_unit)
        except QuantityError as error:
            fault(error.code, column, error.message)
            continue
        if column == "V0":
            per_unit = {"V": values[column]} if values[column] > 0 else {}
        if column in ("V0", "v_min", "v_max") and values[column] <= 0:
            fault("S208", column, f"must be positive, got {shorten(cells[column])}")
        if values[column] and column in UNITS and not 1 / HUGE <= abs(values[column]) <= HUGE:
            fault("S202", column, f"{shorten(cells[column])} is absurd; in SI at most 1e30 in size, at least 1e-30")
        if column in ("np", "nq") and abs(values[column]) > 100:
            fault("S202", column, f"exponent {shorten(cells[column])} is absurd; at most 100 in size")
        if column == "pf" and not 0 < abs(values[column]) <= 1:
            fault("T105", column, f"a power factor is between -1 and 1 and not zero, got {shorten(cells[column])}")
    for column in cells:
        if column not in (*wanted, "name", "v_min", "v_max"):
            known = column in COLUMNS
            fault("T101", column, f"not a column of a load that is {kind}" if known else "unknown column")
    if len(given) == 2 or (absolute and given):
        fault("T104", given[0], "Q0 and pf exclude each other, and absolute coefficients need neither")
    name = cells.get("name", "")
    if not isinstance(name, str) or len(name) > 200 or not name.isprintable():
        fault("S103", "name", "expected a short line of text")
    if not faults and kind == "ZIP in fractions":
        for part in "pq":
            total = sum((values[letter + part] for letter in "ZIP"), Fraction(0))
            if abs(total - 1) > Fraction(1, 20) and not (part == "q" and _reactive(values) == 0):
                fault("T103", f"Z{part}", f"fractions Z{part} + I{part} + P{part} add up to {float_text(total)}, not 1")
    if not faults:
        ends = tuple(
            values.get(c) or parse_quantity(t, "V", per_unit) for c, t in zip(("v_min", "v_max"), band, strict=True)
        )
        if ends[0] >= ends[1]:
            own = [c for c in ("v_min", "v_max") if c in cells]
            told = f"the band is empty: {float_text(ends[0])} V to {float_text(ends[1])} V, one end by --band"
            fault("S307", own[0] if own else "V0", told if len(own) < 2 else told.rpartition(",")[0])
        elif ends[1] * FAR < values["V0"] or ends[0] > FAR * values["V0"]:
            told = f"{float_text(ends[0])} V to {float_text(ends[1])} V"
            fault(
                "T106", "v_min" if "v_min" in cells else "V0", f"{told} is far from V0 = {float_text(values['V0'])} V"
            )
    if faults:
        raise SpecError(tuple(faults))
    return Row(number, name, kind, _load(kind, values), values["V0"], (ends[0], ends[1]))


def float_text(x: Fraction) -> str:
    """A number for a message: six decimals at most."""
    digits = f"{abs(round(x * 10**6)):07d}"
    return f"{'-' if x < 0 else ''}{digits[:-6]}.{digits[-6:]}".rstrip("0").rstrip(".")


def _number(raw: object, unit: str, of_header: str, per_unit: Mapping[str, Fraction]) -> Fraction:
    """A cell in SI: a unit of its own, else that of the header, else SI."""
    text = raw if isinstance(raw, str) else str(raw) if isinstance(raw, int) and not isinstance(raw, bool) else ""
    if not text:
        raise QuantityError("S201", f"expected a number, got {shorten(raw)}")
    if _DECIMAL_COMMA.match(text):
        raise QuantityError("S201", f"a comma inside {shorten(text)}; a decimal point is meant, and no other comma")
    if of_header and (text[-1].isdigit() or text[-1] == "."):
        return parse_quantity(NumberText(text), "", {}) * unit_factor(of_header, unit, per_unit)
    return parse_quantity(str(text), unit, per_unit)


def _reactive(values: Mapping[str, Fraction]) -> Fraction:
    """Q0 in var, as given or from the power factor: positive if the current lags (pf > 0) behind positive P0."""
    if "Q0" in values:
        return values["Q0"]
    squared = 1 / values["pf"] ** 2 - 1
    scale = 10 ** (2 * POWER_FACTOR_DIGITS)
    tangent = Fraction(isqrt(squared.numerator * scale // squared.denominator), 10**POWER_FACTOR_DIGITS)
    return values["P0"] * tangent * (1 if values["pf"] > 0 else -1)


def _load(kind: str, values: Mapping[str, Fraction]) -> ZipLoad | ExpLoad:
    if kind == "ZIP in absolute coefficients":
        pairs = [(values[letter + "p"], values[letter + "q"]) for letter in "YIP"]
        return ZipLoad(pairs[0], pairs[1], pairs[2])
    P0, Q0, V0 = values["P0"], _reactive(values), values["V0"]
    if kind == "exponential":
        return ExpLoad(P0, values["np"], Q0, values["nq"], V0)
    pairs = [(P0 * values[x + "p"] / V0**e, Q0 * values[x + "q"] / V0**e) for e, x in ((2, "Z"), (1, "I"), (0, "P"))]
    return ZipLoad(pairs[0], pairs[1], pairs[2])
