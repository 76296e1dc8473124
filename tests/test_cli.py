"""The command line as its users see it: exit codes, output for people and machines, files written whole or not at all."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from certify.cli import main
from certify.diagnostics import DIAGNOSTICS

CIGRE, PRINTED = "specs/cigre-mv.toml", "specs/cigre-mv-as-printed.toml"


def test_prove_check_explain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.json"
    assert main(["prove", CIGRE, "-o", str(file)]) == 0
    output = capsys.readouterr().out
    assert output.startswith("CERTIFIED")
    assert "asymptotically stable" in output
    assert main(["check", CIGRE, str(file)]) == 0
    assert capsys.readouterr().out.startswith("CERTIFIED")
    assert main(["explain", str(file), CIGRE]) == 0
    story = capsys.readouterr().out
    assert "by rule quadratic-storage" in story
    assert "smallest pivot" in story
    assert "balanced three-phase" in story


def test_refuted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.json"
    assert main(["prove", PRINTED, "-o", str(file)]) == 1
    output = capsys.readouterr().out
    assert "refuted[frequency-witness] dgu/1" in output
    assert "not the stability of the network" in output
    assert "Re(u* Z(s0) u): -" in output
    assert main(["check", PRINTED, str(file)]) == 1
    assert "refuted[frequency-witness] dgu/1" in capsys.readouterr().out
    assert main(["explain", str(file), PRINTED]) == 1
    capsys.readouterr()


def test_unknown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", "specs/negative/lossless.toml"]) == 3
    assert "unknown[P203]" in capsys.readouterr().out


def test_certificate_of_another_spec(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.json"
    main(["prove", CIGRE, "-o", str(file)])
    capsys.readouterr()
    assert main(["check", PRINTED, str(file)]) == 4
    output = capsys.readouterr()
    assert "rejected[K103]" in output.err
    assert not output.out
    assert main(["check", PRINTED, str(file), "--json"]) == 4
    assert json.loads(capsys.readouterr().out)["code"] == "K103"
    assert main(["explain", str(file), PRINTED]) == 4
    capsys.readouterr()


def test_gate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gate", CIGRE, "specs/two-inverters.toml"]) == 0
    assert "2 of 2 certified" in capsys.readouterr().out
    assert main(["gate", CIGRE, PRINTED]) == 1
    assert main(["gate", CIGRE, "specs/negative/lossless.toml"]) == 3
    assert main(["gate", PRINTED, "specs/negative/lossless.toml"]) == 1
    assert main(["gate", PRINTED, "specs/negative/misspelt-key.toml", "missing.toml"]) == 2
    output = capsys.readouterr().out
    assert "S101 node.a.dgu.limts" in output
    assert "S000" in output
    assert main(["gate", "--json", CIGRE, PRINTED]) == 1
    results = json.loads(capsys.readouterr().out)
    assert [r["outcome"] for r in results["results"]] == ["certified", "refuted"]


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", PRINTED, "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome"], result["exit_code"]) == ("refuted", 1)
    claim = next(c for c in result["claims"] if c["id"] == "dgu/1")
    assert claim["status"] == "refuted"
    assert {f["name"] for f in claim["facts"]} >= {"Re s0", "Im s0", "Re u[0]", "Im u[1]", "Re(u* Z(s0) u)"}


def test_every_claim_is_listed_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    main(["prove", CIGRE, "--all"])
    assert "line/23" in capsys.readouterr().out


@pytest.mark.parametrize("code", DIAGNOSTICS)
def test_explain_code(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", code]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{code}: ")
    assert "What to try" in text
    assert main(["explain", code, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["code"] == code


def test_the_smallest_spec_of_the_help_is_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "small.toml"
    file.write_text(DIAGNOSTICS["S002"].example)
    assert main(["prove", str(file)]) == 0
    capsys.readouterr()


def test_every_code_that_is_used_is_explained(root: Path) -> None:
    import re

    used = set()
    for file in (root / "certify").rglob("*.py"):
        used |= set(re.findall(r'"([SKPTUI]\d{3})"', file.read_text()))
    assert used == {code for code in DIAGNOSTICS if re.fullmatch(r"[SKPTUI]\d{3}", code)}


def test_explain_what_is_neither(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "S999"]) == 2
    assert "neither a file nor a code" in capsys.readouterr().err


@pytest.mark.parametrize("target", ["missing/folder/c.json", ".", CIGRE])
def test_output_that_cannot_be_written(target: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = Path(CIGRE).read_bytes()
    assert main(["prove", CIGRE, "-o", target]) == 2
    assert "cannot write" in capsys.readouterr().err
    assert Path(CIGRE).read_bytes() == before


def test_a_failed_write_leaves_the_old_certificate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from certify.certificate import write_atomically

    target = tmp_path / "c.json"
    write_atomically(target, b"old")
    assert stat.S_IMODE(target.stat().st_mode) & 0o600 == 0o600

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="No space"):
        write_atomically(target, b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_same_input_same_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    files = [tmp_path / name for name in ("a.json", "b.json")]
    for file in files:
        main(["prove", PRINTED, "-o", str(file)])
    assert files[0].read_bytes() == files[1].read_bytes()
    capsys.readouterr()


def test_usage_errors_exit_with_2() -> None:
    for arguments in ([], ["prove"], ["proof", "x"], ["check", "x"], ["gate"]):
        with pytest.raises(SystemExit) as stopped:
            main(arguments)
        assert stopped.value.code == 2


def test_an_internal_error_is_no_traceback(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ArithmeticError("planted")

    monkeypatch.setattr("certify.certificate.prove", fail)
    assert main(["prove", CIGRE]) == 70
    output = capsys.readouterr().err
    assert "internal error" in output
    assert "Traceback" not in output


def test_a_search_that_offers_nonsense_is_never_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel disposes: a search gone wrong can only make claims unknown."""
    from certify.certificate import prove
    from certify.search.proposal import Proposal

    def nonsense(*_: object) -> list[Proposal]:
        return [
            Proposal("proved", "quadratic-storage", {"storage": ["1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"]}),
            Proposal("refuted", "frequency-witness", {"s0": "1 1", "u": ["1 0", "0 0"]}),
        ]

    def index_nonsense(*_: object) -> list[Proposal]:
        data = {"shortage": "1/1000", "storage": ["1 0 0 0 0 0"] * 6}
        return [Proposal("proved", "index-storage", data), Proposal("proved", "index-storage", {"shortage": "1"})]

    monkeypatch.setattr("certify.search.prove.propose_dgu", nonsense)
    monkeypatch.setattr("certify.search.shortage.propose_index", index_nonsense)
    verdict = prove(Path(CIGRE).read_bytes()).verdict
    assert {c.status for c in verdict.claims if c.id.startswith("dgu/")} == {"unknown"}


def test_the_module_runs_and_a_closed_pipe_is_no_error() -> None:
    command = f"{sys.executable} -m certify explain S002 | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stdout.startswith("S002")
    assert not done.stderr
