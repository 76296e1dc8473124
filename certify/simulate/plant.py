"""A microgrid as ordinary differential equations in floats, straight from Kirchhoff's laws (THEORY 1).

An independent witness: it shares the spec's data with the kernel, and no model. Control laws are written as they are
executed, with absolute voltages and currents; the kernel only knows deviations from an equilibrium.

Voltages and currents are complex, x_d + j x_q, in the frame that turns at w0; a state is one real array, the parts of
each complex number next to each other (`Plant.slices` has the places).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy
from numpy.typing import NDArray

from certify.kernel.spec import (
    ConstantVoltage,
    Dgu,
    ExpLoad,
    IdaPbc,
    LinearLoop,
    Microgrid,
    Node,
    SeriesBranch,
    StateFeedback,
    ZipLoad,
)

Array = NDArray[numpy.float64]
Phasors = NDArray[numpy.complex128]
Law = Callable[[complex, complex, complex], complex]
Part = tuple[str, ...]  # ("voltage", node), ("current", node), ("integrator", node), ("loop", node), ("line", name), ..


@dataclass(frozen=True)
class Inverter:
    """A filter with its control law u(V, I, integrator) in volt, and the rate of the integrator (None without one)."""

    resistance_ohm: float
    inductance_henry: float
    law: Law
    rate: Callable[[complex], complex] | None
    limits_volt: tuple[float, float] | None


class Plant:
    """x' = rates(x) for a whole microgrid, at the values of the spec (tolerances are of no account)."""

    def __init__(self, grid: Microgrid) -> None:
        self.grid, self.w0 = grid, float(grid.w0)
        self.nodes = {node.name: k for k, node in enumerate(grid.nodes)}
        self.slices: dict[Part, slice] = {}
        self.size = 0
        self.loops = {
            n.name: n.dgu.controller for n in grid.nodes if n.dgu and isinstance(n.dgu.controller, LinearLoop)
        }
        for node in grid.nodes:
            if node.name not in self.loops:
                self._place(("voltage", node.name), 2)
        self.inverters: dict[str, Inverter] = {}
        for node in grid.nodes:
            if node.dgu and node.name not in self.loops:
                self.inverters[node.name] = inverter = _inverter(node.dgu)
                self._place(("current", node.name), 2)
                if inverter.rate:
                    self._place(("integrator", node.name), 2)
        for name, loop in self.loops.items():
            self._place(("loop", name), len(loop.F))
        # Lines, and series R-L loads, the other end of which is grounded: start, end, R + j w0 L, L.
        self.branches: dict[Part, tuple[str, str | None, complex, float]] = {}
        for line in grid.lines:
            self._add_branch(("line", line.name), line.branch, line.start, line.end)
        for node in grid.nodes:
            for k, branch in enumerate(node.branches):
                self._add_branch(("branch", node.name, str(k)), branch, node.name, None)
        self.capacitances = _capacitances(grid)
        self.loads = {node.name: static_load(node) for node in grid.nodes if node.has_static_load}
        self._loop_parts = {name: self._loop(name) for name in self.loops}

    def _place(self, part: Part, size: int) -> None:
        self.slices[part] = slice(self.size, self.size + size)
        self.size += size

    def _add_branch(self, part: Part, branch: SeriesBranch, start: str, end: str | None) -> None:
        R, L = float(branch.resistance_ohm), float(branch.inductance_henry)
        self.branches[part] = (start, end, complex(R, self.w0 * L), L)
        self._place(part, 2)

    def get(self, x: Array, part: Part) -> complex:
        """The complex number of a part of a state."""
        return complex(*x[self.slices[part]])

    def voltage(self, x: Array, name: str) -> complex:
        """The voltage of a node; of a linear loop it is an output: the reference and what the states add."""
        if name not in self.loops:
            return self.get(x, ("voltage", name))
        C, reference = self._loop_parts[name][2:4]
        d, q = C @ x[self.slices["loop", name]]
        return complex(reference + complex(d, q))

    def terminal(self, x: Array, name: str) -> complex:
        """The voltage that an inverter applies, each axis within its limits."""
        inverter = self.inverters[name]
        v = self.get(x, ("integrator", name)) if inverter.rate else 0j
        u = inverter.law(self.voltage(x, name), self.get(x, ("current", name)), v)
        if inverter.limits_volt is None:
            return u
        d, q = inverter.limits_volt
        return complex(min(max(u.real, -d), d), min(max(u.imag, -q), q))

    def rates(self, x: Array) -> Array:
        """dx/dt in V/s, A/s and the like. Shape (n,) to (n,)."""
        out = numpy.empty(self.size)
        V = {name: self.voltage(x, name) for name in self.nodes}
        into = dict.fromkeys(self.nodes, 0j)  # what flows into each node from lines, less what its loads take
        for part, (start, end, impedance, L) in self.branches.items():
            current = self.get(x, part)
            into[start] -= current
            if end is not None:
                into[end] += current
            drop = V[start] - (V[end] if end is not None else 0)
            self._set(out, part, (drop - impedance * current) / L)
        for name, load in self.loads.items():
            into[name] -= load(V[name])
        for name, inverter in self.inverters.items():
            current = self.get(x, ("current", name))
            into[name] += current
            drop = (inverter.resistance_ohm + 1j * self.w0 * inverter.inductance_henry) * current
            self._set(out, ("current", name), (self.terminal(x, name) - V[name] - drop) / inverter.inductance_henry)
            if inverter.rate:
                self._set(out, ("integrator", name), inverter.rate(V[name]))
        for name in self.nodes:
            if name in self.loops:
                F, B, _, _, mass, shunt = self._loop_parts[name]
                d = into[name] - shunt * V[name]
                at = self.slices["loop", name]
                out[at] = numpy.linalg.solve(mass, F @ x[at] + B @ numpy.array([d.real, d.imag]))
            else:
                c = self.capacitances[name]
                self._set(out, ("voltage", name), into[name] / c - 1j * self.w0 * V[name])
        return out

    def _set(self, out: Array, part: Part, value: complex) -> None:
        out[self.slices[part]] = value.real, value.imag

    def _loop(self, name: str) -> tuple[Any, ...]:
        """F, B, C, the reference, and what the capacitance beside the loop does: x' has the mass 1 + c B C."""
        node = self.grid.nodes[self.nodes[name]]
        loop, dgu = self.loops[name], node.dgu
        F, B, C = (numpy.array([[float(x) for x in row] for row in a]) for a in (loop.F, loop.B, loop.C))
        inside = float(dgu.filter.capacitance_farad) if dgu and dgu.filter else 0.0
        legs = self.capacitances[name] - inside
        reference = complex(*map(float, dgu.reference_volt)) if dgu else 0j
        return F, B, C, reference, numpy.eye(len(F)) + legs * B @ C, 1j * self.w0 * legs

    def jacobian(self, x: Array, share: float = 1e-6) -> Array:
        """d rates / d x by central differences, steps relative to the size of each state. Shape (n, n)."""
        result = numpy.empty((self.size, self.size))
        for k in range(self.size):
            step = share * max(abs(x[k]), 1.0)
            up, down = x.copy(), x.copy()
            up[k] += step
            down[k] -= step
            result[:, k] = (self.rates(up) - self.rates(down)) / (up[k] - down[k])
        return result

    def at_rest(
        self, voltages: Mapping[str, complex], lines: Mapping[str, complex], inverters: Mapping[str, complex]
    ) -> Array:
        """The state of an equilibrium, from node voltages, line currents and currents of inverters.

        Integrators are set so that the control laws ask for V + (R + j w0 L) I; a linear loop is at rest if F is
        nonsingular. Raises: numpy.linalg.LinAlgError if a gain of an integrator or F is singular.
        """
        x = numpy.zeros(self.size)
        for part, at in self.slices.items():
            if part[0] == "voltage":
                self._set(x, part, voltages[part[1]])
            elif part[0] == "line":
                self._set(x, part, lines[part[1]])
            elif part[0] == "current":
                self._set(x, part, inverters[part[1]])
            elif part[0] == "branch":
                self._set(x, part, voltages[part[1]] / self.branches[part][2])
            elif part[0] == "loop":
                F, B, C, reference, _, _ = self._loop_parts[part[1]]
                # 0 = F x + B d and C x = V - reference: least squares for x and d together
                n = len(F)
                A = numpy.block([[F, B], [C, numpy.zeros((2, 2))]])
                off = voltages[part[1]] - reference
                x[at] = numpy.linalg.lstsq(A, numpy.array([0.0] * n + [off.real, off.imag]), rcond=None)[0][:n]
        for name, inverter in self.inverters.items():
            if inverter.rate:
                V, current = voltages[name], inverters[name]
                wanted = V + (inverter.resistance_ohm + 1j * self.w0 * inverter.inductance_henry) * current
                base = inverter.law(V, current, 0j)
                gain = numpy.array([_pair(inverter.law(V, current, unit) - base) for unit in (1 + 0j, 1j)]).T
                self._set(x, ("integrator", name), complex(*numpy.linalg.solve(gain, _pair(wanted - base))))
        return x


def _pair(z: complex) -> tuple[float, float]:
    return z.real, z.imag


def _apply(K: Any, z: complex) -> complex:
    """A real 2x2 matrix times (d, q)."""
    return complex(float(K[0][0]) * z.real + float(K[0][1]) * z.imag, float(K[1][0]) * z.real + float(K[1][1]) * z.imag)


def _capacitances(grid: Microgrid) -> dict[str, float]:
    """Farad at each node: its own shunt, its filter's, and half of each line's, unless the spec neglects those."""
    total = {}
    for node in grid.nodes:
        own = node.dgu.filter.capacitance_farad if node.dgu and node.dgu.filter else 0
        total[node.name] = float(node.capacitance_farad + own)
    bare = {node.name for node in grid.nodes if node.dgu and not grid.line_legs_at_dgus}
    for line in grid.lines:
        for end in (line.start, line.end):
            if end not in bare:
                total[end] += float(line.capacitance_farad) / 2
    return total


def _inverter(dgu: Dgu) -> Inverter:
    """The control law of a DGU as it is executed, with its own values of the plant."""
    if dgu.filter is None:
        raise ValueError("an inverter needs a filter")
    reference = complex(*map(float, dgu.reference_volt))
    limits = (float(dgu.limits_volt[0]), float(dgu.limits_volt[1])) if dgu.limits_volt else None
    R, L = float(dgu.filter.resistance_ohm), float(dgu.filter.inductance_henry)
    law, rate = _law(dgu.controller, reference)
    return Inverter(R, L, law, rate, limits)


def _law(controller: Any, reference: complex) -> tuple[Law, Callable[[complex], complex] | None]:
    """The control law u(V, I, integrator), and the rate of the integrator."""
    if isinstance(controller, ConstantVoltage):
        return lambda *_: reference, None
    if isinstance(controller, StateFeedback):
        return _state_feedback(controller), (lambda V: reference - V) if controller.K13 is not None else None
    if isinstance(controller, IdaPbc):
        return _ida_pbc(controller, reference), lambda V: V - reference
    raise TypeError(f"no control law for {type(controller).__name__}")


def _state_feedback(law: StateFeedback) -> Law:
    """u = K11 V + K12 I + K13 v with v' = V* - V."""

    def u(V: complex, current: complex, v: complex) -> complex:
        total = _apply(law.K11, V) + _apply(law.K12, current)
        return total + _apply(law.K13, v) if law.K13 is not None else total

    return u


def _ida_pbc(law: IdaPbc, reference: complex) -> Law:
    """The port-Hamiltonian law with integral action (THEORY 4): xi' = V - V*, axis by axis."""
    R, L, C = (float(x) for x in (law.design.resistance_ohm, law.design.inductance_henry, law.design.capacitance_farad))
    w0 = float(law.design_w0)
    alpha, nu, ki = (tuple(map(float, gains)) for gains in (law.alpha, law.nu, law.ki))

    def scaled(factors: tuple[float, ...], z: complex) -> complex:
        return complex(factors[0] * z.real, factors[1] * z.imag)

    ratio = (alpha[0] / nu[0], alpha[1] / nu[1])

    def u(V: complex, current: complex, xi: complex) -> complex:
        off = V - reference
        # the desired current carries the capacitor at the reference: I_d + w0 C V*_q, I_q - w0 C V*_d
        inner = current - 1j * w0 * C * reference
        return (
            scaled(ratio, inner + scaled(ki, xi))
            - scaled(nu, off)
            + (R + 1j * w0 * L) * current
            + V
            - L * scaled(ki, off)
        )

    return u


def static_load(node: Node) -> Callable[[complex], complex]:
    """The current in ampere that all static loads of a node draw at a voltage: (P - jQ) / v^2 V, summed up."""
    parts = [_power_law(load) for load in node.loads]
    current = _current_law(node) if node.current else None

    def drawn(V: complex) -> complex:
        total = current(V) if current else 0j
        v = abs(V)
        for power, cutoff in parts:
            at = max(v, cutoff)
            if at:  # no voltage, no direction of a current
                total += power(at).conjugate() / at**2 * V
        return total

    return drawn


def _power_law(load: ZipLoad | ExpLoad) -> tuple[Callable[[float], complex], float]:
    """P + jQ in VA at a voltage, and the voltage below which the load is the impedance that it is there."""
    cutoff = float(load.cutoff_volt) if load.cutoff_volt is not None else 0.0
    if isinstance(load, ZipLoad):
        Y, I0, P = (complex(*map(float, pair)) for pair in (load.Y, load.I, load.P))
        return lambda v: Y * v * v + I0 * v + P, cutoff
    P0, Q0, V0 = float(load.P0_watt), float(load.Q0_var), float(load.V0_volt)
    np_, nq = float(load.np), float(load.nq)
    return lambda v: complex(P0 * (v / V0) ** np_, Q0 * (v / V0) ** nq), cutoff


def _current_law(node: Node) -> Callable[[complex], complex]:
    """A load given by formulas of its current, as numbers."""
    law = node.current.law if node.current else None
    if law is None:
        raise ValueError("no load of this node is given by its current")
    polynomials = [[(i, j, float(c)) for (i, j), c in p] for p in (*law.numerators, law.denominator)]

    def drawn(V: complex) -> complex:
        d, q, below = (sum(c * V.real**i * V.imag**j for i, j, c in p) for p in polynomials)
        return complex(d, q) / below

    return drawn
