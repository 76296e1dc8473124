"""A small seeded sample of the random campaign, the oracle against known answers, and loops that are hard to decide."""

from __future__ import annotations

from fractions import Fraction

import pytest

from certify.kernel.linalg import Matrix, to_matrix
from certify.kernel.model import LinearPort
from tests.campaign_dgus import AGREE, compare
from tests.designs import (
    HARD_KINDS,
    NOT_PASSIVE,
    PASSIVE,
    SEMIDEFINITE,
    Design,
    Filter,
    dq_designs,
    single_axis,
    single_designs,
    two_axes,
)
from tests.oracle import decide

UNIT = Filter(Fraction(1), Fraction(1), Fraction(1))
TURNING = Filter(Fraction(1), Fraction(1), Fraction(1), Fraction(1))
ZERO = to_matrix([[0, 0], [0, 0]])
EPSILON = Fraction(1, 10**30)


def usual(designs: list[Design]) -> list[Design]:
    return [design for design in designs if design.kind not in HARD_KINDS]


def label(design: Design) -> str:
    return design.kind


@pytest.mark.parametrize("design", usual(list(single_designs(60, seed=7))), ids=label)
def test_single_axis(design: Design) -> None:
    result = compare(design)
    assert result.outcome == AGREE, result


@pytest.mark.parametrize("design", usual(list(dq_designs(24, seed=7))), ids=label)
def test_two_axes(design: Design) -> None:
    result = compare(design)
    assert result.outcome == AGREE, result


def linear(F: list[list[object]], B: list[list[object]], C: list[list[object]]) -> LinearPort:
    def exact(rows: list[list[object]]) -> Matrix:
        return to_matrix([[Fraction(x) for x in row] for row in rows])  # type: ignore[call-overload]

    return LinearPort(exact(F), exact(B), exact(C))


def touching(error: Fraction) -> LinearPort:
    """Z = (11 s^2 + 25 s + 32 - 8 error) / (8 (s + 1)^3): Re Z(jw) |..|^2 = (w^2 - 2)^2 - error (1 - 3 w^2)."""
    return linear(
        [[0, 1, 0], [0, 0, 1], [-1, -3, -3]],
        [[0], [0], [1]],
        [[4 - error, Fraction(25, 8), Fraction(11, 8)]],
    )


# What each loop is, and the oracle's answer.
KNOWN = {
    "capacitor": (linear([[0]], [[1]], [[1]]), PASSIVE),
    "negative capacitor: the residue is negative": (linear([[0]], [[1]], [[-1]]), NOT_PASSIVE),
    "double integrator": (linear([[0, 0], [1, 0]], [[1], [0]], [[0, 1]]), NOT_PASSIVE),
    "Re Z touches zero at w = sqrt 2": (touching(Fraction(0)), PASSIVE),
    "Re Z is negative near w = sqrt 2": (touching(-EPSILON), NOT_PASSIVE),
    "Re Z is positive near w = sqrt 2": (touching(EPSILON), PASSIVE),
    "Z = -10^-30 / (s + 1) out of two parts": (
        linear([[-1, 0], [0, -1]], [[1], [1]], [[1 - EPSILON, 0 - 1]]),
        NOT_PASSIVE,
    ),
    "a decaying mode out of reach beside a lossy channel": (
        linear([[-1, 1], [0, -2]], [[1], [0]], [[1, 0]]),
        PASSIVE,
    ),
    "a decaying mode out of reach beside a lossless channel": (
        linear([[0, 1], [0, -2]], [[1], [0]], [[1, 0]]),
        NOT_PASSIVE,
    ),
    "two channels, the mode feeds the lossy one": (
        linear([[-1, 0, 1], [0, 0, 0], [0, 0, -2]], [[1, 0], [0, 1], [0, 0]], [[1, 0, 0], [0, 1, 0]]),
        PASSIVE,
    ),
    "two channels, the mode feeds the lossless one": (
        linear([[-1, 0, 0], [0, 0, 1], [0, 0, -2]], [[1, 0], [0, 1], [0, 0]], [[1, 0, 0], [0, 1, 0]]),
        NOT_PASSIVE,
    ),
    "a constant mode that nobody sees, out of reach": (linear([[-1, 0], [0, 0]], [[1], [0]], [[1, 0]]), PASSIVE),
    "an integrator that nobody sees": (linear([[-1, 0], [1, 0]], [[1], [0]], [[1, 0]]), SEMIDEFINITE),
    "two channels, a residue that is not Hermitian": (
        linear([[0, 0], [0, 0]], [[1, 0], [0, 1]], [[1, 1], [-1, 1]]),
        NOT_PASSIVE,
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_oracle(name: str) -> None:
    port, expected = KNOWN[name]
    assert decide(port).verdict == expected


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("digits", [3, 10, 30, 300])
def test_oracle_decides_tiny_errors(sign: int, digits: int) -> None:
    """One axis at zero damping, h = error: passive below zero, not above; so with b at rho = L x."""
    e = Fraction(sign, 10**digits)
    wanted = PASSIVE if sign < 0 else NOT_PASSIVE
    assert decide(single_axis("h", UNIT, Fraction(-2), 1 + e, -e).port).verdict == wanted
    assert decide(single_axis("b", UNIT, Fraction(0) + e, Fraction(0), Fraction(1)).port).verdict == wanted


def ladder(damped: Fraction) -> LinearPort:
    """A capacitor with a parallel conductance at the port, then L and C without loss: P = 1."""
    return linear([[-damped, -1, 0], [1, 0, -1], [0, 1, 0]], [[1], [0], [0]], [[1, 0, 0]])


# Loops that were left open once: faces of P, steps along lossless directions, several bounds for the solver.
ONCE_OPEN = {
    "current source, one axis": (single_axis("", UNIT, Fraction(1), Fraction(1), Fraction(0)), "refuted"),
    "current source, two axes": (
        two_axes("", TURNING, (to_matrix([[1, 0], [0, 1]]), to_matrix([[1, -1], [1, 1]]), ZERO)),
        "refuted",
    ),
    "no damping, integrator unused": (
        two_axes("", UNIT, (to_matrix([[-1, 0], [0, -1]]), to_matrix([[1, 0], [0, 1]]), ZERO)),
        "proved",
    ),
    "damping of rank one": (
        two_axes(
            "",
            TURNING,
            (
                to_matrix([[-1000, 0], [0, -2000]]),
                to_matrix([[0, 0], [2, 0]]),
                to_matrix([[1000, -2000], [-1000, 2000]]),
            ),
        ),
        "proved",
    ),
}

# Loops whose proof needs faces of rank two or at irrational frequencies.
HIGHER_FACES = {
    "ladder": (Design("ladder", ladder(Fraction(1))), "proved"),
    "Re Z touches zero at an irrational frequency": (Design("loop", touching(Fraction(0))), "proved"),
    "a resonance beside a lossy part": (
        Design("loop", linear([[-1, 0, 0], [0, 0, -1], [0, 1, 0]], [[1], [1], [0]], [[1, 1, 0]])),
        "proved",
    ),
}


def expect(design: Design, status: str) -> None:
    result = compare(design)
    assert (result.status, result.outcome) == (status, AGREE), result


@pytest.mark.parametrize("name", ONCE_OPEN)
def test_once_open(name: str) -> None:
    expect(*ONCE_OPEN[name])


@pytest.mark.parametrize("name", HIGHER_FACES)
def test_higher_faces(name: str) -> None:
    expect(*HIGHER_FACES[name])
