"""A small sample of the random loops, the boundary of zero damping, the oracle's answers, and shortages of passivity."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from certify.kernel.linalg import identity, scale, to_matrix, transpose
from certify.kernel.model import LinearPort
from tests.campaign_loops import LMI, OURS, PEERS, RIGHT, WRONG, ask_all, compare, installed_peers, to_floats
from tests.designs import NOT_PASSIVE, PASSIVE, SEMIDEFINITE, Design, gains_of, two_axes
from tests.index_cases import (
    CIGRE,
    Filter,
    index_cases,
    shortage_bracket,
    true_shortage,
    twice_the_cross_term,
)
from tests.loops import damping_series, loops
from tests.oracle import decide
from tests.sweep import check

MOST_STATES = 6  # in the quick sample


def small_sample() -> list[Design]:
    """The first small loop of each kind, or none."""
    found: dict[str, Design] = {}
    for design in loops(400, seed=7):
        if len(design.port.F) <= MOST_STATES:
            found.setdefault(design.kind, design)
    return list(found.values())


def label(design: Design) -> str:
    return design.kind


@pytest.mark.parametrize("design", small_sample(), ids=label)
def test_never_wrong(design: Design) -> None:
    """What the kernel accepts is true; a loop with singular storage functions only is left open."""
    result = compare(0, design)
    assert result.mark(OURS) != WRONG, result
    assert not result.answers[OURS].failed, result


def test_damping_that_is_negative_by_a_hair() -> None:
    for k, port in damping_series():
        says = ask_all(port, ())[OURS].says
        truth = decide(port)
        assert truth.verdict == (NOT_PASSIVE if k else PASSIVE), k
        assert says == PASSIVE if k is None else says != PASSIVE, k


# --- the oracle -----------------------------------------------------------------------------------------------


def test_oracle_agrees_with_the_constructions() -> None:
    for k, design in enumerate(loops(250, seed=11)):
        verdict = decide(design.port).verdict
        assert design.expected in (None, verdict), (k, design.kind, verdict)


def test_oracle_agrees_with_a_sweep() -> None:
    clear = 0
    for k, design in enumerate(loops(16, seed=13)):
        found, truth = check(design.port), decide(design.port)
        assert found in (None, PASSIVE if truth.passive else NOT_PASSIVE), (k, design.kind)
        clear += found is not None
    assert clear >= 8


def dual(port: LinearPort) -> LinearPort:
    return LinearPort(transpose(port.F), transpose(port.C), transpose(port.B))


def test_a_definite_storage_is_one_of_the_dual() -> None:
    """P > 0 belongs to a port iff P^-1 belongs to its dual."""
    for k, design in enumerate(loops(150, seed=17)):
        truth, other = decide(design.port), decide(dual(design.port))
        assert truth.definite == other.definite, (k, design.kind)
        if truth.passive and not truth.unobservable:
            assert truth.definite, (k, design.kind)


def linear(F: list[list[int]], B: list[list[int]], C: list[list[int]]) -> LinearPort:
    return LinearPort(to_matrix(F), to_matrix(B), to_matrix(C))


# Unobservable modes, and whether P > 0 exists.
UNSEEN = {
    "a decaying mode driven by a lossy channel": (linear([[-1, 0], [1, -2]], [[1], [0]], [[1, 0]]), PASSIVE),
    "a decaying mode driven by a lossless channel": (linear([[0, 0], [1, -2]], [[1], [0]], [[1, 0]]), SEMIDEFINITE),
    "a decaying mode apart": (linear([[0, 0], [0, -2]], [[1], [0]], [[1, 0]]), PASSIVE),
    "an oscillation apart": (linear([[-1, 0, 0], [0, 0, 1], [0, -2, 0]], [[1], [0], [0]], [[1, 0, 0]]), PASSIVE),
    "an oscillation that is driven": (
        linear([[-1, 0, 0], [1, 0, 1], [0, -2, 0]], [[1], [0], [0]], [[1, 0, 0]]),
        SEMIDEFINITE,
    ),
    "an oscillation driven by its own likeness out of reach": (
        linear([[-1, 0, 0], [0, 0, 1], [0, 0, 0]], [[1], [0], [0]], [[1, 0, 0]]),
        SEMIDEFINITE,
    ),
    "a growing mode apart": (linear([[-1, 0], [0, 1]], [[1], [0]], [[1, 0]]), SEMIDEFINITE),
}


@pytest.mark.parametrize("name", UNSEEN)
def test_oracle_on_unseen_modes(name: str) -> None:
    port, verdict = UNSEEN[name]
    assert decide(port).verdict == verdict


# --- floating-point tools -------------------------------------------------------------------------------------


@pytest.mark.skipif(installed_peers() != PEERS, reason="needs the optional dependencies `compare`")
def test_peers_answer() -> None:
    """A lossy capacitor: a storage exists, with an interior. The index of a strictly proper loop is 0 at best."""
    answers = ask_all(linear([[-1]], [[1]], [[1]]), PEERS)
    assert [answers[tool].says for tool in (OURS, "ispassive", LMI)] == [PASSIVE] * 3


def test_marks() -> None:
    design = Design("capacitor", linear([[-1]], [[1]], [[1]]))
    assert compare(0, design).mark(OURS) == RIGHT


# --- the shortage of passivity --------------------------------------------------------------------------------


def least_eigenvalue(port: LinearPort, w: float) -> float:
    """lambda_min of Z(jw) + Z(jw)*, in ohm."""
    F, B, C = to_floats(port)
    Z = C @ np.linalg.solve(1j * w * np.eye(len(F)) - F, B)
    return float(np.linalg.eigvalsh(Z + Z.conj().T)[0])


def ida_with_wrong_inductance(error: Fraction) -> Design:
    """nu = 1, alpha = -5, kI = 100, designed with (1 + error) L."""
    believed = Filter(CIGRE.R, CIGRE.L * (1 + error), CIGRE.C, CIGRE.w0)
    one = identity(2)
    return two_axes("wrong L", CIGRE, gains_of(believed, scale(100, one), one, scale(-5, one)))


@pytest.mark.parametrize(
    ("design", "ohm"),
    [
        (twice_the_cross_term(CIGRE, Fraction(1000), Fraction(1000)), 4.4e-5),
        (ida_with_wrong_inductance(Fraction(1, 10)), 1.6e-4),
    ],
    ids=["2 w0 L", "wrong L"],
)
def test_known_shortages(design: Design, ohm: float) -> None:
    low, high = shortage_bracket(design.port)
    assert low < high <= low * (1 + Fraction(1, 10**14))
    assert float(f"{float(high):.1e}") == ohm
    swept = -min(least_eigenvalue(design.port, w) for w in np.logspace(-4, 6, 4001)) / 2
    assert swept == pytest.approx(float(high), rel=1e-3)


def test_no_shortage_of_a_passive_loop() -> None:
    one = identity(2)
    design = two_axes("triple", CIGRE, gains_of(CIGRE, scale(100, one), one, scale(-5, one)))
    assert true_shortage(design.port) == 0


def test_index_cases_are_stable_and_short() -> None:
    for design in index_cases(12):
        F, _, _ = to_floats(design.port)
        assert len(F) in (4, 6, 8)
        assert max(np.linalg.eigvals(F).real) < 1e-6 * abs(np.linalg.eigvals(F)).max()
        low, high = shortage_bracket(design.port, 6)
        assert 0 < low < high
