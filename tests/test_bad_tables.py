"""Every kind of bad table: exit code 2, row and column, what rule, what to try; no traceback, and nothing written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from certify.cli import main
from certify.diagnostics import DIAGNOSTICS

Z = "name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\n"
A = "V0,Yp,Ip,Pp,Yq,Iq,Pq\n"
E = "P0,Q0,V0,np,nq\n"

# what is in the file, the code, and what the message says besides
TEXTS: dict[str, tuple[str, str, str]] = {
    "missing column": ("P0,V0,Zp,Ip,Pp,Zq,Iq,Pq\n1,1,1,0,0,1,0,0\n", "T102", "row 2, column Q0: .*Q0 or pf"),
    "missing V0": ("P0,Q0,np,nq\n1,0,1,1\n", "T102", "row 1: there is no column V0"),
    "no kind": ("P0,Q0,V0\n1,0,1\n", "T102", "row 1: there is no column Zp or"),
    "two kinds": ("P0,Q0,V0,np,nq,Zp\n1,0,1,1,1,1\n", "T104", "row 2: columns of more than one kind"),
    "column of another kind": ("P0,Q0,V0,np,nq,Ip\n1,0,1,1,1,1\n", "T101", "row 2, column Ip"),
    "unknown column": ("P0,Q0,V0,np,nq,colour\n1,0,1,1,1,red\n", "T101", "row 1, column 'colour'.*known are name, pf"),
    "unknown key of JSON": (
        '[{"P0": 1, "Q0": 0, "V0": 1, "np": 1, "nq": 1, "colour": 1}]',
        "T101",
        "row 1, column colour",
    ),
    "column twice": ("P0,Q0,V0,np,nq,np\n1,0,1,1,1,1\n", "T101", "row 1, column np: .*twice"),
    "Q0 and pf": ("P0,Q0,pf,V0,np,nq\n1,0,1,1,1,1\n", "T104", "row 2, column Q0: .*exclude"),
    "pf of zero": ("P0,pf,V0,np,nq\n1,0,1,1,1\n", "T105", "row 2, column pf"),
    "pf of two": ("P0,pf,V0,np,nq\n1,2,1,1,1\n", "T105", "row 2, column pf"),
    "kV in a column of W": (E + "1 kV,0,1,1,1\n", "S203", "row 2, column P0: .*expected W"),
    "kV in the header of W": ("P0 [kV],Q0,V0,np,nq\n1,0,1,1,1\n", "S203", "row 1, column P0: .*expected W"),
    "W and var exchanged": (E + "1 kvar,1 kW,1,1,1\n", "S203", "row 2, column Q0: .*expected var"),
    "A under a fraction": (Z + "x,1,0,1,1,1 A,0,1,0,0\n", "S203", "row 2, column Ip: .*plain number"),
    "A in the header of a fraction": (
        "P0,Q0,V0,Zp,Ip [A],Pp,Zq,Iq,Pq\n1,0,1,1,0,0,1,0,0\n",
        "S203",
        "row 2, column Ip",
    ),
    "percent of a current": ("V0,Yp,Ip [%],Pp,Yq,Iq,Pq\n1,1,1,1,1,1,1\n", "S203", "row 2, column Ip: .*expected A"),
    "V0 in pu": ("P0,Q0,V0 [pu],np,nq\n1,0,1,1,1\n", "S204", "row 1, column V0"),
    "V0 in pu in the cell": (E + "1,0,1 pu,1,1\n", "S204", "row 2, column V0"),
    "P0 in pu": ("P0 [pu],Q0,V0,np,nq\n1,0,1,1,1\n", "S204", "row 1, column P0"),
    "unknown unit": ("P0 [horses],Q0,V0,np,nq\n1,0,1,1,1\n", "S203", "row 1, column P0: unknown unit"),
    "percentages": (Z + "x,1,1,1,50,40,10,50,40,10\n", "T103", "row 2, column Zp: .*add up to 100, not 1"),
    "fractions of Q": (Z + "x,1,1,1,1,0,0,1,0,0.5\n", "T103", "row 2, column Zq: .*1.5, not 1"),
    "V0 of zero": (E + "1,0,0,1,1\n", "S208", "row 2, column V0: must be positive"),
    "negative V0": (E + "1,0,-230,1,1\n", "S208", "row 2, column V0: must be positive"),
    "v_min of zero": ("P0,Q0,V0,np,nq,v_min\n1,0,1,1,1,0\n", "S208", "row 2, column v_min"),
    "own band reversed": ("P0,Q0,V0,np,nq,v_min,v_max\n1,0,1,1,1,2,1\n", "S307", "row 2, column v_min: .*2 V to 1 V"),
    "v_min above the band": ("P0,Q0,V0,np,nq,v_min [pu]\n1,0,230,1,1,1.2\n", "S307", "row 2, column v_min: .*--band"),
    "NaN": (E + "NaN,0,1,1,1\n", "S201", "row 2, column P0"),
    "inf": (E + "1,-inf,1,1,1\n", "S201", "row 2, column Q0"),
    "hexadecimal": (E + "0x10,0,1,1,1\n", "S201|S203", "row 2, column P0"),
    "decimal comma": (E + '"1,5",0,1,1,1\n', "S201|S203", "row 2, column P0"),
    "a formula": (E + "=1+1,0,1,1,1\n", "S201", "row 2, column P0"),
    "empty cell": (E + "1,0,1,,1\n", "T102", "row 2, column np: no value"),
    "empty cells": (E + "1,0,1,,\n", "T102", "row 2: columns of no kind"),
    "exponent of a million": (E + "1,0,1,1e6,1\n", "S202", "row 2, column np"),
    "exponent of 1e400": (E + "1,0,1,1,1e400\n", "S202", "row 2, column nq"),
    "power of 1e400": (E + "1e400,0,1,1,1\n", "S202", "row 2, column P0"),
    "power of 1e31": (E + "1e31,0,1,1,1\n", "S202", "row 2, column P0: .*absurd"),
    "voltage of 1e-40": (E + "1,0,1e-40,1,1\n", "S202", "row 2, column V0: .*absurd"),
    "digits without end": (E + f"{'9' * 5000},0,1,1,1\n", "S202", "row 2, column P0"),
    "digits without end in JSON": (
        f'[{{"P0": {"9" * 10**6}, "Q0": 0, "V0": 1, "np": 1, "nq": 1}}]',
        "S202",
        "row 1, column P0",
    ),
    "a header only": (E, "T001", "no rows"),
    "blank rows only": (E + "\n,,,,\n", "T001", "no rows"),
    "nothing": ("", "T001", "empty"),
    "blank": (" \n\n\t\n", "T001", "empty"),
    "too few cells": (E + "1,0,1\n", "T002", "row 2: 3 cells, but 5 columns"),
    "too many cells": (E + "1,0,1,1,1,\n", "T002", "row 2: 6 cells, but 5 columns"),
    "no header": ("1,0,1,1,1\n", "T101", "row 1, column '1'"),
    "tabs": ("P0\tQ0\tV0\tnp\tnq\n1\t0\t1\t1\t1\n", "T001", "not separated by commas"),
    "a decimal comma": (E + '"1,5",0,1,1,1\n', "S201", "row 2, column P0: .*decimal point"),
    "lower case": ("P0,Q0,v0,np,nq\n1,0,1,1,1\n", "T101", "row 1, column 'v0': .*did you mean 'V0'"),
    "a band in volts that is meant in pu": (
        "P0,Q0,V0,np,nq,v_min,v_max\n1,0,230,1,1,0.9,1.1\n",
        "T106",
        "row 2, column v_min: 0.9 V to 1.1 V is far from V0 = 230 V",
    ),
    "semicolons": ("P0;Q0;V0;np;nq\n1;0;1;1;1\n", "T001", "not separated by commas"),
    "unterminated quote": (E + '"1,0,1,1,1\n1,0,1,1,1\n', "T002", "row 2"),
    "unterminated quote in the header": ('"P0,Q0,V0,np,nq\n1,0,1,1,1\n', "T002", "row 1"),
    "a cell with a line end": ("name," + E + '"a\nb",1,0,1,1,1\n', "T002", "row 2"),
    "control character in a name": ("name," + E + "a\x1b[31m,1,0,1,1,1\n", "S103", "row 2, column name"),
    "long name": ("name," + E + f"{'x' * 201},1,0,1,1,1\n", "S103", "row 2, column name"),
    "a long line": (E + "1," * 30_000 + "\n", "T002", "row 2: .*20000 bytes"),
    "a long header": ("," * 30_000 + "\n", "T002", "row 1"),
    "JSON with a number": ("[1]", "T002", "row 1: expected a table of columns"),
    "JSON with an empty list": ("[]", "T001", "the list is empty"),
    "JSON with an empty row": ("[{}]", "T102", "row 1: columns of no kind"),
    "JSON nested deeply": ("[" * 100_000, "T001", "recursion"),
    "JSON nested in a cell": (
        '[{"P0": ' + "[" * 500 + "]" * 500 + ', "Q0": 0, "V0": 1, "np": 1, "nq": 1}]',
        "S201",
        "row 1, column P0",
    ),
    "JSON cut off": ('[{"P0": 1', "T001", "not valid JSON"),
    "JSON with two documents": ("[{}] [{}]", "T001", "not valid JSON"),
    "JSON with a key twice": ('[{"P0": 1, "P0": 2}]', "T001", "given twice"),
    "JSON with NaN": ('[{"P0": NaN, "Q0": 0, "V0": 1, "np": 1, "nq": 1}]', "S201", "row 1, column P0"),
    "JSON with a boolean": ('[{"P0": true, "Q0": 0, "V0": 1, "np": 1, "nq": 1}]', "S201", "row 1, column P0"),
    "JSON with half a character": (
        '[{"name": "\\ud800", "P0": 1, "Q0": 0, "V0": 1, "np": 1, "nq": 1}]',
        "S103",
        "row 1, column name",
    ),
    "JSON with half a character in a key": (
        '[{"\\ud800": "", "P0": 1, "Q0": 0, "V0": 1, "np": 1, "nq": 1}]',
        "T101",
        "row 1",
    ),
    "a JSON object": ('{"P0": 1}', "S101", "P0"),
}
BYTES: dict[str, tuple[bytes, str, str]] = {
    "Latin-1": (b"name," + E.encode() + b"k\xfcche,1,0,1,1,1\n", "T002", "row 2: .*save the table as UTF-8"),
    "binary": (bytes(range(256)) * 4, "T101", "row 1"),
    "more binary": (bytes(range(255, 0, -1)), "T002", "row 1: cannot be read as UTF-8"),
    "NUL": (E.encode() + b"1,0,1,1,\0\n", "S201|T002", "row 2"),
    "UTF-16": ((E + "1,0,1,1,1\n").encode("utf-16"), "T002", "row 1: cannot be read as UTF-8"),
    "line ends of old": (E.replace("\n", "\r").encode() + b"1,0,1,1,1\r", "T002", "row 1"),
}
CASES = {**{case: (text.encode(), code, says) for case, (text, code, says) in TEXTS.items()}, **BYTES}


def failing_main(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    code = main(["loads", *arguments])
    output = capsys.readouterr()
    assert code == 2, output.err
    assert not output.out
    assert "Traceback" not in output.err
    assert "internal error" not in output.err
    return output.err


@pytest.mark.parametrize("case", CASES, ids=str)
def test_bad_table(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import re

    data, code, says = CASES[case]
    file = tmp_path / ("t.json" if data[:1] in (b"[", b"{") else "t.csv")
    file.write_bytes(data)
    targets = ["-o", str(tmp_path / "o.csv"), "--cert", str(tmp_path / "c")]
    if case != "a JSON object":  # read as a spec
        main(["loads", str(file), "--json", *targets])
        faults = json.loads(capsys.readouterr().out)["faults"]
        assert any(
            re.fullmatch(code, f["code"]) and re.search(says, f"{f['path']}: {f['message']}", re.S) for f in faults
        ), faults
        assert all(len(f["message"]) < 1000 and DIAGNOSTICS[f["code"]].remedy for f in faults)
    else:
        targets = targets[:2]
    message = failing_main([str(file), *targets], capsys)
    assert re.search(rf"error\[({code})\]", message)
    assert str(file) in message
    assert "= help:" in message
    assert [p.name for p in tmp_path.iterdir()] == [file.name]
    if case not in ("a JSON object", "a header only", "blank rows only") and not code.startswith("T001"):
        kept = main(["loads", str(file), "--keep-going", "-o", str(tmp_path / "o.json")])
        assert kept == 2
        assert "internal error" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("band", "code"),
    [
        (("1.1 pu", "0.9 pu"), "S307"),
        (("1 pu", "1 pu"), "S307"),
        (("253 V", "0.2 kV"), "S307"),
        (("x", "y"), "S201"),
        (("0", "1"), "S208"),
        (("-1", "1"), "S208"),
        (("0.9 pu", "nan"), "S201"),
        (("0.9 pu", "1e99 pu"), "S202"),
        (("1 A", "2 A"), "S203"),
        (("", ""), "S201"),
    ],
)
def test_bad_band(band: tuple[str, str], code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_text(E + "1,0,230,1.5,1\n" * 50)
    message = failing_main([str(file), "--band", *band], capsys)
    assert f"error[{code}]" in message
    assert message.count("error[") <= 2  # once, not for every row
    assert "--band" in message


def test_band_in_mixed_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_text(E + "1,0,230,1.5,2\n1,0,400,1.5,2\n")
    assert main(["loads", str(file), "--band", "0.9 pu", "440 V"]) == 0
    capsys.readouterr()
    message = failing_main([str(file), "--band", "0.9 pu", "253 V"], capsys)
    assert "row 3, column V0" in message
    assert "360 V to 253 V" in message


def test_the_list_of_faults_is_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_text(E + "1,0,0,x,\n" * 3000)
    message = failing_main([str(file), "--jobs", "1"], capsys)
    assert message.count("error[") == 40
    assert message.rstrip().count("and 5961 more faults") == 1


def test_directory_and_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (tmp_path, tmp_path / "missing.csv", tmp_path / "a\0b"):
        assert "error[S000]" in failing_main([str(path)], capsys)


def test_as_a_process(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text(E + "1,0,1,1\n")
    for command in (["certify", "loads", str(file)], ["certify.kernel", str(file), str(file)]):
        done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False)
        assert done.returncode in (2, 4)
        assert "Traceback" not in done.stderr
        assert done.stderr


def test_extremes_that_are_read_are_decided(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    rows = (
        "1e30,1e30,1e-30,1.5,99.5",
        "1e-30,1e30,1e30,2.5,-100",
        f"1000,200,230,1.{'0' * 50}1,2.{'0' * 40}1",
        "1000,200,230,-100,100",
        "1e30,-1e30,1e30,100,64",
    )
    file.write_text(E + "\n".join(rows) + "\n")
    code = main(["loads", str(file), "-o", str(tmp_path / "o.json"), "--cert", str(tmp_path / "c")])
    assert code in (1, 3)
    assert "internal error" not in capsys.readouterr().err
    assert "NaN" not in (tmp_path / "o.json").read_text()
    assert main(["check", str(file), str(tmp_path / "c")]) == code
    capsys.readouterr()
