"""The same command twice, at different times: the same bytes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from certify.certificate import prove
from certify.cli import main
from certify.kernel.errors import SpecError
from tests.conftest import ROOT

CIGRE = str(ROOT / "specs" / "cigre-mv.toml")
SINGLE = str(ROOT / "specs" / "single-inverter.toml")
TWO = str(ROOT / "specs" / "two-inverters.toml")
CERTIFICATE = str(ROOT / "specs" / "two-inverters.cert.json")
TABLE = str(ROOT / "tests" / "data" / "loads" / "zip-measured.csv")
COMMANDS = {
    "prove": ["prove", CIGRE, "-o", "c.json"],
    "prove, refuted": ["prove", str(ROOT / "specs" / "cigre-mv-as-printed.toml"), "-o", "c.json"],
    "prove, a scenario": ["prove", CIGRE, "--scenario", "plug-in", "-o", "phases"],
    "prove, reusing": ["prove", CIGRE, "--reuse", str(ROOT / "specs" / "cigre-mv.cert.json"), "-o", "c.json"],
    "synth": ["synth", SINGLE, "--node", "bus", "--settle", "50ms", "-o", "s.toml", "--cert", "c.json"],
    "tolerance": ["tolerance", SINGLE, "--of", "load", "-o", "s.toml", "--cert", "c.json"],
    "loads": ["loads", TABLE, "-o", "r.json", "--cert", "c.jsonl"],
    "simulate --check": ["simulate", TWO, "--end", "1ms", "--attempts", "1", "-o", "s.csv", "--check", CERTIFICATE],
    "gate": ["gate", "--write", "--json", "--junit", "j.xml", "--sarif", "s.sarif", "--statement", "t.json", "x.toml"],
}


def test_every_certificate_comes_out_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    monkeypatch.setenv("CERTIFY_CACHE", "")  # nothing is remembered from the first time
    found: list[dict[str, bytes]] = []
    for turn in range(2):
        if turn:
            time.sleep(1.1)  # the times in certificates were whole seconds
        files: dict[str, bytes] = {}
        for number, (name, arguments) in enumerate(COMMANDS.items()):
            folder = tmp_path / str(turn) / str(number)
            folder.mkdir(parents=True)
            (folder / "x.toml").write_bytes(Path(SINGLE).read_bytes())
            monkeypatch.chdir(folder)
            assert main(arguments) in (0, 1), name
            printed = capsys.readouterr().out
            written = {path for path in folder.rglob("*") if path.is_file()} - {folder / "x.toml"}
            assert written, name
            files |= {f"{name}: {path.relative_to(folder)}": path.read_bytes() for path in written}
            if "--json" in arguments and name == "gate":
                files[f"{name}: printed"] = printed.encode()
        found.append(files)
    first, second = found
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == []


def test_a_time_only_if_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    file = tmp_path / "c.json"

    def created(*options: str) -> str | None:
        assert main(["prove", SINGLE, "-o", str(file), *options]) == 0
        assert main(["check", SINGLE, str(file)]) == 0
        capsys.readouterr()
        time_of: str | None = json.loads(file.read_bytes())["provenance"].get("created")
        return time_of

    assert created() is None
    assert (created("--stamp") or "").startswith("20")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert created() == created("--stamp") == "1970-01-01T00:00:00Z"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "")
    assert created() is None
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    folder = tmp_path / "phases"
    assert main(["prove", CIGRE, "--scenario", "plug-in", "--stamp", "-o", str(folder)]) == 0
    capsys.readouterr()
    files = sorted(folder.glob("*.cert.json"))
    assert len(files) == 4
    assert all("created" in json.loads(path.read_bytes())["provenance"] for path in files)


@pytest.mark.parametrize("epoch", ["soon", "1.5", "-1", "1e9", "٣", " 5", "9" * 17])
def test_an_epoch_that_is_no_time_is_refused(
    epoch: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It also keeps scipy from being imported: what needs a search in floats was then refuted, or not found."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    assert main(["prove", TWO]) == 2
    assert "error[U001]: seconds since 1970 are expected in it" in capsys.readouterr().err
    with pytest.raises(SpecError, match="SOURCE_DATE_EPOCH"):
        prove(TWO)


def test_an_empty_epoch_is_none() -> None:
    """In a process that has not imported scipy: part of it reads the epoch, too."""
    command = [sys.executable, "-m", "certify", "prove", str(ROOT / "specs" / "cigre-mv-cross-2w0.toml")]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, env={**os.environ, "SOURCE_DATE_EPOCH": ""}
    )
    assert (done.returncode, done.stdout[:9]) == (0, "CERTIFIED"), done.stdout + done.stderr
