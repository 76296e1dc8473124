"""The nearest passive gains: accepted by the kernel, written exactly, and near."""

from __future__ import annotations

import json
import random
from fractions import Fraction
from pathlib import Path

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import certify
from certify.cli import main
from certify.kernel.claims import Context
from certify.kernel.linalg import Matrix, add, identity, multiply, scale
from certify.kernel.model import J, dgu_port, node_capacitances
from certify.kernel.reader import read_document
from certify.kernel.rules import quadratic_storage
from certify.kernel.spec import Decoder, Dgu, Filter, IdaPbc, LinearLoop, StateFeedback, angular_frequency
from certify.search.nearest import Suggestion, nearest_gains
from certify.search.storage import find_state_feedback_storage, inverse_2x2

W0 = angular_frequency(Fraction(50))
FILTER = Filter(Fraction("0.1"), Fraction("0.0018"), Fraction("25e-6"))
REFERENCE = (Fraction(1), Fraction(0))
I2 = identity(2)


def suggestion_for(spec: str, node: str) -> Suggestion | None:
    context = Context(certify.load(f"specs/{spec}.toml"))
    dgu = context.nodes[node].dgu
    assert dgu is not None
    return nearest_gains(dgu, node_capacitances(context.grid)[node], context.grid.w0)


def decoded(fragment: str, filter_: Filter) -> IdaPbc | StateFeedback:
    """The law that the kernel reads from a fragment."""
    decoder = Decoder({})
    decoder.w0 = W0
    decoder.controllers = {"c": decoder.controller(read_document(fragment.encode()), "c")}
    assert not decoder.faults
    law = decoder.evaluate("c", filter_)
    assert isinstance(law, IdaPbc | StateFeedback)
    return law


def check(suggestion: Suggestion | None, filter_: Filter = FILTER) -> Suggestion:
    """Passive by the kernel's rule, and the fragment means the same port."""
    assert suggestion is not None
    c = filter_.capacitance_farad
    port = dgu_port(Dgu(filter_, suggestion.gains, REFERENCE, None), c, W0)
    assert dgu_port(Dgu(filter_, decoded(suggestion.fragment, filter_), REFERENCE, None), c, W0) == port
    part = find_state_feedback_storage(port)
    assert part is not None
    n = len(port.F)
    top = [(*(c * (i == j) for j in range(2)), *([Fraction(0)] * (n - 2))) for i in range(2)]
    quadratic_storage(port, (*top, *((Fraction(0), Fraction(0), *row) for row in part)))
    return suggestion


def test_the_doubled_decoupling_becomes_the_single_one() -> None:
    suggestion = check(suggestion_for("cigre-mv-cross-2w0", "1"))
    assert '"-w0*L"' in suggestion.fragment
    assert suggestion.gains.K12[1][0] == W0 * FILTER.inductance_henry
    k11, k12, k13 = suggestion.changes
    assert k12 > 10 * max(k11, k13)
    assert 0.05 < suggestion.largest_change_percent < 0.06  # w0 L against 1000.9 ohm


def test_the_printed_gains_get_another_voltage_gain() -> None:
    suggestion = check(suggestion_for("cigre-mv-as-printed", "1"))
    k11, k12, k13 = suggestion.changes
    assert k11 > 100 * max(k12, k13)  # 1 + kp*L = 2.8 has to fall below 1
    assert 0.9 < suggestion.gains.K11[0][0] < 1


@pytest.mark.parametrize(
    ("spec", "most"),
    [
        ("../wrong-inductance", 0.5),
        ("wrong-frequency", 300),
        ("../tiny-asymmetry", 0.001),
        ("integral-law-as-printed", 1),
        ("positive-damping-sign", 101),
    ],
)
def test_specs_with_one_error(spec: str, most: float) -> None:
    context = Context(certify.load(f"specs/negative/{spec}.toml"))
    node = next(name for name, node in context.nodes.items() if node.dgu)
    suggestion = suggestion_for(f"negative/{spec}", node)
    assert suggestion is not None
    assert suggestion.largest_change_percent < most
    assert len(suggestion.fragment) < 250


def test_an_ida_pbc_law_stays_one() -> None:
    wrong = Filter(Fraction("0.1"), Fraction("0.00181"), Fraction("25e-6"))
    law = IdaPbc((Fraction(-5), Fraction(-4)), (Fraction(1), Fraction(2)), (Fraction(700), Fraction(600)), wrong, W0)
    suggestion = check(nearest_gains(Dgu(FILTER, law, REFERENCE, None), FILTER.capacitance_farad, W0))
    assert suggestion.kind == "ida-pbc"
    assert suggestion.fragment.startswith('kind = "ida-pbc"')
    assert suggestion.largest_change_percent < 2


def random_passive(rng: random.Random) -> StateFeedback:
    """Coupled gains of a triple (X, Bm, H), none of it diagonal (THEORY 4)."""

    def definite(size: float) -> Matrix:
        a = tuple(tuple(Fraction(rng.randint(-9, 9), 7) for _ in range(2)) for _ in range(2))
        return scale(Fraction(size), add(multiply(a, ((a[0][0], a[1][0]), (a[0][1], a[1][1]))), I2))

    X, Bm = definite(50), definite(0.25)
    inverse = inverse_2x2(Bm)
    assert inverse
    H = multiply(add(scale(-1, definite(2)), scale(Fraction(rng.randint(-9, 9), 5), J)), inverse)
    L = FILTER.inductance_henry
    K12 = add(H, add(scale(FILTER.resistance_ohm, I2), scale(W0 * L, J)))
    K11 = add(I2, scale(-1, add(Bm, scale(L, X))))
    return StateFeedback(K11, K12, scale(-1, multiply(H, X)))


@given(st.integers(0, 10**6), st.sampled_from([1e-4, 1e-2, 0.1]))
@settings(max_examples=5, deadline=None)
def test_no_farther_than_the_passive_gains_that_were_spoiled(seed: int, error: float) -> None:
    rng = random.Random(seed)
    good = random_passive(rng)
    gains = []
    for K in (good.K11, good.K12, good.K13):
        assert K is not None
        size = sum(float(x) ** 2 for row in K for x in row) ** 0.5
        gains.append(tuple(tuple(x + Fraction(rng.gauss(0, error * size)) for x in row) for row in K))
    law = StateFeedback(*gains)
    suggestion = check(nearest_gains(Dgu(FILTER, law, REFERENCE, None), FILTER.capacitance_farad, W0))

    def distance(other: StateFeedback) -> float:
        parts = zip((law.K11, law.K12, law.K13), (other.K11, other.K12, other.K13), strict=True)
        pairs = [(numpy.array(a, float), numpy.array(b, float)) for a, b in parts]
        return sum(float(numpy.linalg.norm(a - b) / numpy.linalg.norm(a)) ** 2 for a, b in pairs) ** 0.5

    assert distance(suggestion.gains) == pytest.approx(sum(c**2 for c in suggestion.changes) ** 0.5, rel=1e-6)
    assert distance(suggestion.gains) <= 2.2 * distance(good) + 2e-6  # twice for a simpler family, and rounding


@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12), st.booleans())
@settings(max_examples=3, deadline=None)
def test_any_gains_have_passive_ones_near(entries: list[float], integrator: bool) -> None:
    scales = [2.0] * 4 + [30.0] * 4 + [3000.0] * 4
    values = [Fraction(f"{x * s:.4g}") for x, s in zip(entries, scales, strict=True)]
    K11, K12, K13 = (((k[0], k[1]), (k[2], k[3])) for k in (values[:4], values[4:8], values[8:]))
    law = StateFeedback(K11, K12, K13 if integrator else None)
    suggestion = check(nearest_gains(Dgu(FILTER, law, REFERENCE, None), FILTER.capacitance_farad, W0))
    assert (suggestion.X is not None) == integrator


def test_a_loop_of_matrices_has_no_gains() -> None:
    empty: Matrix = ((Fraction(0),),)
    assert nearest_gains(Dgu(FILTER, LinearLoop(empty, empty, empty), REFERENCE, None), Fraction(1), W0) is None


def test_numbers_beyond_floats_are_no_error() -> None:
    law = StateFeedback(scale(Fraction(10) ** 400, I2), I2, I2)
    assert nearest_gains(Dgu(FILTER, law, REFERENCE, None), FILTER.capacitance_farad, W0) is None


def test_explain_shows_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, file = "specs/cigre-mv-cross-2w0.toml", tmp_path / "c.json"
    main(["prove", spec, "-o", str(file)])
    capsys.readouterr()
    assert main(["explain", str(file), spec]) == 0
    story = capsys.readouterr().out
    after = story[story.index("dgu/1: proved, by rule index-storage") : story.index("load/1")]
    assert "nearest passive gains (largest relative change 0.0565 %, in K12):" in after
    assert '"-w0*L"' in after
    assert main(["explain", str(file), spec, "--json"]) == 0
    suggestion = json.loads(capsys.readouterr().out)["nearest_gains"]["dgu/1"]
    assert set(suggestion["change_percent"]) == {"K11", "K12", "K13"}


def test_the_suggestion_certifies_the_network() -> None:
    """What is suggested for the printed gains, put into the spec."""
    from certify.synthesis import Edit, edited

    suggestion = suggestion_for("cigre-mv-as-printed", "1")
    assert suggestion is not None
    data = Path("specs/cigre-mv-as-printed.toml").read_bytes()
    spec = edited(data, Edit("1", "new", f"[controller.new]\n{suggestion.fragment}", "lc"))
    assert certify.prove(spec).verdict.outcome == "certified"
