"""The pytest plugin, as its users see it: items, fixtures, the report, what a planted error prints, and what it costs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import flint  # noqa: F401
import numpy  # noqa: F401
import pytest
import scipy.optimize  # noqa: F401  # pytest inside of pytest forgets what it has imported; these cannot be loaded twice

import certify.testing.items
import certify.testing.strategies  # noqa: F401
from certify.certificate import prove, write_certificate
from certify.kernel.spec import decode
from certify.search.prove import find_claims
from tests.conftest import ROOT

pytest_plugins = ["pytester"]

EXAMPLE = ROOT / "tests" / "example_suite"
FEEDER = (EXAMPLE / "feeder.microgrid.toml").read_text()
REFUTED = (EXAMPLE / "constant-power.refuted.microgrid.toml").read_text()
SUITE = (EXAMPLE / "test_my_controller.py").read_text()
# Where the package is installed pytest finds the plugin by itself.
PLUGIN = [] if list(entry_points(group="pytest11", name="certify")) else ["-p", "certify.testing.plugin"]
QUICK = """
from hypothesis import Phase, settings
settings.register_profile("quick", derandomize=True, max_examples=15, phases=[Phase.generate, Phase.shrink])
settings.load_profile("quick")
"""


@pytest.fixture
def run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> object:
    """Run pytest in the folder of the test, warnings as errors."""
    monkeypatch.delenv("CI", raising=False)

    def go(*arguments: str, apart: bool = False) -> pytest.RunResult:
        start = [*PLUGIN, "-p", "no:cacheprovider", "-W", "error", "--strict-markers"]
        if not apart:
            return pytester.runpytest_inprocess(*start, "-p", "no:xdist", *arguments)
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
        return pytester.runpytest_subprocess(*start, *arguments)

    return go


def text_of(result: pytest.RunResult) -> str:
    return "\n".join(result.outlines + result.errlines)


# --- a design with a planted error --------------------------------------------------------------------------------

PLANTED = {
    "decoupling": ("[[R - h, -w0() * L], [w0() * L, R - h]]", "[[R - h, w0() * L], [-w0() * L, R - h]]"),
    "published": ('"K11": 1 - b - L * x', '"K11": 1 + L * x'),
    "damping": ("[[R - h, -w0() * L], [w0() * L, R - h]]", "[[R + h, -w0() * L], [w0() * L, R + h]]"),
}


def test_a_correct_design_is_green(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.makeconftest(QUICK)
    pytester.makepyfile(test_my_controller=SUITE)
    for name in ("feeder", "constant-power.refuted"):
        pytester.path.joinpath(f"{name}.microgrid.toml").write_bytes((EXAMPLE / f"{name}.microgrid.toml").read_bytes())
    run().assert_outcomes(passed=5)


@pytest.mark.parametrize("error", PLANTED)
def test_a_planted_sign_error_is_found_shrunk_and_printed(error: str, pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    assert PLANTED[error][0] in SUITE
    pytester.makeconftest(QUICK)
    pytester.makepyfile(test_my_controller=SUITE.replace(*PLANTED[error]))
    result = run("-k", "passive_with_every_filter")
    result.assert_outcomes(failed=1, deselected=2)
    lines = [line.removeprefix("E").strip() for line in result.outlines]
    for words in (
        "AssertionError: not passive",
        "filter=Filter(R='0.1 ohm', L='1 mH', C='10 uF'),",
        'L = "1 mH"',
        "[controller.law]",
        "K13 = 5000",
    ):
        assert words in lines
    printed = "\n".join(lines)
    assert "refuted[frequency-witness] dgu/a" in printed
    assert re.search(r"Re s0: [\d.e+-]+ 1/s\n", printed)
    assert re.search(r"Re\(u\* Z\(s0\) u\): -[\d.e+-]+ ohm", printed)
    assert len(lines) < 75
    assert "certify/testing" not in printed, "no frames of this package"
    gains = {"decoupling": "[-4.9, 0.3141592653", "published": "K11 = 2\n", "damping": "[5.1, -0.31415926535"}
    assert gains[error] in printed


# --- specs as items -----------------------------------------------------------------------------------------------


@pytest.fixture
def grids(pytester: pytest.Pytester) -> Path:
    """A folder with specs of every kind."""
    folder = pytester.path / "grids"
    folder.mkdir()
    files = {
        "good.microgrid.toml": FEEDER,
        "bad.microgrid.toml": REFUTED,
        "known.refuted.microgrid.toml": REFUTED,
        "wrongly.refuted.microgrid.toml": FEEDER,
        "faulty.microgrid.toml": FEEDER.replace('"1.8 mH"', '"-1.8 mH"').replace("nu = 1", "nv = 1"),
        "notes.toml": "no spec",
    }
    for name, text in files.items():
        folder.joinpath(name).write_text(text)
    return folder


@pytest.mark.usefixtures("grids")
def test_items_have_stable_ids_and_are_selected_by_them(run) -> None:  # type: ignore[no-untyped-def]
    result = run("--collect-only", "-q")
    assert result.outlines[:5] == [
        "grids/bad.microgrid.toml::certified",
        "grids/faulty.microgrid.toml::certified",
        "grids/good.microgrid.toml::certified",
        "grids/known.refuted.microgrid.toml::refuted",
        "grids/wrongly.refuted.microgrid.toml::refuted",
    ]
    run("-k", "good or known").assert_outcomes(passed=2, deselected=3)
    run("-m", "certify", "grids/good.microgrid.toml::certified").assert_outcomes(passed=1)


@pytest.mark.usefixtures("grids")
def test_failures_say_which_claim_and_why_without_a_traceback(run) -> None:  # type: ignore[no-untyped-def]
    result = run()
    result.assert_outcomes(passed=2, failed=3)
    text = text_of(result)
    for words in (
        "grids/bad.microgrid.toml is certified",
        "refuted, and not certified: grids/bad.microgrid.toml",
        "refuted[voltage-pair] load/street: the load current at node street is monotone",
        "certified, and not refuted: grids/wrongly.refuted.microgrid.toml",
        "error[S208]: must be positive, got '-1.8 mH'",
        " --> grids/faulty.microgrid.toml: filter.lc.L",
        " --> grids/faulty.microgrid.toml: controller.phs.nv",
        "FAILED grids/bad.microgrid.toml::certified",
    ):
        assert words in text
    assert "Traceback" not in text
    assert ".py" not in text.split("FAILURES")[1]


def test_last_failed(grids: Path, pytester: pytest.Pytester) -> None:
    again = [*PLUGIN, "-p", "no:xdist", "--lf", "--ff"]
    pytester.runpytest_inprocess(*again[:-2]).assert_outcomes(passed=2, failed=3)
    grids.joinpath("bad.microgrid.toml").write_text(FEEDER)
    pytester.runpytest_inprocess(*again[:-1]).assert_outcomes(passed=1, failed=2)


CONDITIONAL = (
    FEEDER.split("[line_type")[0]
    + """[controller.held]
kind = "constant"
[node.a]
dgu = { filter = "lc", controller = "held", reference = ["1 pu", "0 pu"] }
load = [{ kind = "zip", Y = ["1 S", "0 S"], band = ["0.99 pu", "1.01 pu"] }]
"""
)


def test_conditional_verdicts_pass_by_name_only(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.path.joinpath("held.microgrid.toml").write_text(CONDITIONAL)
    result = run()
    result.assert_outcomes(failed=1)
    assert "it needs --certify-allow equilibrium/a:" in text_of(result)
    run("--certify-allow", "equilibrium/b").assert_outcomes(failed=1)
    run("--certify-allow", "equilibrium/b", "--certify-allow", "equilibrium/a").assert_outcomes(passed=1)
    pytester.makeini("[pytest]\ncertify_allow =\n    equilibrium/a\n")
    run().assert_outcomes(passed=1)


# --- certificates beside specs ------------------------------------------------------------------------------------


def test_a_certificate_beside_a_spec_is_checked_if_it_is_about_it(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    spec, certificate = (pytester.path / f"good.microgrid{end}" for end in (".toml", ".cert.json"))
    spec.write_text(FEEDER)
    proof = prove(FEEDER.encode()).data

    def how() -> str:
        run("--certify-report", "r.json").assert_outcomes(passed=1)
        return str(json.loads(pytester.path.joinpath("r.json").read_text())["tests"][0]["verdicts"][0]["how"])

    assert how() == "proved"
    certificate.write_bytes(proof)
    assert how() == "checked: good.microgrid.cert.json"
    spec.write_text(FEEDER + "# changed\n")
    assert how() == "proved", "it is about what the spec was"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda text: text[: len(text) // 2], "K101"),
        (lambda text: text.replace("certify/certificate@1", "certify/certificate@9"), "K102"),
        (lambda text: text.replace('"verdict": "certified"', '"verdict": "refuted"'), "K111"),
    ],
)
def test_a_broken_certificate_fails_the_item_and_the_fixture(change, code: str, pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.path.joinpath("good.microgrid.toml").write_text(FEEDER)
    pytester.path.joinpath("good.microgrid.cert.json").write_text(change(prove(FEEDER.encode()).data.decode()))
    pytester.makepyfile(
        """
        import pytest
        @pytest.mark.certify_spec("good.microgrid.toml")
        def test_verdict(certify_verdict):
            pass
        """
    )
    result = run()
    result.assert_outcomes(failed=1, errors=1)
    assert text_of(result).count(f"rejected[{code}]: the certificate beside good.microgrid.toml does not prove") == 2
    assert "Traceback" not in text_of(result)


def test_a_certificate_beside_a_spec_excuses_no_scenario(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    """The kernel does not read scenarios; a spec that `prove` refuses does not pass by a certificate."""
    spec = f'{FEEDER}\n[scenario.x]\nend = "-3 s"\n'.encode()
    found = find_claims(decode(spec))
    notes = found.pop("notes")
    pytester.path.joinpath("good.microgrid.toml").write_bytes(spec)
    pytester.path.joinpath("good.microgrid.cert.json").write_bytes(write_certificate(spec, found, notes))
    pytester.makepyfile(
        """
        import pytest
        from certify.testing import assert_certified

        @pytest.mark.certify_spec("good.microgrid.toml")
        def test_fixture(certify_verdict):
            assert certify_verdict.outcome == "certified"

        def test_assertion():
            assert_certified("good.microgrid.toml", certificate="good.microgrid.cert.json")
        """
    )
    result = run()
    result.assert_outcomes(failed=2, errors=1)
    assert text_of(result).count("S208") >= 3


def test_a_spec_in_capitals_is_not_passed_over(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    for name, text in (("A.MICROGRID.TOML", FEEDER), ("B.Refuted.Microgrid.toml", REFUTED)):
        pytester.path.joinpath(name).write_text(text)
    assert run("--collect-only", "-q").outlines[:2] == [
        "A.MICROGRID.TOML::certified",
        "B.Refuted.Microgrid.toml::refuted",
    ]
    run().assert_outcomes(passed=2)


def test_a_verdict_is_not_true(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    """`assert certify_verdict` has passed for a refuted spec."""
    pytester.path.joinpath("bad.toml").write_text(REFUTED)
    pytester.makepyfile(
        """
        import pytest

        @pytest.mark.certify_spec("bad.toml")
        def test(certify_verdict):
            assert certify_verdict
        """
    )
    result = run()
    result.assert_outcomes(failed=1)
    assert 'write assert certify_verdict.outcome == "certified"' in text_of(result)


# --- the marker and its fixtures ----------------------------------------------------------------------------------

MARKED = """
import pytest
from hypothesis import given, settings, strategies as st
from certify.testing import assert_certified, assert_refuted, dgu_spec

@pytest.mark.certify_spec("{root}/specs/two-inverters.toml", "here.toml", "at_root.toml")
def test_several(certify_spec, certify_verdict):
    assert certify_verdict.outcome == "certified"
    assert_certified(certify_spec)
    assert certify_spec.path.read_bytes() == certify_spec.data
    assert certify_spec.document["format"] == "certify/microgrid@1"

@pytest.mark.certify_spec("*.toml")
def test_pattern(certify_spec, certify_certificate):
    assert certify_spec.microgrid.nodes
    assert certify_certificate.verdict.outcome == "certified"

PHS = dict(kind="ida-pbc", alpha=-5, nu=1, ki=100)

@pytest.mark.certify_spec(dgu_spec(dict(R=0.1, L=1e-3, C=1e-5), PHS), dgu_spec(dict(R=0, L=1, C=1), PHS, name="lossless filter"))
def test_made(certify_verdict):
    assert certify_verdict.outcome == "certified"

@pytest.mark.certify_spec("here.toml")
class TestClass:
    @settings(max_examples=3, deadline=None)
    @given(st.sampled_from(["2 kW", "3 kW"]))
    def test_with_hypothesis(self, certify_spec, power):
        document = certify_spec.document
        document["node"]["street"]["load"] = [dict(kind="zip", P=[power, "0 var"])]
        assert_refuted(document, "load/street")

    @pytest.mark.certify_spec("at_root.toml")
    def test_the_nearest_mark_counts(self, certify_spec):
        assert certify_spec.name == "at_root.toml"

    def test_needs_none(self):
        pass
"""


def test_marked_specs(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    folder = pytester.mkdir("deep")
    folder.joinpath("test_marked.py").write_text(MARKED.replace("{root}", str(ROOT)))
    folder.joinpath("here.toml").write_text(FEEDER)
    folder.joinpath("also.toml").write_text(FEEDER)
    pytester.path.joinpath("at_root.toml").write_text(FEEDER)
    result = run("-v")
    result.assert_outcomes(passed=10)
    ids = re.findall(r"::(\S+\[.*\]) PASSED", text_of(result))
    for name in ("test_several[here.toml]", "test_pattern[also.toml]", "test_pattern[here.toml]"):
        assert name in ids
    assert {"test_made[spec0]", "test_made[lossless filter]"} <= set(ids)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("def test(certify_spec): pass", "mark the test with @pytest.mark.certify_spec(PATH, ...)"),
        (
            "@pytest.mark.certify_spec('no.toml')\ndef test(certify_verdict): pass",
            "no spec 'no.toml': there is no file",
        ),
        ("@pytest.mark.certify_spec('*.nothing')\ndef test(certify_verdict): pass", "no spec '*.nothing'"),
        ("@pytest.mark.certify_spec('no.toml')\ndef test(): pass", "takes none of certify_certificate, certify_spec"),
        ("@pytest.mark.certify_spec\ndef test(certify_spec): pass", "takes one or more specs"),
        ("@pytest.mark.certify_spec(path='x')\ndef test(certify_spec): pass", "takes one or more specs"),
        ("@pytest.mark.certify_spec(b'nonsense')\ndef test(certify_verdict): pass", "error[S002]: not valid TOML"),
        ("@pytest.mark.certify_spec(3)\ndef test(certify_verdict): pass", "a spec is "),
    ],
)
def test_a_mark_that_cannot_be_meant(body: str, words: str, pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.makepyfile(f"import pytest\n{body}\n")
    result = run()
    outcomes = result.parseoutcomes()
    assert "passed" not in outcomes
    assert words in text_of(result)
    assert "During handling" not in text_of(result)
    assert "Traceback" not in text_of(result)
    assert "INTERNAL" not in text_of(result)


# --- the report ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("grids")
def test_the_report_of_a_run_on_two_workers(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.makepyfile(
        test_many="""
        import pytest
        from certify.testing import assert_passive
        def test_many_laws():
            for ki in [*range(1, 26), 1]:
                assert_passive(dict(R=0.1, L=1e-3, C=1e-5), dict(kind="ida-pbc", alpha=-5, nu=1, ki=ki))
        @pytest.mark.certify_spec("grids/good.microgrid.toml")
        @pytest.mark.parametrize("k", [1, 2])
        def test_marked(certify_verdict, k):
            assert k == 1
        """
    )
    result = run("--certify-report", "out", "-n2", "-p", "no:hypothesispytest", apart=True)
    result.assert_outcomes(passed=4, failed=4)
    assert "certify: 31 verdicts of 7 tests in out" in text_of(result)
    report = json.loads(pytester.path.joinpath("out", "certify.json").read_text())
    tests = {test["test"]: test for test in report["tests"]}
    assert list(tests) == sorted(tests)
    assert tests["test_many.py::test_many_laws"]["outcomes"] == {"certified": 25}
    marked = [tests[f"test_many.py::test_marked[grids/good.microgrid.toml-{k}]"] for k in (1, 2)]
    assert [(test["result"], test["outcomes"]) for test in marked] == [
        (r, {"certified": 1}) for r in ("passed", "failed")
    ]
    bad = tests["grids/bad.microgrid.toml::certified"]
    assert (bad["result"], bad["outcomes"]) == ("failed", {"refuted": 1})
    assert bad["verdicts"][0]["open"][0] == {"id": "load/street", "status": "refuted", "rule": "voltage-pair"}
    assert "grids/faulty.microgrid.toml::certified" not in tests, "nothing was proved of it"
    summary = pytester.path.joinpath("out", "certify.md").read_text()
    assert "| `grids/bad.microgrid.toml::certified` | failed | `grids/bad.microgrid.toml` | refuted |" in summary
    assert "| 25 made by the test | 25 certified |" in summary
    assert "load/street refuted (voltage-pair)" in summary


@pytest.mark.usefixtures("grids")
@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("none/out", "there is no folder to make it in"),
        ("a_file", "it is there, and no folder"),
        ("none/out.md", "there is no such folder"),
        ("folder.json", "it is a folder"),
        ("a_file/out.md", "there is no such folder"),
        ("grids/good.microgrid.json", "what is there is no such report"),
        ("notes.md", "what is there is no such report"),
        ("kept", "certify.md there is no such report"),
    ],
)
def test_a_report_that_cannot_be_written_stops_before_the_run(
    target: str, reason: str, pytester: pytest.Pytester, run
) -> None:  # type: ignore[no-untyped-def]
    pytester.path.joinpath("a_file").write_text("kept")
    pytester.mkdir("folder.json")
    pytester.mkdir("kept").joinpath("certify.md").write_text("notes")
    pytester.path.joinpath("notes.md").write_text("notes")
    pytester.path.joinpath("grids", "good.microgrid.json").write_text("{}")
    result = run("--certify-report", target)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert f"--certify-report: cannot write {target}: {reason}" in text_of(result)
    assert "good.microgrid.toml" not in text_of(result)
    assert pytester.path.joinpath("a_file").read_text() == "kept"
    assert pytester.path.joinpath("kept", "certify.md").read_text() == "notes"


def test_a_report_that_cannot_be_written_in_the_end_is_no_success(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.makepyfile("import os\ndef test(): os.mkdir('out.md')")
    result = run("--certify-report", "out.md")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert "--certify-report: cannot write out.md" in text_of(result)
    assert os.listdir(pytester.path / "out.md") == []
    assert not [name for name in os.listdir(pytester.path) if name.startswith(".out.md")]
    assert "INTERNAL" not in text_of(result)


def test_a_report_takes_the_place_of_an_older_one(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    pytester.path.joinpath("a.microgrid.toml").write_text(FEEDER)
    for target in ("out", "one.md", "one.json"):
        texts = []
        for _ in range(2):
            run("--certify-report", target).assert_outcomes(passed=1)
            folder = pytester.path / target
            texts.append([path.read_bytes() for path in (sorted(folder.iterdir()) if folder.is_dir() else [folder])])
        assert texts[0] == texts[1]


@pytest.mark.usefixtures("grids")
def test_collecting_writes_no_report(pytester: pytest.Pytester, run) -> None:  # type: ignore[no-untyped-def]
    run("--collect-only", "-q", "--certify-report", "out")
    assert not pytester.path.joinpath("out").exists()


# --- what it costs and says ---------------------------------------------------------------------------------------


def test_help_documents_options_and_files(run) -> None:  # type: ignore[no-untyped-def]
    text = " ".join(text_of(run("--help")).split())
    for words in (
        "--certify-report=DIR_or_FILE",
        "--certify-allow=NAME",
        "certify_allow (linelist)",
        "*.refuted.microgrid.toml",
    ):
        assert words in text
    assert "certify_spec(spec, ...)" in text_of(run("--markers"))


def test_the_start_of_pytest_costs_nothing() -> None:
    """Measured at 2 to 3 ms once it is compiled; the bound is wide because machines are busy."""
    code = """
import sys, time, pytest
before = time.process_time()
import certify.testing.plugin
print(time.process_time() - before)
print(*sorted(name for name in sys.modules if name.split(".")[0] in {"certify", "hypothesis", "numpy", "scipy", "rich"}))
"""
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout.split(
            "\n"
        )
        for _ in range(2)
    ]
    assert runs[0][1] == "certify certify.testing certify.testing.plugin"
    assert min(float(run[0]) for run in runs) < 0.02
