"""Every kind of bad input: exit code 2, the path inside the file, a stable code, under a second, no traceback."""

from __future__ import annotations

import json
import os
import re
import time
from pathlib import Path

import pytest

from certify.cli import main
from certify.kernel.errors import SpecError
from certify.kernel.spec import decode

GOOD = """format = "certify/microgrid@1"
frequency = "50 Hz"
base_voltage = "20 kV"
voltage_band = ["0.6 pu", "1.2 pu"]

[filter.lc]
R = "0.1 ohm"
L = "1.8 mH"
C = "25 uF"

[controller.phs]
kind = "ida-pbc"
alpha = -5
nu = 1
ki = 100

[controller.pi]
kind = "state-feedback"
let = { kp = 1000 }
K11 = "1 - kp*L"
K12 = "R - 1001"
K13 = 1000

[line_type.overhead]
R = "0.343 ohm/km"
L = "0.875 mH/km"
C = "151.7 nF/km"

[node.a]
dgu = { filter = "lc", controller = "phs", reference = ["0.9 pu", "0.5 pu"] }

[node.b]
load = [{ kind = "zip", Y = ["75 uS", "75 uS"] }, { kind = "exp", P0 = "5 kW", np = 1.5 }]

[node.d]
dgu = { filter = "lc", controller = "pi", reference = ["0.9 pu", "0.5 pu"] }

[[line]]
name = "1"
from = "a"
to = "b"
type = "overhead"
length = "2 km"

[[line]]
name = "2"
from = "b"
to = "d"
R = 1
L = 1e-3
C = 0
"""

# (what is replaced, by what, the code, the path that the message names)
EDITS = {
    "unknown key at the top": ('base_voltage = "20 kV"', 'base_voltage = "20 kV"\nbase_volt = 1', "S101", "base_volt"),
    "unknown key in a part": ('C = "25 uF"', 'C = "25 uF"\nG = 1', "S101", "filter.lc.G"),
    "unknown key in a load": ("np = 1.5", "np = 1.5, n = 2", "S101", "node.b.load[1].n"),
    "unknown key in a line": ('length = "2 km"', 'length = "2 km"\nlenght = 1', "S101", "line.1.lenght"),
    "missing format": ('format = "certify/microgrid@1"\n', "", "S102", "format"),
    "wrong format": ("microgrid@1", "microgrid@9", "S107", "format"),
    "missing frequency": ('frequency = "50 Hz"\n', "", "S102", "frequency"),
    "missing filter value": ('L = "1.8 mH"\n', "", "S102", "filter.lc.L"),
    "missing reference": (', reference = ["0.9 pu", "0.5 pu"]', "", "S102", "node.a.dgu.reference"),
    "missing filter of a DGU": ('filter = "lc", ', "", "S102", "node.a.dgu.filter"),
    "missing band": ('voltage_band = ["0.6 pu", "1.2 pu"]\n', "", "S102", "node.b.load[0].band"),
    "missing base for V0": (
        'base_voltage = "20 kV"\nvoltage_band = ["0.6 pu", "1.2 pu"]',
        "voltage_band = [1, 2]",
        "S102",
        "node.b.load[1].V0",
    ),
    "missing length": ('length = "2 km"\n', "", "S102", "line.1.length"),
    "missing gain": ("nu = 1\n", "", "S102", "controller.phs.nu"),
    "empty zip load": ('kind = "zip", Y = ["75 uS", "75 uS"]', 'kind = "zip"', "S102", "node.b.load[0]"),
    "half an exponential load": ("np = 1.5", 'np = 1.5, Q0 = "1 kvar"', "S102", "node.b.load[1]"),
    "table where a number belongs": ('R = "0.1 ohm"', "R = { x = 1 }", "S201", "filter.lc.R"),
    "number where a table belongs": ("[filter.lc]", "[filter]\nother = 3\n[filter.lc]", "S103", "filter.other"),
    "boolean where a number belongs": ('R = "0.1 ohm"', "R = true", "S201", "filter.lc.R"),
    "date where a number belongs": ('R = "0.1 ohm"', "R = 2020-01-01", "S201", "filter.lc.R"),
    "one value where two belong": ('Y = ["75 uS", "75 uS"]', 'Y = "75 uS"', "S103", "node.b.load[0].Y"),
    "three values where two belong": (
        '["0.9 pu", "0.5 pu"]',
        '["1 pu", "1 pu", "1 pu"]',
        "S103",
        "node.a.dgu.reference",
    ),
    "number as a name": ('from = "a"', "from = 1", "S301", "line.1.from"),
    "name of a line not text": ('name = "1"', "name = 1", "S103", "line[0].name"),
    "load not a list": (
        'load = [{ kind = "zip", Y = ["75 uS", "75 uS"] }, { kind = "exp", P0 = "5 kW", np = 1.5 }]',
        "load = 5",
        "S103",
        "node.b.load",
    ),
    "wrong shape of a gain": ("K13 = 1000", "K13 = [1, 2, 3]", "S103", "controller.pi.K13"),
    "wrong unit": ('L = "1.8 mH"', 'L = "1.8 mF"', "S203", "filter.lc.L"),
    "unknown unit": ('L = "1.8 mH"', 'L = "1.8 henries"', "S203", "filter.lc.L"),
    "per length where none belongs": ('R = "0.1 ohm"', 'R = "0.1 ohm/km"', "S203", "filter.lc.R"),
    "no length where one belongs": ('"0.343 ohm/km"', '"0.343 ohm"', "S203", "line_type.overhead.R"),
    "reactive power in watt": ('Y = ["75 uS", "75 uS"]', 'P = ["1 kW", "1 kW"]', "S203", "node.b.load[0].P[1]"),
    "pu without a base": ('R = "0.1 ohm"', 'R = "0.1 pu"', "S204", "filter.lc.R"),
    "negative inductance": ('L = "1.8 mH"', 'L = "-1.8 mH"', "S208", "filter.lc.L"),
    "zero capacitance": ('C = "25 uF"', 'C = "0 uF"', "S208", "filter.lc.C"),
    "zero length": ('"2 km"', '"0 km"', "S208", "line.1.length"),
    "zero frequency": ('"50 Hz"', '"0 Hz"', "S208", "frequency"),
    "absurd frequency": ('"50 Hz"', '"50 GHz"', "S202", "frequency"),
    "zero reference": ('["0.9 pu", "0.5 pu"]', "[0, 0]", "S208", "node.a.dgu.reference"),
    "zero limit": ('"0.5 pu"]', '"0.5 pu"], limits = [0, "9 kV"]', "S208", "node.a.dgu.limits[0]"),
    "anti-windup without limits": ('"0.5 pu"]', '"0.5 pu"], anti_windup = "20 ms"', "S212", "node.a.dgu.anti_windup"),
    "anti-windup of zero": (
        '"0.5 pu"]',
        '"0.5 pu"], limits = [1e5, 1e5], anti_windup = 0',
        "S208",
        "node.a.dgu.anti_windup",
    ),
    "anti-windup that is no time": (
        '"0.5 pu"]',
        '"0.5 pu"], limits = [1e5, 1e5], anti_windup = "20 V"',
        "S203",
        "node.a.dgu.anti_windup",
    ),
    "not a number": ('R = "0.1 ohm"', "R = nan", "S201", "filter.lc.R"),
    "infinite": ('R = "0.1 ohm"', "R = inf", "S201", "filter.lc.R"),
    "text for a number": ('R = "0.1 ohm"', 'R = "little"', "S201", "filter.lc.R"),
    "empty text for a number": ('R = "0.1 ohm"', 'R = ""', "S201", "filter.lc.R"),
    "fullwidth digits": ('R = "0.1 ohm"', 'R = "\uff11 ohm"', "S201", "filter.lc.R"),
    "huge exponent": ('R = "0.1 ohm"', "R = 1e999999999", "S202", "filter.lc.R"),
    "huge exponent in text": ('R = "0.1 ohm"', 'R = "1e999999999 ohm"', "S202", "filter.lc.R"),
    "a thousand digits": ('R = "0.1 ohm"', f"R = {'9' * 1000}", "S202", "filter.lc.R"),
    "a million digits": ('R = "0.1 ohm"', f"R = {'9' * 1_000_000}", "S003", ""),
    "absurd exponent of a load": ("np = 1.5", "np = 1e9", "S202", "node.b.load[1].np"),
    "unknown name in a formula": ('"1 - kp*L"', '"1 - kq*L"', "S206", "controller.pi.K11"),
    "unbalanced formula": ('"1 - kp*L"', '"(1 - kp*L"', "S205", "controller.pi.K11"),
    "code in a formula": ('"1 - kp*L"', '"__import__(1)"', "S205", "controller.pi.K11"),
    "power tower with a sign": ('"1 - kp*L"', '"2^-3^2"', "S205", "controller.pi.K11"),
    "power tower": ('"1 - kp*L"', '"9^9^9^9"', "S205", "controller.pi.K11"),
    "large power": ('"1 - kp*L"', '"9^99999"', "S205", "controller.pi.K11"),
    "long formula": ('"1 - kp*L"', f'"1{"+1" * 400}"', "S205", "controller.pi.K11"),
    "division by zero": ("nu = 1", "nu = 0", "S207", "controller.phs.nu"),
    "shadowed name": ("let = { kp = 1000 }", "let = { kp = 1000, L = 1 }", "S105", "controller.pi.let.L"),
    "unknown kind of controller": ('kind = "ida-pbc"', 'kind = "droop"', "S107", "controller.phs.kind"),
    "unknown kind of load": ('kind = "zip"', 'kind = "zap"', "S107", "node.b.load[0].kind"),
    "unknown controller": ('controller = "phs"', 'controller = "psh"', "S306", "node.a.dgu.controller"),
    "unknown filter": ('filter = "lc"', 'filter = "lcl"', "S306", "node.a.dgu.filter"),
    "unknown line type": ('type = "overhead"', 'type = "cable"', "S306", "line.1.type"),
    "line to nowhere": ('to = "b"', 'to = "z"', "S301", "line.1.to"),
    "self-loop": ('to = "b"', 'to = "a"', "S302", "line.1"),
    "island without a DGU": ("[[line]]", '[node.c]\ncapacitance = "1 uF"\n[[line]]', "S304", "node.c"),
    "node without capacitance": ('"151.7 nF/km"', "0", "S305", "node.b"),
    "band upside down": ('["0.6 pu", "1.2 pu"]', '["1.2 pu", "0.6 pu"]', "S307", "voltage_band"),
    "bands without common part": ("np = 1.5", 'np = 1.5, band = ["2 pu", "3 pu"]', "S307", "node.b.load"),
    "control characters in a name": ('to = "b"', 'to = "\\u001b[31m"', "S301", "line.1.to"),
    "empty name": ("[node.a]", '[node.""]', "S105", "node."),
    "absurd value of a formula": ('"1 - kp*L"', '"' + "*".join(["(1e60^4)"] * 40) + '"', "S202", "controller.pi.K11"),
    "duplicate key": ('R = "0.1 ohm"', 'R = "0.1 ohm"\nR = "0.2 ohm"', "S002", ""),
    "duplicate node": ("[node.b]", "[node.a]", "S002", ""),
    "duplicate line": (
        "[[line]]",
        '[[line]]\nname = "1"\nfrom = "a"\nto = "b"\ntype = "overhead"\nlength = 1\n[[line]]',
        "S303",
        "line.1",
    ),
    "broken TOML": ("[filter.lc]", "[filter.lc", "S002", ""),
    "deep nesting": ("nu = 1", f"nu = {'[' * 5000}{']' * 5000}", "S003", ""),
    "deep dotted key": ("nu = 1", f"{'a.' * 9000}a = 1", "S003", ""),
}


def failing_main(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    started = time.perf_counter()
    code = main(["prove", str(path)])
    elapsed = time.perf_counter() - started
    output = capsys.readouterr()
    assert code == 2
    assert not output.out
    assert "Traceback" not in output.err
    assert elapsed < 5  # generous; the benchmark measures
    return output.err


def test_the_good_spec_is_good() -> None:
    assert len(decode(GOOD.encode()).nodes) == 3


def line_of(file: Path, word: str) -> int:
    return next(number for number, line in enumerate(file.read_text().splitlines(), 1) if word in line)


@pytest.mark.parametrize("case", EDITS, ids=str)
def test_edit(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new, code, path = EDITS[case]
    assert GOOD.count(old) >= 1
    file = tmp_path / "spec.toml"
    file.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    message = failing_main(file, capsys)
    assert f"error[{code}]" in message
    assert str(file) in message
    assert re.search(rf"{re.escape(str(file))}:\d+: {re.escape(path)}", message) if path else True
    assert "= help:" in message


@pytest.mark.parametrize(
    "gains",
    [
        ("alpha = -5", "alpha = [-5, 0]"),
        ("ki = 100", "ki = [0, 100]"),
        ('kind = "ida-pbc"\nalpha = -5\nnu = 1\nki = 100', 'kind = "constant"'),
        ('kind = "ida-pbc"\nalpha = -5\nnu = 1\nki = 100', 'kind = "state-feedback"\nK11 = 0\nK12 = -5'),
        (
            'kind = "ida-pbc"\nalpha = -5\nnu = 1\nki = 100',
            'kind = "state-feedback"\nK11 = 0\nK12 = -5\nK13 = [[1, 2], [2, 4]]',
        ),
        (
            'kind = "ida-pbc"\nalpha = -5\nnu = 1\nki = 100',
            'kind = "linear"\nF = [[-1, 0], [0, -1]]\nB = [[1, 0], [0, 1]]\nC = [[1, 0], [0, 1]]',
        ),
    ],
)
def test_anti_windup_needs_an_integral_gain_that_can_be_inverted(
    gains: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "spec.toml"
    text = GOOD.replace(*gains)
    assert text != GOOD
    file.write_text(text.replace('"0.5 pu"]', '"0.5 pu"], limits = [1e5, 1e5], anti_windup = "20 ms"', 1))
    message = failing_main(file, capsys)
    assert "error[S212]: the integral gain of its controller cannot be inverted" in message
    assert (
        f"{file}:{line_of(file, 'anti_windup')}: node.a.dgu.anti_windup\n  = help: give limits and a controller with integral action"
        in message
    )


CONTENTS = {
    "empty": (b"", "S002"),
    "blank": (b" \n\n", "S002"),
    "not UTF-8": (b'format = "\xff\xfe"', "S001"),
    "binary": (bytes(range(256)), "S001"),
    "JSON with a duplicate": (b'{"format": "certify/microgrid@1", "format": "x", "frequency": 50, "node": {}}', "S002"),
    "JSON with NaN": (b'{"format": "certify/microgrid@1", "frequency": NaN, "node": {"a": {}}}', "S201"),
    "JSON cut off": (b'{"format": ', "S002"),
    "JSON nested deeply": (b'{"a":' * 100_000, "S003"),
    "JSON lists nested deeply": (b'{"a":' + b"[" * 100_000, "S003"),
    "JSON with a million digits": (
        b'{"format": "certify/microgrid@1", "frequency": ' + b"9" * 10**6 + b', "node": {}}',
        "S202",
    ),
    "JSON that is a list": (b"[1, 2]", "S002"),
    "no node": (b'{"format": "certify/microgrid@1", "frequency": 50, "node": {}}', "S308"),
    "a hundred thousand unknown keys": (
        json.dumps({f"k{i}": 1 for i in range(100_000)}).encode(),
        "S108",
    ),
}


@pytest.mark.parametrize("case", CONTENTS, ids=str)
def test_content(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content, code = CONTENTS[case]
    file = tmp_path / "spec.toml"
    file.write_bytes(content)
    assert f"error[{code}]" in failing_main(file, capsys) or code == "S108"
    with pytest.raises(SpecError) as caught:
        decode(content)
    assert code in {fault.code for fault in caught.value.faults}


def test_directory_and_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (tmp_path, tmp_path / "missing.toml", tmp_path / "a\0b"):
        assert "error[S000]" in failing_main(path, capsys)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spec.toml"
    file.write_text(GOOD)
    file.chmod(0)
    assert "error[S000]" in failing_main(file, capsys)


def test_unreadable_file_even_for_root(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert "Permission denied" in failing_main(tmp_path / "spec.toml", capsys)


def test_endless_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("certify.inputs.MAX_BYTES", 1 << 20)
    monkeypatch.setattr("certify.kernel.reader.MAX_BYTES", 1 << 20)
    from certify import inputs

    data = inputs.read("/dev/zero", 1 << 20)
    assert len(data) == (1 << 20) + 1
    with pytest.raises(SpecError, match="S003"):
        decode(data)


def test_every_fault_is_reported_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", "specs/negative/many-faults.toml", "--json"]) == 2
    faults = json.loads(capsys.readouterr().out)["faults"]
    assert {f["code"] for f in faults} == {"S101", "S203", "S206", "S301", "S302"}
    assert {f["path"] for f in faults} >= {"nmae", "filter.lc.C", "controller.own.K11", "line.x.to", "line.y"}


def test_nothing_is_written_for_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "out.json"
    assert main(["prove", "specs/negative/negative-inductance.toml", "-o", str(output)]) == 2
    assert list(tmp_path.iterdir()) == []
    capsys.readouterr()


SCENARIOS = {
    "event after the end": ('event = [{ at = "9 s", connect = "a" }]', "S309", "scenario.x.event"),
    "unknown target": ('event = [{ at = "1 s", connect = "z" }]', "S306", "scenario.x.event[0].connect"),
    "two actions": ('event = [{ at = "1 s", connect = "a", disconnect = "a" }]', "S107", "scenario.x.event[0]"),
    "no action": ('event = [{ at = "1 s" }]', "S107", "scenario.x.event[0]"),
    "coefficient of another kind of load": (
        'event = [{ at = 1, load = "b", set = { np = 2 } }]',
        "S101",
        "scenario.x.event[0].set.np",
    ),
    "load without coefficients": ('event = [{ at = "1 s", load = "b" }]', "S102", "scenario.x.event[0].set"),
    "unknown coefficient": ('event = [{ at = 1, load = "b", set = { Z = 1 } }]', "S101", "scenario.x.event[0].set.Z"),
    "unknown start": ('start = "warm"', "S107", "scenario.x.start"),
    "disconnected what is no DGU": ('disconnected = ["b"]', "S306", "scenario.x.disconnected[0]"),
    "negative time": ('event = [{ at = "-1 s", connect = "a" }]', "S208", "scenario.x.event[0].at"),
}


@pytest.mark.parametrize("case", SCENARIOS, ids=str)
def test_scenario(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, code, path = SCENARIOS[case]
    file = tmp_path / "spec.toml"
    file.write_text(f'{GOOD}\n[scenario.x]\nend = "8 s"\n{text}\n')
    message = failing_main(file, capsys)
    assert f"error[{code}]" in message
    assert path in message


def test_scenario_in_per_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spec.toml"
    text = GOOD.replace("base_voltage", 'base_power = "1 MVA"\nbase_voltage', 1)
    file.write_text(
        f'{text}\n[scenario.x]\nend = 2\nevent = [{{ at = 1, load = "b", set = {{ Y = ["0.1 pu", 0] }} }}]\n'
    )
    assert main(["prove", str(file)]) == 0  # read without fault
    capsys.readouterr()


def test_scenario_faults_join_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spec.toml"
    file.write_text(GOOD.replace('"1.8 mH"', '"1.8 mF"') + '\n[scenario.x]\nstart = "warm"\n')
    message = failing_main(file, capsys)
    assert "S203" in message
    assert "scenario.x.start" in message
    assert "scenario.x.end" in message


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('to = "b"', "to = 7", "7 is not a node; did you mean '7', in quotes?"),
        ('to = "b"', f"to = 0x{'f' * 6000}", "a int is not a node; known here: "),  # too long to be written in decimal
        ('["0.9 pu", "0.5 pu"]', '["1 pu"]', "expected a list of two values, got a list of 1"),
    ],
)
def test_what_a_message_says(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "spec.toml"
    path.write_text(GOOD.replace("[node.d]", '[node.7]\ncapacitance = "1 uF"\n[node.d]').replace(old, new, 1))
    assert message in failing_main(path, capsys)
