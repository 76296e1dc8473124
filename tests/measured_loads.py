"""Which measured, published and default loads are monotone: decides every table of tests/data/loads and writes a report.

python tests/measured_loads.py [--report reports/loads.md]
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script

from certify.kernel.table import LoadTable, decode_row

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "tests" / "data" / "loads"
BAND = ("0.9 pu", "1.1 pu")
KINDS = {
    "zip-measured": "appliances on a test bench",
    "zip-gridlabd": "defaults of GridLAB-D",
    "zip-ochre": "defaults of OCHRE",
    "exp-published": "typical values of a lecture",
    "exp-defaults": "defaults of simulators",
    "exp-measured": "household appliances and apartments, over time",
}
SMALL = tuple(name for name in KINDS if name != "exp-measured")
ONE_BY_ONE = ("zip-measured", "exp-published", "exp-defaults")
SHARES = ("0.5", "0.6", "0.7", "0.8", "0.9", "1.0")  # of V0, from which on loads are counted as monotone
FEW = 200  # samples of exp-measured that the test decides again
POWER_FACTORS = ("0.7", "0.9", "0.98", "1")
Cells = dict[str, str]  # a row of a table, or of the results, by column


def read(name: str) -> list[Cells]:
    """The rows of a table as they stand there; units are left out of the columns."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        table = csv.reader(file)
        columns = [cell.split(" [")[0] for cell in next(table)]
        return [dict(zip(columns, row, strict=True)) for row in table]


def decide(rows: Sequence[Cells]) -> list[Cells]:
    """What `certify loads` writes about them. Raises: RuntimeError if it does not come to its end."""
    with tempfile.TemporaryDirectory() as name:
        table, results = Path(name) / "loads.csv", Path(name) / "results.csv"
        with table.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        command = [
            sys.executable,
            "-m",
            "certify",
            "loads",
            str(table),
            "--band",
            *BAND,
            "--keep-going",
            "-o",
            str(results),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
        if not results.exists():
            raise RuntimeError(done.stderr)
        with results.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))


def appliance(row: Cells) -> str:
    """exp-measured names its samples appliance/second."""
    return row["name"].split("/")[0]


def few_samples(rows: Iterable[Cells]) -> dict[str, list[Cells]]:
    """All samples of the appliances with the fewest, FEW samples together at most."""
    by_name: dict[str, list[Cells]] = {}
    for row in rows:
        by_name.setdefault(appliance(row), []).append(row)
    few: dict[str, list[Cells]] = {}
    for name, own in sorted(by_name.items(), key=lambda item: (len(item[1]), item[0])):
        if sum(map(len, few.values())) + len(own) <= FEW:
            few[name] = own
    return few


# --- lines of the report --------------------------------------------------------------------------------------


def rounded(text: str, digits: int, up: bool = False) -> str:
    """To its safe side: down for a margin, up for a product."""
    value = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR).create_decimal(text)
    return f"{value:f}"


def from_voltage(text: str) -> str:
    """The voltage from which on a load is monotone, rounded up; what lies far below every grid is not told apart."""
    if text in ("", "none"):
        return "never" if text else "unknown"
    return "< 0.001" if 0 < Decimal(text) < Decimal("0.001") else rounded(text, 4, up=True)


def count(results: Iterable[Cells], *verdicts: str) -> int:
    return sum(row["verdict"] in verdicts for row in results)


def source_line(name: str, results: Sequence[Cells]) -> str:
    loads = len(results) - count(results, "bad input")
    open_ = count(results, "unknown", "conditional")
    cells = (len(results), loads, count(results, "proved"), count(results, "refuted"), open_, len(results) - loads)
    return f"| `{name}` | {KINDS[name]} | " + " | ".join(f"{n:,}" for n in cells) + " |"


def from_line(name: str, results: Sequence[Cells]) -> str:
    criticals = [row["critical_pu"] for row in results if row["verdict"] != "bad input"]
    found = [Decimal(text) for text in criticals if text not in ("", "none")]
    cells = [sum(v <= Decimal(share) for v in found) for share in SHARES]
    last = (criticals.count("none"), criticals.count(""))
    return f"| `{name}` | {len(criticals):,} | " + " | ".join(f"{n:,}" for n in (*cells, *last)) + " |"


def load_line(row: Cells) -> str:
    """One load: verdict, from where on, margin, and what refutes it."""
    word = {"proved": "monotone", "refuted": "not monotone"}.get(row["verdict"], row["verdict"])
    pair = ""
    if row["verdict"] == "refuted":
        angle = float(row["pair_angle_deg"])
        pair = f"{row['pair_a_V']} V, {row['pair_b_V']} V at {angle if abs(angle) > 1e-9 else 0:.4g}°: "
        pair += f"{rounded(row['product_W'], 3, up=True)} W"
    margin = rounded(row["margin_pu"], 3)
    return f"| {row['name']} | {word} | {from_voltage(row['critical_pu'])} | {margin} | {pair} |"


def appliance_line(name: str, results: Sequence[Cells]) -> str:
    loads = [row for row in results if row["verdict"] != "bad input"]
    good = count(loads, "proved")
    found = [Decimal(row["critical_pu"]) for row in loads if row["critical_pu"] not in ("", "none")]
    share = f"{100 * good / len(loads):.1f} %" if loads else ""
    ends = " to ".join(dict.fromkeys(from_voltage(str(v)) for v in (min(found), max(found)))) if found else ""
    cells = (len(results), len(loads), good, count(loads, "refuted"), count(loads, "unknown", "conditional"))
    never = sum(row["critical_pu"] == "none" for row in loads)
    return f"| {name} | " + " | ".join(f"{n:,}" for n in cells) + f" | {share} | {ends} | {never:,} |"


# --- the report -----------------------------------------------------------------------------------------------

MEANING = """\
A static load is **monotone** on a range of voltages if its current follows its voltage: for any two voltage phasors U, V with magnitudes in
the range, at any angle to each other, Re (V - U)* (I(V) - I(U)) >= 0. An impedance is so at every voltage. This is what the proof of a
microgrid's stability asks of a load (with a margin, where the inverter at its node falls short of passivity): a monotone load may stand at
any node, in any number, whatever the lines and the other loads are.

A load that is **not monotone** can feed energy into a motion of the voltage within the range; the two voltages in the tables show it, with
the negative product in watt. This does not make the grid unstable, but nothing can be certified from this load alone. Its node needs other
devices, whose conductance makes up for it (heating, an impedance, an inverter with damping to spare), or it must have a lower share of the
power at the node. Loads at one node are decided as their sum: write them into a spec and run `certify loads SPEC`.

*from, pu*: the voltage from which on the load is monotone, up to 1.1 pu; 0 means every voltage, *never* that it is not monotone even at 1.1
pu. It may lie below what was measured. *margin*: the smallest eigenvalue of the symmetric part of the Jacobian of I(V) on the band, over
the load's own admittance |S0| / V0^2; proved where the load is monotone, in floats at one voltage where it is not. *refuted by*: magnitudes
of two voltages, the angle between them, and the product. Voltages from which on are rounded up, margins down."""


def without_law(rows: Sequence[Cells]) -> list[str]:
    """What can be said of samples that lack an exponent."""
    no_np = [row for row in rows if row["np"] == ""]
    no_nq = [row for row in rows if row["np"] != "" and row["nq"] == ""]
    best = decide([{**row, "nq": "2"} for row in no_nq])
    settled = count(best, "refuted")
    return [
        f"{len(no_np) + len(no_nq)} samples lack an exponent and are not loads: no law is given. {len(no_np)} of them lack `np` and stay",
        f"without a verdict. {len(no_nq)} lack only `nq`. With P = P0 (V/V0)^np, G = P/V^2, B = -Q/V^2,",
        "D = (np - 1) G^2 - (V B')^2 / 4 <= (np - 1) G^2, with equality for `nq` = 2: what is not monotone with `nq` = 2",
        f"is so with no `nq`, or any other law of Q. This settles {settled} of the {len(no_nq)}: they are not monotone, all with np < 1. The other",
        f"{len(no_nq) - settled} are without a law: whether they are monotone depends on `nq`.",
    ]


def remarks(rows: Sequence[Cells], results: Sequence[Cells]) -> list[str]:
    """Why samples fail, as far as the exponents tell."""
    failed = [row for row, result in zip(rows, results, strict=True) if result["verdict"] == "refuted"]
    steep = [row for row in failed if Fraction(row["np"]) >= 1]
    zero = sum(Fraction(row["nq"]) == 0 for row in steep)
    return [
        f"Of the {len(failed):,} samples that are not monotone, {len(failed) - len(steep):,} have np < 1, which decides it whatever `nq` is. Of the",
        f"other {len(steep):,}, {zero:,} have `nq` = 0, where the source clips `nq`, or sets it for small Q: their verdict is one about that value.",
    ]


def report(tables: dict[str, list[Cells]], results: dict[str, list[Cells]]) -> str:
    long_, steps = "exp-measured", len(SHARES)
    of = ("load", "verdict", "from, pu", "margin", "refuted by")
    lines = [
        "# Which real loads are monotone?",
        "",
        "`python tests/measured_loads.py`: `certify loads` on every table of `tests/data/loads`,",
    ]
    lines += [
        f"from {BAND[0]} to {BAND[1]}; where they come from is in `tests/data/loads/SOURCES.md`.",
        "",
        MEANING,
        "",
    ]
    lines += [
        "## By source",
        "",
        "| table | what | rows | loads | monotone | not monotone | undecided | without an exponent |",
    ]
    lines += ["| --- | --- |" + " ---: |" * 6, *(source_line(name, own) for name, own in results.items())]
    lines += [
        "",
        "From which voltage on they are monotone, up to 1.1 pu; each column includes those before it, but for the last two:",
    ]
    lines += ["", "| table | loads | " + " | ".join(f"{share} pu" for share in SHARES) + " | never | unknown |"]
    lines += ["| --- |" + " ---: |" * (steps + 3), *(from_line(name, own) for name, own in results.items())]
    for name in ONE_BY_ONE:
        lines += ["", f"## {name}: {KINDS[name]}", "", f"| {' | '.join(of)} |", "| --- | --- | ---: | ---: | --- |"]
        lines += [load_line(row) for row in results[name]]
        if name == "zip-measured":
            lines += ["", "![margins over the voltage](loads/margins.svg)"]
    lines += [
        "",
        f"## {long_}: {KINDS[long_]}",
        "",
        "*from, pu*: the range over the samples that are monotone from some voltage on.",
        "",
    ]
    lines += [
        "| appliance | samples | with exponents | monotone | not monotone | undecided | share | from, pu | never |"
    ]
    lines += ["| --- |" + " ---: |" * 8]
    names = dict.fromkeys(map(appliance, results[long_]))
    lines += [appliance_line(name, [row for row in results[long_] if appliance(row) == name]) for name in names]
    lines += ["", *remarks(tables[long_], results[long_]), "", *without_law(tables[long_]), ""]
    lines += ["![measured exponents](loads/exponents.svg)", ""]
    return "\n".join(lines)


# --- figures --------------------------------------------------------------------------------------------------


def draw(folder: Path, tables: dict[str, list[Cells]], results: dict[str, list[Cells]]) -> None:
    from certify.report.figures import save
    from certify.report.load_figures import _per_unit, _word
    from certify.report.load_maps import exponent_map
    from certify.report.load_plots import margin_figure
    from certify.search.maps import exponents_hold

    band = _per_unit(BAND)
    raw = LoadTable((FOLDER / "zip-measured.csv").read_bytes())
    loads = [decode_row(number, cells, raw.units, BAND) for number, cells in raw if isinstance(cells, dict)]
    laws = [(row.name, row.pieces[0][1], row.V0_volt) for row in loads]
    verdicts = [row["verdict"] for row in results["zip-measured"]]
    points = []
    for row in tables["exp-measured"]:
        if row["np"] and row["nq"]:
            P, Q = float(row["P0"]), float(row["Q0"])
            points.append((Fraction(row["np"]), Fraction(row["nq"]), Fraction(P / (P * P + Q * Q) ** 0.5)))
    figure = exponent_map(
        [Fraction(text) for text in POWER_FACTORS],
        band,
        lambda np, nq, square: _word(exponents_hold(np, nq, square, band)),
        points,
        cells=41,
    )
    for ax in figure.axes:
        for line in ax.lines:
            line.set_rasterized(line.get_marker() == "o")  # thousands of points are smaller as a picture
    folder.mkdir(exist_ok=True)
    save(margin_figure(laws, band, verdicts), folder / "margins.svg")
    save(figure, folder / "exponents.svg")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--report", type=Path, help="where to write it; figures go to a folder of the same name")
    options = parser.parse_args()
    tables = {name: read(name) for name in KINDS}
    results = {name: decide(rows) for name, rows in tables.items()}
    text = report(tables, results)
    if options.report:
        options.report.write_text(text, encoding="utf-8")
        draw(options.report.with_suffix(""), tables, results)
    print(text)


if __name__ == "__main__":
    main()
