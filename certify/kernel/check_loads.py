"""The checker for tables of loads: reads the table again, and one line of the certificate for each of its rows.

FORMAT.md, section 5, has the grammar. A line answers for its row whether the load is monotone on its band, as a
certificate of a microgrid does for the load at a node, and from which voltage on it is.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from certify.kernel.claims import Fact
from certify.kernel.data import Data
from certify.kernel.errors import Fault, Rejected, RuleFailure, SpecError, require
from certify.kernel.load_proofs import METHODS, check_monotone, check_pair, read_modulus
from certify.kernel.loads import is_violated_at
from certify.kernel.model import Pieces, law_at, law_corners
from certify.kernel.quantity import shorten
from certify.kernel.reader import Pair, unique
from certify.kernel.table import Cells, LoadTable, Row, decode_row, parse_band

FORMAT = "certify/loads@1"
CRITICAL_WIDTH = Fraction(1, 10**9)  # of the bracket of a critical voltage, relative


@dataclass(frozen=True)
class LoadVerdict:
    """What is shown of one load.

    `critical`: a bracket of the voltage from which on it is monotone up to the top of its band; (0, 0) if from every
    voltage on, (0, v) if from v on at least, far below, () if not even at the top, None if nothing is said.
    `modulus` in siemens.
    """

    status: str
    rule: str | None = None
    strict: bool = False
    modulus: Fraction | None = None
    critical: Pair | tuple[()] | None = None
    facts: tuple[Fact, ...] = ()


@dataclass(frozen=True)
class RowVerdict:
    """A row with its verdict, or with the faults that keep it from being a load."""

    number: int
    row: Row | None
    verdict: LoadVerdict | None
    faults: tuple[Fault, ...] = field(default=())


def check_load(pieces: Pieces, entry: dict[str, Any]) -> LoadVerdict:
    """What an entry shows about a load. Raises: RuleFailure if it does not show what it says."""
    require(set(entry) == {"status", "rule", "data", "critical"}, "an entry has status, rule, data and critical")
    status, rule, data = entry["status"], entry["rule"], Data(entry["data"])
    critical = _critical(pieces, entry["critical"])
    if status == "unknown":
        require(rule is None and entry["data"] is None, "an unknown load has neither rule nor data")
        return LoadVerdict("unknown", critical=critical)
    if status == "refuted":
        require(rule == "voltage-pair", "a load is refuted by a pair of voltages")
        return LoadVerdict(status, rule, critical=critical, facts=check_pair(pieces, data))
    allowed = {"proved": [m for m in METHODS if m != "sampled"], "conditional": ["sampled"]}
    require(isinstance(status, str) and rule in allowed.get(status, []), "a load cannot be decided in this way")
    modulus, rest = read_modulus(data)
    require(not modulus or status == "proved", "what is only sampled has no modulus")
    strict = check_monotone(pieces, rule, rest, modulus)
    return LoadVerdict(status, rule, strict or modulus > 0, modulus or None, critical)


def _critical(pieces: Pieces, raw: object) -> Pair | tuple[()] | None:
    """The bracket of the critical voltage: monotone from its upper end on, not so at its lower end."""
    if raw is None:
        return None
    require(len(pieces) == 1, "a critical voltage is told of loads without a cut-off")
    (band, law) = pieces[0]
    if raw == "never":
        _require_violation(pieces, band[1])
        return ()
    bracket, rule, data = Data(raw).fields("bracket", "rule", "data")
    ends = bracket.vector()
    require(len(ends) == 2 and 0 <= ends[0] <= ends[1] < band[1], "a bracket has two ends below the top of the band")
    whole = ends[1] if ends[0] else band[1]  # a bracket from zero on is an upper bound, far below the band
    require(ends[1] - ends[0] <= CRITICAL_WIDTH * whole, "the bracket is too wide")
    if ends[0]:
        _require_violation(pieces, ends[0])
    name = rule.text()
    require(name in METHODS and name != "sampled", "a load cannot be decided in this way")
    check_monotone((((ends[1], band[1]), law),), name, data)
    return ends[0], ends[1]


def _require_violation(pieces: Pieces, v: Fraction) -> None:
    """G < 0 or D < 0 at a voltage, at a corner of the tolerances."""
    law = pieces[0][1]
    shown = any(is_violated_at(law_at(law, signs, outer=False), v) for signs in law_corners(law))
    require(shown, "the load is not shown to fail below its critical voltage")


def read_row(n: int, cells: Cells | Fault, units: dict[str, str], band: tuple[str, str]) -> Row | tuple[Fault, ...]:
    """The load of row n, or every fault that keeps it from being one."""
    try:
        return decode_row(n, cells, units, band) if isinstance(cells, dict) else (cells,)
    except SpecError as error:
        return error.faults


def check_row(number: int, row: Row | tuple[Fault, ...], line: object) -> RowVerdict:
    """One row with its line of the certificate. Raises: Rejected."""
    where = f"row {number}"
    if not isinstance(line, dict) or line.get("row") != number:
        raise Rejected("K105", where, "the certificate has no line about this row here")
    entry = {key: value for key, value in line.items() if key != "row"}
    if isinstance(row, tuple):
        if entry != {"status": "bad input"}:
            raise Rejected("K105", where, "the row is not a load")
        return RowVerdict(number, None, None, row)
    try:
        return RowVerdict(number, row, check_load(row.pieces, entry))
    except RuleFailure as failure:
        raise Rejected("K201", where, f"rule {shorten(entry.get('rule'))}: {failure}") from None
    except RecursionError:
        raise Rejected("K101", where, "nested too deeply") from None


def check_table(table: bytes, certificate: bytes) -> Iterator[RowVerdict]:
    """The verdict of every row, in order; the certificate is accepted only if this comes to its end.

    Raises: SpecError if the file is not a table; Rejected.
    """
    lines = iter(certificate.splitlines())
    head = _parse(next(lines, b""), "line 1", {"format", "table_sha256", "band", "provenance"})
    if head["format"] != FORMAT:
        raise Rejected("K102", "format", f"this checker reads {FORMAT}")
    if head["table_sha256"] != hashlib.sha256(table).hexdigest():
        raise Rejected("K103", "table_sha256", "the certificate is about another table, or the table has changed")
    band = head["band"]
    if not isinstance(band, list) or len(band) != 2 or not all(isinstance(end, str) for end in band):
        raise Rejected("K101", "band", "expected two voltages")
    ends = parse_band((band[0], band[1]))
    rows, counts = LoadTable(table), Counter[str]()
    for number, cells in rows:
        result = check_row(
            number, read_row(number, cells, rows.units, ends), _parse(next(lines, None), f"row {number}")
        )
        counts[result.verdict.status if result.verdict else "bad input"] += 1
        yield result
    if _parse(next(lines, None), "last line", {"total"})["total"] != dict(counts) or next(lines, None) is not None:
        raise Rejected("K111", "last line", "the rows make another total")


def _parse(line: bytes | None, where: str, keys: set[str] | None = None) -> dict[str, Any]:
    if line is None:
        raise Rejected("K101", where, "the certificate ends before this")

    def no_number(text: str) -> object:
        raise ValueError(f"a bare number {shorten(text)}; rationals are written as text")

    try:
        hooks: Any = {"parse_float": no_number, "parse_constant": no_number, "object_pairs_hook": unique}
        document = json.loads(line, **hooks)
    except (ValueError, RecursionError) as error:
        raise Rejected("K101", where, f"not a line of a certificate: {error}") from None
    if not isinstance(document, dict) or (keys is not None and set(document) != keys):
        raise Rejected("K101", where, "a line of a certificate is a table with other keys")
    return document
