"""The gate: what counts and what does not, committed certificates, baselines, ages, files, and hostile input."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from certify.certificate import prove
from certify.cli import main
from certify.gating.committed import CLOCKS, certificate_path, too_old
from certify.gating.judge import RANK, judge
from certify.gating.policy import Policy, parse_age
from certify.gating.results import Committed, Decision
from certify.kernel.claims import Claim, Verdict
from tests.conftest import ROOT

SINGLE = "single-inverter.toml"
PRINTED = "cigre-mv-as-printed.toml"
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="session")
def proofs() -> dict[str, bytes]:
    """The certificate of each spec that is used here."""
    names = (SINGLE, PRINTED, "cigre-mv.toml", "negative/lossless.toml")
    return {Path(name).name: prove((ROOT / "specs" / name).read_bytes()).data for name in names}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(name: str, certificate: bytes | None = None, as_: str | None = None) -> Path:
    """A spec of the project in this folder, with a certificate beside it if one is given."""
    target = Path(as_ or Path(name).name)
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / "specs" / name, target)
    if certificate is not None:
        certificate_path(str(target)).write_bytes(certificate)
    return target


def gate(capsys: Capture, *arguments: str) -> tuple[int, Any]:
    """The exit code and the results as JSON; the errors as text if there are none."""
    code = main(["gate", "--json", *arguments])
    output = capsys.readouterr()
    assert "Traceback" not in output.err
    assert "internal error" not in output.err
    return code, json.loads(output.out)


def only(found: Any) -> Any:
    (result,) = found["results"]
    return result


@pytest.fixture
def no_proving(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("something was proved")

    monkeypatch.setattr("certify.certificate.prove", fail)


# --- committed certificates -------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here", "no_proving")
@pytest.mark.parametrize(
    ("name", "code", "outcome"),
    [(SINGLE, 0, "certified"), (PRINTED, 1, "refuted"), ("negative/lossless.toml", 3, "unknown")],
)
def test_a_certificate_of_this_spec_counts_whatever_it_says(
    name: str, code: int, outcome: str, proofs: dict[str, bytes], capsys: Capture
) -> None:
    file = put(name, proofs[Path(name).name])
    found, result = gate(capsys, str(file))
    assert (found, only(result)["outcome"]) == (code, outcome)
    assert only(result)["certificate"]["state"] == "fresh"
    assert only(result)["certificate"]["path"] == str(certificate_path(str(file)))
    assert {claim["status"] for claim in only(result)["claims"]} >= {"proved"}
    main(["gate", str(file)])
    assert "(checked)" in capsys.readouterr().out


@pytest.mark.usefixtures("here")
def test_the_kernel_checks_it_for_real(
    proofs: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """What this machine remembers to have accepted is not asked."""
    calls = []
    from certify.gating import committed

    real = committed.check
    monkeypatch.setattr(committed, "check", lambda *data: (calls.append(data), real(*data))[1])
    put(SINGLE, proofs[SINGLE])
    assert gate(capsys, SINGLE)[0] == 0
    assert gate(capsys, SINGLE)[0] == 0
    assert len(calls) == 2


def test_checking_imports_neither_search_nor_other_packages(here: Path, proofs: dict[str, bytes]) -> None:
    put(SINGLE, proofs[SINGLE])
    code = (
        "import sys; from certify.cli import main; main(sys.argv[1:])\n"
        "print('\\n'.join(name for name in sys.modules if not name.startswith('_')))"
    )
    outputs = ["--junit", "j.xml", "--sarif", "s.sarif", "--statement", "t.json"]
    done = subprocess.run(
        [sys.executable, "-c", code, "gate", SINGLE, *outputs],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    loaded = set(done.stdout.split())
    assert {name for name in loaded if name.startswith("certify.search")} <= {
        "certify.search",
        "certify.search.methods",
    }
    assert not {name.split(".")[0] for name in loaded} & {"numpy", "scipy", "flint", "rich", "clarabel", "matplotlib"}
    assert sorted(path.name for path in here.iterdir() if path.suffix != ".toml") == sorted(
        ["j.xml", "s.sarif", "t.json", "single-inverter.cert.json"]
    )


@pytest.mark.usefixtures("here")
def test_a_changed_spec_is_proved_anew_and_written_if_asked_for(proofs: dict[str, bytes], capsys: Capture) -> None:
    file = put(SINGLE, proofs[SINGLE])
    file.write_text(file.read_text() + "# changed\n")
    code, found = gate(capsys, SINGLE)
    assert (code, only(found)["certificate"]["state"], only(found)["certificate"]["written"]) == (0, "stale", None)
    assert certificate_path(SINGLE).read_bytes() == proofs[SINGLE]
    assert main(["gate", SINGLE]) == 0
    assert "(proved anew)" in (told := capsys.readouterr().out)
    assert "single-inverter.cert.json is about another state of this spec (stale); --write replaces it" in told
    assert main(["gate", "--write", SINGLE]) == 0
    assert "wrote single-inverter.cert.json; that of an earlier state said certified" in capsys.readouterr().out
    assert main(["check", SINGLE, "single-inverter.cert.json"]) == 0
    capsys.readouterr()
    assert only(gate(capsys, SINGLE)[1])["certificate"]["state"] == "fresh"


@pytest.mark.usefixtures("here")
def test_a_new_certificate_is_written_whatever_its_verdict(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(PRINTED)
    code, found = gate(capsys, "--write", PRINTED)
    assert (code, only(found)["certificate"]["written"]) == (1, "cigre-mv-as-printed.cert.json")
    assert certificate_path(PRINTED).read_bytes() == proofs[PRINTED]


@pytest.mark.usefixtures("here")
def test_a_folder_of_certificates(capsys: Capture) -> None:
    put(SINGLE, as_="grids/a.toml")
    Path("certs").mkdir()
    assert gate(capsys, "--certificates", "certs", "--require-certificate", "grids/a.toml")[0] == 3
    assert (
        only(gate(capsys, "--certificates", "certs", "--write", "grids/a.toml")[1])["certificate"]["written"]
        == "certs/a.cert.json"
    )
    Path("certs/grids").mkdir()  # where there are its folders, that of another spec of this name is not taken
    found = only(gate(capsys, "--certificates", "certs", "grids/a.toml")[1])["certificate"]
    assert (found["state"], found["path"]) == ("none", None)
    Path("certs/a.cert.json").rename("certs/grids/a.cert.json")
    found = only(gate(capsys, "--certificates", "certs", "grids/a.toml")[1])["certificate"]
    assert (found["state"], found["path"]) == ("fresh", "certs/grids/a.cert.json")
    assert main(["gate", "--certificates", "nowhere", "grids/a.toml"]) == 2


def tampered(certificate: bytes, kind: str) -> bytes:
    document = json.loads(certificate)
    if kind == "verdict":
        document["verdict"] = "refuted"
    elif kind == "claim":
        document["claims"][0]["statement"] = "all is well"
    elif kind == "status":
        next(c for c in document["claims"] if c["id"].startswith("dgu"))["status"] = "refuted"
    elif kind == "proof":
        key = next(c for c in document["claims"] if c["id"].startswith("dgu"))["proof"]
        rows = document["proofs"][key]["storage"]
        document["proofs"][key]["storage"] = [rows[0].replace("0", "1", 1), *rows[1:]]
    elif kind == "format":
        document["format"] = "certify/certificate@2"
    elif kind == "number":
        document["verdict"] = 1.5
    elif kind == "list":
        return json.dumps([document]).encode()
    return json.dumps(document).encode()


@pytest.mark.usefixtures("here", "no_proving")
@pytest.mark.parametrize("kind", ["verdict", "claim", "status", "proof", "format", "number", "list"])
@pytest.mark.parametrize("options", [[], ["--write"], ["--require-certificate"]], ids=str)
def test_a_certificate_that_is_rejected_stays_and_fails(
    kind: str, options: list[str], proofs: dict[str, bytes], capsys: Capture
) -> None:
    data = tampered(proofs[SINGLE], kind)
    put(SINGLE, data)
    code, found = gate(capsys, *options, SINGLE)
    assert (code, only(found)["outcome"], only(found)["certificate"]["state"]) == (4, "rejected", "rejected")
    assert certificate_path(SINGLE).read_bytes() == data
    assert main(["gate", *options, SINGLE]) == 4
    assert "single-inverter.cert.json: K" in (told := capsys.readouterr().out)
    assert "= help: " in told


@pytest.mark.usefixtures("here", "no_proving")
@pytest.mark.parametrize("share", [0, 0.1, 0.5, 0.9, 0.999])
def test_a_certificate_that_is_cut_off(share: float, proofs: dict[str, bytes], capsys: Capture) -> None:
    data = proofs[SINGLE]
    put(SINGLE, data[: int(share * (len(data) - 1))])
    code, found = gate(capsys, SINGLE)
    assert (code, only(found)["problems"][0]["code"]) == (4, "K101")


@pytest.mark.usefixtures("here", "no_proving")
def test_certificates_that_are_none(capsys: Capture) -> None:
    put(SINGLE, b'{"format":"certify/loads@1"}\n{}\n')
    assert gate(capsys, SINGLE)[0] == 4
    certificate_path(SINGLE).write_bytes(b"\xff" * 100)
    assert gate(capsys, SINGLE)[0] == 4
    certificate_path(SINGLE).unlink()
    certificate_path(SINGLE).mkdir()
    code, found = gate(capsys, SINGLE)
    assert (code, only(found)["problems"][0]["code"]) == (2, "S000")
    assert only(found)["problems"][0]["file"] == "single-inverter.cert.json"


@pytest.mark.usefixtures("here", "no_proving")
def test_a_required_certificate(proofs: dict[str, bytes], capsys: Capture) -> None:
    file = put(SINGLE)
    code, found = gate(capsys, "--require-certificate", SINGLE)
    assert (code, only(found)["problems"][0]["code"], only(found)["certificate"]["state"]) == (3, "U010", "none")
    certificate_path(SINGLE).write_bytes(proofs[SINGLE])
    assert gate(capsys, "--require-certificate", SINGLE)[0] == 0
    file.write_text(file.read_text() + "\n")
    code, found = gate(capsys, "--require-certificate", SINGLE)
    assert (code, only(found)["problems"][0]["code"], only(found)["certificate"]["state"]) == (3, "U011", "stale")
    file.write_text(file.read_text().replace("nu", "un"))
    code, found = gate(capsys, "--require-certificate", SINGLE)
    assert (code, only(found)["outcome"]) == (2, "bad input")


def test_the_certificates_of_this_project_are_those_of_its_specs(capsys: Capture) -> None:
    specs = ["specs/cigre-mv.toml", "specs/two-inverters.toml"]
    code, found = gate(capsys, "--require-certificate", *specs)
    assert code == 0
    assert [entry["certificate"]["state"] for entry in found["results"]] == ["fresh", "fresh"]


# --- age --------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here")
def test_the_age_of_a_certificate(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    now = int(datetime.now(UTC).timestamp())
    put(SINGLE)
    assert main(["prove", SINGLE, "-o", "single-inverter.cert.json"]) == 0
    capsys.readouterr()
    code, found = gate(capsys, "--max-age", "90d", SINGLE)
    assert (code, only(found)["problems"][0]["code"], only(found)["outcome"]) == (3, "U012", "certified")
    assert main(["gate", "--max-age", "90d", SINGLE]) == 3
    assert "failed " in (told := capsys.readouterr().out)
    assert "--stamp" in told
    assert main(["prove", SINGLE, "--stamp", "-o", "single-inverter.cert.json"]) == 0
    capsys.readouterr()
    assert gate(capsys, "--max-age", "90d", SINGLE)[0] == 0
    for age, code in ((11 * 3600, 0), (13 * 3600, 3), (-3600, 2)):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", str(now - age))
        certificate_path(SINGLE).unlink()
        gate(capsys, "--write", SINGLE)
        monkeypatch.delenv("SOURCE_DATE_EPOCH")
        assert gate(capsys, "--max-age", "12 h", SINGLE)[0] == code
    certificate_path(SINGLE).unlink()
    assert gate(capsys, "--max-age", "1m", SINGLE)[0] == 0  # proved now


def test_times_that_mean_nothing() -> None:
    now = datetime(2026, 1, 31, tzinfo=UTC)
    policy = Policy(max_age="1d")
    cases = [(None, "U012"), ("yesterday", "U013"), ("2026-01-31T00:00:00", "U013"), ("2026-01-29T00:00:00Z", "U012")]
    cases += [("2026-02-01T00:00:00Z", "U013"), ("\ud800", "U013"), ("0000-01-01T00:00:00Z", "U013")]
    for created, code in cases:
        assert (problem := too_old(created, "c", policy, now)) is not None
        assert problem.fault.code == code, created
    for created in ("2026-01-30T12:00:00Z", f"2026-01-31T00:0{CLOCKS // 60}:00Z"):
        assert too_old(created, "c", policy, now) is None
    assert too_old(None, "c", Policy(), now) is None


@pytest.mark.parametrize("text", ["", "90", "d", "-1d", "1y", "1.5d", "9999999d", "٣d"])
def test_ages_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="expected an age"):
        parse_age(text)


# --- what counts ------------------------------------------------------------------------------------------------


def decided(statuses: dict[str, str], outcome: str = "unknown", ledger: tuple[str, ...] = ()) -> Decision:
    claims = tuple(Claim(name, f"says {name}", status) for name, status in statuses.items())
    verdict = Verdict(outcome, claims, tuple((name, "is assumed") for name in ("balanced", *ledger)))
    return Decision("x.toml", "0" * 64, Committed(), verdict, {}, (), None, 0.0)


@pytest.mark.parametrize("now", RANK)
@pytest.mark.parametrize("before", [*RANK, None])
def test_only_what_got_worse_counts(now: str, before: str | None) -> None:
    known = {"dgu/1": before} if before else {}
    result = judge(decided({"dgu/1": now}), Policy(), known)
    better = {"proved": 3, "conditional": 2, "unknown": 2, "refuted": 1}
    expected = now == "proved" or (before is not None and better[now] >= better[before])
    assert result.passed == expected
    assert result.exit_code == (0 if expected else 1 if now == "refuted" else 3)
    assert result.claims[0].before == before
    assert judge(decided({"dgu/1": now}), Policy(), None).passed == (now == "proved")


def test_claims_that_come_and_go() -> None:
    result = judge(
        decided({"dgu/5a": "unknown", "line/1": "proved"}), Policy(), {"dgu/5": "unknown", "line/1": "proved"}
    )
    assert result.exit_code == 3  # a new name is a new claim
    assert result.absent == (("dgu/5", "unknown"),)
    assert judge(decided({"line/1": "proved"}), Policy(), {"dgu/5": "refuted", "line/1": "unknown"}).passed


def test_what_is_beside_the_verdict_never_counts() -> None:
    assert judge(
        decided({"line/1": "proved", "mode/1/d": "refuted", "saturated/1": "unknown"}, "certified"), Policy()
    ).passed


@pytest.mark.parametrize(
    ("statuses", "outcome", "ledger", "allow", "failed"),
    [
        ({"load/9": "conditional", "microgrid": "conditional"}, "conditional", ("sampled/9",), (), 2),
        ({"load/9": "conditional", "microgrid": "conditional"}, "conditional", ("sampled/9",), ("sampled/9",), 0),
        ({"load/9": "conditional", "microgrid": "conditional"}, "conditional", ("sampled/9",), ("sampled/*",), 0),
        ({"load/9": "conditional", "microgrid": "conditional"}, "conditional", ("sampled/9",), ("sampled",), 2),
        (
            {"load/9": "conditional", "load/8": "conditional"},
            "conditional",
            ("sampled/8", "sampled/9"),
            ("sampled/9",),
            2,
        ),
        ({"equilibrium/1": "unknown", "region/1": "unknown"}, "conditional", ("equilibrium/1",), ("equilibrium/1",), 0),
        ({"equilibrium/1": "unknown", "dgu/1": "refuted"}, "refuted", ("equilibrium/1",), ("*",), 1),
        ({"equilibrium/1": "refuted", "dgu/1": "proved"}, "refuted", (), ("*",), 1),
        ({"load/9": "conditional", "load/8": "unknown"}, "unknown", ("sampled/9",), ("sampled/9",), 1),
        ({"load/9": "unknown"}, "unknown", (), ("*", "load/9", "sampled/9"), 1),
        ({"microgrid": "unknown"}, "unknown", (), ("*",), 1),
    ],
)
def test_allowed(
    statuses: dict[str, str], outcome: str, ledger: tuple[str, ...], allow: tuple[str, ...], failed: int
) -> None:
    result = judge(decided(statuses, outcome, ledger), Policy(allow=allow))
    assert len(result.of("failed")) == failed
    assert result.passed == (failed == 0)


@pytest.mark.usefixtures("here")
def test_sampled_loads_pass_only_if_they_are_named(capsys: Capture) -> None:
    shutil.copyfile(ROOT / "specs" / "single-inverter.toml", "a.toml")
    text = Path("a.toml").read_text()
    assert 'kind = "zip"' in text
    for allow, code in (([], 3), (["--allow", "sampled/*"], 0), (["--allow", "sampled/zz"], 3)):
        assert main(["gate", "--method", "sampled", *allow, "a.toml"]) == code
        output = capsys.readouterr()
        assert ("to pass, it needs --allow sampled/" in output.out) == (code == 3)
        assert ("--allow sampled/zz: no verdict rests on" in output.err) == ("sampled/zz" in allow)


# --- baselines --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here")
def test_a_baseline_of_certificates(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(PRINTED, as_="specs/a.toml")
    Path("base").mkdir()
    Path("base/a.cert.json").write_bytes(proofs[PRINTED])
    code, found = gate(capsys, "--baseline", "base", "specs/a.toml")
    assert (code, only(found)["outcome"], only(found)["in_baseline"]) == (0, "refuted", True)
    assert {claim["standing"] for claim in only(found)["claims"]} == {"passed", "no worse"}
    main(["gate", "--baseline", "base", "specs/a.toml"])
    assert "excused, no worse than before: refuted dgu/1, unknown invariant-set/1" in capsys.readouterr().out
    Path("base/a.cert.json").write_bytes(proofs["cigre-mv.toml"])
    code, found = gate(capsys, "--baseline", "base", "specs/a.toml")
    assert code == 1
    assert "refuted dgu/1 (frequency-witness), was proved" in only(found)["detail"]
    Path("base/a.cert.json").unlink()  # a new spec is judged as without a baseline
    code, found = gate(capsys, "--baseline", "base", "specs/a.toml")
    assert (code, only(found)["in_baseline"]) == (1, False)


@pytest.mark.usefixtures("here")
def test_a_baseline_that_the_gate_has_printed(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(PRINTED, proofs[PRINTED], as_="specs/a.toml")
    main(["gate", "--json", "specs/a.toml"])
    Path("base.json").write_text(capsys.readouterr().out)
    assert gate(capsys, "--baseline", "base.json", "./specs/a.toml")[0] == 0
    put(PRINTED, proofs[PRINTED], as_="specs/b.toml")
    assert gate(capsys, "--baseline", "base.json", "specs/a.toml", "specs/b.toml")[0] == 1
    Path("specs/a.toml").write_text("x = 1")
    assert gate(capsys, "--baseline", "base.json", "specs/a.toml")[0] == 2


@pytest.mark.usefixtures("here")
def test_a_baseline_makes_nothing_proved(proofs: dict[str, bytes], capsys: Capture) -> None:
    """Whatever it says of before, what is found now is told as it is."""
    put(PRINTED, proofs[PRINTED], as_="a.toml")
    document = json.loads(proofs[PRINTED])
    for status in ("refuted", "proved"):
        for claim in document["claims"]:
            claim["status"] = status
        Path("base").mkdir(exist_ok=True)
        Path("base/a.cert.json").write_text(json.dumps(document))
        code, found = gate(capsys, "--baseline", "base", "a.toml")
        assert (code, only(found)["outcome"]) == (0 if status == "refuted" else 1, "refuted")
        assert {claim["status"] for claim in only(found)["claims"]} == {"proved", "refuted", "unknown"}


@pytest.mark.usefixtures("here", "no_proving")
def test_baselines_that_cannot_be_used(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(PRINTED, proofs[PRINTED], as_="a.toml")
    Path("base").mkdir()
    Path("old.json").write_text("{}")
    contents: list[bytes] = [b"{", b"[]", proofs[PRINTED][:3000], tampered(proofs[PRINTED], "format")]
    document = json.loads(proofs[PRINTED])
    contents += [
        json.dumps({**document, "claims": claims}).encode()
        for claims in (1, [1], [{"id": "x"}], [{"id": "x", "status": "fine"}])
    ]
    for content in contents:
        Path("base/a.cert.json").write_bytes(content)
        assert main(["gate", "--baseline", "base", "a.toml"]) == 2
        assert "error[U014]" in capsys.readouterr().err
    for source in (".", "old.json", "missing", "a.toml"):  # "." has the very certificate that is judged
        assert main(["gate", "--baseline", source, "a.toml"]) == 2
        assert "error[U014]" in capsys.readouterr().err
    Path("base/a.cert.json").write_bytes(tampered(proofs[PRINTED], "claim"))
    put(PRINTED, as_="base/a.toml")  # what it is about is there: then the kernel checks it
    assert main(["gate", "--baseline", "base", "a.toml"]) == 2
    assert "is rejected" in capsys.readouterr().err


# --- input and output -------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("here", "no_proving")
def test_outputs_are_checked_before_the_work(here: Path, proofs: dict[str, bytes], capsys: Capture) -> None:
    put(SINGLE, proofs[SINGLE])
    before = sorted(here.rglob("*"))
    cases = [
        (["--sarif", "nowhere/x.sarif"], "there is no folder nowhere"),
        (["--junit", "single-inverter.toml"], "it is a spec"),
        (["--junit", "./single-inverter.cert.json"], "the certificate of a spec is there"),
        (["--sarif", "."], "it is a folder"),
        (["--sarif", "x", "--junit", "./x"], "another output goes there"),
        (["--statement", "nowhere/x/"], "there is no folder nowhere"),
        (["--max-age", "soon"], "expected an age"),
        (["--jobs", "0"], "expected a number from 1"),
        (["--sarif-kinds", "fail,bad"], "expected some of"),
        (["--write", "--require-certificate"], "nothing is proved, so nothing is written"),
        (["--stamp"], "only kept with --write"),
    ]
    for arguments, message in cases:
        assert main(["gate", *arguments, SINGLE]) == 2
        assert message in capsys.readouterr().err
    assert main(["gate", "--sarif", "nowhere/x", "--junit", SINGLE, SINGLE]) == 2
    assert capsys.readouterr().err.count("error[U001]") == 2
    assert sorted(here.rglob("*")) == before


@pytest.mark.usefixtures("here")
def test_two_specs_of_one_certificate(capsys: Capture) -> None:
    put(SINGLE, as_="a.toml")
    put("custom-loop.json", as_="a.json")
    assert main(["gate", "--write", "a.toml", "a.json"]) == 2
    assert "share the certificate a.cert.json" in capsys.readouterr().err
    assert gate(capsys, "a.toml", "a.json")[0] == 0


@pytest.mark.usefixtures("here")
def test_what_is_given(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(SINGLE, proofs[SINGLE])
    Path("sub").mkdir()
    Path("bad.toml").write_bytes(b'a = 1\nx = "\xff"')
    Path("lone.cert.json").write_bytes(proofs[SINGLE])
    given = [SINGLE, f"./{SINGLE}", "single-inverter.cert.json", "sub", "bad.toml", "missing.toml", "lone.cert.json"]
    code, found = gate(capsys, *given)
    assert code == 2
    told = {entry["spec"]: [(p["code"], p.get("line")) for p in entry["problems"]] for entry in found["results"]}
    assert told == {
        "lone.cert.json": [("U015", None)],
        SINGLE: [],
        "sub": [("S000", None)],
        "bad.toml": [("S001", 2)],
        "missing.toml": [("S000", None)],
    }
    assert found["warnings"] == [f"./{SINGLE} is given twice, and judged once"]
    assert [entry["spec"] for entry in gate(capsys, "single-inverter.cert.json")[1]["results"]] == [SINGLE]


@pytest.mark.usefixtures("here")
def test_names_that_play_tricks(capsys: Capture) -> None:
    for name in ("\x1b[2Jx.toml", "a\nb.toml", "<&>.toml", "\udcff.toml", "", ".", "x" * 300):
        outputs = ["--junit", "j.xml", "--sarif", "s.sarif", "--statement", "t.json"]
        assert main(["gate", name, *outputs]) == 2
        output = capsys.readouterr()
        assert "\x1b" not in output.out
        assert "internal error" not in output.err


@pytest.mark.usefixtures("here")
def test_several_processes_say_the_same(proofs: dict[str, bytes], capsys: Capture) -> None:
    names = [f"{k}.toml" for k in range(6)]
    for k, name in enumerate(names):
        put(SINGLE, proofs[SINGLE] if k % 2 else None, as_=name)
    Path("5.toml").write_text("x = 1")
    alone, together = gate(capsys, "--jobs", "1", *names), gate(capsys, "--jobs", "2", *names)
    assert alone == together
    assert alone[0] == 2
    assert [entry["spec"] for entry in alone[1]["results"]] == names


@pytest.mark.usefixtures("here")
def test_the_same_again_byte_for_byte(proofs: dict[str, bytes], capsys: Capture) -> None:
    put(SINGLE, proofs[SINGLE])
    put(PRINTED)
    runs = []
    for turn in ("1", "2"):
        Path(turn).mkdir()
        outputs = ["--junit", f"{turn}/j.xml", "--sarif", f"{turn}/s.sarif", "--statement", f"{turn}/t/"]
        main(["gate", "--json", SINGLE, PRINTED, *outputs])
        files = sorted(path for path in Path(turn).rglob("*") if path.is_file())
        assert len(files) == 4
        runs.append([capsys.readouterr().out, *(path.read_bytes() for path in files)])
    assert runs[0] == runs[1]
    main(["gate", "--json", "--times", SINGLE])
    assert "milliseconds" in only(json.loads(capsys.readouterr().out))


@pytest.mark.usefixtures("here")
def test_a_disk_that_is_full_at_the_end(
    proofs: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    put(SINGLE, proofs[SINGLE])

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    assert main(["gate", SINGLE, "--junit", "j.xml"]) == 2
    assert "cannot write j.xml: No space left on device" in capsys.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == ["single-inverter.cert.json", SINGLE]
