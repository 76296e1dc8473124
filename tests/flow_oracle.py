"""A power flow of a spec by its numbers alone: an admittance matrix and Newton's method, DGUs as stiff sources.

Nothing here comes from the import or from a solver of the project: what a spec says is read from the decoded spec.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from certify.kernel.spec import ExpLoad, Microgrid, ZipLoad


def _power(load: ZipLoad | ExpLoad, v: float) -> tuple[complex, complex]:
    """P + jQ that a load draws at v volt, and the derivative by v."""
    if isinstance(load, ExpLoad):
        base, result, slope = float(load.V0_volt), [], []
        for size, exponent in ((load.P0_watt, load.np), (load.Q0_var, load.nq)):
            p, n = float(size), float(exponent)
            result.append(p * (v / base) ** n)
            slope.append(p * n * (v / base) ** (n - 1) / base if n else 0.0)
        return complex(*result), complex(*slope)
    y, i, p = (complex(float(pair[0]), float(pair[1])) for pair in (load.Y, load.I, load.P))
    return y * v * v + i * v + p, 2 * y * v + i


def flow(microgrid: Microgrid) -> dict[str, complex]:
    """Voltages of all nodes, from line to line. Raises: ArithmeticError if Newton does not get there."""
    names = [node.name for node in microgrid.nodes]
    at = {name: k for k, name in enumerate(names)}
    n, w = len(names), float(microgrid.w0)
    y: Any = np.zeros((n, n), complex)
    for line in microgrid.lines:
        a, b = at[line.start], at[line.end]
        series = 1 / complex(float(line.branch.resistance_ohm), w * float(line.branch.inductance_henry))
        leg = 0.5j * w * float(line.capacitance_farad)
        y[a, a] += series + leg
        y[b, b] += series + leg
        y[a, b] -= series
        y[b, a] -= series
    for node in microgrid.nodes:
        y[at[node.name], at[node.name]] += 1j * w * float(node.capacitance_farad)
    stiff = np.array([node.dgu is not None for node in microgrid.nodes])
    v: Any = np.zeros(n, complex)
    for k, node in enumerate(microgrid.nodes):
        if node.dgu is not None:
            v[k] = complex(*map(float, node.dgu.reference_volt))
    free = np.flatnonzero(~stiff)
    if not len(free):
        return dict(zip(names, map(complex, v), strict=True))
    v[free] = -np.linalg.solve(y[np.ix_(free, free)], y[np.ix_(free, np.flatnonzero(stiff))] @ v[stiff])
    for _ in range(40):
        current, by_d, by_q = y @ v, y.astype(complex), 1j * y
        for k in free:
            size = abs(v[k])
            for load in microgrid.nodes[k].loads:
                s, slope = _power(load, size)
                drawn = (s / v[k]).conjugate()
                current[k] += drawn
                for column, step in ((by_d, 1), (by_q, 1j)):
                    rate = (v[k].conjugate() * step).real / size
                    column[k, k] += ((slope * rate * v[k] - s * step) / v[k] ** 2).conjugate()
        off = current[free]
        rows = [by_d[np.ix_(free, free)], by_q[np.ix_(free, free)]]
        jacobian = np.block([[r.real for r in rows], [r.imag for r in rows]])
        change = np.linalg.solve(jacobian, -np.concatenate([off.real, off.imag]))
        step = change[: len(free)] + 1j * change[len(free) :]
        v[free] += step
        if np.abs(step / v[free]).max() < 1e-13:
            return dict(zip(names, map(complex, v), strict=True))
    raise ArithmeticError("Newton's method has not converged")
