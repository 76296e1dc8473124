"""The README tells the truth: its commands, its output, its examples."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from certify.certificate import prove
from certify.cli import main
from tests.conftest import ROOT

TEXT = (ROOT / "README.md").read_text()
SHOWN = re.findall(r"<!-- certify (.*?) -->\n```text\n(.*?)```", TEXT, re.DOTALL)


def test_there_is_output_to_compare() -> None:
    assert len(SHOWN) == 13


@pytest.mark.parametrize(("command", "text"), SHOWN, ids=[command for command, _ in SHOWN])
def test_shown_output_is_real(command: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = shlex.split(command)
    if "-o" in arguments:
        arguments[-1] = str(tmp_path / arguments[-1])
    main(arguments)
    output = capsys.readouterr()
    printed = (output.out + output.err).replace(f"{tmp_path}/", "")
    # What a search or a simulation in floats ends with, and how long it takes, differs between machines.
    if arguments[0] in ("synth", "tolerance", "simulate", "gate") or "cross" in command:
        text, printed = without_numbers(text), without_numbers(printed)
    lines = iter(printed.splitlines())
    for line in text.splitlines():
        assert line in lines, f"not printed, or not in this order: {line!r}"


def without_numbers(text: str) -> str:
    """The words of a text, its decimals and the spaces between columns left out."""
    return re.sub(r"[ \t]+", " ", re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "0", text))


def test_exactly_two_set_up_commands() -> None:
    lines = [line for line in TEXT.splitlines() if line.startswith("python3.11 -m venv")]
    assert len(lines) == 2
    assert "certify prove specs/cigre-mv.toml" in lines[0]
    assert "pytest" in lines[1]


def test_python_example_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})


def test_spec_example_is_certified() -> None:
    (spec,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    assert prove(spec.encode()).verdict.outcome == "certified"


def test_commands_of_the_tour_parse(capsys: pytest.CaptureFixture[str]) -> None:
    tour = re.findall(r"^certify (\w+) ", TEXT, re.MULTILINE)
    assert set(tour) == {
        *("check", "explain", "gate", "report", "tolerance", "synth", "diff", "simulate", "init", "import")
    }
    for command in ("prove", *tour):
        with pytest.raises(SystemExit) as stopped:
            main([command, "--help"])
        assert stopped.value.code == 0
        assert "example:" in capsys.readouterr().out


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target
