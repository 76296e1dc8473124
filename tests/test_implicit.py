"""Collocation for large networks: against dense references, exact exponentials, and the integrator of small ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from certify.inputs import decode_all
from certify.kernel.spec import Microgrid
from certify.simulator.exponential import Exponential, Modes
from certify.simulator.flow import Flow, find_rest
from certify.simulator.implicit import Collocation
from certify.simulator.midpoint import audit
from certify.simulator.nodal import Nodal
from certify.simulator.plant import Plant
from tests.bench.networks import microgrid
from tests.conftest import ROOT

SPECS = ROOT / "specs"
Array = numpy.ndarray[Any, Any]


def flow_of(data: bytes, loads: bool = True) -> Flow:
    """Without limits, and without static loads if they are not wanted."""
    grid = decode_all(data)
    if not loads:
        grid = without_loads(grid)
    plant = Plant(grid)
    return Flow(plant, numpy.zeros(2 * len(plant.inverters)))


def without_loads(grid: Microgrid) -> Microgrid:
    return replace(grid, nodes=tuple(replace(node, loads=(), band_volt=None, current=None) for node in grid.nodes))


def harsh(flow: Flow) -> Array:
    """Inverters' nodes at their references, the others about there, no currents."""
    plant = flow.plant
    x = numpy.zeros(plant.size)
    known = [node.dgu.reference_volt for node in plant.grid.nodes if node.dgu]
    for node in plant.grid.nodes:
        if node.name not in plant.loops:
            x[plant.slices["voltage", node.name]] = numpy.array(
                node.dgu.reference_volt if node.dgu else known[0], dtype=float
            )
    return x


def near_rest(flow: Flow) -> Array:
    """Another start, for networks in which a node without current from its line collapses."""
    rest = find_rest(flow, harsh(flow))
    assert rest is not None
    return 0.97 * rest


def sizes(flow: Flow, x: Array) -> Array:
    """What an error is compared with: the largest of each kind of state."""
    result = numpy.ones(len(x))
    for kind in {part[0] for part in flow.plant.slices}:
        at = numpy.concatenate(
            [numpy.arange(s.start, s.stop) for part, s in flow.plant.slices.items() if part[0] == kind]
        )
        result[at] = {"voltage": 1e4, "integrator": 10.0, "loop": 1e3}.get(kind, 100.0)
    return result


def follow(stepper: Any, weights: Array, times: Array) -> Array:
    """The states at times that rise. Shape (t,) to (t, n)."""
    result, k = numpy.empty((len(times), len(weights))), 0
    while k < len(times):
        window = stepper.advance(weights)
        ended = window.end >= times[-1] * (1 - 1e-12)
        last = len(times) if ended else int(numpy.searchsorted(times, window.end, side="right"))
        result[k:last] = window.states(times[k:last])
        k = last
    return result


def reference(flow: Flow, x: Array, times: Array, weights: Array) -> Array:
    """By scipy's Radau, with the exact Jacobian."""
    run = solve_ivp(
        lambda _, y: flow.rates(y),
        (0.0, times[-1]),
        x,
        method="Radau",
        jac=lambda _, y: flow.jacobian(y),
        rtol=2e-9,
        atol=1e-9 * weights,
        t_eval=times,
    )
    assert run.success
    return run.y.T


NETWORKS = {
    "cigre": ((SPECS / "cigre-mv.toml").read_bytes, 3e-4),
    "other-loads": ((SPECS / "other-loads.toml").read_bytes, 3e-4),
    "custom-loop": ((SPECS / "custom-loop.json").read_bytes, 1e-2),  # near its rest
    "mesh": (lambda: microgrid(30, mesh=True), 1e-4),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_states_are_those_of_a_dense_reference(name: str) -> None:
    data, span = NETWORKS[name]
    flow = flow_of(data())
    x = near_rest(flow) if name == "custom-loop" else harsh(flow)
    weights, times = sizes(flow, x), numpy.linspace(0, span, 60)
    wanted = reference(flow, x, times, weights)
    for tolerance in (1e-5, 1e-8):
        found = follow(Collocation(flow, x, span, tolerance), weights, times)
        assert numpy.abs((found - wanted) / weights).max() < 3 * tolerance


@pytest.mark.parametrize("name", NETWORKS)
def test_linear_motion_is_that_of_the_exponential(name: str) -> None:
    data, span = NETWORKS[name]
    flow = flow_of(data(), loads=False)
    x, A = harsh(flow), flow.A.toarray()
    weights = sizes(flow, x)
    whole = numpy.block([[A, flow.b[:, None]], [numpy.zeros((1, len(x) + 1))]])
    wanted = expm(whole * span) @ numpy.append(x, 1.0)
    stepper = Collocation(flow, x, span, 1e-9)
    while not stepper.done:
        window = stepper.advance(weights)
    assert numpy.abs((window.last - wanted[:-1]) / weights).max() < 3e-9
    assert window.end == pytest.approx(span, rel=1e-12)


@pytest.mark.parametrize("name", NETWORKS)
def test_shifted_systems_are_solved_as_by_a_dense_solver(name: str) -> None:
    flow, rng = flow_of(NETWORKS[name][0]()), numpy.random.default_rng(7)
    x = harsh(flow)
    nodal, J = Nodal(flow), flow.jacobian(x).toarray()
    loads, order = nodal.loads(x[nodal.kept]), numpy.concatenate([nodal.kept, nodal.local])
    assert sorted(order) == list(range(flow.plant.size))
    weights = sizes(flow, x)
    for k in range(20):
        shift = complex(10 ** rng.uniform(1, 6), 0 if k % 2 else 10 ** rng.uniform(1, 6) * rng.choice([-1, 1]))
        r = rng.normal(size=len(x)) * weights
        wanted = numpy.linalg.solve(shift * numpy.eye(len(x)) - J, r)
        found = numpy.concatenate(nodal.shifted(shift, loads).solve(r[nodal.kept], r[nodal.local]))
        assert numpy.iscomplexobj(found) == bool(shift.imag)
        scale = numpy.abs(wanted / weights).max()
        assert numpy.abs((found - wanted[order]) / weights[order]).max() < 1e-9 * scale


@pytest.mark.parametrize("stages", [3, 5, 7])
def test_errors_fall_with_the_order_of_the_polynomials(stages: int) -> None:
    """By two to the stages and one, or more, within windows of one length; at their ends by about its square."""
    flow = flow_of((SPECS / "cigre-mv.toml").read_bytes())
    x = harsh(flow)
    weights, span = sizes(flow, x), 2e-5
    # what is stiffest goes first: a start on the smooth motion
    start = follow(Collocation(flow, x, 1e-4, 1e-10), weights, numpy.array([1e-4]))[0]
    times = numpy.linspace(0, span, 33)
    wanted = follow(Collocation(flow, start, span, 1e-13, 9), weights, times)
    errors = []
    for parts in (2, 4):
        stepper = Collocation(flow, start, span, 1e-11, stages)
        stepper.units = 2**53 // parts
        stepper._lengthen = lambda *_: None  # type: ignore[method-assign]
        found = fixed(stepper, weights, times)
        errors.append(numpy.abs((found - wanted) / weights).max())
    assert errors[1] > 1e-12
    assert numpy.log2(errors[0] / errors[1]) > stages + 0.5


def fixed(stepper: Collocation, weights: Array, times: Array) -> Array:
    """Windows of one length, whatever their error."""
    accept = stepper._finish

    def any_error(*given: Any) -> Any:
        window, _, _ = accept(*given)
        return window, 0.0, 1.0

    stepper._finish = any_error  # type: ignore[method-assign]
    return follow(stepper, weights, times)


def test_both_integrators_agree_after_a_harsh_start() -> None:
    flow = flow_of((SPECS / "cigre-mv.toml").read_bytes())
    plant = flow.plant
    x = numpy.zeros(plant.size)
    scale = numpy.ones(plant.size)
    for node in plant.grid.nodes:
        V = [float(v) for v in node.dgu.reference_volt] if node.dgu else [14e3, 14e3]
        x[plant.slices["voltage", node.name]] = V
        scale[plant.slices["voltage", node.name]] = plant.capacitances[node.name] ** -0.5
    for part, (_, _, _, L) in plant.branches.items():
        scale[plant.slices[part]] = L**-0.5
    for name, inverter in plant.inverters.items():
        scale[plant.slices["current", name]] = inverter.inductance_henry**-0.5
    weights, span = sizes(flow, x), 0.005
    origin = find_rest(flow, x)
    assert origin is not None
    times = numpy.sort(numpy.random.default_rng(3).uniform(0, span, 200))
    wanted = follow(Exponential(Modes(flow, origin, scale), x, span, 1e-9), weights, times)
    found = follow(Collocation(flow, x, span, 1e-8), weights, times)
    assert numpy.abs((found - wanted) / weights).max() < 1e-7


def test_windows_grow_over_decades_once_the_ringing_is_over() -> None:
    flow = flow_of(microgrid(30))
    x = harsh(flow)
    weights, stepper, lengths = sizes(flow, x), Collocation(flow, x, 400.0, 1e-5), []
    while not stepper.done:
        lengths.append(stepper.advance(weights).length)
    rest = find_rest(flow, x)
    assert rest is not None
    assert max(lengths) > 1e4 * min(lengths)
    assert numpy.abs((stepper.x - rest) / weights).max() < 1e-4


def test_windows_meet_and_may_be_looked_at_anywhere() -> None:
    flow = flow_of((SPECS / "other-loads.toml").read_bytes())
    x = harsh(flow)
    weights, stepper = sizes(flow, x), Collocation(flow, x, 1e-3, 1e-7)
    end, last = 0.0, x
    while not stepper.done:
        window = stepper.advance(weights)
        assert window.start == pytest.approx(end, abs=1e-18)
        edges = window.states(numpy.array([window.start, window.end]))
        assert numpy.abs((edges - [last, window.last]) / weights).max() < 1e-9
        end, last = window.end, window.last


def test_a_window_may_be_taken_back() -> None:
    flow = flow_of((SPECS / "cigre-mv.toml").read_bytes())
    x, span = harsh(flow), 1e-3
    weights, stepper = sizes(flow, x), Collocation(flow, x, span, 1e-8)
    wanted = follow(Collocation(flow, x, span, 1e-8), weights, numpy.array([span]))[0]
    k = 0
    while not stepper.done:
        window = stepper.advance(weights)
        k += 1
        if k % 10 == 5:
            stepper.shorten()
            assert numpy.array_equal(stepper.x, window.first)
            again = stepper.advance(weights)
            assert (again.start, again.length) == (window.start, pytest.approx(window.length / 2, rel=1e-6))
    assert window.end == pytest.approx(span, rel=1e-12)
    assert numpy.abs((window.last - wanted) / weights).max() < 1e-7
    beyond = stepper.advance(weights)
    assert (beyond.start, beyond.end > span) == (window.end, True)


def test_growth_beyond_all_bounds_is_an_error_and_not_a_state() -> None:
    flow = flow_of((SPECS / "cigre-mv.toml").read_bytes())
    grown = Flow(flow.plant, flow.held)
    A = flow.A.copy()
    A.setdiag(A.diagonal() + 1e5)
    object.__setattr__(grown, "A", A)
    x = harsh(flow)
    weights, stepper = sizes(flow, x), Collocation(grown, x, 1.0, 1e-6)

    def run() -> None:
        nonlocal weights
        while not stepper.done:
            weights = numpy.maximum(weights, numpy.abs(stepper.advance(weights).last))

    with numpy.errstate(all="ignore"), pytest.raises(FloatingPointError):
        run()
    with numpy.errstate(all="ignore"), pytest.raises(FloatingPointError):
        Collocation(flow, x * numpy.inf, 1.0, 1e-6).advance(weights)


def energy(plant: Plant, x: Array) -> float:
    """Of capacitors and lines, in joule."""
    stored = sum(C * abs(plant.get(x, ("voltage", name))) ** 2 for name, C in plant.capacitances.items())
    return float(stored + sum(L * abs(plant.get(x, part)) ** 2 for part, (_, _, _, L) in plant.branches.items())) / 2


def ringing() -> Flow:
    """Lines and capacitors alone, without losses."""
    grid = decode_all((SPECS / "cigre-mv.toml").read_bytes())
    nodes = tuple(replace(node, dgu=None, branches=()) for node in without_loads(grid).nodes)
    lines = tuple(
        replace(line, branch=replace(line.branch, resistance_ohm=line.branch.resistance_ohm * 0)) for line in grid.lines
    )
    plant = Plant(replace(grid, nodes=nodes, lines=lines))
    return Flow(plant, numpy.zeros(0))


def test_the_midpoint_rule_keeps_the_energy_of_a_lossless_network() -> None:
    flow = ringing()
    x = numpy.random.default_rng(5).normal(size=flow.plant.size) * 1e3
    states = audit(flow, x, 0.01, 2000)
    energies = [energy(flow.plant, state) for state in states]
    assert max(energies) / min(energies) - 1 < 1e-11
    assert numpy.abs(states[-1] - x).max() > 100  # it has moved


def test_the_midpoint_rule_is_of_second_order_with_loads() -> None:
    flow = flow_of((SPECS / "other-loads.toml").read_bytes())
    x = harsh(flow)
    weights = sizes(flow, x)
    start = follow(Collocation(flow, x, 1e-3, 1e-9), weights, numpy.array([1e-3]))[0]
    wanted = follow(Collocation(flow, start, 1e-4, 1e-10), weights, numpy.array([1e-4]))[0]
    errors = [numpy.abs((audit(flow, start, 1e-4, n)[-1] - wanted) / weights).max() for n in (100, 200)]
    assert 1.9 < numpy.log2(errors[0] / errors[1]) < 2.1
