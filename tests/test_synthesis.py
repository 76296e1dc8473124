"""Synthesis: every design is passive and as fast as it is said to be, and what cannot be is refused in words."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import certify
from certify.certificate import Certificate, prove
from certify.cli import main
from certify.inputs import decode_all, read
from certify.kernel.claims import Context
from certify.kernel.errors import SpecError
from certify.kernel.linalg import Matrix, add, block, identity, ldl_pivots, scale, solve, transpose, zeros
from certify.kernel.model import node_capacitances
from certify.kernel.reader import read_document
from certify.kernel.rules import quadratic_storage
from certify.search.storage import find_state_feedback_storage
from certify.search.synthesis import Design, Plant, decay_bracket, decays_at, find_design, is_hurwitz, to_decimal
from certify.synthesis import Edit, controller_fragment, edited, read_wish, with_tolerance

CIGRE = "specs/cigre-mv.toml"
W0 = Fraction("314.15926535897932384626433832795028841972")
PLANT = Plant(Fraction("0.1"), Fraction("0.0018"), Fraction("25.21238e-6"), W0)


# --- the exact proof of the rate ----------------------------------------------------------------------------------


def lyapunov_says_stable(F: Matrix) -> bool:
    """The oracle: F'P + PF = -I has exactly one solution, and it is positive definite. No polynomial is formed."""
    n, unit = len(F), identity(len(F))
    rows = block([[scale(F[k][i], unit) for k in range(n)] for i in range(n)])  # vec of F'P, P by rows
    other = block([[transpose(F) if i == j else zeros(n, n) for j in range(n)] for i in range(n)])
    right = tuple((Fraction(-1 if i == j else 0),) for i in range(n) for j in range(n))
    try:
        entries = [row[0] for row in solve(add(rows, other), right)]
    except ZeroDivisionError:  # two modes that add up to zero
        return False
    P = tuple(tuple(entries[n * i : n * i + n]) for i in range(n))
    pivots, semidefinite = ldl_pivots(scale(Fraction(1, 2), add(P, transpose(P))))
    return semidefinite and all(pivots)


small = st.integers(-6, 6).map(Fraction)


@st.composite
def matrices(draw: Any, most: int = 4) -> Matrix:
    n = draw(st.integers(1, most))
    return tuple(tuple(draw(small) for _ in range(n)) for _ in range(n))


@given(matrices(), st.integers(-20, 20))
@settings(max_examples=150, deadline=None)
def test_the_decay_proof_agrees_with_lyapunov(F: Matrix, rate: int) -> None:
    shifted = add(F, scale(Fraction(rate), identity(len(F))))
    assert decays_at(F, Fraction(rate)) == lyapunov_says_stable(shifted)


@given(matrices())
@settings(max_examples=100, deadline=None)
def test_the_bracket_agrees_with_eigenvalues(F: Matrix) -> None:
    low, high = decay_bracket(F)
    assert low < high
    assert decays_at(F, low)
    assert not decays_at(F, high)
    values = numpy.linalg.eigvals(numpy.array([[float(x) for x in row] for row in F]))
    rate = -float(values.real.max())
    room = 1e-2 * max(1.0, float(numpy.abs(values).max()))  # multiple eigenvalues move by the root of the rounding
    assert float(low) - room <= rate <= float(high) + room
    if abs(rate) > room:
        assert high - low <= abs(high) / 100


@pytest.mark.parametrize(
    ("p", "expected"),
    [
        ([1], True),
        ([1, 0], False),
        ([-2, -1], True),
        ([1, 1, 0], False),
        ([1, 0, 1], False),
        ([1, 1, 1, 1], False),  # (s + 1)(s^2 + 1)
        ([1, 2, 2, 1], True),
        ([1, 3, 3, 9], False),
        ([1, 3, 3, Fraction(9) - Fraction(1, 10**40)], True),
        ([1, 3, 3, Fraction(9) + Fraction(1, 10**40)], False),
        ([1, -1, 1], False),
        ([1, 0, 2, 0, 1], False),
    ],
)
def test_hurwitz(p: list[Any], expected: bool) -> None:
    assert is_hurwitz([Fraction(c) for c in p]) is expected


def test_an_undamped_mode_has_the_rate_zero() -> None:
    F = ((Fraction(0), Fraction(1)), (Fraction(-1), Fraction(0)))
    low, high = decay_bracket(F)
    assert -Fraction(1, 10**8) < low < high == 0


# --- designs ------------------------------------------------------------------------------------------------------


def storage_of(design: Design, plant: Plant) -> Matrix:
    """The closed-form storage matrix; `quadratic_storage` judges it."""
    part = find_state_feedback_storage(design.port(plant))
    assert part is not None
    beside = zeros(2, 4)
    return block([[scale(plant.capacitance_farad, identity(2)), beside], [transpose(beside), part]])


def check_design(design: Design, plant: Plant) -> None:
    quadratic_storage(design.port(plant), storage_of(design, plant))
    assert all(len(f"{float(x):.15g}".strip("-0.").replace(".", "").rstrip("0")) <= 14 for x in (design.x, design.b))


def decimals(low: float, high: float) -> Any:
    return st.floats(math.log10(low), math.log10(high)).map(lambda e: Fraction(f"{10**e:.2e}"))


plants = st.builds(Plant, decimals(1e-3, 1), decimals(1e-5, 1e-2), decimals(1e-6, 1e-3), st.just(W0))


@given(plants, decimals(0.1, 1e4), st.sampled_from(["pi", "ida-pbc"]))
@example(
    Plant(Fraction(1), Fraction(1, 10**4), Fraction(1, 10**3), W0), Fraction(1), "pi"
)  # began at the very edge of its box
@settings(max_examples=2, deadline=None)
def test_every_wish_for_a_rate_is_met_by_a_passive_design(plant: Plant, rate: Fraction, kind: str) -> None:
    found = find_design(plant, kind, rate, None)
    assert found.design is not None
    check_design(found.design, plant)
    assert decays_at(found.design.port(plant).F, rate)
    assert kind == "pi" or not found.design.g
    F = numpy.array([[float(x) for x in row] for row in found.design.port(plant).F])
    assert -numpy.linalg.eigvals(F).real.max() > float(rate) * (1 - 1e-5)


@given(plants, decimals(1, 1e4))
@settings(max_examples=2, deadline=None)
def test_every_bound_above_one_is_kept_by_a_passive_design(plant: Plant, bound: Fraction) -> None:
    found = find_design(plant, "pi", None, bound)
    assert found.design is not None
    check_design(found.design, plant)
    assert found.design.largest_gain(plant) <= bound
    assert decays_at(found.design.port(plant).F, Fraction(0))


def test_the_rotation_lowers_the_gains() -> None:
    found = find_design(PLANT, "pi", Fraction(200), None)
    assert found.design is not None
    assert found.plain is not None
    assert found.design.g
    assert not found.plain.g
    assert found.design.largest_gain(PLANT) * 2 < found.plain.largest_gain(PLANT)
    for design in (found.design, found.plain):
        check_design(design, PLANT)
        assert decays_at(design.port(PLANT).F, Fraction(200))


def test_a_wish_too_high_is_answered_with_the_best() -> None:
    found = find_design(PLANT, "pi", Fraction(400), Fraction(2))
    assert found.design is None
    assert found.fastest is not None
    assert found.smallest is not None
    assert found.fastest.largest_gain(PLANT) <= 2
    assert not decays_at(found.fastest.port(PLANT).F, Fraction(400))
    assert decays_at(found.smallest.port(PLANT).F, Fraction(400))
    # what it says is possible is possible
    least = found.smallest.largest_gain(PLANT)
    assert find_design(PLANT, "pi", Fraction(400), least).design is not None
    reached = decay_bracket(found.fastest.port(PLANT).F)[0]
    assert find_design(PLANT, "pi", reached, Fraction(2)).design is not None


def test_numbers_beyond_floats_find_nothing() -> None:
    absurd = Plant(Fraction(1), Fraction(1, 10**200), Fraction(1, 10**200), W0)
    assert find_design(absurd, "pi", Fraction(1), None).design is None


def test_the_convex_step_lowers_the_gain_and_keeps_the_rate() -> None:
    from certify.search.synthesis import _Search

    search = _Search(PLANT)
    q = numpy.array([5.0, 0.1, 20.0, 0.0])
    rate = 0.9 * float(search.rate(q))
    better = search._convex_step(q, rate, (1, 2))
    assert better[0] == q[0]
    assert float(search.gain(better)) < float(search.gain(q))
    assert float(search.rate(better)) >= rate * (1 - 1e-4)


# --- the spec as text ---------------------------------------------------------------------------------------------

FRAGMENT = controller_fragment("new", Design(Fraction(3), Fraction(1, 8), Fraction(2)), "pi")
LAYOUTS = {
    "tables": b'[filter.lc] # a comment\nR = 1.50\n[controller.pi]\nkind = "x"\n\n[node.1]\ndgu = { filter = "lc", controller = "pi" }\n',
    "nested": b'[filter]\nlc = { R = 1.50 }\n[controller]\npi = { kind = "x" }\n[node.1.dgu]\nfilter = "lc"\ncontroller = "pi"\n',
    "inline": b'filter = { lc = { R = 1.50 } }\ncontroller = { pi = { kind = "x" } }\nnode = { 1 = { dgu = { filter = "lc", controller = "pi" } } }\n',
    "scattered": b'[controller.pi]\nkind = "x"\n[[line]]\nname = "a"\n[node.1]\ndgu = { filter = "lc", controller = "pi" }\n[[line]]\nname = "b"\n[filter.lc]\nR = 1.50\n[controller.q]\nkind = "y"\n[node.2]\n',
    "windows": b'[filter.lc]\r\nR = 1.50\r\n[controller.pi]\r\nkind = "x"\r\n[node.1]\r\ndgu = { filter = "lc", controller = "pi" }\r\n',
    "json": b'{\n  "filter": {"lc": {"R": 1.50}},\n  "controller": {"pi": {"kind": "x"}},\n  "node": {"1": {"dgu": {"filter": "lc", "controller": "pi"}}}}\n',
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("copied", [None, "lc-1"])
def test_editing_changes_what_it_should_and_no_more(layout: str, copied: str | None) -> None:
    data = LAYOUTS[layout]
    document = read_document(edited(data, Edit("1", "new", FRAGMENT, "lc", copied, "5 %")))
    assert document["controller"]["new"]["let"] == {"x": 3, "b": "0.125", "h": 2} or layout == "json"
    assert document["controller"]["pi"] == {"kind": "x"}
    assert document["node"]["1"]["dgu"] == {"filter": copied or "lc", "controller": "new"}
    assert document["filter"][copied or "lc"] == {"R": "1.50", "tolerance": "5 %"}
    assert not copied or document["filter"]["lc"] == {"R": "1.50"}


def test_a_layout_that_cannot_be_edited_is_refused_in_words() -> None:
    data = b'filter.lc.R = 1.50\ncontroller.pi.kind = "x"\nnode.1.dgu.filter = "lc"\nnode.1.dgu.controller = "pi"\n'
    with pytest.raises(SpecError, match="cannot be edited"):
        edited(data, Edit("1", "new", FRAGMENT, "lc"))


def test_comments_and_order_of_a_spec_stay() -> None:
    old = Path(CIGRE).read_text().splitlines()
    new = edited(Path(CIGRE).read_bytes(), Edit("1", "new", FRAGMENT, "lc")).decode().splitlines()
    changed = [line for line in old if line not in new]
    assert len(changed) == 1
    assert '"pi"' in changed[0]
    kept = iter(new)
    assert all(line in kept for line in old if line not in changed)


def test_tolerance_goes_to_the_filter() -> None:
    assert with_tolerance({"filter": {"a": {}}}, "a", "5 %") == {"filter": {"a": {"tolerance": "5 %"}}}


@given(
    st.fractions(Fraction(-(10**6)), Fraction(10**6), max_denominator=10**4).map(
        lambda x: round(x * 1000) / Fraction(10**9)
    )
)
def test_decimals_are_exact(x: Fraction) -> None:
    assert Fraction(to_decimal(x)) == x


@pytest.mark.parametrize("kind", ["pi", "ida-pbc"])
@pytest.mark.parametrize("g", ["0", "-0.46"])
def test_the_fragment_means_the_design(kind: str, g: str) -> None:
    """What the kernel decodes from the fragment is exactly the port that was designed."""
    design = Design(Fraction("1.37"), Fraction("0.0141"), Fraction("1.23"), Fraction(g if kind == "pi" else 0))
    fragment = controller_fragment("new", design, kind)
    context = Context(decode_all(edited(Path(CIGRE).read_bytes(), Edit("1", "new", fragment, "lc"))))
    plant = Plant(Fraction("0.1"), Fraction("0.0018"), node_capacitances(context.grid)["1"], context.grid.w0)
    assert context.port("1") == design.port(plant)


# --- the whole way ------------------------------------------------------------------------------------------------


def test_node_1_of_cigre_becomes_three_times_faster(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, cert = tmp_path / "new.toml", tmp_path / "new.json"
    before = decay_bracket(Context(certify.load(CIGRE)).port("1").F)
    assert main(["synth", CIGRE, "--node", "1", "--settle", "50 ms", "-o", str(out), "--cert", str(cert)]) == 0
    text = capsys.readouterr().out
    assert "CERTIFIED" in text
    assert "rotation" in text
    after = decay_bracket(Context(certify.load(out)).port("1").F)
    assert after[0] > 3 * before[1]
    assert after[0] >= 80
    assert main(["check", str(out), str(cert)]) == 0
    read_document(text.encode())  # the whole output is TOML: a fragment and comments
    capsys.readouterr()


def test_json_and_the_other_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new.json"
    assert (
        main(
            [
                "synth",
                "specs/single-inverter.toml",
                "--node",
                "bus",
                "--decay",
                "90 1/s",
                "--kind",
                "ida-pbc",
                "-o",
                str(out),
                "--json",
            ]
        )
        == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert result["outcome"] == "certified"
    assert Fraction(result["rate"][0]) >= 90
    assert result["exit_code"] == 0
    assert prove(out.read_bytes()).verdict.outcome == "certified"


def test_a_json_spec_stays_json_and_exact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = tmp_path / "spec.json", tmp_path / "new.json"
    document = {
        "format": "certify/microgrid@1",
        "frequency": "50 Hz",
        "filter": {"lc": {"R": "NUMBER", "L": "1.8 mH", "C": "25 uF"}},
        "controller": {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}},
        "node": {
            "a b": {
                "dgu": {"filter": "lc", "controller": "phs", "reference": ["20 kV", "0 V"]},
                "load": [{"kind": "rl", "R": 50, "L": 0.1}],
            }
        },
    }
    number = "0.1000000000000000000000000000000001"
    spec.write_text(json.dumps(document, indent=2).replace('"NUMBER"', number))
    assert main(["synth", str(spec), "--node", "a b", "--max-gain", "1", "-o", str(out)]) == 0
    assert number in out.read_text()
    assert main(["prove", str(out)]) == 0
    capsys.readouterr()


def test_wishes_that_cannot_be_met(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new.toml"
    assert main(["synth", CIGRE, "--node", "1", "--decay", "400", "--max-gain", "2", "-o", str(out)]) == 3
    text = capsys.readouterr().out
    assert "the fastest design found decays at" in text
    assert "takes --max-gain" in text
    assert not out.exists()
    assert main(["synth", CIGRE, "--node", "1", "--max-gain", "0.1", "--kind", "ida-pbc"]) == 3
    assert "no passive and stable design" in capsys.readouterr().out


def test_a_network_that_fails_elsewhere_is_not_certified(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synth", "specs/negative/constant-power-load.toml", "--node", "a", "--decay", "50", "--json"]) == 3
    result = json.loads(capsys.readouterr().out)
    assert result["outcome"] == "not met"
    assert "load/" in result["limits"][0]


def fake_prove(most: Fraction) -> Any:
    """As `prove` once it knows tolerances: certified if the one in the spec is small enough."""

    def proved(data: bytes, progress: Any = None) -> Certificate:
        document = read_document(data)
        own = [f.pop("tolerance") for f in document["filter"].values() if "tolerance" in f]
        good = not own or Fraction(own[0].removesuffix(" %")) <= most
        spec = "specs/cigre-mv.toml" if good else "specs/cigre-mv-as-printed.toml"
        return prove(read(spec), progress)

    return proved


def test_the_largest_tolerance_is_found_by_bisection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("certify.synthesis.RAISES", ())
    monkeypatch.setattr("certify.synthesis.prove", fake_prove(Fraction(3)))
    wish: Any = {"decay": 50, "tolerance": "5 %", "kind": "ida-pbc"}
    result = certify.synthesize(read(CIGRE), "1", **wish)
    assert not result.met
    assert "3 % (in steps of 0.25 %)" in result.limits[1]
    monkeypatch.setattr("certify.synthesis.prove", fake_prove(Fraction(5)))
    result = certify.synthesize(read(CIGRE), "1", **wish)
    assert result.met
    assert result.spec is not None
    document = read_document(result.spec)
    assert document["filter"]["lc-1"]["tolerance"] == "5 %"
    assert document["node"]["1"]["dgu"]["filter"] == "lc-1"
    assert "tolerance" not in document["filter"]["lc"]
    assert document["node"]["2"]["dgu"]["filter"] == "lc"


def test_tolerance_of_node_1() -> None:
    assert certify.synthesize(read(CIGRE), "1", settle="50 ms", tolerance="5%").met


# --- bad input ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--node", "99", "--decay", "5"], "U001", "no node '99'"),
        (["--node", "7", "--decay", "5"], "U001", "no DGU at node 7"),
        (["--node", "1"], "U001", "nothing is wished for"),
        (["--node", "1", "--settle", "1", "--decay", "5"], "U001", "same thing"),
        (["--node", "1", "--settle", "-1"], "S208", "positive"),
        (["--node", "1", "--settle", "0 s"], "S208", "positive"),
        (["--node", "1", "--settle", "5 ohm"], "S203", "expected s"),
        (["--node", "1", "--settle", "soon"], "S201", "cannot read"),
        (["--node", "1", "--settle", "1e-30"], "S202", "absurd"),
        (["--node", "1", "--settle", "1e999"], "S202", "absurd"),
        (["--node", "1", "--decay", "1e20"], "S202", "absurd"),
        (["--node", "1", "--decay", "nan"], "S201", "cannot read"),
        (["--node", "1", "--decay", "5 s"], "S203", "does not fit"),
        (["--node", "1", "--max-gain", "0"], "S208", "positive"),
        (["--node", "1", "--max-gain", "3 ohm"], "S203", "plain number"),
        (["--node", "1", "--decay", "5", "--tolerance", "5"], "S202", "absurd"),
        (["--node", "1", "--decay", "5", "--tolerance=-5%"], "S208", "positive"),
        (["--node", "1", "--decay", "5", "--kind", "pid"], "U001", "none of"),
        (["--node", "1", "--decay", "5", "--cert", "x.json"], "U001", "needs -o"),
        (["--node", "1", "--decay", "5", "-o", "no/such/folder/x.toml"], "U001", "cannot write"),
        (["--node", "1", "--decay", "5", "-o", CIGRE], "U001", "the spec itself"),
        (["--node", "1", "--decay", "5", "-o", "x.toml", "--cert", "x.toml"], "U001", "goes there"),
    ],
)
def test_bad_wishes(arguments: list[str], code: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synth", CIGRE, *arguments]) == 2
    output = capsys.readouterr()
    assert f"error[{code}]" in output.err
    assert said in output.err
    assert not output.out


def test_bad_specs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synth", "missing.toml", "--node", "1", "--decay", "5"]) == 2
    assert main(["synth", "specs/negative/misspelt-key.toml", "--node", "a", "--decay", "5"]) == 2
    assert "S101" in capsys.readouterr().err


def test_a_dgu_without_filter(capsys: pytest.CaptureFixture[str]) -> None:
    name = next(name for name, node in Context(certify.load("specs/custom-loop.json")).nodes.items() if node.dgu)
    document = json.loads(Path("specs/custom-loop.json").read_text())
    has_filter = "filter" in document["node"][name]["dgu"]
    assert main(["synth", "specs/custom-loop.json", "--node", name, "--max-gain", "1"]) == (0 if has_filter else 2)
    capsys.readouterr()


def test_wishes_as_numbers() -> None:
    assert read_wish(settle=Fraction(1, 5)).rate == 20
    assert read_wish(decay="20/s").rate == 20
    assert read_wish(decay="20 1/s", tolerance="0.05").tolerance == "5 %"
