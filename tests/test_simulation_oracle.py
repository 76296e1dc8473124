"""The oracle for simulations against itself at tighter tolerances and by another method, and against laws written out."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from certify.kernel.spec import IdaPbc, StateFeedback
from tests.conftest import ROOT
from tests.simulation_cases import Case, cigre, oscillator, random_case
from tests.simulation_oracle import (
    Bench,
    Phase,
    Vector,
    difference,
    equilibrium,
    flat_voltages,
    floats,
    load_document,
    reset,
    run,
    start_state,
)

ENOUGH = 1e-8


def shortened(case: Case, end_ms: int) -> Case:
    """The first milliseconds of a case."""
    timed = tuple((at, changes) for at, changes in case.timed if float(at.split()[0]) < end_ms)
    return replace(case, timed=timed, end=f"{end_ms} ms")


QUICK: list[Callable[[], Case]] = [
    lambda: oscillator(1000, False),
    lambda: oscillator(1000, True),
    lambda: oscillator(100, False),
    lambda: shortened(random_case(1), 50),
    lambda: shortened(random_case(5), 25),
    lambda: shortened(random_case(10), 20),
]


def number(x: Vector) -> complex:
    return complex(*x)


# --- the integration ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", QUICK, ids=lambda make: make().name)
def test_tighter_tolerances_change_nothing(make: Callable[[], Case]) -> None:
    case = make()
    gap, part = difference(case.reference(), case.reference(rtol=1e-13))
    assert gap < ENOUGH, part


@pytest.mark.parametrize("make", [lambda: oscillator(100, False), lambda: shortened(oscillator(1000, False), 20)])
def test_radau_agrees(make: Callable[[], Case]) -> None:
    case = make()
    gap, part = difference(case.reference(), case.reference(rtol=1e-11, method="Radau"))
    assert gap < 1e-7, part


def test_radau_agrees_with_events_cutoffs_and_anti_windup() -> None:
    case = shortened(random_case(10), 16)
    gap, part = difference(case.reference(), case.reference(rtol=1e-9, method="Radau"))
    assert gap < 1e-6, part


def test_jacobian_is_the_derivative_of_the_rates() -> None:
    for case in (random_case(0), random_case(1), random_case(5)):
        phase = Bench(case.document).phase()
        x = start_state(phase, "flat") + np.random.default_rng(1).normal(size=phase.size) * 30
        system = phase.system(phase.mode(x))
        step = np.random.default_rng(2).normal(size=phase.size) * 1e-3
        numeric = (system.rates(0, x + step) - system.rates(0, x - step)) / 2
        assert np.allclose(numeric, system.jacobian(0, x) @ step, rtol=1e-6, atol=1e-8 * abs(numeric).max())


# --- rest and energy ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cigre-mv.toml", "other-loads.toml", "custom-loop.json", "wrong-inductance.toml"])
def test_nothing_moves_from_equilibrium(name: str) -> None:
    out = run(load_document(ROOT / "specs" / name), [], "equilibrium", 0.003, [0, 0.001, 0.003])
    for part, values in out.items():
        assert np.abs(values - values[0]).max() <= 1e-9 * max(np.abs(values).max(), 1e-3), part


def test_equilibrium_of_regulating_inverters_is_their_reference() -> None:
    phase = Bench(load_document(ROOT / "specs" / "cigre-mv.toml"), {("dgu", "5")}).phase()
    x = equilibrium(phase, start_state(phase, "flat"))
    for name, dgu in phase.dgus.items():
        assert np.allclose(phase.voltage(x, name), [float(y) for y in dgu.reference_volt], rtol=1e-12)
    assert abs(number(phase.voltage(x, "5")) - 20_000 * (0.7 + 0.75j)) > 1600


def energy(phase: Phase, x: Vector) -> float:
    """In capacitors and coils, in joule."""
    total = sum(phase.capacitance[n] * abs(number(x[phase.at["voltage", n]])) ** 2 for n in phase.nodes)
    for name, inverter in phase.inverters.items():
        total += inverter.L * abs(number(x[phase.at["current", name]])) ** 2
    series = {("line", n): line.branch for n, line in phase.lines.items()} | phase.branches
    for part, branch in series.items():
        total += float(branch.inductance_henry) * abs(number(x[phase.at[part]])) ** 2
    return float(total) / 2


def power(phase: Phase, x: Vector) -> float:
    """What inverters give less what resistances and loads take, in watt."""
    total = 0.0
    for name, inverter in phase.inverters.items():
        current = number(x[phase.at["current", name]])
        total += (np.conj(current) * number(phase.applied(x, name))).real - inverter.R * abs(current) ** 2
    series = {("line", n): line.branch for n, line in phase.lines.items()} | phase.branches
    for part, branch in series.items():
        total -= float(branch.resistance_ohm) * abs(number(x[phase.at[part]])) ** 2
    for name, loads in phase.static.items():
        v = abs(number(phase.voltage(x, name)))
        for load in loads:
            cut = float(load.cutoff_volt or 0)
            w = max(v, cut)
            if hasattr(load, "Y"):
                p = float(load.Y[0]) * w**2 + float(load.I[0]) * w + float(load.P[0])
            else:
                p = float(load.P0_watt) * (w / float(load.V0_volt)) ** float(load.np)
            total -= p * (v / w) ** 2
    return total


@pytest.mark.parametrize("number_of_case", [3, 7])
def test_energy_balance_along_a_heavily_loaded_run(number_of_case: int) -> None:
    case = random_case(number_of_case)
    phase = Bench(case.document, set(case.off)).phase()
    first = case.changes[0][0]
    middles, h = [first * share for share in (0.011, 0.03, 0.3, 0.77)], 2e-8
    times = [t + k * h for t in middles for k in (-2, -1, 0, 1, 2)]
    out = run(case.document, [], case.start, times[-1], times, case.off)
    states = np.zeros((len(times), phase.size))
    for part, place in phase.at.items():
        states[:, place] = np.stack([out[part].real, out[part].imag], 1)
    for k in range(0, len(times), 5):
        a, b, _, c, d = (energy(phase, x) for x in states[k : k + 5])
        span = (times[k + 4] - times[k]) / 4
        flow = power(phase, states[k + 2])
        assert (8 * (c - b) - (d - a)) / (12 * span) == pytest.approx(
            flow, rel=1e-4, abs=1e-11 * energy(phase, states[k]) / h
        )


# --- laws, written out ----------------------------------------------------------------------------------------------


def axes(pair: Any, z: complex) -> complex:
    """Gains of both axes on a complex number."""
    return complex(float(pair[0]) * z.real, float(pair[1]) * z.imag)


@pytest.mark.parametrize("number_of_case", [4, 5, 8, 10])
def test_control_laws_with_limits_and_anti_windup(number_of_case: int) -> None:
    case = random_case(number_of_case)
    phase = Bench(case.document).phase()
    rng = np.random.default_rng(number_of_case)
    w0 = phase.w
    for _ in range(5):
        x = start_state(phase, "flat") + rng.normal(size=phase.size) * 100
        rates = phase.system(phase.mode(x)).rates(0, x)
        for name, dgu in phase.dgus.items():
            if name in phase.loops:
                continue
            V, I = (number(x[phase.at[kind, name]]) for kind in ("voltage", "current"))  # noqa: E741
            reference = complex(*map(float, dgu.reference_volt))
            law, at = dgu.controller, phase.at.get(("integrator", name))
            if isinstance(law, IdaPbc):
                f = law.design
                R, L, C, w = (
                    float(y) for y in (f.resistance_ohm, f.inductance_henry, f.capacitance_farad, law.design_w0)
                )
                xi = number(x[at])
                h = [float(a) / float(n) for a, n in zip(law.alpha, law.nu, strict=True)]
                u = axes(h, I - 1j * w * C * reference + axes(law.ki, xi)) - axes(law.nu, V - reference)
                u += (R + 1j * w * L) * I + V - L * axes(law.ki, V - reference)
                K13 = np.diag([-a * float(k) for a, k in zip(h, law.ki, strict=True)])
            elif isinstance(law, StateFeedback):
                vector = floats(law.K11) @ [V.real, V.imag] + floats(law.K12) @ [I.real, I.imag]
                if law.K13 is not None:
                    K13 = floats(law.K13)
                    vector = vector + K13 @ x[at]
                u = number(vector)
            else:
                u = reference
            limits = dgu.limits_volt
            held = u
            if limits is not None:
                d, q = map(float, limits)
                held = complex(min(max(u.real, -d), d), min(max(u.imag, -q), q))
            R, L = float(dgu.filter.resistance_ohm), float(dgu.filter.inductance_henry)
            slope = number(rates[phase.at["current", name]])
            assert slope * L == pytest.approx(held - V - (R + 1j * w0 * L) * I, rel=1e-9, abs=1e-7)
            if at is None:
                continue
            time = phase.windup.get(name)
            cut = number(np.linalg.solve(K13, [(held - u).real, (held - u).imag])) / time if time else 0
            v = reference - V + cut
            assert number(rates[at]) == pytest.approx(-v if isinstance(law, IdaPbc) else v, rel=1e-9, abs=1e-7)


def test_saturation_as_theory_has_it() -> None:
    late = {}
    for ki, static in ((1000, False), (100, False), (1000, True)):
        case = oscillator(ki, static)
        out, reference = case.reference(rtol=1e-10), 20_000 * (0.65 + 0.8j)
        error = abs(out["voltage", "a"] - reference)
        late[ki, static] = error[case.samples > 0.15].max()
        assert error.max() > 20_000
    assert late[1000, False] > 40_000
    assert late[100, False] < 20
    assert late[1000, True] < 20


# --- starts and events ------------------------------------------------------------------------------------------------


def test_flat_start_takes_the_nearest_inverter_and_of_two_the_first() -> None:
    document = load_document(ROOT / "specs" / "cigre-mv.toml")
    phase = Bench(document, {("dgu", "5")}).phase()
    flat = {name: number(V) / 20_000 for name, V in flat_voltages(phase).items()}
    assert flat["7"] == 0.9 + 0.55j  # between 1 and 2
    assert flat["5"] == 0.85 + 0.6j  # next to 2
    assert flat["10"] == 0.75 + 0.7j
    assert flat["11"] == 0.65 + 0.8j
    assert flat["9"] == 0.75 + 0.7j


def after(
    document: dict[str, Any], off: set[Any], change: Any, x: Vector | None = None
) -> tuple[Phase, Phase, Vector, Vector]:
    bench = Bench(copy.deepcopy(document), set(off))
    old = bench.phase()
    x = equilibrium(old, start_state(old, "flat")) if x is None else x
    bench.document = copy.deepcopy(bench.document)
    bench.edit(change)
    new = bench.phase()
    return old, new, x, reset(old, new, x, change)


@pytest.mark.parametrize(("kind", "jump"), [("connect-dgu", 0), ("connect-dgu-discharged", 1)])
def test_a_connecting_inverter(kind: str, jump: int) -> None:
    document = load_document(ROOT / "specs" / "cigre-mv.toml")
    old, new, x, y = after(document, {("dgu", "5")}, (kind, "5"))
    V, W = number(old.voltage(x, "5")), number(new.voltage(y, "5"))
    legs = 151.7e-12 * (1300 + 300 + 1700) / 2
    assert legs == pytest.approx(old.capacitance["5"])
    assert pytest.approx(V * (legs / (legs + 25e-6) if jump else 1)) == W
    current = number(y[new.at["current", "5"]])
    assert current == pytest.approx(0 if jump else 1j * new.w * 25e-6 * V)
    if jump:
        assert not y[new.at["integrator", "5"]].any()
    else:
        rates = new.system(new.mode(y)).rates(0, y)
        assert abs(number(rates[new.at["current", "5"]])) < 1e-6


def test_lines_join_discharged_and_charge_stays() -> None:
    case = random_case(1)
    old, new, x, y = after(case.document, set(case.off), case.changes[0][1][0])
    line = new.lines["x3"]
    assert {line.start, line.end} == {"n0", "n3"}
    assert "n0" in new.loops
    assert not y[new.at["line", "x3"]].any()
    charges = [p.capacitance["n3"] * p.voltage(z, "n3") for p, z in ((old, x), (new, y))]
    assert np.allclose(*charges, rtol=1e-13)
    loop, place = new.loops["n0"], new.at["loop", "n0"]
    kept = [
        z[p.at["loop", "n0"]] + floats(loop.B) @ (p.capacitance["n0"] * p.voltage(z, "n0"))
        for p, z in ((old, x), (new, y))
    ]
    assert np.allclose(*kept, rtol=1e-12)
    assert new.capacitance["n0"] > old.capacitance["n0"]
    assert abs(y[place] - x[old.at["loop", "n0"]]).max() > 0


def test_a_new_controller_does_not_move_what_is_applied() -> None:
    case = random_case(10)
    phase = Bench(case.document, set(case.off)).phase()
    x = start_state(phase, "flat")
    x[phase.at["integrator", "n0"]] = -30, 0
    asked, applied = phase.asked(x, "n0"), phase.applied(x, "n0")
    assert (asked != applied).any()
    _, new, _, y = after(case.document, set(case.off), case.changes[0][1][0], x)
    assert np.allclose(new.asked(y, "n0"), applied, rtol=1e-12)
    for kind in ("voltage", "current"):
        assert (y[new.at[kind, "n0"]] == x[phase.at[kind, "n0"]]).all()


def test_samples_at_events_are_the_states_after_them_and_what_is_gone_is_nan() -> None:
    case = shortened(random_case(5), 22)
    out = case.reference(rtol=1e-7)
    (gone, _), (back, _) = case.changes
    times = case.samples
    off = (times >= gone) & (times < back)
    assert (np.isnan(out["current", "n4"]) == off).all()
    assert not np.isnan(out["voltage", "n4"]).any()
    k = int(np.flatnonzero(times == back)[0])
    phase = Bench(case.document).phase()
    charging = 1j * phase.w * phase.inverters["n4"].C * out["voltage", "n4"][k]
    assert out["current", "n4"][k] == pytest.approx(charging, rel=1e-9)


def test_changes_are_told_as_the_scenario_of_a_spec() -> None:
    events = [event for k in (3, 4, 5) for event in random_case(k).document["scenario"]["course"]["event"]]
    assert {"at": "14.46 ms", "connect": "n2", "filter": "discharged"} in events
    assert any(event.get("connect") == {"load": "n4", "index": 0} for event in events)
    assert any(event.get("reference") == "n0" and len(event["set"]) == 2 for event in events)
    assert any(event.get("controller") == "n0" and event["set"] == "phs" for event in events)
    table = cigre("flat").document["scenario"]["course"]
    assert (table["start"], table["disconnected"], table["event"][0]) == (
        "flat",
        ["5"],
        {"at": "40 ms", "connect": "5"},
    )


def test_switching_what_is_switched_so_already_is_an_error() -> None:
    bench = Bench(load_document(ROOT / "specs" / "cigre-mv.toml"))
    with pytest.raises(ValueError, match="already"):
        bench.edit(("connect-dgu", "5"))
    with pytest.raises(ValueError, match="unknown change"):
        bench.edit(("explode", "5"))
