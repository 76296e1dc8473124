"""`certify loads`: the verdict about every row of a table of loads, each with its line of a certificate.

Rows are independent of each other: they are decided in chunks, on all cores if there are many, and come in order.
Every line is checked by the kernel from its text before it is written.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice
from typing import Any

from certify import __version__
from certify.kernel.check_loads import FORMAT, LoadVerdict, RowVerdict, check_row, read_row
from certify.kernel.claims import Context
from certify.kernel.data import Data
from certify.kernel.errors import Fault, Rejected, RuleFailure
from certify.kernel.load_proofs import lipschitz
from certify.kernel.loads import lipschitz_bound
from certify.kernel.model import LoadLaw, Pieces
from certify.kernel.proofs import RULES
from certify.kernel.quantity import parse_quantity
from certify.kernel.spec import ExpLoad, Microgrid, ZipLoad
from certify.kernel.table import Cells, LoadTable, parse_band
from certify.search.analysis import analyse, find_entries
from certify.search.loads import propose_disk
from certify.search.voltages import least_eigenvalue

CHUNK = 250  # rows decided at once
MANY = 4000  # rows from which on it pays to start processes
Band = tuple[str, str]


@dataclass(frozen=True)
class Result:
    """What is told of one load; voltages in volt, `modulus` and `lipschitz` in siemens, `product` in watt.

    `critical`: bracket of the voltage from which on the load is monotone, (0, 0) if from every voltage on, () if not
    even at the top of its band, None if unknown. `margin`: smallest eigenvalue of the symmetric part of the Jacobian on
    the band, per unit of the load's admittance |S0| / V0^2: a proved lower bound if the load is monotone, else the
    least that floats see. `pair` and `tangent` name the two voltages that refute, with the tangent of half their angle.
    """

    number: int
    name: str
    verdict: str
    rule: str | None = None
    band: tuple[Fraction, ...] = ()
    base: Fraction | None = None
    critical: tuple[Fraction, ...] | None = None
    strict: bool = False
    margin: float | None = None
    modulus: Fraction | None = None
    lipschitz: Fraction | None = None
    violation: Fraction | None = None
    pair: tuple[Fraction, ...] = ()
    tangent: Fraction | None = None
    product: Fraction | None = None
    faults: tuple[Fault, ...] = ()
    reason: str | None = None  # why it is not decided, as a code of `certify explain`
    law: LoadLaw | None = None
    load: ZipLoad | ExpLoad | None = None


@dataclass(frozen=True)
class Decided:
    """A result with its line of the certificate."""

    result: Result
    line: str


def header(table: bytes, band: Band) -> str:
    """The first line of a certificate about this table."""
    return _json(
        {
            "format": FORMAT,
            "table_sha256": hashlib.sha256(table).hexdigest(),
            "band": list(band),
            "provenance": {"certify": __version__, "python": platform.python_version()},
        }
    )


def footer(counts: Counter[str]) -> str:
    """The last line, which shows that none is missing."""
    return _json({"total": dict(counts)})


def decide_table(
    table: LoadTable,
    band: Band,
    method: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    jobs: int | None = None,
    keep_going: bool = True,
) -> Iterator[Decided]:
    """Every row in order. Without `keep_going`, rows after one with a fault are read for their faults only.

    Raises: SpecError if the band is none.
    """
    parse_band(band)
    rows = _with_progress(table, progress)
    first = list(islice(rows, MANY))
    jobs = jobs or (os.cpu_count() or 1 if len(first) == MANY else 1)
    chunks = _chunks(first, rows)
    if jobs == 1:
        faulty = False
        for chunk in chunks:
            for decided in _decide_chunk(chunk, table.units, band, method, faulty and not keep_going):
                faulty = faulty or bool(decided.result.faults)
                yield decided
        return
    yield from _in_parallel(chunks, table.units, band, method, keep_going, jobs)


def _in_parallel(
    chunks: Iterator[list[tuple[int, Any]]],
    units: dict[str, str],
    band: Band,
    method: str | None,
    keep: bool,
    jobs: int,
) -> Iterator[Decided]:
    from collections import deque
    from concurrent.futures import Future, ProcessPoolExecutor

    faulty = False
    with ProcessPoolExecutor(jobs) as pool:
        waiting: deque[Future[list[Decided]]] = deque()

        def submit(count: int) -> None:
            for chunk in islice(chunks, count):
                waiting.append(pool.submit(_decide_chunk, chunk, units, band, method, faulty and not keep))

        submit(3 * jobs)
        while waiting:
            decided = waiting.popleft().result()
            faulty = faulty or any(one.result.faults for one in decided)
            yield from decided
            submit(1)


def _with_progress(table: LoadTable, progress: Callable[[int, int], None] | None) -> Iterator[tuple[int, Any]]:
    total = max(table.data.count(b"\n"), 1)
    for count, row in enumerate(table):
        if progress and count % CHUNK == 0:
            progress(min(count, total), total)
        yield row


def _chunks(first: list[tuple[int, Any]], rest: Iterator[tuple[int, Any]]) -> Iterator[list[tuple[int, Any]]]:
    for k in range(0, len(first), CHUNK):
        yield first[k : k + CHUNK]
    while chunk := list(islice(rest, CHUNK)):
        yield chunk


def _decide_chunk(
    rows: Iterable[tuple[int, Cells | Fault]], units: dict[str, str], band: Band, method: str | None, only_read: bool
) -> list[Decided]:
    return [_decide_row(number, cells, units, band, method, only_read) for number, cells in rows]


def _decide_row(
    number: int, cells: Cells | Fault, units: dict[str, str], band: Band, method: str | None, only_read: bool
) -> Decided:
    name = cells.get("name", "") if isinstance(cells, dict) else ""
    name = str(name)[:200] if isinstance(name, str) and name.isprintable() else ""
    row = read_row(number, cells, units, band)
    if only_read:
        faults = row if isinstance(row, tuple) else ()
        return Decided(Result(number, name, "bad input" if faults else "not decided", faults=faults), "")
    entries = iter([{"status": "bad input"}]) if isinstance(row, tuple) else find_entries(row.pieces, method)
    rejections = []
    for entry in entries:  # the first will mostly do; the last is made of parts that the kernel has accepted
        line = _json({"row": number, **entry})
        try:
            return Decided(_row_result(check_row(number, row, json.loads(line)), name, method), line)
        except Rejected as rejection:
            rejections.append(rejection)
    raise rejections[-1]


def _row_result(checked: RowVerdict, name: str, method: str | None) -> Result:
    row, verdict = checked.row, checked.verdict
    if row is None or verdict is None:
        return Result(checked.number, name, "bad input", faults=checked.faults)
    result = to_result(checked.number, row.name, row.pieces, verdict, row.V0_volt, method)
    return replace(result, load=row.load)


def to_result(
    number: int, name: str, pieces: Pieces, verdict: LoadVerdict, base: Fraction | None, method: str | None = None
) -> Result:
    """A verdict of the kernel with the numbers that follow from it."""
    facts = {(what, unit): value for what, value, unit in verdict.facts}
    pair = tuple(value for what, value, _ in verdict.facts if what == "voltage of the pair")
    from_zero = verdict.status == "proved" and pieces[0][0][0] == 0  # then nothing is left below the band
    violation = facts.get(("linearisation not passive at", "V"))
    return Result(
        number,
        name,
        verdict.status,
        verdict.rule,
        (pieces[0][0][0], pieces[-1][0][1]),
        base,
        (Fraction(0), Fraction(0)) if from_zero else verdict.critical,
        verdict.strict,
        _margin(pieces, verdict, base),
        verdict.modulus,
        lipschitz_bound(pieces),
        violation,
        pair,
        facts.get(("tangent of half the angle between them", "")),
        facts.get(("violating product, at most", "W")),
        reason=None if verdict.status != "unknown" else "P210" if method else "P202",
        law=pieces[-1][1] if len(pieces) == 1 else None,
    )


def _margin(pieces: Pieces, verdict: LoadVerdict, base: Fraction | None) -> float | None:
    """Smallest eigenvalue over |S0| / V0^2: its proved lower bound, or else the least that floats see on the band."""
    law = pieces[-1][1]
    v = float(base if base is not None else pieces[-1][0][1])
    try:
        P, Q = (
            math.fsum(float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) for t in part)
            for part in (law.active, law.reactive)
        )
        unit = math.hypot(P, Q) / v**2
        if not unit:
            return None
        if verdict.modulus is not None:
            return float(verdict.modulus) / unit
        least = min(least_eigenvalue(own, band, 96) for band, own in pieces)
    except OverflowError:
        return None
    return least / unit if verdict.status == "refuted" else 0.0 if verdict.status == "proved" else None


def decide_spec(grid: Microgrid, method: str | None = None, base: str | None = None) -> Iterator[Result]:
    """The loads of every node of a microgrid, summed at each node. `base`: 1 pu, as text."""
    context = Context(grid)
    volts = parse_quantity(base, "V", {}) if base else None
    for number, node in enumerate((node for node in grid.nodes if node.has_static_load), 1):
        if node.current:
            yield _disk_result(number, node.name, context, method, volts)
        else:
            pieces = context.pieces(node.name)
            yield to_result(number, node.name, pieces, analyse(pieces, method), volts, method)


def _disk_result(number: int, node: str, context: Context, method: str | None, base: Fraction | None) -> Result:
    """Of a load given by its current, on its disk."""
    for proposal in propose_disk(context, node, True, method):
        try:
            facts = RULES["current", proposal.status, proposal.rule](context, node, Data(proposal.data))
            bound = lipschitz(context, node)
        except RuleFailure:
            continue
        product = next((value for what, value, _ in facts if what == "violating product"), None)
        strict, modulus = node in context.strict_loads, context.moduli.get(node) or None
        return Result(
            number,
            node,
            proposal.status,
            proposal.rule,
            base=base,
            strict=strict,
            modulus=modulus,
            lipschitz=bound,
            product=product,
        )
    return Result(number, node, "unknown", base=base, reason="P210" if method else "P211")


def _json(document: dict[str, Any]) -> str:
    return json.dumps(document, sort_keys=True, separators=(",", ":"))
