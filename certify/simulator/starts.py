"""The states in which a simulation may start."""

from __future__ import annotations

from collections import deque

import numpy

from certify.kernel.spec import Microgrid
from certify.simulator.flow import find_held_rest
from certify.simulator.plant import Array, Plant


def start_state(plant: Plant, start: str) -> Array | None:
    """A state to start from: "zero", "flat", or "equilibrium", which is None if none is found.

    Flat: every node with a DGU is at its reference, every other one at that of the nearest DGU by number of lines, the
    first of the spec among equals; no currents, and integrators at zero.
    """
    if start == "zero":
        return zero_state(plant)
    x = flat_state(plant)
    return x if start == "flat" else find_held_rest(plant, x)


def flat_state(plant: Plant) -> Array:
    """Voltages at the references, and nothing else: linear loops are at theirs."""
    x = numpy.zeros(plant.size)
    for name, V in flat_voltages(plant.grid).items():
        if ("voltage", name) in plant.slices:
            x[plant.slices["voltage", name]] = V.real, V.imag
    return x


def zero_state(plant: Plant) -> Array:
    """No voltage, no current; of a linear loop the least states that give it no voltage."""
    x = numpy.zeros(plant.size)
    for name, loop in plant.loops.items():
        x[plant.slices["loop", name]] = -numpy.linalg.pinv(loop.C) @ loop.reference
    return x


def flat_voltages(grid: Microgrid) -> dict[str, complex]:
    """The reference of the nearest DGU at every node, in volt."""
    neighbours: dict[str, list[str]] = {node.name: [] for node in grid.nodes}
    for line in grid.lines:
        neighbours[line.start].append(line.end)
        neighbours[line.end].append(line.start)
    found = {node.name: complex(*map(float, node.dgu.reference_volt)) for node in grid.nodes if node.dgu}
    # breadth first; the nodes of one distance in the order of the DGUs that reach them
    rank = {name: k for k, name in enumerate(found)}
    queue = deque(found)
    distance = dict.fromkeys(found, 0)
    while queue:
        name = queue.popleft()
        for other in neighbours[name]:
            if other not in distance:
                distance[other], rank[other], found[other] = distance[name] + 1, rank[name], found[name]
                queue.append(other)
            elif distance[other] == distance[name] + 1 and rank[name] < rank[other]:
                rank[other], found[other] = rank[name], found[name]
    return found
