"""The gate against those who would like to pass it: each case has passed, or has told the wrong thing, once."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.certificate import prove, write_certificate
from certify.cli import main
from certify.gating.judge import judge, may_pass
from certify.gating.policy import Policy
from certify.gating.results import Committed, Decision
from certify.kernel.check import check
from certify.kernel.claims import Claim, Verdict, overall
from certify.kernel.errors import Fault, SpecError
from certify.kernel.spec import decode
from certify.search.prove import find_claims
from tests.conftest import ROOT

SINGLE = (ROOT / "specs" / "single-inverter.toml").read_bytes()
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def claims_alone(spec: bytes) -> bytes:
    """A certificate that the kernel accepts, of a spec that `prove` refuses because of its scenario."""
    found = find_claims(decode(spec))
    notes = found.pop("notes")
    certificate = write_certificate(spec, found, notes)
    assert check(spec, certificate).outcome == "certified"
    return certificate


def test_a_certificate_does_not_excuse_a_faulty_scenario(capsys: Capture) -> None:
    """The kernel does not read scenarios, and a spec that cannot be proved as a whole may not pass by parts."""
    spec = SINGLE + b'\n[scenario.x]\nend = "-3 s"\nbogus = 1\n'
    Path("a.toml").write_bytes(spec)
    Path("a.cert.json").write_bytes(claims_alone(spec))
    assert main(["gate", "--json", "a.toml"]) == 2
    (found,) = json.loads(capsys.readouterr().out)["results"]
    assert found["outcome"] == "bad input"
    assert [problem["code"] for problem in found["problems"]] == ["S101", "S208"]


def test_a_certificate_that_cannot_be_kept_fails_in_every_report(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Such as on a disk that is full: exit code 2, and no statement says that all is well."""

    def full(path: Path, _: bytes) -> None:
        raise SpecError((Fault("U001", "--write", f"cannot write {path}: No space left on device"),))

    monkeypatch.setattr("certify.report.gate_files.write_certificate", full)
    Path("a.toml").write_bytes(SINGLE)
    outputs = ["--statement", "t.json", "--junit", "j.xml", "--sarif", "s.sarif"]
    assert main(["gate", "--write", *outputs, "a.toml"]) == 2
    output = capsys.readouterr().out
    assert "cannot write a.cert.json: No space left on device" in output
    assert "0 of 1 certified" in output
    statement = json.loads(Path("t.json").read_text())["predicate"]
    assert (statement["result"], statement["failedTests"]) == ("FAILED", ["a.toml#U001 --write"])
    assert ElementTree.parse("j.xml").getroot().get("errors") == "0"
    assert ElementTree.parse("j.xml").getroot().get("failures") == "1"
    (run,) = json.loads(Path("s.sarif").read_text())["runs"]
    assert run["invocations"][0]["exitCode"] == 2
    assert [entry["kind"] for entry in run["results"]].count("fail") == 1


def printed(*paths: str) -> None:
    for path in paths:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / "specs" / "cigre-mv-as-printed.toml", path)


@pytest.fixture(scope="module")
def refuted() -> bytes:
    return prove(ROOT / "specs" / "cigre-mv-as-printed.toml").data


STATUS = st.sampled_from(("proved", "proved", "conditional", "unknown", "refuted"))
NAMES = ("dgu/1", "load/1", "load/2", "invariant-set/1", "microgrid", "equilibrium/1", "region/1", "mode/1/d")
LEDGER = ("sampled/1", "sampled/2", "equilibrium/1", "region/1")


@settings(deadline=None, max_examples=200, derandomize=True)
@given(
    st.fixed_dictionaries(dict.fromkeys(NAMES, STATUS)),
    st.sets(st.sampled_from(LEDGER)),
    st.sets(st.sampled_from((*LEDGER, "sampled/*", "*", "balanced", "*/1"))),
)
def test_claim_by_claim_the_gate_passes_what_the_verdict_lets_pass(
    statuses: dict[str, str], ledger: set[str], allow: set[str]
) -> None:
    """Whatever the kernel might say: no specs pass by their claims that do not by their verdict, nor the reverse."""
    assumed = tuple((name, "") for name in ("balanced", *sorted(ledger)))
    claims = tuple(Claim(name, name, status) for name, status in statuses.items())
    verdict, policy = Verdict(overall(statuses), claims, assumed), Policy(allow=tuple(sorted(allow)))
    result = judge(Decision("a.toml", "0", Committed(), verdict, {}, (), None, 0.0), policy)
    assert result.passed == may_pass(verdict, policy)
    assert not result.passed or verdict.outcome in ("certified", "conditional")


def gate(capsys: Capture, *arguments: str) -> tuple[int, Any, str]:
    code = main(["gate", "--json", *arguments])
    output = capsys.readouterr()
    return code, json.loads(output.out), output.err


def test_a_baseline_excuses_no_other_spec_of_the_same_name(refuted: bytes, capsys: Capture) -> None:
    printed("x/a.toml", "y/a.toml")
    Path("base").mkdir()
    Path("base/a.cert.json").write_bytes(refuted)
    assert gate(capsys, "--baseline", "base", "x/a.toml")[0] == 0
    code, found, _ = gate(capsys, "--baseline", "base", "x/a.toml", "y/a.toml")
    assert code == 2
    assert [fault["code"] for fault in found["faults"]] == ["U014"]
    assert "is found for x/a.toml and for y/a.toml" in found["faults"][0]["message"]
    Path("base/x").mkdir()  # a tree as of the base branch, in which x/a.toml has no certificate
    code, found, _ = gate(capsys, "--baseline", "base", "x/a.toml")
    assert (code, found["results"][0]["in_baseline"]) == (1, False)


def test_a_folder_of_statements_tells_what_it_leaves_out(capsys: Capture) -> None:
    Path("out").mkdir()
    Path("out/b.intoto.json").write_text("of another day")
    Path("a.toml").write_bytes(SINGLE)
    assert main(["gate", "--statement", "out", "a.toml", "b.toml"]) == 2
    assert "warning: out gets no statement about b.toml, which could not be read" in capsys.readouterr().err
    assert {path.name for path in Path("out").iterdir()} == {"a.intoto.json", "b.intoto.json"}


def test_an_output_without_a_name_is_refused_before_the_work(capsys: Capture) -> None:
    Path("a.toml").write_bytes(SINGLE)
    for option in ("--sarif", "--junit", "--statement"):
        assert main(["gate", option, "", "a.toml"]) == 2
        assert "it has no name" in capsys.readouterr().err


@pytest.mark.parametrize("windows", [False, True])
def test_line_ends_that_git_has_changed_are_named(windows: bool, capsys: Capture) -> None:
    """Otherwise every certificate would be stale on some machines, and nobody would know why."""
    other = SINGLE.replace(b"\n", b"\r\n")
    proved, found = (SINGLE, other) if windows else (other, SINGLE)
    Path("a.toml").write_bytes(found)
    Path("a.cert.json").write_bytes(prove(proved).data)
    assert main(["gate", "--require-certificate", "a.toml"]) == 3
    assert "a.cert.json is about this spec with other line ends" in capsys.readouterr().out
    assert main(["gate", "a.toml"]) == 0
    assert "`*.toml -text` in .gitattributes" in capsys.readouterr().out
    Path("a.toml").write_bytes(found + b"# more")
    assert main(["gate", "--require-certificate", "a.toml"]) == 3
    assert "about another state of this spec" in capsys.readouterr().out


def test_a_changed_certificate_in_a_folder_stands_for_its_spec(capsys: Capture) -> None:
    """What a hook is given: files that have changed, wherever certificates are."""
    Path("grids").mkdir()
    Path("certs/grids").mkdir(parents=True)
    Path("grids/a.toml").write_bytes(SINGLE)
    Path("certs/grids/a.cert.json").write_bytes(prove(SINGLE).data)
    code, found, _ = gate(capsys, "--certificates", "certs", "certs/grids/a.cert.json")
    assert code == 0
    assert [(r["spec"], r["certificate"]["state"]) for r in found["results"]] == [("grids/a.toml", "fresh")]
    assert gate(capsys, "certs/grids/a.cert.json")[0] == 2


def test_a_pattern_that_the_shell_has_left_says_so(capsys: Capture) -> None:
    assert main(["gate", "specs/*.toml"]) == 2
    assert "no file is called like this pattern" in capsys.readouterr().out


def test_json_has_the_exit_code_of_the_process(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """Also when a report could not be written in the end."""

    def full(*_: object) -> list[str]:
        raise SpecError((Fault("U001", "--sarif", "cannot write s.sarif: No space left on device"),))

    monkeypatch.setattr("certify.report.gate_files.write_files", full)
    Path("a.toml").write_bytes(SINGLE)
    code, found, error = gate(capsys, "--sarif", "s.sarif", "a.toml")
    assert (code, found["exit_code"]) == (2, 2)
    assert "No space left" in error
