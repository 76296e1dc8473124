"""The committed tables of loads: as many rows as their sources have, sums of fractions, figures as the sources print them."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections import Counter
from decimal import Decimal
from pathlib import Path

import pytest

from tests.conftest import ROOT

FOLDER = ROOT / "tests" / "data" / "loads"
P_FRACTIONS, Q_FRACTIONS = ("Zp", "Ip", "Pp"), ("Zq", "Iq", "Pq")
ROWS = {
    "zip-measured": 15,
    "zip-gridlabd": 31,
    "zip-ochre": 37,
    "exp-published": 8,
    "exp-defaults": 10,
    "exp-measured": 4976,
}


def read(name: str) -> dict[str, dict[str, str]]:
    """The rows by their names, without units in the keys."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        table = csv.reader(file)
        keys = [cell.split(" [")[0] for cell in next(table)]
        rows = [dict(zip(keys, row, strict=True)) for row in table]
    found = {row["name"]: row for row in rows}
    assert len(found) == len(rows), "names are unique"
    return found


@pytest.mark.parametrize("name", ROWS)
def test_rows_and_cells(name: str) -> None:
    rows = read(name)
    assert len(rows) == ROWS[name]
    for row in rows.values():
        assert ("Q0" in row) != ("pf" in row)
        for key, cell in row.items():
            if key != "name" and not (name == "exp-measured" and key in ("np", "nq") and cell == ""):
                assert Decimal(cell).is_finite()
        assert Decimal(row["V0"]) > 0
        assert Decimal(row["P0"]) > 0
        assert 0 < Decimal(row.get("pf", "1")) <= 1


def test_every_table_is_known_and_named_in_the_sources() -> None:
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(ROWS)
    text = (FOLDER / "SOURCES.md").read_text(encoding="utf-8")
    assert all(f"## {name}.csv" in text for name in ROWS)


@pytest.mark.parametrize("name", ["zip-measured", "zip-gridlabd", "zip-ochre"])
def test_fractions_add_up(name: str) -> None:
    for row in read(name).values():
        for keys in (P_FRACTIONS, Q_FRACTIONS):
            assert abs(sum(Decimal(row[key]) for key in keys) - 1) <= Decimal("0.011"), row["name"]


# Typed from the sources; every digit counts.
@pytest.mark.parametrize(
    ("table", "name", "cells"),
    [
        ("zip-measured", "BOK-A00", "P0 496.33, Q0 125.94, V0 120.0, Zp 1.17, Ip -1.83, Pp 1.66, Zq 15.68, Iq -27.15, Pq 12.47"),
        ("zip-measured", "BOK-A04", "P0 1168.54, Q0 844.71, V0 208.0, Zp 0.24, Ip -0.23, Pp 0.99, Zq 4.79, Iq -7.61, Pq 3.82"),
        ("zip-measured", "BOK-A16", "P0 208.03, Q0 -20.58, V0 120.0, Zp 0.11, Ip -0.17, Pp 1.06, Zq 1.58, Iq -1.72, Pq 1.14"),
        ("zip-measured", "BOK-A28", "P0 256.2, Q0 21.04, V0 120.0, Zp 0.43, Ip 0.7, Pp -0.13, Zq -0.11, Iq 0.66, Pq 0.45"),
        ("zip-gridlabd", "elcap1990/LIGHTS", "P0 760.0, pf 0.97, V0 1, Zp 0.5, Ip 0.1, Pp 0.4, Zq 0.5, Iq 0.1, Pq 0.4"),
        ("zip-gridlabd", "elcap2010/FREEZER", "P0 610.0, pf 0.9, V0 1, Zp 0.1, Ip 0.0, Pp 0.9, Zq 0.1, Iq 0.0, Pq 0.9"),
        ("zip-gridlabd", "rbsa2014/MICROWAVE", "P0 120.0, pf 0.7, V0 1, Zp 0.0, Ip 0.0, Pp 1.0, Zq 0.0, Iq 0.0, Pq 1.0"),
        ("zip-gridlabd", "zipload-example", "P0 1000.0, V0 1, Zp 0.5, Ip 0.25, Pp 0.25, Zq 0"),
        ("zip-ochre", "MELs", "P0 1, pf 0.8, V0 1, Zp 0.36147, Ip -0.08583, Pp 0.72436, Zq 8.39985, Iq -14.1677, Pq 6.76785"),
        ("zip-ochre", "Heat Pump Water Heater", "pf 0.97, Zp 0.825, Ip -0.44, Pp 0.615, Zq 7.465, Iq -11.425, Pq 4.96"),
        ("zip-ochre", "Clothes Washer", "pf 0.65, Zp 0.05, Ip 0.31, Pp 0.64, Zq -0.56, Iq 2.2, Pq -0.64"),
        ("exp-published", "Refrigerator", "P0 1, pf 0.8, V0 1, np 0.77, nq 2.5"),
        ("exp-published", "Transformer (unloaded)", "pf 0.64, np 3.4, nq 11.5"),
        ("exp-defaults", "DSS-CVR-greencircuit", "P0 1, pf 0.9, V0 1, np 0.8, nq 3.0"),
        ("exp-defaults", "paper-zip-table", "np 1.57, nq 1.57"),
        ("exp-measured", "AirConditioner/0", "P0 485.41, Q0 95.52, V0 230.49, np 1.07, nq 3.96"),
        ("exp-measured", "AirConditioner/15", "P0 485.46, Q0 96.34, V0 230.55, np 1.06, nq 4.44"),
    ],
)  # fmt: skip
def test_figures_of_the_sources(table: str, name: str, cells: str) -> None:
    row = read(table)[name]
    for cell in cells.split(", "):
        key, value = cell.split()
        assert row[key] == value, cell


def test_the_load_with_three_power_factors() -> None:
    """500 W at 1, 250 W at 0.85 lagging, 250 W at 0.9 leading: from Q = P tan(acos pf), to as many digits as given."""
    row = read("zip-gridlabd")["zipload-example"]
    pf, Iq, Pq = (Decimal(row[key]) for key in ("pf", "Iq", "Pq"))
    of_current = (1 / Decimal("0.85") ** 2 - 1).sqrt() * 250
    of_power = -((1 / Decimal("0.9") ** 2 - 1).sqrt() * 250)
    Q0 = (1 / pf**2 - 1).sqrt() * 1000
    assert Iq + Pq == 1
    assert abs(Q0 - (of_current + of_power)) < Decimal("1e-20")
    assert abs(Q0 * Iq - of_current) < Decimal("1e-20")
    assert abs(Q0 * Pq - of_power) < Decimal("1e-20")


def test_samples_and_gaps_of_the_measured_series() -> None:
    rows = read("exp-measured")
    per_appliance = Counter(name.split("/")[0] for name in rows)
    assert len(per_appliance) == 23
    assert (per_appliance["Apartment"], per_appliance["ClothDryer"], per_appliance["Toaster"]) == (1298, 465, 6)
    gaps = Counter((row["np"] == "", row["nq"] == "") for row in rows.values())
    assert gaps == {(False, False): 4731, (True, False): 178, (False, True): 32, (True, True): 35}
    where = Counter(name.split("/")[0] for name, row in rows.items() if "" in (row["np"], row["nq"]))
    assert where == {
        "Apartment": 71,
        "Apartment_AggHeater": 71,
        "ClothDryer": 87,
        "Oven": 7,
        "Dishwasher": 5,
        "WashingMachine": 3,
        "AirConditioner": 1,
    }


def test_converter_refuses_fractions_that_do_not_add_up(tmp_path: Path) -> None:
    row = {"id": "x", "P0_W": 1, "Q0_var": 1, "V0_V": 1, **dict.fromkeys((*P_FRACTIONS, *Q_FRACTIONS), 0.5)}
    empty: dict[str, object] = {
        key: {"rows": []} for key in ("gridlabd_implicit_enduses", "ochre", "nptel_typical", "tool_defaults")
    }
    sets = {"sets": {"measured_appliances": {"rows": [row]}, **empty}}
    for name in ("zip_loads", "exp_loads"):
        (tmp_path / f"{name}.json").write_text(json.dumps(sets))
    (tmp_path / "exp_loads_timeseries.json").write_text('{"series": {}}')
    before = (FOLDER / "zip-measured.csv").read_bytes()
    command = [sys.executable, str(FOLDER / "convert.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode
    assert "do not add up to 1" in done.stderr
    assert (FOLDER / "zip-measured.csv").read_bytes() == before
