"""A spec to begin with, help that shows how, and completion: what a new user meets first."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from certify.cli import main
from certify.commands import COMMANDS, build_parser, command_module
from certify.commands.completion import SHELLS
from tests.conftest import ROOT


def test_the_starter_is_certified_through_its_events_and_can_be_designed_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init"]) == 0
    assert "certify prove microgrid.toml" in capsys.readouterr().out
    text = Path("microgrid.toml").read_text()
    assert "THIS_FILE" not in text
    assert max(map(len, text.splitlines())) <= 125
    assert main(["prove", "microgrid.toml", "--scenario", "morning"]) == 0
    assert main(["synth", "microgrid.toml", "--node", "east", "--settle", "50ms"]) == 0  # as its comments say


def test_init_writes_over_nothing_unless_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "my grid.toml"
    assert main(["init", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"written": str(file), "exit_code": 0}
    file.write_text("mine")
    assert main(["init", str(file)]) == 2
    assert "--force" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert main(["init", str(file), "--force"]) == 0
    assert file.read_text() != "mine"
    for bad in (tmp_path, tmp_path / "no" / "a.toml", tmp_path / "a.json"):
        assert main(["init", str(bad)]) == 2
    assert {path.name for path in tmp_path.iterdir()} == {"my grid.toml"}


def test_help_has_an_example_for_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    told = capsys.readouterr().out
    assert "certify prove grid.toml" in told
    for name in COMMANDS:
        assert name in told
        with pytest.raises(SystemExit):
            main([name, "--help"])
        shown = capsys.readouterr().out
        assert "example:" in shown
        for line in command_module(name).EXAMPLE.splitlines():
            assert line in shown


def test_a_command_alone_and_all_of_them_read_the_same() -> None:
    words = ["prove", "a.toml", "-o", "b", "--all"]
    assert build_parser("prove").parse_args(words) == build_parser().parse_args(words)


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_knows_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in COMMANDS)
    if shutil.which(shell):
        done = subprocess.run([shell, "-n"], input=script, text=True, capture_output=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_bash_completes_commands_options_and_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    for typed, offered in (
        ("certify ga", "gate"),
        ("certify prove --sc", "--scenario"),
        ("certify check specs/two", "specs/two-inverters.toml"),
        ("certify loads --method st", "sturm"),
    ):
        ask = f"{script}\nCOMP_WORDS=({typed}); COMP_CWORD={len(typed.split()) - 1}; _shtab_certify; echo ${{COMPREPLY[@]}}"
        done = subprocess.run(["bash"], input=ask, text=True, capture_output=True, check=True, cwd=ROOT)
        assert offered in done.stdout.split(), (typed, done.stdout, done.stderr)
