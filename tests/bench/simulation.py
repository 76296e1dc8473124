"""Simulations: time at equal measured error beside scipy's Radau, and networks of 10,000 nodes and lines.

python tests/bench/simulation.py [--report reports/benchmark-simulation.md] [--only cigre|middle|large]

An error is the largest of all states and times, relative to the largest modulus of the state's complex number, against
a reference of a tighter tolerance by one integrator that the other one, or a still tighter run, confirms.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy
from scipy.integrate import Radau
from scipy.sparse import csc_matrix

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent))  # so that it runs as a script

from certify.inputs import decode_all
from certify.simulation import Course
from certify.simulator.compiled import COMPILED
from certify.simulator.flow import Flow, find_rest, free_flow
from certify.simulator.implicit import Collocation
from certify.simulator.motion import Follower, natural_sizes
from certify.simulator.plant import Plant
from certify.simulator.starts import flat_state
from tests.bench.networks import microgrid

ROOT = Path(__file__).resolve().parent.parent.parent
SAMPLES = 1000
Array = numpy.ndarray[Any, Any]
Motion = Callable[[Array], Array]  # times that rise, (t,), to states, (t, n)
OUR_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LEVELS = (3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # errors at which times are compared
STEPPED = 20.0  # kW more at one node in a hundred, for a step of loads


# --- motions ------------------------------------------------------------------------------------------------


def joined(windows: Sequence[Any]) -> Motion:
    """Windows, or pieces, one after the other as one motion."""
    starts = numpy.array([window.start for window in windows])

    def states(times: Array) -> Array:
        at = numpy.clip(numpy.searchsorted(starts, times, side="right") - 1, 0, len(windows) - 1)
        return numpy.concatenate([windows[k].states(times[at == k]) for k in sorted(set(at))])

    return states


def pieces(plant: Plant, x: Array, span: float, tolerance: float) -> Iterator[Any]:
    """What the program does with one phase of a scenario, for a small network."""
    return Follower(plant, x, tolerance, "exponential").pieces(x, 0.0, span)


def collocated(flow: Flow, x: Array, span: float, tolerance: float) -> Iterator[Any]:
    weights = numpy.maximum(numpy.abs(x), natural_sizes(flow.plant, None) * 1e-4)
    weights = numpy.maximum(weights, sized(flow.plant, weights))
    stepper = Collocation(flow, x, span, tolerance)
    while not stepper.done:
        window = stepper.advance(weights)
        weights = numpy.maximum(weights, numpy.abs(window.last))
        yield window


def sized(plant: Plant, x: Array) -> Array:
    """A hundredth of the largest of each kind of state: how large a state is taken to be at least."""
    result = numpy.empty(len(x))
    kinds = numpy.empty(len(x), dtype=object)
    for part, at in plant.slices.items():
        kinds[at] = part[0]
    natural = natural_sizes(plant, None)
    for kind in set(kinds):
        result[kinds == kind] = 0.01 * natural[kinds == kind].max()
    return result


def radau(flow: Flow, x: Array, span: float, tolerance: float, largest: Array, dense: bool) -> tuple[float, Any]:
    """Seconds of scipy's Radau with the exact Jacobian, and its own steps (times, states): the best that it has."""
    form: Callable[[Any], Any] = (lambda J: J.toarray()) if dense else csc_matrix
    started = time.perf_counter()
    solver = Radau(
        lambda _, y: flow.rates(y),
        0.0,
        x,
        span,
        rtol=max(tolerance, 1e-12),
        atol=tolerance * largest,
        jac=lambda _, y: form(flow.jacobian(y)),
        first_step=span * 1e-9,
    )
    times, states = [], []
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise RuntimeError(message)
        times.append(solver.t)
        states.append(solver.y)
    return time.perf_counter() - started, (numpy.array(times), states)


def moduli(plant: Plant, states: Array) -> Array:
    """The largest modulus of the complex number that each state is a part of, over times. Shape (t, n) to (n,)."""
    result = numpy.abs(states).max(axis=0)
    for part, at in plant.slices.items():
        if part[0] != "loop":
            result[at] = numpy.hypot(states[:, at.start], states[:, at.start + 1]).max()
    return numpy.maximum(result, 1e-9 * result.max())


def sampled(span: float, first: float) -> Array:
    """Half of the times evenly, half on a logarithmic scale: neither ringing nor settling is left out."""
    even = numpy.linspace(0, span, SAMPLES // 2)
    return numpy.unique(numpy.concatenate([even, numpy.geomspace(first, span, SAMPLES // 2)]))


def at_levels(points: Sequence[tuple[float, float]]) -> dict[float, float]:
    """Seconds for each level of error that the measured points (error, seconds) enclose, by logarithms."""
    best = sorted(points)
    errors, seconds = (numpy.log10(numpy.array(column)) for column in zip(*best, strict=True))
    return {
        level: float(10 ** numpy.interp(numpy.log10(level), errors, seconds))
        for level in LEVELS
        if errors[0] <= numpy.log10(level) <= errors[-1]
    }


def of_steps(steps: Any, reference: Motion, largest: Array) -> float:
    """The largest error of a run by its own steps."""
    times, states = steps
    some = numpy.unique(numpy.linspace(0, len(times) - 1, SAMPLES).astype(int))
    return float((numpy.abs(numpy.array([states[k] for k in some]) - reference(times[some])) / largest).max())


# --- (a) the CIGRE feeder -----------------------------------------------------------------------------------


def cigre_case() -> list[tuple[Plant, Array, float]]:
    """The harsh case: a flat start with DGU 5 off, which connects at 4 s, two load steps, 8 s; phase by phase.

    Each phase begins where a run at a tolerance of 1e-12 has come to, after the events.
    """
    course = Course((ROOT / "specs/cigre-mv.toml").read_bytes(), "plug-in")
    course.start = "flat"
    stages = {stage.phase.number: stage for stage, _ in course.motion(None, 1e-12)}
    spans = [float(phase.end_second - phase.start_second) for phase in course.phases]
    return [(stages[k].plant, stages[k].first, span) for k, span in enumerate(spans, 1)]


def cigre(beside: bool) -> dict[str, Any]:
    """Seconds and windows, or steps, of all phases together, and the largest error of any."""
    phases = []
    for plant, x, span in cigre_case():
        reference, times = joined(list(pieces(plant, x, span, 1e-11))), sampled(span, 1e-7)
        phases.append((plant, x, span, reference, times, moduli(plant, reference(times))))
    ours = []
    for tolerance in OUR_TOLERANCES:
        best = numpy.inf
        for _ in range(3):
            started = time.perf_counter()
            runs = [list(pieces(plant, x, span, tolerance)) for plant, x, span, *_ in phases]
            best = min(best, time.perf_counter() - started)
        errors = [
            (numpy.abs(joined(run)(times) - reference(times)) / largest).max()
            for run, (*_, reference, times, largest) in zip(runs, phases, strict=True)
        ]
        ours.append((float(max(errors)), best, sum(map(len, runs))))
    theirs = []
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9) if beside else ():
        error, taken, steps = 0.0, 0.0, 0
        for plant, x, span, reference, _, largest in phases:
            flow = free_flow(plant)
            seconds, own = radau(flow, x, span, tolerance, largest, True)
            error, taken, steps = max(error, of_steps(own, reference, largest)), taken + seconds, steps + len(own[0])
        theirs.append((error, taken, steps))
    seconds = sum(span for _, _, span, *_ in phases)
    return {"compiled": COMPILED, "ours": ours, "theirs": theirs, "span": seconds, "states": phases[-1][0].size}


# --- (b), (c) large networks --------------------------------------------------------------------------------


def large_case(nodes: int, mesh: bool, start: str) -> tuple[Flow, Array]:
    """A flat start, or the equilibrium as one in a hundred of the ZIP loads grows by a step."""
    data = microgrid(nodes, mesh=mesh)
    plant = Plant(decode_all(data))
    x = flat_state(plant)
    if start == "step":
        rest = find_rest(free_flow(plant), x)
        assert rest is not None
        spec = json.loads(data)
        for k in range(2, nodes, 100):
            load = spec["node"][f"n{k}"]["load"][0]
            load["P"] = [f"{float(load['P'][0].split()[0]) + STEPPED} kW", load["P"][1]]
        plant, x = Plant(decode_all(json.dumps(spec).encode())), rest
    return free_flow(plant), x


def middle(beside: bool, mesh: bool, start: str, span: float) -> dict[str, Any]:
    flow, x = large_case(1000, mesh, start)
    times = sampled(span, span * 1e-5)
    list(collocated(flow, x, span / 100, 1e-4))
    reference = joined(list(collocated(flow, x, span, 1e-10)))
    at_times = reference(times)
    largest = moduli(flow.plant, at_times)
    ours, theirs = [], []
    for tolerance in OUR_TOLERANCES:
        started = time.perf_counter()
        run = list(collocated(flow, x, span, tolerance))
        taken = time.perf_counter() - started
        ours.append((float((numpy.abs(joined(run)(times) - at_times) / largest).max()), taken, len(run)))
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8) if beside else ():
        taken, steps = radau(flow, x, span, tolerance, largest, False)
        theirs.append((of_steps(steps, reference, largest), taken, len(steps[0])))
        if taken > 40:
            break
    return {"compiled": COMPILED, "ours": ours, "theirs": theirs, "span": span, "states": flow.plant.size}


def large(start: str, span: float = 1.0, nodes: int = 10000) -> dict[str, Any]:
    flow, x = large_case(nodes, False, start)
    list(collocated(flow, x, 1e-6, 1e-3))
    times = numpy.unique(numpy.concatenate([numpy.geomspace(1e-6, span, 120), numpy.linspace(0, span, 40)]))

    def run(tolerance: float) -> tuple[Array, float, float, int]:
        """The windows are looked at as they come, and not kept."""
        states, k, count = numpy.empty((len(times), flow.plant.size)), 0, 0
        looking = 0.0
        started, used = time.perf_counter(), time.process_time()
        for window in collocated(flow, x, span, tolerance):
            count += 1
            looked = time.perf_counter()
            last = int(numpy.searchsorted(times, window.end * (1 + 1e-12), side="right"))
            if last > k:
                states[k:last] = window.states(times[k:last])
                k = last
            looking += time.perf_counter() - looked
        return states, time.perf_counter() - started - looking, time.process_time() - used - looking, count

    states, seconds, cpu, windows = run(1e-6)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    tighter, *_ = run(1e-8)
    largest = numpy.maximum(moduli(flow.plant, tighter), sized(flow.plant, x))
    error = float((numpy.abs(states - tighter) / largest).max())
    lines = sum(part[0] == "line" for part in flow.plant.slices)
    return {
        "compiled": COMPILED,
        "states": flow.plant.size,
        "lines": lines,
        "seconds": seconds,
        "cpu": cpu,
        "memory": memory,
        "windows": windows,
        "error": error,
    }


# --- the report ---------------------------------------------------------------------------------------------


def apart(compiled: bool, call: str) -> dict[str, Any]:
    """One measurement in a process of its own."""
    environment = {**os.environ, "CERTIFY_NUMBA": "1" if compiled else "0", "OPENBLAS_NUM_THREADS": "1"}
    code = f"import json; from tests.bench.simulation import *; print(json.dumps({call}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    print(call, "compiled" if compiled else "plain", json.dumps(found), file=sys.stderr)
    return found


def table(theirs: Any, runs: dict[str, Any]) -> list[str]:
    """Times at equal errors, and how many times as fast."""
    base = at_levels([(e, s) for e, s, _ in theirs])
    columns = {name: at_levels([(e, s) for e, s, _ in run["ours"]]) for name, run in runs.items()}
    rows = [
        "| error | scipy's Radau, s |" + "".join(f" {name}, s | times as fast |" for name in columns),
        "| ---: | ---: |" + " ---: | ---: |" * len(columns),
    ]
    for level, seconds in base.items():
        cells = "".join(
            f" {c[level]:.3g} | {seconds / c[level]:.1f} |" if level in c else " | |" for c in columns.values()
        )
        rows.append(f"| {level:.0e} | {seconds:.3g} |{cells}")
    measured = [f"Radau {e:.1e} in {s:.2f} s ({n:,} steps)" for e, s, n in theirs]
    for name, run in runs.items():
        measured += [f"{name} {e:.1e} in {s:.3f} s ({n:,} windows)" for e, s, n in run["ours"]]
    return [*rows, "", "Measured: " + "; ".join(measured) + "."]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--only", choices=("cigre", "middle", "large"))
    options = parser.parse_args()
    parts = [options.only] if options.only else ["cigre", "middle", "large"]
    version = f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores"
    lines = [
        "# Simulations: time at equal error, and large networks",
        "",
        f"`python tests/bench/simulation.py`, {version}. One run for each part; the cores were shared, so compare within a table only.",
        "An error is the largest of all states at 1,000 times (half of them on a logarithmic scale), relative to the largest",
        "modulus of the state's complex number; that of scipy's Radau is taken at its own steps, which spares it the error of",
        "its interpolation. Times between measured ones are interpolated, logarithms of both.",
    ]
    if "cigre" in parts:
        plain, fast = apart(False, "cigre(True)"), apart(True, "cigre(False)")
        lines += [
            "",
            f"## The CIGRE feeder, flat start, with all events, {plain['span']:g} s, {plain['states']} states",
            "",
        ]
        lines += ["Scipy's Radau has the exact Jacobian, dense. The exponential integrator without and with numba.", ""]
        lines += table(plain["theirs"], {"plain": plain, "compiled": fast})
    if "middle" in parts:
        lines += ["", "## 1,000 nodes", ""]
        lines += ["Scipy's Radau has the exact Jacobian, sparse, beside collocation without and with numba."]
        for mesh, start, span in (
            (False, "flat", 2e-3),
            (True, "flat", 1e-3),
            (False, "step", 5e-2),
            (True, "step", 2e-2),
        ):
            call = f"{mesh}, {start!r}, {span})"
            plain, fast = apart(False, f"middle(True, {call}"), apart(True, f"middle(False, {call}")
            title = (
                f"{'Mesh' if mesh else 'Tree'}, {'a flat start' if start == 'flat' else 'a step of loads'}, {span:g} s"
            )
            lines += ["", f"### {title}, {plain['states']:,} states", ""]
            lines += table(plain["theirs"], {"plain": plain, "compiled": fast})
    if "large" in parts:
        lines += ["", "## 10,000 nodes and lines, 1 s at a tolerance of 1e-6", ""]
        lines += [
            "Errors of states smaller than a hundredth of the largest natural size of their kind are relative to that;"
        ]
        lines += [
            "the reference is a run of the same integrator at 1e-8. Memory is the peak of the process, the network included.",
            "",
        ]
        lines += ["| start | numba | states | windows | s | of CPU, s | memory, MiB | error against 1e-8 |"]
        lines += ["| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
        for start in ("step", "flat"):
            for compiled in (False, True):
                found = apart(compiled, f"large({start!r})")
                lines.append(
                    f"| {'flat' if start == 'flat' else 'equilibrium, a step of loads'} | {'yes' if compiled else 'no'} "
                    f"| {found['states']:,} | {found['windows']:,} | {found['seconds']:.1f} | {found['cpu']:.1f} "
                    f"| {found['memory']:,.0f} | {found['error']:.1e} |"
                )
    text = "\n".join(lines) + "\n"
    print(text)
    if options.report:
        options.report.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
