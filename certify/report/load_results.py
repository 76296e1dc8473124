"""The results of `certify loads` in files: a row of decimals for each load, or exact numbers for machines."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from contextlib import ExitStack
from decimal import ROUND_CEILING, ROUND_HALF_EVEN, Context
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

from certify.certificate import open_atomically
from certify.load_tables import Result

COLUMNS = (
    *("row", "name", "verdict", "rule", "from_V", "to_V", "critical_V", "critical_pu", "strict", "margin_pu"),
    *("modulus_S", "lipschitz_S", "violation_V", "pair_a_V", "pair_b_V", "pair_angle_deg", "product_W", "faults"),
)
DIGITS = 12
MAX_BITS = 10_000  # of a number as text


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
    entry |= {"tangent": text(result.tangent), "product": text(result.product), "reason": result.reason}
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
