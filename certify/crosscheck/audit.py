"""Energy by the implicit midpoint rule: it balances step by step to rounding, however coarse the steps (THEORY 12).

With m the middle of a step of length h from x to y, y - x = h f(m), so H(y) - H(x) = h <m, P f(m)> for every quadratic
H, exactly. The certificate says that this is -h psi(m). So what is left is the difference between the certificate's
matrices and the simulator's equations alone, whatever the error of the motion.
"""

from __future__ import annotations

import numpy

from certify.crosscheck.energy import Storage
from certify.crosscheck.findings import Finding
from certify.simulator.flow import free_flow
from certify.simulator.midpoint import audit
from certify.simulator.plant import Array

STEPS = 200
SECONDS = 2e-3
CLOSED = 1e-10  # of H at first


def audit_balance(storage: Storage, x: Array, sizes: Array) -> list[Finding]:
    """The largest difference of H + sum of h psi from H at first, as a share of it, on each island, from a state.

    Inverters are taken to be free of limits, as psi has them.
    """
    try:
        states = audit(free_flow(storage.plant), x, SECONDS, STEPS)
    except FloatingPointError:
        return []
    middles = (states[1:] + states[:-1]) / 2
    H = storage.of(states)
    lost = numpy.cumsum(storage.dissipated(middles), axis=0) * (SECONDS / STEPS)
    first = numpy.maximum(H.max(axis=0), storage.least(sizes))
    off = numpy.abs(H[1:] + lost - H[0]) / first
    worst = off.max(axis=0, initial=0.0)
    return [
        Finding("midpoint balance", name, float(worst[k]), CLOSED, "", SECONDS, states[-1])
        for k, name in enumerate(storage.first)
    ]
