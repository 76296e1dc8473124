"""The library as its users meet it: what it takes, what it returns, what it refuses, and what its import costs."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import json
import subprocess
import sys
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy
import pytest

import certify
from certify.inputs import to_bytes
from certify.kernel.errors import RuleFailure
from tests import library_user
from tests.conftest import ROOT

TWO = "specs/two-inverters.toml"
PRINTED = "specs/cigre-mv-as-printed.toml"
# Of the kernel, whose words are its own, and shown by the examples of those who return or raise them.
KERNELS = {"CertifyError", "Claim", "Fault", "Rejected", "SpecError", "Verdict"}
RETURNED_BY = {
    "CrossCheck": "cross_check",
    "Difference": "diff",
    "LargestTolerance": "largest_tolerance",
    "NetworkModel": "network_model",
    "Synthesis": "synthesize",
}


@pytest.fixture(scope="module")
def two() -> certify.Certificate:
    return certify.prove(ROOT / TWO)


@pytest.fixture(scope="module")
def printed() -> certify.Certificate:
    return certify.prove(ROOT / PRINTED)


# --- what a spec may be -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "source",
    [
        TWO,
        Path(TWO),
        (ROOT / TWO).read_bytes(),
        bytearray((ROOT / TWO).read_bytes()),
        tomllib.loads((ROOT / TWO).read_text()),
        certify.Spec.read(ROOT / TWO),
    ],
    ids=lambda source: type(source).__name__,
)
def test_every_function_takes_every_kind_of_spec(source: Any) -> None:
    assert certify.load(source) == certify.load(TWO)
    certificate = certify.prove(source)
    assert certify.check(source, certificate).outcome == "certified"
    assert certificate.spec == to_bytes(source)
    assert certify.dgu_model(source, "a").exact == certify.dgu_model(TWO, "a").exact
    assert certify.line_model(source, "a-b").exact == certify.line_model(TWO, "a-b").exact
    assert len(certify.simulate(source, end=1e-3, samples=3).times) == 4
    assert certify.diff(source, source).after.outcome == "certified"


@pytest.mark.parametrize("source", [None, 5, 1.5, object(), [b"x"], dict, certify.load(ROOT / TWO)])
def test_what_is_no_spec_is_a_wrong_type(source: Any) -> None:
    calls: list[Callable[[], Any]] = [
        lambda: certify.load(source),
        lambda: certify.prove(source),
        lambda: certify.check(source, b""),
        lambda: certify.simulate(source),
        lambda: certify.dgu_model(source, "a"),
        lambda: certify.Spec.read(source),
    ]
    for call in calls:
        with pytest.raises(TypeError, match="spec"):
            call()


@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("none.toml", "S000"),
        (Path("specs"), "S000"),
        ("a\0b", "S000"),
        ("x = 1\n", "U031"),
        ("{}", "U031"),
        (b"", "S002"),
        (b"\xff", "S001"),
        ({"a": object()}, "U030"),
        ({"a": numpy.array([1.0, numpy.inf])}, "S201"),
        ({1: 2, "1": 3}, "U030"),
        ({}, "S102"),
        ({"node": None}, "S102"),
    ],
)
def test_bad_input_is_a_spec_error_with_a_code(source: Any, code: str) -> None:
    with pytest.raises(certify.SpecError) as refused:
        certify.prove(source)
    assert code in {fault.code for fault in refused.value.faults}


def test_a_document_that_holds_itself_is_refused() -> None:
    document: dict[str, Any] = {}
    document["node"] = document
    with pytest.raises(certify.SpecError, match="nested too deeply"):
        certify.prove(document)


def test_equal_mappings_are_proved_to_the_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    document = tomllib.loads((ROOT / TWO).read_text())
    assert certify.prove(document).data == certify.prove(json.loads(json.dumps(document))).data
    assert certify.prove(certify.Spec.read(TWO)).data == certify.prove(TWO).data


# --- certificates -------------------------------------------------------------------------------------------------


def test_a_certificate_answers_for_its_claims(two: certify.Certificate) -> None:
    assert list(two.claims) == [claim.id for claim in two.verdict.claims]
    assert [vars(two[c.id]) | {"note": ""} for c in two.verdict.claims] == [
        vars(c) | {"note": ""} for c in two.verdict.claims
    ]
    assert two["line/a-b"].values == {"dissipation per squared current": Fraction(1, 5)}
    assert two.assumptions == two.verdict.assumptions
    with pytest.raises(KeyError, match=r"dgu/a|dgu/b"):
        two["dgu/c"]
    assert two.to_dict()["claims"][0]["facts"][0]["value"] == "1/5"
    assert json.loads(json.dumps(two.to_dict())) == two.to_dict()


def test_margins_are_of_claims_that_hold(two: certify.Certificate, printed: certify.Certificate) -> None:
    assert two.margins["region/a"][0][0] == "level c of the storage"
    assert all(value > 0 for facts in two.margins.values() for _, value, _ in facts)
    assert "dgu/1" not in printed.margins
    assert printed["dgu/1"].status == "refuted"


def test_a_verdict_is_no_boolean(two: certify.Certificate) -> None:
    with pytest.raises(TypeError, match='outcome == "certified"'):
        bool(two)
    with pytest.raises(TypeError):
        assert not certify.check(TWO, two)


def test_results_are_frozen_and_short_to_look_at(two: certify.Certificate, printed: certify.Certificate) -> None:
    motion = certify.simulate(TWO, end=1e-3, samples=2)
    difference = certify.diff(TWO, TWO)
    for value in (two, printed, two["region/a"], motion, difference, certify.dgu_model(TWO, "a")):
        name = dataclasses.fields(value)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, name, None)
    for value in (two, printed, two.claims, two["equilibrium/a"], motion, difference):
        assert len(repr(value)) < 160
    assert len(printed._repr_markdown_()) < 500
    assert "- refuted `dgu/1` (frequency-witness)" in printed._repr_markdown_()
    assert len({two, two}) == 1


def test_open_claims_say_why(printed: certify.Certificate) -> None:
    assert printed["invariant-set/1"].note == "P203"
    assert repr(printed["invariant-set/1"]) == "<Claim invariant-set/1: unknown (P203)>"
    checked = certify.check(PRINTED, printed.data)
    assert checked.notes == {k: v for k, v in printed.notes.items() if " " not in k}
    document = json.loads(printed.data)
    document["provenance"]["notes"] = {"invariant-set/1": "all is well", "microgrid": 5}
    assert certify.check(PRINTED, json.dumps(document).encode()).notes == {}  # nobody vouches for provenance


def test_what_the_kernel_does_not_accept_is_no_certificate(two: certify.Certificate) -> None:
    document = json.loads(two.data)
    document["verdict"] = "conditional"
    for bad in (json.dumps(document).encode(), two.data[:-40], b"", certify.prove(PRINTED)):
        with pytest.raises(certify.Rejected):
            certify.check(TWO, bad)
    with pytest.raises(certify.SpecError, match="S000"):
        certify.check(TWO, "none.cert.json")
    with pytest.raises(certify.SpecError, match="U031"):
        certify.check(TWO, two.data.decode())
    with pytest.raises(TypeError, match="certificate"):
        certify.check(TWO, two.verdict)  # type: ignore[arg-type]


def test_saving_leaves_a_whole_file_or_none(two: certify.Certificate, tmp_path: Path) -> None:
    file = tmp_path / "c.json"
    two.save(file)
    assert certify.check(TWO, file) == certify.check(TWO, str(file)) == certify.check(TWO, two)
    for bad in (tmp_path, tmp_path / "no" / "c.json", f"{tmp_path}/a\0b"):
        with pytest.raises(certify.SpecError, match="U032"):
            two.save(bad)
    assert [path.name for path in tmp_path.iterdir()] == ["c.json"]


# --- simulations, comparisons, words ------------------------------------------------------------------------------


def test_a_simulation_gives_phasors_by_name() -> None:
    motion = certify.simulate(TWO, end="10 ms", samples=20)
    at = motion.columns.index("voltage at node b, d")
    assert numpy.array_equal(motion.voltages["b"].real, motion.states[:, at])
    assert numpy.array_equal(motion.voltages["b"].imag, motion.states[:, at + 1])
    assert set(motion.inverter_currents) == {"a", "b"}
    assert motion.line_currents["a-b"].shape == motion.times.shape == (21,)
    assert motion.times[-1] == 0.01
    assert numpy.array_equal(motion.states, certify.simulate(TWO, end=Fraction(1, 100), samples=20).states)


@pytest.mark.parametrize("end", ["10 V", "soon", float("nan"), -1, 0, object(), True])
def test_an_end_that_is_no_time(end: Any) -> None:
    with pytest.raises(certify.SpecError, match="U005"):
        certify.simulate(TWO, end=end)


def test_a_cross_check_has_the_storage_over_time(two: certify.Certificate) -> None:
    found = certify.cross_check(TWO, two, end="20 ms", attempts=0)
    assert found.contradictions == ()
    times, H = found.storage()
    assert times.shape == H["a"].shape
    assert (numpy.diff(H["a"]) <= 1e-6 * H["a"][0]).all()
    assert "no proof" in repr(found)
    with pytest.raises(certify.SpecError, match="U008"):
        certify.cross_check(TWO, [two, two], end="1 ms")
    with pytest.raises(certify.Rejected, match="K103"):
        certify.cross_check("specs/single-inverter.toml", two, end="1 ms")


def test_a_wrong_simulator_would_be_contradicted(monkeypatch: pytest.MonkeyPatch, two: certify.Certificate) -> None:
    from certify.simulator import plant

    monkeypatch.setattr(plant, "J", -plant.J)  # all frames turn backwards
    assert certify.cross_check(TWO, two, end="1 ms", attempts=0).contradictions


def test_a_difference_names_what_is_lost() -> None:
    found = certify.diff("specs/cigre-mv.toml", PRINTED)
    assert [change.id for change in found.lost][:1] == ["dgu/1"]
    assert (found.before.outcome, found.after.outcome) == ("certified", "refuted")
    assert repr(found).startswith("<Difference: certified -> refuted; claims: ")


def test_explanations(printed: certify.Certificate) -> None:
    text = certify.explain(printed)
    assert "dgu/1: refuted, by rule frequency-witness" in text
    assert "nearest passive gains" in text
    assert "What to try" in certify.explain("K103")
    with pytest.raises(certify.SpecError, match=r"U034.*did you mean S203"):
        certify.explain("s2o3")
    with pytest.raises(TypeError):
        certify.explain(5)  # type: ignore[arg-type]


def test_wishes_may_be_numbers() -> None:
    found = certify.synthesize("specs/single-inverter.toml", "bus", settle=0.02, kind="ida-pbc")
    assert found.met
    assert found.certificate is not None
    assert found.spec is not None
    assert certify.check(found.spec, found.certificate).outcome == "certified"
    assert len(repr(found)) < 4000
    for bad in (float("inf"), object(), "5 V"):
        with pytest.raises(certify.SpecError) as refused:
            certify.synthesize("specs/single-inverter.toml", "bus", settle=bad)
        assert refused.value.faults[0].path == "--settle"


def test_threads_do_not_disturb_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    names = [TWO, "specs/single-inverter.toml", "specs/custom-loop.json", PRINTED] * 2
    alone = {name: certify.prove(name).data for name in set(names)}
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(certify.prove, names))
    assert [certificate.data for certificate in found] == [alone[name] for name in names]


# --- what is public -------------------------------------------------------------------------------------------------


def test_the_lists_of_what_is_public_agree() -> None:
    tree = ast.parse((ROOT / "certify" / "__init__.py").read_text())
    block = next(x for x in tree.body if isinstance(x, ast.If))
    typed = {(x.module, a.name) for x in block.body if isinstance(x, ast.ImportFrom) for a in x.names}
    typed.remove(("typing", "Any"))
    assert typed == {(f"certify.{home}", name) for home, names in certify._HOMES.items() for name in names}
    assert sorted(certify.__all__) == sorted(name for _, name in typed)
    assert certify.__all__ == sorted(certify.__all__, key=lambda name: (name[0].islower(), name))
    assert list(certify._HOMES) == sorted(certify._HOMES)
    assert set(certify.__all__) <= set(dir(certify))
    with pytest.raises(AttributeError, match="nothing"):
        certify.nothing  # noqa: B018
    assert (ROOT / "certify" / "py.typed").exists()


@pytest.mark.parametrize("name", certify.__all__)
def test_every_public_name_is_documented_with_an_example(name: str) -> None:
    value = getattr(certify, name)
    assert value.__doc__
    assert not value.__doc__.startswith(f"{name}(")  # what dataclass writes for want of a better one
    if name in KERNELS:
        assert value.__module__.startswith("certify.kernel")
        return
    if name in RETURNED_BY:
        assert f"`{RETURNED_BY[name]}`" in value.__doc__
        name = RETURNED_BY[name]
        value = getattr(certify, name)
    module = sys.modules[value.__module__]
    examples = [case for case in doctest.DocTestFinder().find(value, name, module) if case.examples]
    assert examples, f"no example in {name}"  # they run with all other doctests


def test_errors_of_the_library_have_one_base() -> None:
    for error in (certify.SpecError, certify.Rejected, certify.NotProved, RuleFailure):
        assert issubclass(error, certify.CertifyError)


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout.strip()


def test_import_is_quick_and_brings_nothing_heavy() -> None:
    code = "import time; t = time.process_time(); import certify; print(time.process_time() - t)"
    assert min(float(run(code)) for _ in range(3)) < 0.015
    loaded = run("import sys, certify; print(' '.join(sys.modules))").split()
    assert [name for name in loaded if name.startswith("certify")] == ["certify"]
    assert not {"numpy", "scipy", "tomllib", "json"} & set(loaded)
    heavy = run("import sys, certify; certify.prove('specs/cigre-mv.toml'); print(' '.join(sys.modules))").split()
    assert not {"numpy", "scipy", "tomlkit", "rich", "matplotlib"} & set(heavy)
    built = run("import sys, certify; certify.Spec(frequency=50.0).to_toml(); print(' '.join(sys.modules))").split()
    assert not {"numpy", "scipy", "tomlkit"} & set(built)


def test_star_import_brings_all_names() -> None:
    assert (
        run("from certify import *; print(prove.__name__, Spec.__name__, simulate.__name__)") == "prove Spec simulate"
    )


def test_the_program_of_a_user_runs() -> None:
    """Its types are checked with those of the package."""
    found = library_user.main()
    assert found["damping"] == 0.2
    assert found["least loss"] > -1e-9
    assert found["rejected"] == 1
    assert found["lost"] == 0
    assert found["slowest"] < 0
    assert "tests/library_user.py" in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["files"]


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"start": "here"}, "U006"),
        ({"start": [1.0, 2.0]}, "U006"),
        ({"samples": 0}, "U005"),
        ({"samples": 10**12}, "U007"),
        ({"tolerance": -1}, "U005"),
        ({"tolerance": float("nan")}, "U005"),
        ({"method": "euler"}, "U005"),
        ({"end": 1e300}, "U005"),
        ({"scenario": "none"}, "U002"),
    ],
)
def test_a_simulation_that_nobody_can_run(options: dict[str, Any], code: str) -> None:
    """Each was taken for something else once: an unknown start for a flat one, an unknown method for collocation."""
    for run_it in (certify.simulate, certify.cross_check):
        with pytest.raises(certify.SpecError) as refused:
            run_it(TWO, **options)
        assert refused.value.faults[0].code == code


def test_a_method_that_there_is_not() -> None:
    with pytest.raises(certify.SpecError, match=r"U001.*ends, bernstein"):
        certify.prove(TWO, method="magic")
