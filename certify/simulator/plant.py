"""A microgrid as ordinary differential equations in floats, straight from Kirchhoff's laws (THEORY 1).

An independent witness: it shares the spec's data with the kernel, and no model. Control laws are written as they are
executed, with absolute voltages and currents; the kernel only knows deviations from an equilibrium. All that is linear
is stamped into sparse matrices, element by element; static loads and the limits of inverters stand beside them:

    x' = A x + b + G sat(u) - D I(V),    u = K x + k,    V = S x + s at the nodes with static loads.

Voltages and currents are complex, x_d + j x_q, in the frame that turns at w0; a state is one real array, the parts of
each complex number next to each other (`Plant.slices` has the places).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from certify.kernel.spec import (
    ConstantVoltage,
    Dgu,
    IdaPbc,
    LinearLoop,
    Microgrid,
    SeriesBranch,
    StateFeedback,
)
from certify.simulator.loads import StaticLoads
from certify.simulator.stamps import Stamps

Array = NDArray[numpy.floating[Any]]
Phasors = NDArray[numpy.complex128]
Law = Callable[[complex, complex, complex], complex]
Part = tuple[str, ...]  # ("voltage", node), ("current", node), ("integrator", node), ("loop", node), ("line", name), ..
# How parts are called, by their kind and names.
TITLES = {
    "voltage": "voltage at node {0}",
    "current": "current of the DGU at node {0}",
    "integrator": "integrator of the DGU at node {0}",
    "line": "current in line {0}",
    "branch": "current of R-L load {1} at node {0}",
    "loop": "state of the loop at node {0}",
}
I2 = numpy.eye(2)
J = numpy.array([[0.0, -1.0], [1.0, 0.0]])  # multiplication by j


@dataclass(frozen=True)
class Inverter:
    """A filter with its control law u(V, I, integrator) in volt, and the rate of the integrator (None without one).

    The law is affine; `gains` are its matrices in V, I and the integrator, each (2, 2). `tracking` is what an
    anti-windup adds to the rate of the integrator for each volt that the limits take off, (2, 2).
    """

    resistance_ohm: float
    inductance_henry: float
    capacitance_farad: float
    law: Law
    gains: tuple[Array, Array, Array]
    rate: Callable[[complex], complex] | None
    limits_volt: tuple[float, float] | None
    tracking: Array | None


class Plant:
    """x' = rates(x) for a whole microgrid, at the values of the spec (tolerances are of no account).

    `u` has two components for each inverter, in the order of `inverters`; `limits` is their bound in volt, infinite
    without one. `loaded` names the nodes with static loads. `numbers` may give other names than 0, 1, .. to the series
    R-L loads of a node, so that they keep theirs when some are off.
    """

    def __init__(self, grid: Microgrid, numbers: Mapping[str, Sequence[str]] | None = None) -> None:
        self.grid, self.w0 = grid, float(grid.w0)
        self.nodes = {node.name: k for k, node in enumerate(grid.nodes)}
        self.slices: dict[Part, slice] = {}
        self.size = 0
        self.loops: dict[str, Loop] = {}
        self.capacitances = _capacitances(grid)
        for node in grid.nodes:
            if node.dgu and isinstance(node.dgu.controller, LinearLoop):
                self.loops[node.name] = Loop(node.dgu, node.dgu.controller, self.capacitances[node.name], self.w0)
            else:
                self._place(("voltage", node.name), 2)
        self.inverters: dict[str, Inverter] = {}
        for node in grid.nodes:
            if node.dgu and node.name not in self.loops:
                self.inverters[node.name] = inverter = inverter_of(node.dgu)
                self._place(("current", node.name), 2)
                if inverter.rate:
                    self._place(("integrator", node.name), 2)
        # Lines, and series R-L loads, the other end of which is grounded: start, end, R + j w0 L, L.
        self.branches: dict[Part, tuple[str, str | None, complex, float]] = {}
        for line in grid.lines:
            self._add_branch(("line", line.name), line.branch, line.start, line.end)
        for node in grid.nodes:
            own = (numbers or {}).get(node.name)
            names = [str(k) for k in range(len(node.branches))] if own is None else own
            for k, branch in zip(names, node.branches, strict=True):
                self._add_branch(("branch", node.name, k), branch, node.name, None)
        for name, loop in self.loops.items():  # last: they may have an odd number of states
            self._place(("loop", name), len(loop.F))
        loaded = [node for node in grid.nodes if node.has_static_load]
        self.loaded, self.loads = [node.name for node in loaded], StaticLoads(loaded)
        bounds = [inverter.limits_volt or (numpy.inf, numpy.inf) for inverter in self.inverters.values()]
        self.limits = numpy.array(bounds).reshape(-1)
        self._stamp()

    def _place(self, part: Part, size: int) -> None:
        self.slices[part] = slice(self.size, self.size + size)
        self.size += size

    def _add_branch(self, part: Part, branch: SeriesBranch, start: str, end: str | None) -> None:
        R, L = float(branch.resistance_ohm), float(branch.inductance_henry)
        self.branches[part] = (start, end, complex(R, self.w0 * L), L)
        self._place(part, 2)

    def _stamp(self) -> None:
        """Write down Kirchhoff's laws: every element adds to the equations of the parts that it touches."""
        n, m, k = self.size, 2 * len(self.inverters), 2 * len(self.loaded)
        A, G, D, K, S = Stamps(n, n), Stamps(n, m), Stamps(n, k), Stamps(m, n), Stamps(k, n)
        b, u0, s = numpy.zeros(n), numpy.zeros(m), numpy.zeros(k)
        for name in self.nodes:
            if name in self.loops:
                loop, at = self.loops[name], self.slices["loop", name]
                A.add(at, at, loop.own)
                b[at] += loop.constant
            else:
                at = self.slices["voltage", name]
                A.add(at, at, -self.w0 * J)  # C V' = .. - j w0 C V
        for part, (start, end, impedance, L) in self.branches.items():
            at = self.slices[part]
            A.add(at, at, -_matrix(impedance) / L)
            for node, sign in ((start, 1), (end, -1)):
                if node is not None:  # L I' = V_start - V_end - Z I, and the current leaves the start
                    source, reads, offset = self.read_voltage(node)
                    A.add(at, source, sign * reads / L)
                    b[at] += sign * offset / L
                    A.add(source, at, -sign * self._enters(node))
        for j, (name, inverter) in enumerate(self.inverters.items()):
            at, V, u = self.slices["current", name], self.slices["voltage", name], slice(2 * j, 2 * j + 2)
            L = inverter.inductance_henry
            A.add(at, at, -_matrix(complex(inverter.resistance_ohm, self.w0 * L)) / L)
            A.add(at, V, -I2 / L)
            G.add(at, u, I2 / L)  # L I' = u - V - (R + j w0 L) I
            A.add(V, at, self._enters(name))
            u0[u] = _pair(inverter.law(0j, 0j, 0j))
            parts = [V, at]
            if inverter.rate:
                own = self.slices["integrator", name]
                parts.append(own)
                b[own] += _pair(inverter.rate(0j))
                A.add(own, V, numpy.array([_pair(inverter.rate(x) - inverter.rate(0j)) for x in (1, 1j)]).T)
            for where, gain in zip(parts, inverter.gains, strict=False):
                K.add(u, where, gain)
            if inverter.tracking is not None:  # the integrator follows what the limits take off: T (sat(u) - u)
                G.add(own, u, inverter.tracking)
                for where, gain in zip(parts, inverter.gains, strict=True):
                    A.add(own, where, -inverter.tracking @ gain)
                b[own] -= inverter.tracking @ u0[u]
        for j, name in enumerate(self.loaded):
            own = slice(2 * j, 2 * j + 2)
            source, reads, offset = self.read_voltage(name)
            S.add(own, source, reads)
            s[own] = offset
            D.add(source, own, self._enters(name))
        self.A, self.G, self.D, self.K, self.S = A.matrix(), G.matrix(), D.matrix(), K.matrix(), S.matrix()
        self.b, self.k, self.s = b, u0, s

    def read_voltage(self, name: str) -> tuple[slice, Array, Array]:
        """Where a node's voltage is read: the states, the matrix and the constant of V = matrix x + constant."""
        if name in self.loops:
            loop = self.loops[name]
            return self.slices["loop", name], loop.C, loop.reference
        return self.slices["voltage", name], I2, numpy.zeros(2)

    def _enters(self, name: str) -> Array:
        """What a current into a node does to the rates of the states there."""
        return self.loops[name].B if name in self.loops else I2 / self.capacitances[name]

    def get(self, x: Array, part: Part) -> complex:
        """The complex number of a part of a state."""
        return complex(*x[self.slices[part]])

    def voltage(self, x: Array, name: str) -> complex:
        """The voltage of a node; of a linear loop it is an output: the reference and what the states add."""
        at, reads, offset = self.read_voltage(name)
        return complex(*(reads @ x[at] + offset))

    @cached_property
    def voltages(self) -> tuple[csr_matrix, Array]:
        """The matrix and the constant of V = matrix x + constant, all nodes in the order of the spec."""
        rows, offsets = Stamps(2 * len(self.nodes), self.size), numpy.zeros(2 * len(self.nodes))
        for k, name in enumerate(self.nodes):
            at, reads, offset = self.read_voltage(name)
            rows.add(slice(2 * k, 2 * k + 2), at, reads)
            offsets[2 * k : 2 * k + 2] = offset
        return rows.matrix(), offsets

    # Of one state, (n,), or of many, (t, n).

    def asked(self, x: Array) -> Array:
        """The voltages u in volt that the control laws ask for, two for each inverter."""
        return (self.K @ x.T).T + self.k

    def loaded_voltages(self, x: Array) -> Array:
        """The voltages of the nodes in `loaded`, two for each, in volt."""
        return (self.S @ x.T).T + self.s

    def drawn(self, x: Array) -> Array:
        """The currents of the static loads in ampere, two for each node of `loaded`."""
        V = self.loaded_voltages(x)
        return to_pairs(self.loads.currents(to_phasors(numpy.atleast_2d(V)))).reshape(V.shape)

    def rates(self, x: Array) -> Array:
        """dx/dt in V/s, A/s and the like. Shape (n,) to (n,), or (t, n) to (t, n)."""
        applied = numpy.clip(self.asked(x), -self.limits, self.limits)
        return (self.A @ x.T).T + self.b + (self.G @ applied.T).T - (self.D @ self.drawn(x).T).T

    def load_slopes(self, x: Array) -> csr_matrix:
        """The part of the Jacobian of the rates that is due to static loads, with its sign. Shape (n, n)."""
        blocks = self.loads.slopes(to_phasors(self.S @ x + self.s))
        middle = Stamps(2 * len(blocks), 2 * len(blocks))
        for j, block in enumerate(blocks):
            middle.add(slice(2 * j, 2 * j + 2), slice(2 * j, 2 * j + 2), block)
        return csr_matrix(-self.D @ middle.matrix() @ self.S)

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
                x[at] = _pair(voltages[part[1]])
            elif part[0] == "line":
                x[at] = _pair(lines[part[1]])
            elif part[0] == "current":
                x[at] = _pair(inverters[part[1]])
            elif part[0] == "branch":
                x[at] = _pair(voltages[part[1]] / self.branches[part][2])
            elif part[0] == "loop":
                loop = self.loops[part[1]]
                # 0 = F x + B d and C x = V - reference: least squares for x and d together
                n = len(loop.F)
                equations = numpy.block([[loop.F, loop.raw], [loop.C, numpy.zeros((2, 2))]])
                off = numpy.array(_pair(voltages[part[1]])) - loop.reference
                x[at] = numpy.linalg.lstsq(equations, numpy.concatenate([numpy.zeros(n), off]), rcond=None)[0][:n]
        for name, inverter in self.inverters.items():
            if inverter.rate:
                V, current = voltages[name], inverters[name]
                wanted = V + complex(inverter.resistance_ohm, self.w0 * inverter.inductance_henry) * current
                x[self.slices["integrator", name]] = settled(inverter, V, current, wanted)
        return x


class Loop:
    """A linear loop x' = F x + B d, V = C x + reference beside the capacitances of its lines' legs.

    These take c (V' + j w0 V) off d, so x' has the mass 1 + c B C: `own` is F with that, `B` and `constant` likewise;
    `raw` is B as it is given.
    """

    def __init__(self, dgu: Dgu, loop: LinearLoop, capacitance_farad: float, w0: float) -> None:
        self.F, self.raw, self.C = (
            numpy.array([[float(x) for x in row] for row in a]) for a in (loop.F, loop.B, loop.C)
        )
        self.reference = numpy.array([*map(float, dgu.reference_volt)])
        self.legs_farad = capacitance_farad - (float(dgu.filter.capacitance_farad) if dgu.filter else 0.0)
        mass = numpy.eye(len(self.F)) + self.legs_farad * self.raw @ self.C
        self.own = numpy.linalg.solve(mass, self.F - w0 * self.legs_farad * self.raw @ J @ self.C)
        self.B = numpy.linalg.solve(mass, self.raw)
        self.constant = -w0 * self.legs_farad * self.B @ J @ self.reference


def to_phasors(pairs: Array) -> Phasors:
    """(d, q, d, q, ..) along the last axis as complex numbers, half as many."""
    return numpy.ascontiguousarray(pairs).view(complex)


def to_pairs(phasors: Phasors) -> Array:
    """The inverse of `to_phasors`."""
    return numpy.ascontiguousarray(phasors).view(float)


def _pair(z: complex) -> tuple[float, float]:
    return z.real, z.imag


def _matrix(z: complex) -> Array:
    """Multiplication by a complex number, as a real matrix."""
    return z.real * I2 + z.imag * J


def settled(inverter: Inverter, V: complex, current: complex, wanted: complex) -> Array:
    """The state of the integrator with which the control law asks for a voltage. Raises: LinAlgError if none does."""
    missing = wanted - inverter.law(V, current, 0j)
    return numpy.linalg.solve(inverter.gains[2], numpy.array(_pair(missing)))


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


def inverter_of(dgu: Dgu) -> Inverter:
    """The control law of a DGU as it is executed, with its own values of the plant."""
    if dgu.filter is None:
        raise ValueError("an inverter needs a filter")
    reference = complex(*map(float, dgu.reference_volt))
    limits = (float(dgu.limits_volt[0]), float(dgu.limits_volt[1])) if dgu.limits_volt else None
    R, L, C = map(float, (dgu.filter.resistance_ohm, dgu.filter.inductance_henry, dgu.filter.capacitance_farad))
    law, rate = _law(dgu.controller, reference)
    linear, _ = _law(dgu.controller, 0j)  # what is linear in it, without digits lost to the reference
    unit = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    gains = tuple(
        numpy.array([_pair(linear(*(complex(x) for x in e))), _pair(linear(*(1j * x for x in e)))]).T for e in unit
    )
    tracking = None
    time = dgu.anti_windup_second
    if time is not None and rate:
        # T K13 v' = .. + sat(u) - u; xi = -v has the sign of its own gain in `gains`
        tracking = numpy.linalg.inv(gains[2]) / float(time)
    return Inverter(R, L, C, law, (gains[0], gains[1], gains[2]), rate, limits, tracking)


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
