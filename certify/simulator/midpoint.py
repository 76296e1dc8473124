"""The implicit midpoint rule with a fixed step: an audit of energies, and not a reference (THEORY 12).

It keeps every quadratic invariant of a motion, so of a linear network without losses the energy up to round-off; of
one with losses it balances the energy with what is dissipated at the midpoints, step by step. Its phase is right to
second order only: at steps that do not resolve the ringing of lines it is 12 % off in the states, whatever the energy
says.
"""

from __future__ import annotations

import numpy

from certify.simulator.flow import Flow
from certify.simulator.nodal import Nodal
from certify.simulator.plant import Array

ITERATIONS = 50
SETTLED = 1e-15  # of the largest current of a load: a change with which iterations end
ROUND_OFF = 1e-11  # of the same: a change that is as good, if the next one is no smaller
STALE = 6  # iterations after which the slopes of the loads are taken anew


def audit(flow: Flow, x: Array, span: float, steps: int) -> Array:
    """The states at the ends of `steps` equal steps over a span in s, from x (n,). Shape (steps + 1, n).

    The equations of a step are solved to round-off. Raises: FloatingPointError if their iteration does not settle.
    """
    nodal, h = Nodal(flow), span / steps
    kept, local = nodal.kept, nodal.local
    states = numpy.empty((steps + 1, len(x)))
    states[0] = x
    loads = nodal.loads(x[kept])
    system = nodal.shifted(complex(2 / h), loads)
    for k in range(steps):
        x = states[k]
        # (2 / h - J) (m - x) = f(x) - D (R(m) - R(x)) for the midpoint m
        rates, at = flow.rates(x), x[kept]
        start = loads.remainder(nodal.voltages(at[None, :]))
        size = 1.0 + float(numpy.abs(flow.plant.loads.currents(nodal.voltages(at[None, :]))).max(initial=0.0))
        half, rest = system.solve(rates[kept], rates[local])
        drawn = numpy.zeros(2 * start.shape[1])
        count, before = 0, numpy.inf
        while True:
            count += 1
            new = (loads.remainder(nodal.voltages((at + half)[None, :])) - start)[0].view(float)
            change = float(numpy.abs(new - drawn).max(initial=0.0))
            if not numpy.isfinite(change) or count > ITERATIONS:
                raise FloatingPointError("a step of the midpoint rule does not settle")
            if change <= SETTLED * size or before <= change <= ROUND_OFF * size:
                break
            before = change
            half, rest = system.solve(rates[kept] - nodal.D @ new, rates[local])
            drawn = new
        states[k + 1, kept], states[k + 1, local] = x[kept] + 2 * half, x[local] + 2 * rest
        if count > STALE:
            loads = nodal.loads(states[k + 1, kept])
            system = nodal.shifted(complex(2 / h), loads)
    return states
