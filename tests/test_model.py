"""The kernel's matrices against Kirchhoff's laws written out again, in complex floats and from the paper's text."""

from __future__ import annotations

import cmath
import random
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.inputs import load
from certify.kernel.claims import Context, grid_assumptions
from certify.kernel.model import LoadLaw, dgu_port, load_law, node_capacitances
from certify.kernel.spec import (
    Dgu,
    ExpLoad,
    Filter,
    IdaPbc,
    LinearLoop,
    Node,
    StateFeedback,
    ZipLoad,
    angular_frequency,
    decode,
)

RNG = random.Random(7)
W0 = angular_frequency(Fraction(50))


def rational(low: float, high: float) -> Fraction:
    return Fraction(RNG.uniform(low, high)).limit_denominator(10**6)


def random_filter() -> Filter:
    return Filter(rational(0.01, 1), rational(1e-3, 5e-3), rational(1e-5, 5e-5))


def numeric_jacobian(rhs, x0: numpy.ndarray) -> numpy.ndarray:  # type: ignore[no-untyped-def]
    columns = []
    for k in range(len(x0)):
        step = numpy.zeros_like(x0)
        step[k] = 1.0
        columns.append((rhs(x0 + step) - rhs(x0 - step)) / 2)
    return numpy.array(columns).T


def right_hand_side(law, filter_: Filter, c: Fraction, d: complex, reference: complex):  # type: ignore[no-untyped-def]
    """V, I and the integrator of one DGU, from the circuit and the printed control laws (corrected)."""
    R, L, C, w = (float(v) for v in (filter_.resistance_ohm, filter_.inductance_henry, c, W0))

    def rhs(x: numpy.ndarray) -> numpy.ndarray:
        V, I, v = (complex(x[k], x[k + 1]) for k in (0, 2, 4))  # noqa: E741
        if isinstance(law, StateFeedback):
            parts = ((law.K11, V), (law.K12, I), (law.K13, v))
            u = sum(
                complex(*(float(m[r][0]) * z.real + float(m[r][1]) * z.imag for r in (0, 1))) for m, z in parts if m
            )
            v_dot = reference - V
        else:
            Rd, Ld, Cd, wd = (
                float(q)
                for q in (
                    law.design.resistance_ohm,
                    law.design.inductance_henry,
                    law.design.capacitance_farad,
                    law.design_w0,
                )
            )
            u_axes = []
            j_term = (I.real + wd * Cd * reference.imag, I.imag - wd * Cd * reference.real)
            cross = 1j * wd * Ld * I
            for axis, pick in ((0, lambda z: z.real), (1, lambda z: z.imag)):
                alpha, nu, ki = (float(pair[axis]) for pair in (law.alpha, law.nu, law.ki))
                xi = -pick(v)
                u_axes.append(
                    alpha / nu * j_term[axis]
                    - nu * (pick(V) - pick(reference))
                    + Rd * pick(I)
                    + pick(cross)
                    + pick(V)
                    + alpha / nu * ki * xi
                    - ki * Ld * (pick(V) - pick(reference))
                )
            u = complex(*u_axes)
            v_dot = reference - V
        I_dot = (-R * I - 1j * w * L * I - V + u) / L
        V_dot = (I - 1j * w * C * V + d) / C
        return numpy.array([V_dot.real, V_dot.imag, I_dot.real, I_dot.imag, v_dot.real, v_dot.imag])

    return rhs


@pytest.mark.parametrize("kind", ["state-feedback", "ida-pbc"])
@pytest.mark.parametrize("repeat", range(10))
def test_closed_loop_against_finite_differences(kind: str, repeat: int) -> None:  # noqa: ARG001
    filter_, c = random_filter(), rational(1e-5, 9e-5)
    law: StateFeedback | IdaPbc
    if kind == "state-feedback":
        gains = [tuple(tuple(rational(-5, 5) for _ in range(2)) for _ in range(2)) for _ in range(3)]
        law = StateFeedback(*gains)
    else:
        pairs = [tuple(rational(lo, hi) for _ in range(2)) for lo, hi in ((-9, -1), (0.5, 3), (10, 200))]
        law = IdaPbc(*pairs, random_filter(), W0 * Fraction(101, 100))  # type: ignore[arg-type]
    port = dgu_port(Dgu(filter_, law, (Fraction(1), Fraction(2)), None), c, W0)
    rhs = right_hand_side(law, filter_, c, 3 - 2j, 1 + 2j)
    expected = numeric_jacobian(rhs, numpy.array([RNG.uniform(-1, 1) for _ in range(6)]))
    actual = numpy.array([[float(x) for x in row] for row in port.F])
    numpy.testing.assert_allclose(actual, expected, rtol=1e-6, atol=1e-6 * abs(expected).max())
    B = numpy.zeros((6, 2))
    B[0, 0] = B[1, 1] = 1 / float(c)
    numpy.testing.assert_allclose([[float(x) for x in row] for row in port.B], B)
    assert tuple(tuple(Fraction(int(i == j)) for j in range(6)) for i in range(2)) == port.C


def saturating(law, filter_: Filter, c: Fraction, limits: tuple[float, float], T: float):  # type: ignore[no-untyped-def]
    """x = (V, I, v) with limits and back-calculation, as it is executed; of IDA-PBC the state is xi and v = -xi."""
    R, L, C, w = (float(v) for v in (filter_.resistance_ohm, filter_.inductance_henry, c, W0))
    reference, ida = numpy.array([310.0, -40.0]), isinstance(law, IdaPbc)
    turn = numpy.array([[0.0, -1.0], [1.0, 0.0]])
    if ida:
        alpha, nu, ki = (numpy.array([float(x) for x in pair]) for pair in (law.alpha, law.nu, law.ki))
        Rd, Ld, Cd, wd = (
            float(q)
            for q in (
                law.design.resistance_ohm,
                law.design.inductance_henry,
                law.design.capacitance_farad,
                law.design_w0,
            )
        )
        K13 = numpy.diag(-alpha / nu * ki)
    else:
        K11, K12, K13 = (numpy.array([[float(x) for x in row] for row in K]) for K in (law.K11, law.K12, law.K13))

    def asked(x: numpy.ndarray) -> numpy.ndarray:
        V, I, s = x[:2], x[2:4], x[4:]  # noqa: E741
        if not ida:
            return K11 @ V + K12 @ I + K13 @ s
        off = V - reference
        inner = I - wd * Cd * (turn @ reference)
        return alpha / nu * (inner + ki * s) - nu * off + Rd * I + wd * Ld * (turn @ I) + V - Ld * ki * off

    def rhs(x: numpy.ndarray) -> numpy.ndarray:
        V, I, u = x[:2], x[2:4], asked(x)  # noqa: E741
        sat = numpy.clip(u, -numpy.array(limits), limits)
        back = numpy.linalg.solve(K13, sat - u) / T
        s_dot = V - reference - back if ida else reference - V + back
        return numpy.concatenate([(I - w * C * (turn @ V)) / C, (sat - V - R * I - w * L * (turn @ I)) / L, s_dot])

    return asked, rhs


@pytest.mark.parametrize("shape", ["full", "upper", "lower", "diagonal", "ida-pbc"])
@pytest.mark.parametrize("held", ["", "d", "q", "dq"])
def test_modes_with_anti_windup_against_finite_differences(shape: str, held: str) -> None:
    """The port of a mode is the block of what stays, and what is left out does not enter it."""
    filter_, c, T = random_filter(), rational(1e-5, 9e-5), rational(1e-3, 1e-1)
    law: StateFeedback | IdaPbc
    if shape == "ida-pbc":
        pairs = [tuple(rational(lo, hi) for _ in range(2)) for lo, hi in ((-9, -1), (0.5, 3), (10, 200))]
        law = IdaPbc(*pairs, random_filter(), W0 * Fraction(101, 100))  # type: ignore[arg-type]
    else:
        gains = [tuple(tuple(rational(1, 5) for _ in range(2)) for _ in range(2)) for _ in range(3)]
        zero = {"full": (), "upper": ((1, 0),), "lower": ((0, 1),), "diagonal": ((0, 1), (1, 0))}[shape]
        K13 = [[Fraction(0) if (i, j) in zero else gains[2][i][j] for j in (0, 1)] for i in (0, 1)]
        law = StateFeedback(gains[0], gains[1], tuple(map(tuple, K13)))
    x = numpy.array([300.0, 20.0, 7.0, -3.0, 11.0, 13.0])
    wanted, _ = saturating(law, filter_, c, (1.0, 1.0), float(T))
    u = numpy.abs(wanted(x))
    limits = (u[0] / 9 if "d" in held else u[0] * 9 + 99, u[1] / 9 if "q" in held else u[1] * 9 + 99)
    _, rhs = saturating(law, filter_, c, limits, float(T))
    step = 1e-3
    whole = numpy.array([(rhs(x + step * e) - rhs(x - step * e)) / (2 * step) for e in numpy.eye(6)]).T
    if shape == "ida-pbc":
        whole[4:, :] *= -1
        whole[:, 4:] *= -1
    dgu = Dgu(filter_, law, (Fraction(310), Fraction(-40)), (Fraction(1), Fraction(1)), T)
    port = dgu_port(dgu, c, W0, held)
    stay = range(6)
    if held == "dq":
        stay = range(4)
    elif len(port.F) == 5:  # the integrator that acts on the free axis
        free = 1 if held == "d" else 0
        assert isinstance(law, IdaPbc) or sum(bool(x) for x in (law.K13 or ())[free]) == 1
        stay = [*range(4), 4 + (free if shape in ("diagonal", "ida-pbc") else next(k for k in (0, 1) if K13[free][k]))]
    expected = whole[numpy.ix_(stay, stay)]
    actual = numpy.array([[float(v) for v in row] for row in port.F])
    assert numpy.allclose(actual, expected, rtol=1e-6, atol=1e-6 * abs(expected).max(axis=1, keepdims=True))
    left_out = [k for k in range(6) if k not in stay]
    assert abs(whole[numpy.ix_(stay, left_out)]).max(initial=0) < 1e-6
    without = dgu_port(replace(dgu, anti_windup_second=None), c, W0, held)
    assert (port == without) == ((shape != "full" and len(port.F) != 6) or held in ("", "dq"))


def test_linear_loop_with_legs_is_the_plant_with_more_capacitance() -> None:
    """A filter and controller given as matrices, plus legs, equals the same thing built from its parts."""
    filter_, legs = random_filter(), rational(1e-7, 1e-6)
    gains = [tuple(tuple(rational(-5, 5) for _ in range(2)) for _ in range(2)) for _ in range(3)]
    feedback = Dgu(filter_, StateFeedback(*gains), (Fraction(1), Fraction(0)), None)
    bare = dgu_port(feedback, filter_.capacitance_farad, W0)
    whole = dgu_port(feedback, filter_.capacitance_farad + legs, W0)
    linear = dgu_port(Dgu(None, LinearLoop(bare.F, bare.B, bare.C), (Fraction(1), Fraction(0)), None), legs, W0)
    assert (linear.F, linear.B, linear.C) == (whole.F, whole.B, whole.C)


def test_no_integrator_is_the_upper_block() -> None:
    filter_ = random_filter()
    gains = [tuple(tuple(rational(-5, 5) for _ in range(2)) for _ in range(2)) for _ in range(2)]
    without = dgu_port(
        Dgu(filter_, StateFeedback(gains[0], gains[1], None), (Fraction(1), Fraction(0)), None), Fraction(1, 10**5), W0
    )
    zero = ((Fraction(0),) * 2,) * 2
    with_zero = dgu_port(
        Dgu(filter_, StateFeedback(gains[0], gains[1], zero), (Fraction(1), Fraction(0)), None), Fraction(1, 10**5), W0
    )
    assert tuple(row[:4] for row in with_zero.F[:4]) == without.F


def current(law: LoadLaw, V: complex) -> complex:
    """The paper's load current, component by component (eq. modelling:nonlinear_R_zip_exp)."""
    v = abs(V)
    P, Q = (
        sum(float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) for t in part)
        for part in (law.active, law.reactive)
    )
    return complex(P * V.real + Q * V.imag, P * V.imag - Q * V.real) / v**2


def test_loads_against_the_printed_currents() -> None:
    zip_load = ZipLoad((Fraction(2), Fraction(3)), (Fraction(5), Fraction(7)), (Fraction(11), Fraction(13)))
    exp_load = ExpLoad(Fraction(17), Fraction(3, 2), Fraction(19), Fraction(5, 2), Fraction(2))
    V = 1.5 * cmath.exp(0.4j)
    v = abs(V)
    node = Node("x", None, (zip_load, exp_load), (), (Fraction(1), Fraction(2)), Fraction(1))
    d = (11 * V.real + 13 * V.imag) / v**2 + (5 * V.real + 7 * V.imag) / v + 2 * V.real + 3 * V.imag
    q = (11 * V.imag - 13 * V.real) / v**2 + (5 * V.imag - 7 * V.real) / v + 2 * V.imag - 3 * V.real
    a, b = 17 * v**-0.5 / 2**1.5, 19 * v**0.5 / 2**2.5
    expected = complex(d + a * V.real + b * V.imag, q + a * V.imag - b * V.real)
    assert current(load_law(node.loads), V) == pytest.approx(expected)


@given(st.fractions(Fraction(1, 100), Fraction(100)))
@settings(max_examples=50, deadline=None)
def test_angular_frequency_has_forty_digits(frequency: Fraction) -> None:
    import mpmath

    w0 = angular_frequency(frequency)
    with mpmath.workdps(80):
        exact = 2 * mpmath.pi * mpmath.mpf(frequency.numerator) / frequency.denominator
        assert abs(mpmath.mpf(w0.numerator) / w0.denominator / exact - 1) < mpmath.mpf(10) ** -39
    digits = str(w0.numerator * 10**60 // w0.denominator).strip("0")
    assert len(digits) <= 40


def test_cigre_capacitances_count_half_of_each_line() -> None:
    grid = load("specs/cigre-mv.toml")
    total = node_capacitances(grid)
    per_km, filter_ = 151.7e-9, 25e-6
    lengths = {"7": 2.8 + 4.4, "9": 0.5 + 0.3, "2": 4.4 + 0.6 + 1.3}
    assert float(total["7"]) == pytest.approx(lengths["7"] * per_km / 2)
    assert float(total["9"]) == pytest.approx(lengths["9"] * per_km / 2)
    assert float(total["2"]) == pytest.approx(filter_ + lengths["2"] * per_km / 2)


def test_neglected_legs(specs: Path) -> None:
    text = (specs / "cigre-mv.toml").read_text()
    grid = decode(text.replace("base_voltage", 'line_legs = "neglected at DGUs"\nbase_voltage', 1).encode())
    total = node_capacitances(grid)
    assert total["2"] == Fraction(25, 10**6)
    assert float(total["9"]) == pytest.approx(0.8 * 151.7e-9 / 2)
    assert "line-legs" in grid_assumptions(grid)


def test_cigre_lines_are_the_papers() -> None:
    grid = load("specs/cigre-mv.toml")
    expected = (
        "1-7 2.8, 7-2 4.4, 2-8 0.6, 8-3 0.6, 2-5 1.3, 8-9 0.5, 9-4 0.3, 3-6 1.5, 4-10 0.8, 10-5 0.3, 5-11 1.7, 11-6 0.2"
    )
    found = ", ".join(
        f"{line.start}-{line.end} {float(line.branch.resistance_ohm / Fraction('0.000343')) / 1000:.1f}"
        for line in grid.lines
    )
    assert found == expected
    assert Context(grid).islands == (tuple(str(k) for k in range(1, 12)),)
