"""The smooth motion of a microgrid between switchings, and the state in which it rests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from certify.simulator.plant import Array, Plant

NEWTON_STEPS = 40
HALVINGS = 30
ROUNDS = 20  # of choosing anew which inverters are at their limits


@dataclass(frozen=True)
class Flow:
    """x' = A x + b - D I(V): each component of each inverter is free, or held at its upper or lower limit.

    `held` has 0, 1 or -1 for each component of u. That a limit selects another flow is not looked after here: see
    `flow_at`, and `motion`.
    """

    plant: Plant
    held: Array

    @cached_property
    def A(self) -> csr_matrix:
        free = (self.held == 0).astype(float)
        return csr_matrix(self.plant.A + self.plant.G.multiply(free) @ self.plant.K)

    @cached_property
    def b(self) -> Array:
        free = self.held == 0
        constant = numpy.where(free, self.plant.k, self.held * numpy.where(free, 0.0, self.plant.limits))
        return self.plant.b + self.plant.G @ constant

    def rates(self, x: Array) -> Array:
        """dx/dt. Shape (n,) to (n,)."""
        return self.A @ x + self.b - self.plant.D @ self.plant.drawn(x)

    def jacobian(self, x: Array) -> csr_matrix:
        """d rates / dx, sparse, of shape (n, n)."""
        return csr_matrix(self.A + self.plant.load_slopes(x))


def free_flow(plant: Plant) -> Flow:
    """The flow without limits."""
    return Flow(plant, numpy.zeros(len(plant.limits)))


def flow_at(plant: Plant, x: Array) -> Flow:
    """The flow that the limits select in a state."""
    u = plant.asked(x)
    return Flow(plant, numpy.where(u > plant.limits, 1.0, numpy.where(u < -plant.limits, -1.0, 0.0)))


def find_held_rest(plant: Plant, guess: Array) -> Array | None:
    """An equilibrium with inverters at their limits where it asks for more, or None if none is found."""
    flow, x = free_flow(plant), guess
    for _ in range(ROUNDS):
        found = find_rest(flow, x)
        if found is None:
            return None
        x = found
        new = flow_at(plant, x)
        if numpy.array_equal(new.held, flow.held):
            return x
        flow = new
    return None


def find_rest(flow: Flow, guess: Array, accuracy: float = 1e-13) -> Array | None:
    """An equilibrium of a flow by Newton's method with halved steps, or None if that does not get there.

    `accuracy` is that of the states, relative to the largest of each kind of Newton's last step.
    """
    x = guess.astype(float)
    scale = numpy.maximum(numpy.abs(guess), 1e-3 * max(1.0, float(numpy.abs(guess).max(initial=0.0))))
    rates = flow.rates(x)
    for _ in range(NEWTON_STEPS):
        try:
            solver = splu(csc_matrix(flow.jacobian(x)))
        except (RuntimeError, ValueError):  # singular, or not finite
            return None
        step = -solver.solve(rates)
        if not numpy.isfinite(step).all():
            return None
        size, best = 1.0, float(numpy.abs(step / scale).max())
        for _ in range(HALVINGS):
            trial = x + size * step
            new = flow.rates(trial)
            if numpy.isfinite(new).all():
                remaining = float(numpy.abs(solver.solve(new) / scale).max())
                if remaining < best or best < accuracy:
                    break
            size /= 2
        else:
            return x if best < 1e-9 else None
        x, rates = trial, new
        scale = numpy.maximum(numpy.abs(x), scale)
        if best < accuracy:
            return x
    return None
