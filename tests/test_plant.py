"""The equations of the simulator against those of the kernel, which share no code: both must describe one network."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy
import pytest
from scipy.integrate import solve_ivp

from certify.certificate import prove
from certify.inputs import decode_all
from certify.kernel.claims import Context
from certify.kernel.data import Data
from certify.kernel.proofs import full_storage
from certify.kernel.rules import storage_at
from certify.kernel.spec import LinearLoop, Microgrid, Node
from certify.rests import read_rest
from certify.simulator.plant import Plant
from tests.bench.networks import microgrid
from tests.conftest import ROOT, SPECS
from tests.test_equilibrium import oscillator


def rest_of(grid: Microgrid, data: bytes) -> tuple[Plant, numpy.ndarray]:
    """The state in which the kernel's proved equilibria put the simulator."""
    plant = Plant(grid)
    found = [
        read_rest(c) for c in prove(data).verdict.claims if c.id.startswith("equilibrium/") and c.status == "proved"
    ]
    merged: list[dict[str, complex]] = [{}, {}, {}]
    for rest in found:
        for part, more in zip(merged, (rest.voltages, rest.lines, rest.inverters), strict=True):
            part.update(more)
    return plant, plant.at_rest(*merged)


def without_limits(node: Node) -> Node:
    """Nor static loads: what is left is linear."""
    dgu = node.dgu and replace(node.dgu, limits_volt=None)
    return replace(node, dgu=dgu, loads=(), band_volt=None, current=None)


# With tolerances the figures of a proof are middles of balls, and no state of any one network.
@pytest.mark.parametrize("path", [p for p in SPECS if "tolerances" not in p.stem], ids=lambda p: p.stem)
def test_the_kernels_equilibrium_is_one_of_the_simulator(path: Path) -> None:
    data = path.read_bytes()
    plant, x = rest_of(decode_all(data), data)
    # rates are compared with what the largest of their terms could make of the state
    scale = numpy.abs(plant.jacobian(x)) @ numpy.abs(x)
    assert (numpy.abs(plant.rates(x)) <= 1e-9 * scale + 1e-6).all()


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.stem)
def test_the_kernels_dgus_are_those_of_the_simulator(path: Path) -> None:
    """F of every port is the block of the Jacobian of its own states, in a network without static loads."""
    data = path.read_bytes()
    grid = decode_all(data)
    bare = replace(grid, nodes=tuple(without_limits(n) for n in grid.nodes))
    plant, context = Plant(bare), Context(grid)
    x = numpy.array([17.0 + 3 * k for k in range(plant.size)])
    J = plant.jacobian(x, 1e-3)  # linear without loads, so a large step is exact
    for name, node in context.nodes.items():
        if node.dgu is None:
            continue
        F = numpy.array([[float(v) for v in row] for row in context.port(name).F])
        parts = (
            [("loop", name)] if isinstance(node.dgu.controller, LinearLoop) else [("voltage", name), ("current", name)]
        )
        if ("integrator", name) in plant.slices:
            parts.append(("integrator", name))
        at = numpy.concatenate([numpy.arange(plant.size)[plant.slices[part]] for part in parts])
        own = J[numpy.ix_(at, at)]
        if ("integrator", name) in plant.slices and getattr(node.dgu.controller, "ki", None):
            own[:, 4:] *= -1  # xi = -v: the simulator integrates V - V* there
            own[4:, :] *= -1
        assert numpy.allclose(own, F, rtol=1e-7, atol=1e-7 * numpy.abs(F).max(axis=1, keepdims=True))


def storage(data: bytes, grid: Microgrid, plant: Plant) -> numpy.ndarray:
    """The matrix of H in the states of the simulator, from the proofs of the certificate."""
    document = json.loads(prove(data).data)
    context = Context(grid)
    H = numpy.zeros((plant.size, plant.size))
    for part, at in plant.slices.items():
        k = numpy.arange(plant.size)[at]
        if part[0] == "voltage" and context.nodes[part[1]].dgu is None:
            H[k, k] = plant.capacitances[part[1]]
        elif part[0] == "line":
            H[k, k] = float(next(x for x in grid.lines if x.name == part[1]).branch.inductance_henry)
        elif part[0] == "branch":
            H[k, k] = float(context.nodes[part[1]].branches[int(part[2])].inductance_henry)
    for claim in document["claims"]:
        if claim["id"].startswith("dgu/"):
            name = claim["id"].removeprefix("dgu/")
            given = Data(document["proofs"][claim["proof"]]["storage"]).matrix()
            port = context.port(name)
            P: Any = full_storage(port, given) if claim["rule"] == "quadratic-storage" else storage_at(port, given)
            parts = [
                p
                for p in (("loop", name), ("voltage", name), ("current", name), ("integrator", name))
                if p in plant.slices
            ]
            at = numpy.concatenate([numpy.arange(plant.size)[plant.slices[p]] for p in parts])
            dense = numpy.array([[float(v) for v in row] for row in P])
            if hasattr(context.nodes[name].dgu.controller, "ki"):  # type: ignore[union-attr]
                dense[:, 4:] *= -1
                dense[4:, :] *= -1
            H[numpy.ix_(at, at)] = dense
    return H


@pytest.mark.parametrize(
    "name", ["two-inverters.toml", "custom-loop.json", "wrong-inductance.toml", "saturating-inverter.toml"]
)
def test_storage_falls_along_motion_inside_the_region(name: str) -> None:
    """From random states on H = 0.9 c the storage does not grow, and the motion comes back."""
    data = (ROOT / "specs" / name).read_bytes()
    grid = decode_all(data)
    plant, rest = rest_of(grid, data)
    H = storage(data, grid, plant)
    facts = {n: v for c in prove(data).verdict.claims if c.id.startswith("region/") for n, v, _ in c.facts}
    level = float(facts["level c of the storage"])
    rng = numpy.random.default_rng(5)
    for _ in range(1 if name == "two-inverters.toml" else 2):  # that one is stiff
        off = numpy.linalg.solve(numpy.linalg.cholesky(H).T, rng.normal(size=plant.size))
        off *= numpy.sqrt(0.9 * level / (off @ H @ off / 2))
        done = solve_ivp(lambda _, x: plant.rates(x), (0, 0.01), rest + off, method="Radau", rtol=1e-8, atol=1e-9)
        assert done.success
        values = [(x - rest) @ H @ (x - rest) / 2 for x in done.y.T]
        assert all(b <= a + 1e-6 * level for a, b in pairwise(values))
        assert values[-1] < values[0]


def test_a_generated_mesh_too() -> None:
    data = microgrid(30, mesh=True)
    plant, x = rest_of(decode_all(data), data)
    scale = numpy.abs(plant.jacobian(x)) @ numpy.abs(x)
    assert (numpy.abs(plant.rates(x)) <= 1e-9 * scale + 1e-6).all()


@pytest.mark.parametrize(("ki", "load", "recovers"), [(1000, "rl", False), (100, "rl", True), (1000, "static", True)])
def test_an_inverter_whose_extreme_modes_are_passive_may_oscillate(ki: int, load: str, recovers: bool) -> None:
    """From zero, with limits and integrators that wind up: 47.6 kV of error for ever, or back to rest (THEORY 7)."""
    grid = decode_all(oscillator(ki, load))
    plant, end = Plant(grid), 0.4
    done = solve_ivp(
        lambda _, x: plant.rates(x), (0, end), numpy.zeros(plant.size), method="LSODA", rtol=1e-6, atol=1e-4
    )
    late = done.t > 0.8 * end
    error = numpy.abs(done.y[0][late] + 1j * done.y[1][late] - (13_000 + 16_000j)).max()
    assert (error < 200) if recovers else error == pytest.approx(47_600, rel=0.01)
