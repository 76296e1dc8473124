"""The simulator against an oracle of another kind, through events, cut-offs and limits; and what it promises besides."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy
import pytest

from certify.inputs import decode_all
from certify.kernel.errors import SpecError
from certify.kernel.spec import ExpLoad, Node, ZipLoad
from certify.simulation import Course, Simulation, simulate
from certify.simulator.exponential import Exponential, Modes
from certify.simulator.flow import find_held_rest, find_rest, flow_at, free_flow
from certify.simulator.loads import StaticLoads
from certify.simulator.motion import Follower, natural_sizes
from certify.simulator.plant import Plant, to_phasors
from certify.simulator.starts import flat_voltages, start_state
from tests.conftest import ROOT, SPECS
from tests.simulation_cases import SCENARIO, Case
from tests.simulation_oracle import difference
from tests.simulation_references import all_cases, read
from tests.test_equilibrium import oscillator

CASES = all_cases()
AGREEMENT = 1e-6  # of the largest modulus of a part


def worst_gap(result: Simulation, reference: dict[tuple[str, ...], Any]) -> tuple[float, tuple[str, ...]]:
    """The largest difference, as a share of the largest modulus of that part, and where it is."""
    gaps = []
    for part, expected in reference.items():
        found = result.part(*part) if part[0] == "loop" else result.phasor(*part)
        assert numpy.array_equal(numpy.isnan(found), numpy.isnan(expected)), part
        if not numpy.isnan(expected).all():
            size = max(float(numpy.nanmax(numpy.abs(expected))), 1e-9)
            gaps.append((float(numpy.nanmax(numpy.abs(found - expected))) / size, part))
    return max(gaps)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_simulator_agrees_with_the_oracle(case: Case) -> None:
    """The oracle has equations and events of its own, and scipy's integrators, at a relative tolerance of 1e-12.

    What it says is kept in tests/data/simulations; of two cases it is asked again below.
    """
    result = simulate(case.data, SCENARIO, samples=case.samples)
    assert result.diverged is None
    assert numpy.array_equal(result.times, case.samples)
    gap, part = worst_gap(result, read(case))
    assert gap <= AGREEMENT, part


@pytest.mark.parametrize("case", [CASES[3], CASES[15]], ids=lambda case: case.name)
def test_what_is_kept_is_what_the_oracle_says(case: Case) -> None:
    assert difference(case.reference(), read(case))[0] < 1e-9


@pytest.mark.parametrize("case", CASES[5:7], ids=lambda case: case.name)
def test_both_methods_agree(case: Case) -> None:
    one, other = (simulate(case.data, SCENARIO, samples=case.samples, method=m) for m in ("exponential", "collocation"))
    largest = numpy.nanmax(numpy.abs(one.states), axis=0)
    gap = numpy.nanmax(numpy.abs(one.states - other.states), axis=0)
    assert {entry["method"] for entry in other.phases} == {"collocation"}
    assert (gap <= AGREEMENT * numpy.maximum(largest, 1e-3 * numpy.nanmax(largest)) + 1e-9).all()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_the_tolerance_is_kept(tolerance: float) -> None:
    """Errors add up over hundreds of windows: they stay within thirty times what one may add."""
    case = next(case for case in CASES if case.name == "random 1")
    gap, _ = worst_gap(simulate(case.data, SCENARIO, samples=case.samples, tolerance=tolerance), read(case))
    assert gap <= 30 * tolerance


def test_an_oscillation_that_never_ends_and_twins_that_recover() -> None:
    """The counterexample of THEORY 7: the sizes of its limits, its load and its gain all matter."""
    late = {}
    for ki, load in ((1000, "rl"), (100, "rl"), (1000, "static")):
        found = simulate(oscillator(ki, load), start="zero", end=Fraction(1, 2), samples=5000, tolerance=1e-6)
        error = numpy.abs(found.phasor("voltage", "a") - (13_000 + 16_000j))
        late[ki, load] = error[found.times > 0.4].max()
        assert found.phases[0]["switches"] > 5
    assert late[1000, "rl"] == pytest.approx(47_600, rel=0.01)
    assert late[100, "rl"] < 1e-3
    assert late[1000, "static"] < 1e-3


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.stem)
@pytest.mark.parametrize("start", ["flat", "equilibrium"])
def test_every_spec_is_simulated(path: Any, start: str) -> None:
    found = simulate(path.read_bytes(), start=start, end=Fraction(1, 20), samples=10, tolerance=1e-6)
    assert found.diverged is None
    assert numpy.isfinite(found.states).all()
    if start == "equilibrium":
        assert numpy.allclose(found.states[-1], found.states[0], rtol=1e-6, atol=1e-3)


def test_samples_do_not_depend_on_how_many_there_are() -> None:
    spec = (ROOT / "specs/cigre-mv.toml").read_bytes()
    few, many = (simulate(spec, end=Fraction(1, 100), samples=n) for n in (5, 500))
    assert numpy.allclose(few.states, many.states[::100], rtol=1e-9, atol=1e-6)


def test_a_motion_goes_on_from_where_it_was_left() -> None:
    """Half of it, and the other half from there: the same as all of it."""
    spec = (ROOT / "specs/two-inverters.toml").read_bytes()
    whole = simulate(spec, end=Fraction(1, 50), samples=2, tolerance=1e-10)
    rest = simulate(spec, end=Fraction(1, 100), start=whole.states[1], samples=1, tolerance=1e-10)
    scale = numpy.abs(whole.states).max(axis=0)
    assert (numpy.abs(rest.states[-1] - whole.states[-1]) <= 1e-7 * scale + 1e-9).all()


def test_dense_output_is_the_motion_itself() -> None:
    """Between the points of a window, with modes that ring many times within it, as after many short ones."""
    grid = decode_all((ROOT / "specs/cigre-mv.toml").read_bytes())
    plant = Plant(grid)
    x = start_state(plant, "flat")
    assert x is not None
    flow = flow_at(plant, x)
    rest = find_rest(flow, x)
    assert rest is not None
    sizes = natural_sizes(plant, rest)
    modes = Modes(flow, rest, sizes)
    times = numpy.linspace(0, 2e-3, 301)[1:]

    def states(tolerance: float) -> Any:
        stepper, out, done = Exponential(modes, x, 1.0, tolerance), [], 0
        while done < len(times):
            window = stepper.advance(sizes)
            until = int(numpy.searchsorted(times, window.end, "right"))
            out.append(window.states(times[done:until]))
            done = until
        return numpy.concatenate(out)

    coarse, fine = states(1e-7), states(1e-13)
    assert (numpy.abs(coarse - fine) <= 1e-5 * sizes).all()


# --- parts -------------------------------------------------------------------------------------------------------


def some_loads() -> list[Node]:
    return [node for node in decode_all((ROOT / "specs/other-loads.toml").read_bytes()).nodes if node.has_static_load]


def test_slopes_of_loads_are_their_differences() -> None:
    nodes = [*some_loads(), *decode_all((ROOT / "specs/cigre-mv.toml").read_bytes()).nodes]
    loads = StaticLoads([node for node in nodes if node.has_static_load])
    rng = numpy.random.default_rng(3)
    for _ in range(20):
        V = (200 + 20_000 * rng.random(loads.size)) * numpy.exp(2j * numpy.pi * rng.random(loads.size))
        J = loads.slopes(V)
        for k, step in ((0, 1e-3), (1, 1e-3j)):
            found = (loads.currents((V + step)[None]) - loads.currents((V - step)[None]))[0] / 2e-3
            scale = numpy.abs(J).max(axis=(1, 2))
            assert (numpy.abs(found.real - J[:, 0, k]) <= 1e-5 * scale + 1e-12).all()
            assert (numpy.abs(found.imag - J[:, 1, k]) <= 1e-5 * scale + 1e-12).all()


def test_loads_without_voltage_draw_nothing() -> None:
    zip_load = ZipLoad((Fraction(1), Fraction(1)), (Fraction(1), Fraction(1)), (Fraction(1), Fraction(1)))
    exp_load = ExpLoad(Fraction(1), Fraction(0), Fraction(1), Fraction(1, 2), Fraction(100))
    node = Node("a", None, (zip_load, exp_load), (), (Fraction(90), Fraction(110)), Fraction(1))
    for own in (node, replace(node, loads=tuple(replace(x, cutoff_volt=Fraction(90)) for x in node.loads))):  # type: ignore[type-var]
        loads = StaticLoads([own])
        V = numpy.array([[0j]])
        assert loads.currents(V) == 0
        assert numpy.isfinite(loads.slopes(V[0])).all()


def test_a_flat_start_takes_the_nearest_reference() -> None:
    grid = decode_all((ROOT / "specs/cigre-mv.toml").read_bytes())
    flat = flat_voltages(grid)
    assert flat["1"] == 18_000 + 11_000j
    assert flat["7"] == flat["1"]  # between 1 and 2, and 1 is the first
    assert flat["9"] == 15_000 + 14_000j  # one line from 4, two from 3


def test_an_equilibrium_with_inverters_at_their_limits_is_found() -> None:
    case = next(case for case in CASES if case.name == "random 5")
    course = Course(case.data, SCENARIO)
    plant = course.plant(course.phases[0])
    flat = start_state(plant, "flat")
    assert flat is not None
    rest = find_held_rest(plant, flat)
    assert rest is not None
    assert (numpy.abs(plant.asked(rest)) > plant.limits).any()
    assert (numpy.abs(plant.rates(rest)) <= 1e-6 * (abs(plant.A) @ numpy.abs(rest)) + 1e-6).all()


def test_rates_of_many_states_are_those_of_each() -> None:
    plant = Plant(decode_all((ROOT / "specs/two-inverters.toml").read_bytes()))
    x = 100 * numpy.random.default_rng(1).normal(size=(5, plant.size))
    assert numpy.allclose(plant.rates(x), [plant.rates(y) for y in x], rtol=1e-12)
    assert numpy.allclose(plant.drawn(x), [plant.drawn(y) for y in x], rtol=1e-12)
    assert to_phasors(plant.loaded_voltages(x)).shape == (5, len(plant.loaded))


# --- what is refused, and what ends early ------------------------------------------------------------------------


def unstable() -> bytes:
    """An inverter with a wrong sign in its integrator."""
    document = json.loads(oscillator(100, "rl"))
    document["controller"] = {"bad": {"kind": "state-feedback", "K11": "-1", "K12": "-2", "K13": "-500"}}
    document["node"]["a"]["dgu"] |= {"controller": "bad"}
    document["node"]["a"]["dgu"].pop("limits")
    return json.dumps(document).encode()


def test_a_motion_that_grows_is_said_to_diverge() -> None:
    found = simulate(unstable(), end=Fraction(100), samples=1000)
    assert found.diverged is not None
    assert str(found.diverged).startswith("diverged at t = ")
    assert "node a has reached" in str(found.diverged)
    assert numpy.isfinite(found.states).all()
    assert found.times[-1] <= found.diverged.at_second < 100
    # the time is that at which a bound is passed, however long the last window is
    again = simulate(unstable(), end=Fraction(100), samples=10, tolerance=1e-4)
    assert again.diverged is not None
    assert again.diverged.at_second == pytest.approx(found.diverged.at_second, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"end": Fraction(0)}, "U005"),
        ({"end": Fraction(-1)}, "U005"),
        ({"scenario": "plug-in", "end": Fraction(9)}, "U005"),
        ({"scenario": "none"}, "U002"),
        ({"start": numpy.zeros(3)}, "U006"),
        ({"samples": 10**9}, "U007"),
    ],
)
def test_what_cannot_be_simulated_is_refused(options: dict[str, Any], code: str) -> None:
    with pytest.raises(SpecError) as refused:
        simulate((ROOT / "specs/cigre-mv.toml").read_bytes(), **options)
    assert [fault.code for fault in refused.value.faults] == [code]


def test_modes_that_are_no_basis_are_left_to_the_other_method() -> None:
    """Two equal integrators in a row have one eigenvector: the network is followed by collocation instead."""
    loop = {
        "kind": "linear",
        "F": [[-1, 1, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1], [0, 0, 0, -1]],
        "B": [[1000, 0], [0, 0], [0, 1000], [0, 0]],
        "C": [[1, 0, 0, 0], [0, 0, 1, 0]],
    }
    spec = {
        "format": "certify/microgrid@1",
        "frequency": "50 Hz",
        "voltage_band": ["100 V", "500 V"],
        "controller": {"own": loop},
        "node": {"a": {"dgu": {"controller": "own", "reference": [300, 0]}}},
    }
    data = json.dumps(spec).encode()
    course = Course(data, end_second=Fraction(1))
    start = numpy.zeros(course.size)
    start[course.parts["loop", "a"]] = 0, 10, 0, -20
    found = simulate(data, end=Fraction(1), start=start, samples=4)
    assert found.phases[0]["method"] == "collocation"
    t = found.times
    # x1 = (x1(0) + x2(0) t) e^-t, by hand
    assert numpy.allclose(found.part("loop", "a")[:, 0], 10 * t * numpy.exp(-t), rtol=1e-6, atol=1e-6)
    assert numpy.allclose(found.phasor("voltage", "a"), 300 + (10 - 20j) * t * numpy.exp(-t), rtol=1e-8)


def test_the_follower_starts_where_it_is_told() -> None:
    plant = Plant(decode_all((ROOT / "specs/two-inverters.toml").read_bytes()))
    x = start_state(plant, "flat")
    assert x is not None
    pieces = list(Follower(plant, x, 1e-8).pieces(x, 3.0, 3.001))
    assert pieces[0].start == 3.0
    assert pieces[-1].end == 3.001
    assert numpy.allclose(pieces[0].states(numpy.array([3.0]))[0], x, rtol=1e-9, atol=1e-9)
    assert free_flow(plant).rates(x).shape == x.shape


# --- found by a hostile review, kept as cases --------------------------------------------------------------------


def found_case(name: str) -> bytes:
    return (ROOT / "tests/cases/simulations" / f"{name}.toml").read_bytes()


@pytest.mark.parametrize("name", ["hang-tiny-limit", "hang-millivolt-limit", "crash-tiny-limit"])
def test_limits_smaller_than_rounding_let_time_pass(name: str) -> None:
    """Rounding of a law with terms of kilovolts once held the motion at a limit of nanovolts for ever."""
    found = simulate(found_case(name), start="zero", end=Fraction(1, 10), samples=10)
    assert found.diverged is None
    assert found.phases[0]["windows"] < 2000


def test_a_limit_that_is_met_thousands_of_times() -> None:
    found = simulate(found_case("crash-high-gain"), start="zero", end=Fraction(1, 20), samples=10)
    assert found.diverged is None


def test_a_short_dip_over_a_limit_is_not_missed() -> None:
    both = [
        simulate(found_case("missed-dip"), end=Fraction(228, 10_000), samples=40, tolerance=1e-9, method=method)
        for method in ("exponential", "collocation")
    ]
    assert both[0].phases[0]["switches"] == both[1].phases[0]["switches"]
    scale = numpy.abs(both[1].states).max(axis=0)
    assert (numpy.abs(both[0].states - both[1].states) <= 1e-6 * scale).all()


def test_windows_that_crawl_are_left_to_the_other_method() -> None:
    found = simulate(found_case("slow-load-away-from-rest"), start="zero", end=Fraction(1, 50), samples=5)
    assert found.diverged is None
    assert found.phases[0]["method"] == "collocation"
    assert found.phases[0]["windows"] < 5000


def test_a_line_and_a_reference_at_one_time_at_a_linear_loop() -> None:
    """The charge is shared at the voltage before, whatever the reference is then."""
    together, apart = (
        simulate(found_case("loop-line-and-reference"), scenario, samples=numpy.array([0.0, 0.01 + 2e-12, 0.02]))
        for scenario in ("together", "apart")
    )
    assert numpy.allclose(together.phasor("voltage", "a"), apart.phasor("voltage", "a"), rtol=1e-6)


def test_collocation_with_a_load_at_a_linear_loop() -> None:
    one, other = (
        simulate(found_case("loop-collocation"), end=Fraction(1, 20), samples=10, method=method)
        for method in ("exponential", "collocation")
    )
    scale = numpy.abs(one.states).max(axis=0)
    assert (numpy.abs(one.states - other.states) <= 1e-6 * scale + 1e-9).all()


def test_a_very_long_run_begins_with_short_windows() -> None:
    found = simulate((ROOT / "specs/two-inverters.toml").read_bytes(), end=Fraction(10**9), samples=1)
    assert found.diverged is None
    assert found.phases[0]["windows"] < 2000


@pytest.mark.parametrize("samples", [[0.0, 2.0], [0.5, 0.1], [-0.1, 0.5], [float("nan")], []])
def test_times_of_samples_are_looked_at(samples: list[float]) -> None:
    with pytest.raises(SpecError, match="times of samples"):
        simulate((ROOT / "specs/two-inverters.toml").read_bytes(), samples=numpy.array(samples))


def test_a_start_without_numbers_is_refused() -> None:
    spec = (ROOT / "specs/two-inverters.toml").read_bytes()
    with pytest.raises(SpecError, match="finite"):
        simulate(spec, start=numpy.full(Course(spec).size, numpy.nan))
