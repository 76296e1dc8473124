"""Write the load tables of this folder from collections of measured and published coefficients.

    python tests/data/loads/convert.py SOURCE_FOLDER

SOURCE_FOLDER holds zip_loads.json, exp_loads.json and exp_loads_timeseries.json, each with the rows as their
sources print them; SOURCES.md says what those are. Numbers are copied as text, digit by digit, and never pass through
a float. Only one row is computed: GridLAB-D's load with three power factors, see `zip_gridlabd`.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterable, Sequence
from decimal import Context, Decimal
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
FRACTIONS = ("Zp", "Ip", "Pp", "Zq", "Iq", "Pq")
DIGITS = 30  # of the computed row
SLACK = Decimal("0.011")  # how far printed fractions may be from a sum of one
# Two of the rows of conventions are those of the paper that this project starts from.
RENAMED = {"SEED-ZIPfoot": "paper-zip-table", "SEED-EXP": "paper-exp-table"}

Row = Sequence[str]


def load(path: Path) -> Any:
    """JSON with every number as the text that stands there."""
    return json.loads(path.read_text(encoding="utf-8"), parse_float=str, parse_int=str)


def zip_measured(sets: Any) -> Iterable[Row]:
    yield ("name", "P0 [W]", "Q0 [var]", "V0 [V]", *FRACTIONS)
    for row in sets["measured_appliances"]["rows"]:
        yield (row["id"], row["P0_W"], row["Q0_var"], row["V0_V"], *(row[key] for key in FRACTIONS))


def zip_gridlabd(sets: Any) -> Iterable[Row]:
    """Thirty rows as printed; the last gives a power factor for each part, and here fractions of P0 and of Q0.

    The reactive power of a part with active power p and power factor f is p sqrt(1/f^2 - 1), with the sign of f. Those
    of the current and power part are irrational, so Q0 and with it `pf`, and Iq, are rounded to 30 digits; Zq is 0
    exactly, and Pq = 1 - Iq, so that the sum is exact.
    """
    yield ("name", "P0 [W]", "pf", "V0", *FRACTIONS)
    for row in sets["gridlabd_implicit_enduses"]["rows"]:
        if "pf" in row:
            name = f"{row['source_set']}/{row['name']}"
            yield (name, row["P0_W"], row["pf"], "1", *(row[key] for key in FRACTIONS))
        else:
            yield _of_three_factors(row)


def _of_three_factors(row: Any) -> Row:
    wide, narrow = Context(prec=3 * DIGITS), Context(prec=DIGITS)
    parts = ("impedance", "current", "power")
    shares = [Decimal(row[f"{part}_fraction"]) for part in parts]
    factors = [Decimal(row[f"{part}_pf"]) for part in parts]
    if sum(shares) != 1 or abs(factors[0]) != 1:
        raise ValueError(f"{row['id']}: expected shares that add up to 1 and an impedance of power factor 1")

    def reactive(share: Decimal, factor: Decimal) -> Decimal:
        root = wide.sqrt(wide.subtract(wide.divide(1, factor * factor), 1))
        return wide.multiply(share, root).copy_sign(factor)

    of_current, of_power = (reactive(*pair) for pair in list(zip(shares, factors, strict=True))[1:])
    whole = wide.add(of_current, of_power)  # Q0 / P0
    pf = narrow.plus(wide.divide(1, wide.sqrt(wide.add(1, wide.multiply(whole, whole)))))
    Iq = narrow.plus(wide.divide(of_current, whole))
    Pq = wide.subtract(1, Iq)
    return ("zipload-example", row["base_power_W"], str(pf), "1", *map(str, shares), "0", str(Iq), str(Pq))


def zip_ochre(sets: Any) -> Iterable[Row]:
    yield ("name", "P0", "pf", "V0", *FRACTIONS)
    for row in sets["ochre"]["rows"]:
        yield (row["name"], "1", row["pf"], "1", *(row[key] for key in FRACTIONS))


def exp_published(sets: Any) -> Iterable[Row]:
    yield ("name", "P0", "pf", "V0", "np", "nq")
    for row in sets["nptel_typical"]["rows"]:
        yield (row["name"], "1", row["pf"], "1", row["n_p"], row["n_q"])


def exp_defaults(sets: Any) -> Iterable[Row]:
    yield ("name", "P0", "pf", "V0", "np", "nq")
    for row in sets["tool_defaults"]["rows"]:
        yield (RENAMED.get(row["id"], row["id"]), "1", "0.9", "1", row["n_p"], row["n_q"])


def exp_measured(series: Any) -> Iterable[Row]:
    """One row for each sample, named appliance/second; an exponent that was not identified is an empty cell."""
    yield ("name", "P0 [W]", "Q0 [var]", "V0 [V]", "np", "nq")
    for appliance, columns in series.items():
        keys = ("time_s", "P0", "Q0", "V0", "npv", "nqv")
        for time, *values in zip(*(columns[key] for key in keys), strict=True):
            second = time.removesuffix(".0")
            yield (f"{appliance}/{second}", *("" if value is None else value for value in values))


def check(name: str, rows: Sequence[Row]) -> None:
    """Unique names, and fractions that add up to one but for rounding. Raises: ValueError."""
    names = [row[0] for row in rows[1:]]
    if len(set(names)) < len(names):
        raise ValueError(f"{name}: two rows have the same name")
    if FRACTIONS[0] in rows[0]:
        start = rows[0].index(FRACTIONS[0])
        for row in rows[1:]:
            for part in (row[start : start + 3], row[start + 3 : start + 6]):
                if abs(sum(map(Decimal, part), Decimal(0)) - 1) > SLACK:
                    raise ValueError(f"{name}: the fractions {', '.join(part)} of {row[0]} do not add up to 1")


def main(source: Path) -> None:
    zips, exps = (load(source / f"{kind}_loads.json")["sets"] for kind in ("zip", "exp"))
    tables = {
        "zip-measured": zip_measured(zips),
        "zip-gridlabd": zip_gridlabd(zips),
        "zip-ochre": zip_ochre(zips),
        "exp-published": exp_published(exps),
        "exp-defaults": exp_defaults(exps),
        "exp-measured": exp_measured(load(source / "exp_loads_timeseries.json")["series"]),
    }
    written = {name: list(table) for name, table in tables.items()}
    for name, rows in written.items():
        check(name, rows)
    for name, rows in written.items():
        with (HERE / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
        print(f"{name}.csv: {len(rows) - 1} rows")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
