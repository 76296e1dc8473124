"""SARIF, JUnit and the in-toto statement: against their schemas, read by others, and saying what the gate says."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import xmlschema
from google.protobuf.json_format import Parse, ParseDict
from in_toto_attestation.predicates.test_result.v0 import test_result_pb2
from in_toto_attestation.v1 import resource_descriptor_pb2, statement_pb2
from in_toto_attestation.v1.resource_descriptor import ResourceDescriptor
from in_toto_attestation.v1.statement import Statement
from ruamel.yaml import YAML

from certify.certificate import prove
from certify.cli import main
from certify.diagnostics import DIAGNOSTICS
from certify.gating.judge import judge
from certify.gating.policy import Policy
from certify.gating.results import Committed, Decision, GateResult, Problem
from certify.kernel.claims import Claim, Verdict
from certify.kernel.errors import Fault
from certify.report.junit import to_junit
from certify.report.sarif import to_sarif
from certify.report.statement import to_statement
from tests.conftest import ROOT

SCHEMAS = ROOT / "tests" / "data" / "schemas"
SARIF_SCHEMA = json.loads((SCHEMAS / "sarif-schema-2.1.0.json").read_text())
JUNIT_SCHEMA = xmlschema.XMLSchema(str(SCHEMAS / "junit-10.xsd"))
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with some specs."""
    (tmp_path / ".git").mkdir()
    (tmp_path / "specs").mkdir()
    for name in (
        "cigre-mv-as-printed.toml",
        "single-inverter.toml",
        "negative/many-faults.toml",
        "negative/lossless.toml",
    ):
        target = tmp_path / "specs" / Path(name).name
        target.write_bytes((ROOT / "specs" / name).read_bytes())
    (tmp_path / "specs" / "single-inverter.cert.json").write_bytes(
        prove((ROOT / "specs/single-inverter.toml").read_bytes()).data
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


ALL = ["cigre-mv-as-printed", "single-inverter", "many-faults", "lossless"]


def gate(*arguments: str, names: list[str] = ALL) -> int:
    return main(
        [
            "gate",
            "--junit",
            "j.xml",
            "--sarif",
            "s.sarif",
            "--statement",
            "t.json",
            *arguments,
            *(f"specs/{n}.toml" for n in names),
        ]
    )


def read_sarif(path: str = "s.sarif") -> Any:
    log = json.loads(Path(path).read_text())
    validator = jsonschema.validators.validator_for(SARIF_SCHEMA)
    assert list(validator(SARIF_SCHEMA, format_checker=validator.FORMAT_CHECKER).iter_errors(log)) == []
    return log


def results(log: Any) -> dict[tuple[str, str], Any]:
    """Each result by its spec and claim, or path of the fault."""
    found = {}
    for result in log["runs"][0]["results"]:
        (location,) = result["locations"]
        logical = location.get("logicalLocations", [{"fullyQualifiedName": result["message"]["text"].split(":")[0]}])
        key = (location["physicalLocation"]["artifactLocation"]["uri"], logical[0]["fullyQualifiedName"])
        assert key not in found
        found[key] = result
    return found


def marked(result: Any) -> str:
    """The text of the region of a result."""
    place = result["locations"][0]["physicalLocation"]
    line = Path(place["artifactLocation"]["uri"]).read_text().splitlines()[place["region"]["startLine"] - 1]
    return line[place["region"]["startColumn"] - 1 : place["region"]["endColumn"] - 1]


# --- SARIF ------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here")
def test_sarif_says_what_the_gate_says(capsys: Capture) -> None:
    assert gate() == 2
    capsys.readouterr()
    log = read_sarif()
    found = results(log)
    printed = "specs/cigre-mv-as-printed.toml"
    expected = {
        (printed, "dgu/1"): ("fail", "error", "frequency-witness", "dgu"),
        (printed, "dgu/2"): ("pass", "none", "quadratic-storage", "dgu"),
        (printed, "load/9"): ("pass", "none", "monotone-ends", "load"),
        (printed, "microgrid"): ("open", "none", "P204", "f"),
        (printed, "invariant-set/1"): ("open", "none", "P203", "1"),
        ("specs/many-faults.toml", "filter.lc.C"): ("fail", "error", "S203", "C"),
        ("specs/many-faults.toml", "nmae"): ("fail", "error", "S101", "nmae"),
        ("specs/many-faults.toml", "line.x.to"): ("fail", "error", "S301", "to"),
    }
    for key, (kind, level, rule, text) in expected.items():
        assert (found[key]["kind"], found[key]["level"], found[key]["ruleId"]) == (kind, level, rule), key
        if text != "f":
            assert marked(found[key]) == text, key
    assert "It refutes" not in found[printed, "dgu/1"]["message"]["text"]
    assert "no storage function of any kind exists" in found[printed, "dgu/1"]["message"]["text"]
    related = {entry["message"]["text"]: entry for entry in found[printed, "dgu/1"]["relatedLocations"]}
    assert set(related) == {"the controller pi", "the filter lc"}
    lines = Path(printed).read_text().splitlines()
    start = related["the controller pi"]["physicalLocation"]["region"]["startLine"]
    assert lines[start - 1] == "[controller.pi]"


@pytest.mark.usefixtures("here")
def test_sarif_has_what_code_scanning_asks_for(capsys: Capture) -> None:
    """Of GitHub's documentation: what is marked as required, and its limits."""
    gate()
    capsys.readouterr()
    (run,) = read_sarif()["runs"]
    rules = run["tool"]["driver"]["rules"]
    assert len({rule["id"] for rule in rules}) == len(rules)
    for rule in rules:
        assert rule["id"] in DIAGNOSTICS
        assert 0 < len(rule["shortDescription"]["text"]) <= 1024
        assert 0 < len(rule["fullDescription"]["text"]) <= 1024
        assert rule["help"]["text"]
        assert 0 < len(rule["name"]) <= 255
    prints = [result["partialFingerprints"]["primaryLocationLineHash"] for result in run["results"]]
    assert len(set(prints)) == len(prints)
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["level"] == "none" or result["kind"] == "fail"
        assert result["message"]["text"]
        place = result["locations"][0]["physicalLocation"]
        assert place["artifactLocation"]["uriBaseId"] == "%SRCROOT%"
        assert not place["artifactLocation"]["uri"].startswith(("/", "file:"))
        assert place["region"]["endColumn"] > place["region"]["startColumn"] >= 1
    assert run["automationDetails"]["id"].endswith("/")
    assert run["columnKind"] == "unicodeCodePoints"


@pytest.mark.usefixtures("here")
def test_fingerprints_stay_when_lines_move_and_other_parts_are_renamed(capsys: Capture) -> None:
    gate(names=["cigre-mv-as-printed"])
    before = {key[1]: r["partialFingerprints"] for key, r in results(read_sarif()).items()}
    path = Path("specs/cigre-mv-as-printed.toml")
    text = path.read_text()
    path.write_text(
        "# moved\n\n\n" + text.replace("overhead", "cable").replace('"3"', '"3x"').replace("[node.3]", "[node.3x]")
    )
    gate(names=["cigre-mv-as-printed"])
    after = {key[1]: r["partialFingerprints"] for key, r in results(read_sarif()).items()}
    assert set(before) - set(after) == {"dgu/3"}
    assert all(after[name] == before[name] for name in before if name in after)
    Path("specs/other.toml").write_text(text)
    gate(names=["other"])
    assert not {str(p) for p in before.values()} & {
        str(r["partialFingerprints"]) for r in results(read_sarif()).values()
    }
    capsys.readouterr()


@pytest.mark.usefixtures("here")
def test_kinds_may_be_chosen(capsys: Capture) -> None:
    gate("--sarif-kinds", "fail,open,review")
    capsys.readouterr()
    assert {result["kind"] for result in read_sarif()["runs"][0]["results"]} == {"fail", "open"}
    gate("--sarif-kinds", "fail,open,review", names=["single-inverter"])
    assert read_sarif()["runs"][0]["results"] == []
    capsys.readouterr()


def test_paths_are_relative_to_the_repository(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.chdir(here / "specs")
    (here / "specs" / "a link.toml").symlink_to("single-inverter.toml")
    outside = here.parent / f"{here.name}-outside ä.toml"
    outside.write_bytes((here / "specs" / "single-inverter.toml").read_bytes())
    main(["gate", "--sarif", "s.sarif", "a link.toml", str(outside)])
    capsys.readouterr()
    log = read_sarif("s.sarif")
    uris = {r["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for r in log["runs"][0]["results"]}
    assert "specs/single-inverter.toml" in uris
    (other,) = uris - {"specs/single-inverter.toml"}
    assert other.startswith("file:///")
    assert other.endswith("-outside%20%C3%A4.toml")
    outside.unlink()


@pytest.mark.usefixtures("here")
def test_baseline_states(capsys: Capture) -> None:
    gate("--json", names=["cigre-mv-as-printed"])
    base = json.loads(capsys.readouterr().out)
    claims = {claim["id"]: claim for claim in base["results"][0]["claims"]}
    claims["dgu/2"]["status"] = "unknown"
    del claims["load/9"]
    claims["dgu/99"] = {"id": "dgu/99", "status": "refuted"}
    base["results"][0]["claims"] = list(claims.values())
    Path("base.json").write_text(json.dumps(base))
    assert gate("--baseline", "base.json", names=["cigre-mv-as-printed"]) == 0
    capsys.readouterr()
    found = {name: result for (_, name), result in results(read_sarif()).items()}
    states = {name: found[name]["baselineState"] for name in ("dgu/1", "dgu/2", "load/9", "dgu/99")}
    assert states == {"dgu/1": "unchanged", "dgu/2": "updated", "load/9": "new", "dgu/99": "absent"}
    assert (found["dgu/1"]["kind"], found["dgu/1"]["level"]) == ("fail", "note")
    assert (found["dgu/99"]["kind"], found["dgu/99"]["level"]) == ("notApplicable", "none")


def test_no_more_results_than_code_scanning_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    statuses = ("proved", "refuted", "unknown", "proved", "refuted")
    claims = tuple(Claim(f"load/{k}", "says", status) for k, status in enumerate(statuses))
    decision = Decision("x.toml", "0" * 64, Committed(), Verdict("refuted", claims, ()), {}, (), None, 0.0)
    result = GateResult((judge(decision, Policy()),))
    monkeypatch.setattr("certify.report.sarif.MOST", 3)
    (run,) = json.loads(to_sarif(result))["runs"]
    assert [entry["kind"] for entry in run["results"]] == ["fail", "open", "fail"]
    (note,) = run["invocations"][0]["toolExecutionNotifications"]
    assert note["message"]["text"].startswith("2 results are left out")


# --- results of every sort, made by hand ------------------------------------------------------------------------

NAME = "a\x1b[31m\udcff <&>\"']]>\ufffe é %41 #?"
NASTY = "a\x00b\x1b[31m\ud800 <&>\"']]>\ufffe é"


def made(status: str, outcome: str, ledger: tuple[str, ...] = (), name: str = "load/9", **problem: Any) -> Decision:
    claims = (
        Claim("line/1", "line 1 is strictly passive", "proved", "series-branch"),
        Claim(name, f"says {NASTY}", status),
    )
    verdict = Verdict(outcome, claims, tuple((x, "is assumed") for x in ("balanced", *ledger)))
    problems = (Problem(**problem),) if problem else ()
    found = None if problem.get("kind") in ("bad input", "rejected") else verdict
    return Decision(f"specs/{NAME}.toml", "0" * 64, Committed(), found, {}, problems, None, 0.25)


SORTS: dict[str, tuple[Decision, Policy, dict[str, str] | None]] = {
    "proved": (made("proved", "certified"), Policy(), None),
    "refuted": (made("refuted", "refuted"), Policy(), None),
    "refuted before": (made("refuted", "refuted"), Policy(), {"load/9": "refuted"}),
    "refuted now": (made("refuted", "refuted"), Policy(), {"load/9": "unknown"}),
    "unknown": (made("unknown", "unknown"), Policy(), None),
    "unknown before": (made("unknown", "unknown"), Policy(), {"load/9": "refuted", "load/7": "proved"}),
    "conditional": (made("conditional", "conditional", ("sampled/9",)), Policy(), None),
    "allowed": (made("conditional", "conditional", ("sampled/9",)), Policy(allow=("sampled/9",)), None),
    "equilibrium": (made("unknown", "conditional", ("equilibrium/9",), "equilibrium/9"), Policy(), None),
    "beside": (made("refuted", "certified", (), "mode/9/d"), Policy(), None),
    "bad input": (
        made("", "", kind="bad input", file="x", fault=Fault("S101", NASTY, NASTY), exit_code=2),
        Policy(),
        None,
    ),
    "rejected": (
        made("", "", kind="rejected", file="c", fault=Fault("K201", "load/9", NASTY), exit_code=4),
        Policy(),
        None,
    ),
    "too old": (
        made("proved", "certified", kind="certificate", file="c", fault=Fault("U012", "", "old"), exit_code=3),
        Policy(),
        None,
    ),
}


def view_of(junit: bytes) -> dict[str, int]:
    """What a view of test results counts: cases by what they hold."""
    counts = dict.fromkeys(("passed", "failure", "error", "skipped"), 0)
    for case in ET.fromstring(junit).iter("testcase"):
        counts[next((child.tag for child in case), "passed")] += 1
    return counts


@pytest.mark.parametrize("sort", SORTS)
def test_each_format_fails_exactly_when_the_gate_does(sort: str) -> None:
    decision, policy, before = SORTS[sort]
    spec = judge(decision, policy, before)
    result = GateResult((spec,), (), "base" if before else None)
    fails = sort in (
        "refuted",
        "refuted now",
        "unknown",
        "conditional",
        "equilibrium",
        "bad input",
        "rejected",
        "too old",
    )
    assert (result.exit_code != 0) == fails

    junit = to_junit(result)
    JUNIT_SCHEMA.validate(junit.decode())
    counts = view_of(junit)
    assert (counts["failure"] + counts["error"] > 0) == fails
    root = ET.fromstring(junit)
    suite = root.find("testsuite")
    assert suite is not None
    for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        assert suite.get(key) == str(counts[tag])
    assert suite.get("tests") == str(sum(counts.values())) == root.get("tests")

    log = json.loads(to_sarif(result))
    validator = jsonschema.validators.validator_for(SARIF_SCHEMA)
    assert list(validator(SARIF_SCHEMA).iter_errors(log)) == []
    levels = {entry["level"] for entry in log["runs"][0]["results"]}
    kinds = {entry["kind"] for entry in log["runs"][0]["results"]}
    assert (bool(levels & {"error"}) or bool(kinds & {"open", "review"})) >= fails
    assert ("baselineState" in log["runs"][0]["results"][0]) == (before is not None)

    data = to_statement(result.specs)
    assert data is not None
    statement = Statement.copy_from_pb(Parse(data.decode(), statement_pb2.Statement()))
    statement.validate()
    predicate = json.loads(data)["predicate"]
    assert (predicate["result"] == "FAILED") == fails == bool(predicate["failedTests"])
    assert predicate["result"] == ("FAILED" if fails else "WARNED" if predicate["warnedTests"] else "PASSED")


# --- JUnit and the statement ------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here")
def test_junit_has_a_suite_for_each_spec_and_a_case_for_each_claim(capsys: Capture) -> None:
    gate()
    capsys.readouterr()
    JUNIT_SCHEMA.validate("j.xml")
    suites = {suite.get("name"): suite for suite in ET.parse("j.xml").getroot()}
    assert list(suites) == [f"specs/{name}.toml" for name in ALL]
    printed = suites["specs/cigre-mv-as-printed.toml"]
    cases = {case.get("name"): case for case in printed.iter("testcase")}
    assert len(cases) == 32
    assert {case.get("classname") for case in cases.values()} == {"specs/cigre-mv-as-printed.toml"}
    failure = cases["dgu/1"].find("failure")
    assert failure is not None
    assert failure.get("type") == "frequency-witness"
    assert "no storage function of any kind exists" in (failure.text or "")
    assert len(list(suites["specs/many-faults.toml"].iter("error"))) == 5
    assert "time" not in Path("j.xml").read_text()
    gate("--times")
    JUNIT_SCHEMA.validate("j.xml")
    assert ' time="' in Path("j.xml").read_text()
    capsys.readouterr()


@pytest.mark.usefixtures("here")
def test_the_statement_is_read_by_the_library_of_in_toto(capsys: Capture) -> None:
    gate()
    text = Path("t.json").read_text()
    statement = Statement.copy_from_pb(Parse(text, statement_pb2.Statement()))
    statement.validate()
    assert statement.pb.predicate_type == "https://in-toto.io/attestation/test-result/v0.1"
    assert [subject.name for subject in statement.pb.subject] == [f"specs/{name}.toml" for name in ALL]
    predicate = json.loads(text)["predicate"]
    read = ParseDict(predicate, test_result_pb2.TestResult())
    assert read.result == "FAILED"
    assert "specs/cigre-mv-as-printed.toml#dgu/1" in read.failed_tests
    assert "specs/many-faults.toml#S203 filter.lc.C" in read.failed_tests
    assert "specs/single-inverter.toml#microgrid" in read.passed_tests
    for entry in predicate["configuration"]:
        ResourceDescriptor.copy_from_pb(ParseDict(entry, resource_descriptor_pb2.ResourceDescriptor())).validate()
    committed = [entry for entry in predicate["configuration"] if entry["name"] == "specs/single-inverter.cert.json"]
    assert committed[0]["digest"] != {}
    assert main(["gate", "--statement", "statements/", "specs/single-inverter.toml", "specs/lossless.toml"]) == 3
    assert sorted(path.name for path in Path("statements").iterdir()) == [
        "lossless.intoto.json",
        "single-inverter.intoto.json",
    ]
    assert json.loads(Path("statements/single-inverter.intoto.json").read_text())["predicate"]["result"] == "PASSED"
    Path("t.json").unlink()
    assert main(["gate", "--statement", "t.json", "missing.toml"]) == 2
    assert "t.json is not written: none of the specs could be read" in capsys.readouterr().err
    assert not Path("t.json").exists()


# --- the workflow and the hook ----------------------------------------------------------------------------------


def test_the_workflow_is_one() -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.github-workflows"]
    done = subprocess.run(
        [*command, str(ROOT / ".github/workflows/certify.yml")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_the_steps_of_the_workflow_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but GitHub's own actions and the installation."""
    workflow = YAML(typ="safe").load(ROOT / ".github/workflows/certify.yml")
    steps = {step.get("name"): step for step in workflow["jobs"]["gate"]["steps"]}
    default = steps["Gate"]["env"]["SPECS"].split("'")[1]
    assert default == workflow["on"]["workflow_call"]["inputs"]["specs"]["default"]
    for spec in default.split():
        for name in (spec, spec.replace(".toml", ".cert.json")):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    environment = {"SPECS": default, "OPTIONS": "--require-certificate", "PATH": "/usr/bin:/bin"}
    script = f'certify() {{ {shlex.quote(sys.executable)} -m certify "$@"; }}\n{steps["Gate"]["run"]}'
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", script],
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    written = steps["Keep the results"]["with"]["path"].split()
    assert all((tmp_path / name).exists() for name in written)
    assert steps["Upload to code scanning"]["with"]["sarif_file"] in written
    assert read_sarif("certify.sarif")["runs"][0]["results"] == []
    assert workflow["permissions"] == {"contents": "read"}


def test_the_hook_takes_specs_and_certificates() -> None:
    import re

    (hook,) = YAML(typ="safe").load(ROOT / ".pre-commit-hooks.yaml")
    assert (hook["id"], hook["entry"], hook["language"]) == ("certify-gate", "certify gate", "python")
    for name in ("specs/a.toml", "x/specs/b.json", "c.microgrid.toml", "specs/a.cert.json", "d.cert.json"):
        assert re.search(hook["files"], name), name
    for name in ("pyproject.toml", "package.json", "specs/deep/er.toml", "specs/a.tomlx"):
        assert not re.search(hook["files"], name), name
