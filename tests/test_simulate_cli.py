"""`certify simulate` as its users see it: text, JSON, files and pictures, states to start from, bad input, divergence."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import zipfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy
import pytest

from certify.cli import main
from certify.diagnostics import DIAGNOSTICS
from certify.report.simulation_plots import draw_figures
from certify.samples import read_state
from certify.settling import Watch
from certify.simulation import Course, simulate
from tests.conftest import ROOT

CIGRE, OSCILLATOR = "specs/cigre-mv.toml", "specs/saturating-inverter.toml"
SMALL = """format = "certify/microgrid@1"
frequency = "50 Hz"
[filter.lc]
R = "0.1 ohm"
L = "1.8 mH"
C = "25 uF"
[controller.pi]
kind = "state-feedback"
let = { kp = 1000, ki = 1000 }
K11 = "1 - kp*L"
K12 = [["R - ki*(1/kp + 1)", "-w0*L"], ["w0*L", "R - ki*(1/kp + 1)"]]
K13 = "ki"
[node.a]
dgu = { filter = "lc", controller = "pi", reference = ["20 kV", "0 V"] }
load = [{ kind = "rl", R = "50 ohm", L = "0.1 H" }]
[node.b]
dgu = { filter = "lc", controller = "pi", reference = ["20 kV", "0 V"] }
[[line]]
name = "ab"
from = "a"
to = "b"
R = "1 ohm"
L = "1 mH"
C = "10 nF"
[scenario.plug-in]
end = "30 ms"
disconnected = ["b"]
event = [{ at = "10 ms", connect = "b" }]
"""
GROWS = SMALL.replace('K13 = "ki"', 'K13 = "-10*ki"')


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture
def grows(tmp_path: Path) -> Path:
    path = tmp_path / "grows.toml"
    path.write_text(GROWS)
    return path


def told(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """What was printed as JSON, which must be strict."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    found: dict[str, Any] = json.loads(capsys.readouterr().out, parse_constant=refuse)
    return found


def test_cigre_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", CIGRE, "--end", "0.02", "--samples", "20"]) == 0
    output = capsys.readouterr().out
    assert output.startswith(f"SIMULATED: {CIGRE}, 0 s to 0.02 s, start: flat\n")
    assert "11 nodes, 6 DGUs, 12 lines; exponential method, tolerance 1e-08 a step" in output
    assert output.count("not by the end") == 6
    assert "nodes without a DGU: |V| from" in output
    assert "stay within 2 V up to the end of the phase" in output  # 0.01 % of 20 kV
    assert "no proof" in output


def test_settling_of_the_published_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    """DGU 1 settles 1.57 s after the connection at 4 s, across the load step at 5 s: the paper's figure."""
    assert main(["simulate", CIGRE, "--scenario", "plug-in", "--samples", "8", "--json"]) == 0
    result = told(capsys)
    assert result["exit_code"] == 0
    assert result["outcome"] == "simulated"
    assert [phase["number"] for phase in result["phases"]] == [1, 2, 3, 4]
    assert [phase["off"] for phase in result["phases"]] == [["5"], [], [], []]
    assert result["phases"][1]["events"][0]["text"] == "DGU 5 connects"
    (one,) = (dgu for dgu in result["phases"][1]["dgus"] if dgu["node"] == "1")
    assert not one["settled"]
    assert one["settling_time"] is None
    assert one["finally"]["phase"] == 3
    assert one["finally"]["after"] == pytest.approx(1.5676, abs=2e-4)
    assert one["finally"]["at"] == pytest.approx(4 + one["finally"]["after"])
    assert all(dgu["settled"] for dgu in result["phases"][2]["dgus"])
    (again,) = (dgu for dgu in result["phases"][2]["dgus"] if dgu["node"] == "1")
    assert again["settling_time"] == pytest.approx(one["finally"]["after"] - 1)
    assert max(dgu["settling_time"] for dgu in result["phases"][1]["dgus"] if dgu["settled"]) < 0.6


def test_watched_errors_are_those_of_dense_samples() -> None:
    """Settling times and largest errors against brute force, half a microsecond between samples."""
    spec = (ROOT / OSCILLATOR).read_bytes().replace(b', limits = ["14189 V", "17751 V"]', b"")
    end, band = Fraction(1, 25), 50.0
    watch = Watch(lambda *_: band)
    times = numpy.linspace(0, float(end), 80_001)
    result = simulate(spec, start="zero", end=end, samples=times, observe=watch)
    (phase,) = watch.result(result)
    (dgu,) = phase.dgus
    e = numpy.abs(result.part("voltage", "a") - [13000, 16000])
    outside = times[numpy.flatnonzero(e.max(axis=1) > band)[-1]]
    assert dgu.settled
    assert dgu.outside_second is not None
    assert 0 <= dgu.outside_second - outside <= times[1]
    assert dgu.largest_volt == pytest.approx(e.max(axis=0), rel=1e-4)
    assert phase.settling_second(dgu) == dgu.outside_second


def test_rapid_oscillations_are_not_overlooked() -> None:
    """A window may be longer than many periods of a line that rings: still the last of them counts."""
    spec = (ROOT / CIGRE).read_bytes()
    end, times = Fraction(1, 50), numpy.linspace(0, 0.02, 200_001)
    for band in (500.0, 1000.0):
        watch = Watch(lambda *_, band=band: band)
        result = simulate(spec, end=end, samples=times, observe=watch)
        (phase,) = watch.result(result)
        for dgu in phase.dgus:
            e = numpy.abs(result.phasor("voltage", dgu.node) - dgu.reference_volt)
            pairs = result.part("voltage", dgu.node) - [dgu.reference_volt.real, dgu.reference_volt.imag]
            outside = numpy.flatnonzero(numpy.abs(pairs).max(axis=1) > band)
            assert dgu.outside_second == pytest.approx(times[outside[-1]], abs=2.1e-7)
            assert max(dgu.largest_volt) == pytest.approx(numpy.abs(pairs).max(), rel=2e-3)
            assert e.max() >= max(dgu.largest_volt) * 0.99


def test_what_never_settles_and_what_is_settled_all_along(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(small), "--start", "equilibrium", "--end", "5ms"]) == 0
    assert capsys.readouterr().out.count("all along") == 2
    assert main(["simulate", OSCILLATOR, "--start", "zero", "--end", "0.05"]) == 0
    output = capsys.readouterr().out
    assert "times in or out of limits" in output
    assert "not by the end" in output
    assert "away from the equilibrium without limits (node a)" in output
    assert main(["simulate", OSCILLATOR, "--start", "zero", "--end", "50 ms", "--json"]) == 0
    (phase,) = told(capsys)["phases"]
    assert phase["switches"] > 50
    (dgu,) = phase["dgus"]
    assert not dgu["settled"]
    assert dgu["finally"] is None
    assert dgu["last_outside"] == 0.05


def test_the_band(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def band(*options: str) -> float:
        assert main(["simulate", str(small), "--end", "1ms", "--json", *options]) == 0
        return float(told(capsys)["phases"][0]["dgus"][0]["band"])

    assert band() == pytest.approx(2)  # no base voltage: of the reference
    assert band("--band", "1 %") == pytest.approx(200)
    assert band("--band", "0.5 kV") == 500
    assert band("--band", "3") == 3
    small.write_text(SMALL.replace("[filter", 'base_voltage = "10 kV"\n[filter', 1))
    assert band() == pytest.approx(1)
    assert band("--band", "0.01 pu") == pytest.approx(100)
    assert main(["simulate", str(small), "--end", "1ms", "--band", "1 mV"]) == 0
    assert "near the accuracy of the simulation" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_samples_go_out_and_come_back(
    kind: str, small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two halves a simulation is what it is at once; NaN where the DGU was off."""
    file, rest = tmp_path / f"first.{kind}", tmp_path / f"rest.{kind}"
    whole, course = simulate(SMALL.encode(), "plug-in"), Course(SMALL.encode(), "plug-in")
    assert main(["simulate", str(small), "--scenario", "plug-in", "--end", "10ms", "-o", str(file)]) == 0
    assert f"samples: 1001 of {len(whole.columns)} columns in {file}" in capsys.readouterr().out
    state = read_state(str(file), course)
    off = numpy.isnan(state)
    assert {name.split(",")[0] for name, x in zip(whole.columns, off, strict=True) if x} == {
        "current of the DGU at node b",
        "integrator of the DGU at node b",
    }
    at = int(numpy.searchsorted(whole.times, 0.01))
    assert state[~off] == pytest.approx(whole.states[at][~off], rel=1e-6, abs=1e-3)
    # read and written bit by bit; the first sample of what starts there has been in modes and back
    assert main(["simulate", str(small), "--end", "1us", "--samples", "1", "--scenario", "plug-in",
                 "--start", str(file), "-o", str(rest)]) == 0  # fmt: skip
    if kind == "npz":
        with numpy.load(rest, allow_pickle=False) as archive:
            assert archive["states"][0] == pytest.approx(state, rel=1e-9, abs=1e-6, nan_ok=True)
            assert (archive["states"][-1][~off] == read_state(str(rest), course)[~off]).all()
            assert tuple(archive["columns"]) == whole.columns
            assert archive["times"].tolist() == [0.0, 1e-6]
            about = json.loads(str(archive["metadata"]))
            assert about["format"] == "certify/simulation@1"
            assert about["start"] == str(file)
            assert set(archive["units"]) == {"V", "A", "V s"}
    else:
        with rest.open(newline="") as lines:
            rows = list(csv.reader(lines))
        assert rows[0][:2] == ["t", "voltage at node a, d [V]"]
        first, last = ([float(x) if x else numpy.nan for x in row[1:]] for row in rows[1:])
        assert first == pytest.approx(state, rel=1e-9, abs=1e-6, nan_ok=True)
        assert last == pytest.approx(read_state(str(rest), course), rel=0, abs=0, nan_ok=True)
    assert [x.name for x in tmp_path.iterdir() if x.name.startswith(".")] == []


def test_a_state_by_name_and_as_a_list(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    course = Course(SMALL.encode(), "plug-in")
    first = simulate(SMALL.encode(), "plug-in", end=Fraction(1, 1000), samples=1)
    named = {name: x for name, x in zip(first.columns, first.states[-1].tolist(), strict=True) if x == x}
    listed = [None if x != x else x for x in first.states[-1].tolist()]
    for document in (named, {**named, "current of the DGU at node b, d": None}, listed):
        file = tmp_path / "state.json"
        file.write_text(json.dumps(document))
        assert read_state(str(file), course) == pytest.approx(first.states[-1], nan_ok=True)
        assert main(["simulate", str(small), "--scenario", "plug-in", "--end", "1ms", "--start", str(file)]) == 0
        assert f"start: {file}" in capsys.readouterr().out
    # without the scenario everything is on, and two columns of DGU b are missing on each axis
    assert main(["simulate", str(small), "--start", str(file)]) == 2
    assert capsys.readouterr().err.count("on in the first phase") == 4


def test_the_voltage_at_a_linear_loop_has_to_agree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, file = ROOT / "specs/custom-loop.json", tmp_path / "loop.npz"
    assert main(["simulate", str(spec), "--start", "equilibrium", "--end", "1ms", "-o", str(file)]) == 0
    course = Course(spec.read_bytes())
    state = read_state(str(file), course)
    columns = simulate(spec.read_bytes(), start="equilibrium", end=Fraction(1, 10**6), samples=1).columns
    loop = next(part[1] for part in course.parts if part[0] == "loop")
    document = dict(zip(columns, state.tolist(), strict=True))
    document[f"voltage at node {loop}, d"] += 10
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(document))
    assert main(["simulate", str(spec), "--start", str(wrong)]) == 2
    assert "10 V away from what the states of the loop there make" in capsys.readouterr().err
    del document[f"voltage at node {loop}, d"], document[f"voltage at node {loop}, q"]
    wrong.write_text(json.dumps(document))
    assert main(["simulate", str(spec), "--end", "1ms", "--start", str(wrong)]) == 0
    capsys.readouterr()


BAD = {
    "end of zero": (["--end", "0"], "U005", "after 0 s"),
    "end before the start": (["--end", "-1"], "U005", "got '-1'"),
    "end in metres": (["--end", "1 m"], "U005", "expected s"),
    "end without sense": (["--end", "soon"], "U005", "'soon'"),
    "end that is no number": (["--end", "nan"], "U005", "'nan'"),
    "end after the scenario": (
        ["--scenario", "plug-in", "--end", "31ms"],
        "U005",
        "after the end of the scenario, 0.03 s",
    ),
    "no samples": (["--samples", "0"], "U005", "from 1 to"),
    "too many samples": (["--samples", "99999999"], "U007", "take fewer"),
    "no tolerance": (["--tolerance", "0"], "U005", "1e-13 to 1e-2"),
    "wide tolerance": (["--tolerance", "0.5"], "U005", "1e-13 to 1e-2"),
    "no band": (["--band", "0"], "U005", "more than 0"),
    "band in ampere": (["--band", "3 A"], "U005", "expected V"),
    "band in pu without a base": (["--band", "0.1 pu"], "U005", "pu is not defined"),
    "unknown scenario": (["--scenario", "plugin"], "U002", "there are: plug-in"),
    "a start that is no word": (["--start", "zeros"], "U006", "did you mean zero?"),
    "a start that is not there": (["--start", "no.npz"], "U006", "No such file"),
    "a folder as start": (["--start", "."], "U006", "directory"),
    "an endless start": (["--start", "/dev/zero"], "U006", "more than"),
    "output in no folder": (["-o", "no/such/folder.npz"], "U001", "no such folder"),
    "output of no kind": (["-o", "x.parquet"], "U001", "must end in .npz or .csv"),
    "pictures in no folder": (["--plot", "no/such/folder"], "U001", "no folder to make it in"),
    "pictures into a file": (["--plot", "README.md"], "U001", "no folder"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options(case: str, small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options, code, message = BAD[case]
    before = sorted(small.parent.iterdir())
    assert main(["simulate", str(small), *options]) == 2
    output = capsys.readouterr()
    assert not output.out
    assert f"error[{code}]" in output.err
    assert message in output.err
    assert f"help: {DIAGNOSTICS[code].remedy}" in output.err
    assert sorted(small.parent.iterdir()) == before


def test_all_faults_at_once(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [
        "--end",
        "-1",
        "--tolerance",
        "1",
        "-o",
        "x.txt",
        "--start",
        "nowhere",
        "--band",
        "1A",
        "--plot",
        "README.md",
    ]
    assert main(["simulate", str(small), *options, "--json"]) == 2
    faults = told(capsys)["faults"]
    assert [fault["path"] for fault in faults] == ["-o", "--plot", "--end", "--tolerance", "--band", "--start"]
    assert main(["simulate", "specs/negative/many-faults.toml", "--end", "0"]) == 2
    output = capsys.readouterr().err
    assert all(f"error[{code}]" in output for code in ("U005", "S101", "S203"))
    assert main(["simulate", str(small), "-o", str(small)]) == 2
    assert "it is the spec itself" in capsys.readouterr().err
    assert small.read_text() == SMALL


GOOD = {
    f"{what}, {axis}": 1.0
    for what in (
        "voltage at node a",
        "voltage at node b",
        "current of the DGU at node a",
        "integrator of the DGU at node a",
        "current of the DGU at node b",
        "integrator of the DGU at node b",
        "current in line ab",
        "current of R-L load 0 at node a",
    )
    for axis in "dq"
}
STATES = {
    "too short": ("[1, 2, 3]", "3 numbers, where 16 are expected"),
    "no number": ('{"voltage at node a, d": "x"}', "voltage at node a, d: not a finite number"),
    "a boolean": ('{"voltage at node a, d": true}', "voltage at node a, d: not a finite number"),
    "nothing": ('{"voltage at node a, d": null}', "voltage at node a, d: empty"),
    "NaN": ('{"voltage at node a, d": NaN}', "voltage at node a, d: "),
    "infinite": ('{"voltage at node a, d": -Infinity}', "voltage at node a, d: not a finite number"),
    "out of range": ('{"voltage at node a, d": 1e999}', "voltage at node a, d: not a finite number"),
    "many digits": ('{"voltage at node a, d": 1%s}' % ("0" * 400), "voltage at node a, d: not a finite number"),
    "absurd": ('{"voltage at node a, d": 1e30}', "voltage at node a, d: 1e+30 is absurd"),
    "misspelt": ('{"voltage at noda a, d": 1}', "did you mean 'voltage at node a, d'?"),
    "twice": ('{"voltage at node a, d": 1, "voltage at node a, d": 2}', "given twice"),
    "text": ("hello", "is not a state as JSON"),
    "a number": ("1", "expected a table of numbers by column"),
    "deep": ("[" * 100_000, "is not a state as JSON"),
}


@pytest.mark.parametrize("case", STATES)
def test_bad_states(case: str, small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, message = STATES[case]
    file = tmp_path / "state.json"
    if text.startswith("{") and case not in ("twice", "many digits"):
        document = {**GOOD, **json.loads(text)}
        if case == "misspelt":
            del document["voltage at node a, d"]
        text = json.dumps(document)
    file.write_text(text)
    assert main(["simulate", str(small), "--end", "1ms", "--start", str(file)]) == 2
    output = capsys.readouterr()
    assert not output.out
    assert "error[U006]" in output.err
    assert message in output.err


def test_all_faults_of_a_state(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "state.json"
    file.write_text(json.dumps({"voltage at node a, d": "?", "x": 1, "current in line ab, d": 1e40}))
    assert main(["simulate", str(small), "--start", str(file)]) == 2
    assert capsys.readouterr().err.count("error[U006]") == 1 + 16  # the strange name; two numbers, 14 missing


def test_files_that_are_no_samples(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = tmp_path / "good.npz"
    assert main(["simulate", str(small), "--end", "1ms", "--samples", "3", "-o", str(good)]) == 0
    capsys.readouterr()
    with numpy.load(good) as archive:
        arrays = dict(archive)
    broken = {
        "not-a-zip.npz": b"hello",
        "cut.npz": good.read_bytes()[:-200],
        "empty.npz": b"",
        "empty.csv": b"",
        "words.csv": b"hello\n",
        "cut.csv": b"t,a,b\n0,1,2\n0,1\n",
        "twice.csv": b"t,a,a\n0,1,2\n",
        "binary.csv": b"t,\xff\n0,1\n",
        "words-in-cells.csv": b't,"voltage at node a, d [V]"\n0,x\n',
        "other.csv": b"t,x\n0,1\n",
    }
    for name, data in broken.items():
        (tmp_path / name).write_bytes(data)
    objects = numpy.array([{}], dtype=object)
    for name, change in {
        "no-states": {"states": None},
        "no-rows": {"states": arrays["states"][:0]},
        "narrow": {"states": arrays["states"][:, 1:]},
        "objects": {"columns": objects},
        "flat": {"states": arrays["states"][0]},
        "complex": {"states": arrays["states"] * 1j},
        "by-column": {"states": numpy.asfortranarray(arrays["states"])},
    }.items():
        numpy.savez(tmp_path / f"{name}.npz", **{k: v for k, v in {**arrays, **change}.items() if v is not None})
        broken[f"{name}.npz"] = b""
    # a header that promises more than there is
    with zipfile.ZipFile(tmp_path / "absurd.npz", "w") as archive, zipfile.ZipFile(good) as old:
        archive.writestr("columns.npy", old.read("columns.npy"))
        archive.writestr("states.npy", old.read("states.npy").replace(b"(4, 16), }   ", b"(10**9, 16),}"))
    broken["absurd.npz"] = b""
    for name in broken:
        assert main(["simulate", str(small), "--end", "1ms", "--start", str(tmp_path / name)]) == 2, name
        output = capsys.readouterr().err
        assert "error[U006]" in output, name
        assert "Traceback" not in output
    assert main(["simulate", str(small), "--end", "1ms", "--start", str(good)]) == 0


def test_a_network_that_diverges(grows: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 3, told clearly; what there is up to then is written."""
    file, folder = tmp_path / "up-to-then.csv", tmp_path / "pictures"
    options = ["simulate", str(grows), "--end", "5", "--samples", "1000"]
    assert main([*options, "-o", str(file), "--plot", str(folder)]) == 3
    output = capsys.readouterr()
    assert output.out.startswith("DIVERGED: ")
    assert "diverged at t = 0.0" in output.out
    assert f"columns in {file}, up to 0.0" in output.out
    assert {path.name for path in folder.iterdir()} == {
        f"{x}.{y}" for x in ("voltages", "errors") for y in ("svg", "png")
    }
    assert main([*options, "--json"]) == 3
    result = told(capsys)
    assert result["outcome"] == "diverged"
    assert result["exit_code"] == 3
    assert 0 < result["diverged"]["at"] < 5
    assert not result["phases"][0]["complete"]
    with file.open(newline="") as lines:
        rows = list(csv.reader(lines))
    assert len(rows) - 1 == result["samples"] < 1001
    assert float(rows[-1][0]) <= result["diverged"]["at"]
    assert all(len(row) == len(rows[0]) for row in rows)
    assert main(["simulate", str(grows), "--start", str(file)]) == 2  # that far nothing may start
    assert "is absurd" in capsys.readouterr().err


def test_pictures(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in ("a", "b"):
        options = ["simulate", str(small), "--scenario", "plug-in", "--samples", "50", "--start", "equilibrium"]
        assert main([*options, "--plot", str(tmp_path / folder)]) == 0
        assert f"pictures: voltages, errors, zoom in {tmp_path / folder}" in capsys.readouterr().out
    names = {f"{name}.{kind}" for name in ("voltages", "errors", "zoom") for kind in ("svg", "png")}
    assert {path.name for path in (tmp_path / "a").iterdir()} == names
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    text = (tmp_path / "a" / "voltages.svg").read_text()
    assert "DGU b connects" in text
    assert "dc:date" not in text
    assert main(["simulate", OSCILLATOR, "--start", "zero", "--end", "5ms", "--plot", str(tmp_path / "c")]) == 0
    assert "voltages, errors, terminals in" in capsys.readouterr().out  # an oscillation leaves nothing to zoom into


def test_pictures_of_many_and_of_storage() -> None:
    """More DGUs than can be named, one of which is off for a while; and H over time."""
    document: dict[str, Any] = {
        "format": "certify/microgrid@1",
        "frequency": "50 Hz",
        "filter": {"lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}},
        "controller": {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}},
        "node": {
            f"n{k}": {"dgu": {"filter": "lc", "controller": "phs", "reference": ["20 kV", f"{k} V"]}} for k in range(10)
        },
        "line": [
            {"name": f"l{k}", "from": f"n{k}", "to": f"n{k + 1}", "R": "1 ohm", "L": "1 mH", "C": "10 nF"}
            for k in range(9)
        ],
        "scenario": {"s": {"end": "2 ms", "disconnected": ["n3"], "event": [{"at": "1 ms", "connect": "n3"}]}},
    }
    spec = json.dumps(document).encode()
    watch = Watch(lambda *_: 2.0)
    result = simulate(spec, "s", samples=20, observe=watch)
    H = 1e5 * numpy.exp(-1000 * result.times)
    figures = draw_figures(Course(spec, "s"), result, watch.result(result), "ten", (result.times, H, "H of the island"))
    assert set(figures) >= {"voltages", "errors", "storage"}
    labels = figures["errors"].legends[0].get_texts()
    assert {"all 10 DGUs", "median"} <= {label.get_text() for label in labels}


def test_nothing_is_left_half_written(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "x.csv"
    file.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("certify.samples._write_csv", fail)
    assert main(["simulate", str(small), "--end", "1ms", "-o", str(file)]) == 2
    assert file.read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["small.toml", "x.csv"]


def test_commands_that_prove_do_not_load_numpy() -> None:
    code = (
        "import sys\nfrom certify.cli import main\n"
        "try: main(['simulate', '--help'])\nexcept SystemExit: pass\n"
        "sys.exit(bool({'numpy', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0
    assert "example:" in done.stdout
    assert "3 diverged" in done.stdout
