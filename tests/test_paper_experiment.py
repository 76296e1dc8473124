"""The published experiment: what the simulation says of it, and that the committed report says the same."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy
import pytest

from tests import paper_experiment as experiment
from tests.conftest import ROOT
from tests.paper_experiment import DGUS, Run, Table, largest, saturated, share, volts
from tests.simulation_oracle import run as run_oracle

FOLDER = ROOT / "reports" / "cigre-mv"
REPORT = (FOLDER / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def told(table: Table, column: str, key: str) -> str:
    """What the report has in a cell."""
    lines = REPORT.splitlines()
    at = lines.index(table.header)
    (row,) = (line for line in lines[at + 2 : at + 2 + len(table.keys)] if line.startswith(f"| {key} |"))
    return row.strip("| ").split(" | ")[[table.key, *table.columns].index(column)]


def agree(cell: str, found: str) -> bool:
    """The same words, and numbers within one unit of the last digit shown."""
    if NUMBER.sub("#", cell) != NUMBER.sub("#", found):
        return False
    pairs = zip(NUMBER.findall(cell), NUMBER.findall(found), strict=True)
    return all(abs(float(a) - float(b)) <= 1.01 * max(unit(a), unit(b)) for a, b in pairs)


def unit(number: str) -> float:
    """Of the last digit.

    >>> unit("0.25"), unit("12"), unit("1.5e+06")
    (0.01, 1.0, 100000.0)
    """
    digits, _, power = number.partition("e")
    return float(f"1e{int(power or 0) - len(digits.partition('.')[2])}")


def compare(table: Table, columns: Iterable[str]) -> None:
    """What the report has in columns with what is found now."""
    for column in columns:
        for key in table.keys:
            cell, found = told(table, column, key), table.columns[column](key)
            assert agree(cell, found), (column, key, cell, found)


def settled_after(run: Run, node: str) -> float:
    found = run.settling(2, node)
    assert found is not None
    return found


def peaks(run: Run, phase: int) -> dict[str, float]:
    """The largest error of each DGU on its worse axis."""
    return {dgu.node: max(dgu.largest_volt) for dgu in run.phases[phase - 1].dgus}


def test_the_connection_from_equilibrium() -> None:
    run = experiment.plugged("equilibrium")
    assert settled_after(run, "1") == pytest.approx(1.57, abs=0.02)
    for node in DGUS[1:]:
        assert 0.5 <= settled_after(run, node) <= 0.6
    most = peaks(run, 2)
    assert 1200 < most.pop("5") < 1250
    assert max(most.values()) < 700
    assert max(experiment.peaks_from(run, "5", experiment.CONNECTED + 0.1)) < 700
    for node in DGUS:  # the modulus is what both axes are within, and more
        settling = run.settling(2, node, by_modulus=True)
        assert settling is not None
        assert settling >= settled_after(run, node)
        rows = (abs(run.simulation.times - 4 - settling) < 6e-3) & (run.simulation.times < 8)
        at = numpy.interp(-2.0, -abs(run.error(node)[rows]), run.simulation.times[rows])
        assert at == pytest.approx(4 + settling, abs=1e-4)
    compare(experiment.SETTLING, ("equilibrium, s", "by modulus, s"))
    compare(experiment.PEAKS, ("synchronised: d, q, V", "from 0.1 s after it on, V", "idle at its reference: d, q, V"))
    compare(experiment.STEPS, ("5 s, in the scenario, V", "6 s, in the scenario, V"))
    compare(experiment.STARTS, ("equilibrium: largest error, V",))


def test_a_discharged_filter() -> None:
    run = experiment.discharged("4.05")
    assert min(peaks(run, 2).values()) > 1.3e3
    assert peaks(run, 2)["3"] == pytest.approx(8.7e3, rel=0.01)
    assert all(agree(told(experiment.PEAKS, "discharged: d, q, V", node), largest(run, 2, node)) for node in DGUS)


def test_steps_of_loads_from_rest() -> None:
    run = experiment.stepped()
    assert [sorted(peaks(run, phase)) for phase in (2, 3)] == [[*DGUS], [*DGUS]]
    assert all(2.5 < x < 6.0 for x in peaks(run, 2).values())
    assert all(1.9 < x < 2.6 for x in peaks(run, 3).values())
    assert all(0.009 < float(share(run, phase, node)) < 0.031 for phase in (2, 3) for node in DGUS)
    compare(experiment.STEPS, ("5 s, from rest: d, q, V", "of 20 kV, %", "6 s, from rest: d, q, V", "of that, %"))


def test_the_flat_start() -> None:
    run = experiment.plugged("flat", "3")
    for node in DGUS:
        column = "largest error: d, q, V"
        assert agree(told(experiment.STARTS, column, node), largest(run, 1, node)), node
        settling = experiment.from_start(run, node)
        assert agree(told(experiment.STARTS, "flat: settled, s", node), settling), node


def test_the_energy_balance_closes() -> None:
    """In all four phases; the last one as far as it is cheap. Residuals are rounding, and differ between machines."""
    checked = experiment.balanced("6.02", 1e-10)
    assert [entry.number for entry in checked] == [1, 2, 3, 4]
    for entry in checked:
        assert entry.outcome == "certified"
        assert not entry.contradictions
        assert experiment.residual(entry) < 1e-10
        key = str(entry.number)
        assert float(told(experiment.BALANCE, "largest residual / H at its start", key)) < 1e-10
        assert agree(told(experiment.BALANCE, "H at its start, J", key), f"{entry.storages[0].sum():.4g}")


def test_the_gains_as_printed() -> None:
    """The network is stable with them, DGU 1 alone is not, and refuted is the passivity of DGU 1 in both."""
    network, alone = ("network, gains as printed", "DGU 1 alone, gains as printed")
    assert experiment.modes(experiment.case_spec(network))[0].real == pytest.approx(-2.5, abs=0.01)
    assert experiment.modes(experiment.case_spec(alone))[0].real == pytest.approx(55.6, abs=0.1)
    assert experiment.nudged(*experiment.CASES[network]).simulation.diverged is None
    grown = experiment.nudged(*experiment.CASES[alone])
    assert grown.simulation.diverged is not None
    assert "node 1" in grown.simulation.diverged.reason
    assert grown.rate == pytest.approx(55.6, abs=0.1)
    compare(experiment.GAINS, experiment.GAINS.columns)


def test_the_inverter_that_saturates() -> None:
    """0.5 s of what the report has for longer: the oscillation does not change any more by then."""
    oscillates = saturated("as it is", "0.5")
    assert oscillates.largest == pytest.approx(47.6e3, rel=0.01)
    assert oscillates.late == pytest.approx(47.6e3, rel=0.01)
    for name in ("ki = 100", "static load", "anti-windup 3 ms"):
        assert saturated(name, "0.2").late < 1
        assert told(experiment.SATURATION, "recovers", name) == "yes"
    column = "in the last fifth, kV"
    assert agree(told(experiment.SATURATION, column, "as it is"), f"{oscillates.late / 1e3:.2f}")
    assert told(experiment.SATURATION, "simulated, s", "as it is") == experiment.LONG
    assert told(experiment.SATURATION, "recovers", "as it is") == "no"


@pytest.mark.parametrize("time", ["3 ms", "20 ms"])
def test_anti_windup_beside_an_independent_integrator(time: str) -> None:
    document = experiment.tomllib.loads((ROOT / experiment.SATURATING).read_text())
    experiment.with_tracking(time)(document)
    ours = saturated(f"anti-windup {time}", "0.04")
    theirs = run_oracle(document, [], "zero", 0.04, ours.times, rtol=1e-8)["voltage", "a"]
    numpy.testing.assert_allclose(ours.sizes, numpy.abs(theirs - (13e3 + 16e3j)), rtol=0, atol=1)


def test_figures_are_there_and_small() -> None:
    shown = re.findall(r"\]\((\w+\.svg)\)", REPORT)
    assert sorted(shown) == sorted(path.name for path in FOLDER.glob("*.svg"))
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 2_000_000


def test_volts_of_nothing_are_zero() -> None:
    assert volts([3e-12, 2.06, 15.0], 1) == "0, 2.1, 15.0"
