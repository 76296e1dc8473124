"""The committed report on real loads says what the tool decides now: every small table, and whole appliances of the large one."""

from __future__ import annotations

import re

import pytest

from tests import measured_loads
from tests.conftest import ROOT

REPORT = (ROOT / "reports" / "loads.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", measured_loads.SMALL)
def test_small_tables(name: str) -> None:
    results = measured_loads.decide(measured_loads.read(name))
    lines = [measured_loads.source_line(name, results), measured_loads.from_line(name, results)]
    if name in measured_loads.ONE_BY_ONE:
        lines += [measured_loads.load_line(row) for row in results]
    for line in lines:
        assert f"{line}\n" in REPORT


def test_appliances_with_few_samples() -> None:
    few = measured_loads.few_samples(measured_loads.read("exp-measured"))
    rows = [row for own in few.values() for row in own]
    assert measured_loads.FEW / 2 < len(rows) <= measured_loads.FEW
    results = measured_loads.decide(rows)
    assert {row["verdict"] for row in results} == {"proved", "refuted"}
    for name in few:
        own = [row for row in results if measured_loads.appliance(row) == name]
        assert f"{measured_loads.appliance_line(name, own)}\n" in REPORT


def test_samples_without_an_exponent() -> None:
    assert f"{' '.join(measured_loads.without_law(measured_loads.read('exp-measured')))}" in REPORT.replace("\n", " ")


def test_lines_of_the_appliances_add_up() -> None:
    """Rows, loads, monotone, not monotone and undecided, as in the line of the whole table."""

    def numbers(line: str) -> list[int]:
        return [int(cell.replace(",", "")) for cell in line.split(" | ") if re.fullmatch(r"[\d,]+", cell)][:5]

    whole = next(line for line in REPORT.splitlines() if line.startswith("| `exp-measured` | household"))
    names = dict.fromkeys(map(measured_loads.appliance, measured_loads.read("exp-measured")))
    lines = [next(line for line in REPORT.splitlines() if line.startswith(f"| {name} |")) for name in names]
    assert [sum(column) for column in zip(*map(numbers, lines), strict=True)] == numbers(whole)


@pytest.mark.parametrize("name", ["margins", "exponents"])
def test_figures_are_small(name: str) -> None:
    assert f"(loads/{name}.svg)" in REPORT
    assert (ROOT / "reports" / "loads" / f"{name}.svg").stat().st_size < 200_000
