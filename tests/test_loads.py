"""Loads: decisions against dense sampling, the two-voltage lemma against random voltages, published tables."""

from __future__ import annotations

import cmath
import math
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from certify.kernel.claims import Context
from certify.kernel.model import LoadLaw, PowerTerm, load_law
from certify.kernel.spec import ExpLoad, ZipLoad, decode
from certify.search.analysis import analyse
from certify.search.loads import propose_load
from certify.search.proposal import Proposal
from certify.search.roots import square_root
from tests.accept import accepts
from tests.conftest import ROOT

Pair = tuple[Fraction, Fraction]


def decide(law: LoadLaw, band: Pair, method: str | None = None) -> tuple[str, Proposal | None, bool]:
    """Status, accepted proposal, and whether the load is strictly monotone."""
    for proposal in propose_load(((band, law),), method=method):
        context = accepts((law, band), proposal)
        if context:
            return proposal.status, proposal, bool(context.strict_loads)
    return "unknown", None, False


def law_and_band(grid: Any, name: str) -> tuple[LoadLaw, Pair]:
    ((band, law),) = Context(grid).pieces(name)
    return law, band


def node(*loads: ZipLoad | ExpLoad) -> LoadLaw:
    return load_law(loads)


def current(law: LoadLaw, V: complex) -> complex:
    v = abs(V)
    P, Q = (
        math.fsum(float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) for t in part)
        for part in (law.active, law.reactive)
    )
    return complex(P, -Q) / v**2 * V


def least_determinant(law: LoadLaw, band: Pair) -> float:
    """The smallest of G and D over a fine grid, relative to their size; by formulas in floats."""
    worst = math.inf
    for k in range(2001):
        v = float(band[0]) + float(band[1] - band[0]) * k / 2000
        p = [float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) / v**2 for t in law.active]
        q = [float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) / v**2 for t in law.reactive]
        G = math.fsum(p)
        radial = math.fsum(x * (float(t.exponent) - 1) for x, t in zip(p, law.active, strict=True))
        cross = math.fsum(x * (float(t.exponent) - 2) for x, t in zip(q, law.reactive, strict=True))
        size = sum(map(abs, p)) + sum(map(abs, q)) + 1e-30
        worst = min(worst, G / size, (G * radial - cross**2 / 4) / size**2)
    return worst


coefficient = st.fractions(-2, 2, max_denominator=50)
pairs = st.tuples(coefficient, coefficient)
zips = st.builds(ZipLoad, pairs, pairs, pairs)
exps = st.builds(
    ExpLoad,
    coefficient,
    st.fractions(0, 3, max_denominator=20),
    coefficient,
    st.fractions(0, 5, max_denominator=20),
    st.just(Fraction(1)) | st.fractions(Fraction(1, 2), 2, max_denominator=5),
)
bands = st.tuples(
    st.fractions(Fraction(1, 3), Fraction(9, 10), max_denominator=20),
    st.fractions(Fraction(11, 10), 2, max_denominator=20),
)


@given(st.one_of(zips.map(node), exps.map(node), st.builds(node, zips, exps), st.builds(node, exps, exps)), bands)
@settings(max_examples=60, deadline=None)
def test_decided_as_dense_sampling_says(law: LoadLaw, band: Pair) -> None:
    status, proposal, strict = decide(law, band)
    least = least_determinant(law, band)
    if status == "proved":
        assert least > -1e-9
        assert not strict or least > -1e-12
    elif status == "refuted":
        assert least < 1e-6
    else:  # honest only near the edge, and never for ZIP loads
        assert abs(least) < 1e-3
        assert proposal is None
        assert any(t.exponent.denominator > 1 for t in (*law.active, *law.reactive))


little = st.tuples(*[st.fractions(Fraction(-2, 5), Fraction(2, 5), max_denominator=20)] * 2)
mostly_monotone = st.builds(
    ZipLoad, st.tuples(st.fractions(Fraction(1, 2), 2, max_denominator=20), coefficient), little, little
)


@given(
    mostly_monotone.map(node),
    bands,
    st.lists(st.tuples(st.floats(0, 1), st.floats(-math.pi, math.pi)), min_size=2, max_size=2),
)
@settings(max_examples=120, deadline=None)
def test_the_lemma_cannot_be_broken(law: LoadLaw, band: Pair, places: list[tuple[float, float]]) -> None:
    """An accepted load is monotone between any two voltages of the annulus, at any angle."""
    status, _, _ = decide(law, band)
    assume(status == "proved")
    U, V = (cmath.rect(float(band[0] + (band[1] - band[0]) * Fraction(x)), angle) for x, angle in places)
    product = ((V - U).conjugate() * (current(law, V) - current(law, U))).real
    assert product >= -1e-9 * abs(V - U) * (abs(current(law, V)) + abs(current(law, U)))


@given(zips.map(node), bands)
@settings(max_examples=80, deadline=None)
def test_a_refuting_pair_shows_in_floats_too(law: LoadLaw, band: Pair) -> None:
    status, proposal, _ = decide(law, band)
    assume(status == "refuted")
    assert proposal is not None
    a, b = (Fraction(x) for x in proposal.data["pair"].split())
    U, V = complex(float(a)), cmath.rect(float(b), 2 * math.atan(float(Fraction(proposal.data["t"]))))
    product = ((V - U).conjugate() * (current(law, V) - current(law, U))).real
    assert product < 1e-12


@pytest.mark.parametrize("error", ["1e-3", "1e-10", "1e-20", "1e-30"])
def test_zip_on_the_edge_is_decided(error: str) -> None:
    """D v^4 = (v^2)^2 - Pp^2 vanishes at v = 1/2 for Pp = 1/4."""
    band = (Fraction(1, 2), Fraction(1))
    zero = (Fraction(0), Fraction(0))
    for sign, expected in ((1, "refuted"), (-1, "proved")):
        power = Fraction(1, 4) + sign * Fraction(error)
        assert decide(node(ZipLoad((Fraction(1), Fraction(0)), zero, (power, Fraction(0)))), band)[0] == expected
    exact = decide(node(ZipLoad((Fraction(1), Fraction(0)), zero, (Fraction(1, 4), Fraction(0)))), band)
    assert (exact[0], exact[2]) == ("proved", False)


def test_exponential_on_the_edge_is_decided() -> None:
    """np = 1.5, nq = 0.5: the condition is v^2 >= 9/8 Q0^2/P0^2, exactly at the lower end."""
    load = ExpLoad(Fraction(1), Fraction(3, 2), Fraction(1), Fraction(1, 2), Fraction(1))
    law = node(load)
    root = square_root(Fraction(9, 8), 40)
    assert decide(law, (root + Fraction(1, 10**35), Fraction(2)))[0] == "proved"
    assert decide(law, (root - Fraction(1, 10**35), Fraction(2)))[0] == "refuted"


@pytest.mark.parametrize("name", ["1", "2", "4", "5", "7", "8"])
def test_cigre_zip_loads_from_55_percent_on(name: str) -> None:
    """Published figures: each ZIP row is monotone from 0.553 V0 on, and not below."""
    grid = decode((ROOT / "specs/cigre-mv.toml").read_bytes())
    law, _ = law_and_band(grid, name)
    high = Fraction(24000)
    assert decide(law, (Fraction("0.554") * 20000, high))[0] == "proved"
    assert decide(law, (Fraction("0.550") * 20000, high))[0] == "refuted"


@pytest.mark.parametrize("name", ["9", "10", "11"])
def test_cigre_exponential_loads_at_every_voltage(name: str) -> None:
    grid = decode((ROOT / "specs/cigre-mv.toml").read_bytes())
    law, _ = law_and_band(grid, name)
    assert decide(law, (Fraction(1, 10**6), Fraction(10**9)))[0] == "proved"


def test_one_load_makes_up_for_another() -> None:
    zero = (Fraction(0), Fraction(0))
    impedance = ZipLoad((Fraction(1), Fraction(0)), zero, zero)
    power = ZipLoad(zero, zero, (Fraction(1, 2), Fraction(0)))
    band = (Fraction(9, 10), Fraction(11, 10))
    assert decide(node(power), band)[0] == "refuted"
    assert decide(node(power, impedance), band)[0] == "proved"


def test_whole_exponents_join_the_polynomial() -> None:
    """An exponential load with np = 2 is a constant impedance, whatever its V0."""
    load = ExpLoad(Fraction(8), Fraction(2), Fraction(0), Fraction(0), Fraction(2))
    assert node(load).active == (PowerTerm(Fraction(2), Fraction(1), Fraction(2)),)


def test_critical_voltage_far_below_the_band() -> None:
    """np - nq = 1/50: 4 (np - 1) v^(2 np) = (nq - 2)^2 Q0^2 v^(2 nq) at v = c^25, 65 decades below V0."""
    load = ExpLoad(Fraction(1), Fraction("1.4"), Fraction("0.1"), Fraction("1.38"), Fraction(1))
    verdict = analyse((((Fraction("0.9"), Fraction("1.1")), node(load)),))
    exact = ((2 - load.nq) ** 2 * load.Q0_var**2 / (4 * (load.np - 1))) ** 25
    assert verdict.status == "proved"
    assert verdict.critical
    low, high = verdict.critical
    assert 0 < low <= exact <= high < Fraction(1, 10**60)
