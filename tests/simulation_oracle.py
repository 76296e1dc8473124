"""An oracle for simulations: the network from Kirchhoff's laws, integrated by scipy from event to event.

It shares the dataclasses of a spec with `certify`, and no equation: it does not read scenarios, does not split a spec into
phases, and writes its laws with absolute values. A run takes the document of a spec and a list of (time, changes); a
change is a tuple, such as

    ("connect-dgu", node), ("connect-dgu-discharged", node), ("disconnect-dgu", node), ("connect-line", name),
    ("disconnect-line", name), ("load-on", node, index), ("load-off", node, index), ("load-set", node, index, {..}),
    ("reference", node, [d, q]), ("controller", node, name).

Between events each way of being saturated (and of being above or below the cut-offs of loads) is a smooth system of its own:
an axis of a terminal voltage is free or held, and the integration stops and starts anew where that changes. The method is
DOP853 while it is cheap or the network rings, and Radau with the analytic Jacobian afterwards. Samples are not interpolated, but
integrated up to. The tolerance of a state is `rtol` times the largest modulus that its part has had so far.

States are real, d and q of each complex number next to each other, in the frame that turns at w0.
"""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import DOP853, Radau
from scipy.optimize import brentq

from certify.inputs import decode_all
from certify.kernel.currents import Bivariate
from certify.kernel.spec import ConstantVoltage, Dgu, ExpLoad, IdaPbc, LinearLoop, Microgrid, StateFeedback, ZipLoad
from tests.equilibrium_oracle import quantity

Vector = np.ndarray[Any, Any]
Part = tuple[str, ...]
Change = tuple[Any, ...]
Changes = Sequence[tuple[float, Sequence[Change]]]
Affine = tuple[Vector, Vector]  # M (2, n) and c (2,): the value M x + c

J = np.array([[0.0, -1.0], [1.0, 0.0]])
E = np.eye(2)
RTOL = 1e-12
SWITCH = 1e-11  # by how much of itself a limit is passed before a mode changes
CHEAP, DEAR = 15_000, 60_000  # steps of DOP853 that are taken without asking, and at most
RINGING, DEAD = 3e3, 30.0  # rad/s from which on an oscillation rings, and the e-folds after which it does no more
PROBES = np.linspace(0, 1, 9)[1:]  # where, within a step, limits are looked at


def load_document(path: str | Path) -> dict[str, Any]:
    """The document of a TOML or JSON spec; decimals stay text, so that they mean what they say."""
    text = Path(path).read_text()
    return json.loads(text) if text.lstrip().startswith("{") else tomllib.loads(text, parse_float=str)


# --- what is connected ------------------------------------------------------------------------------------------


@dataclass
class Bench:
    """A document that changes edit, and the names of what is off."""

    document: dict[str, Any]
    off: set[Change] = field(default_factory=set)  # ("dgu", node), ("line", name), ("load", node, index)

    def phase(self) -> Phase:
        return Phase(self.document, frozenset(self.off))

    def edit(self, change: Change) -> None:
        """Raises: ValueError for a change that is unknown, or that switches what is switched so already."""
        kind, *target = change
        if kind in ("load-set", "reference", "controller"):
            node = self.document["node"][target[0]]
            if kind == "load-set":
                node["load"][target[1]].update(target[2])
            else:
                node["dgu"][kind] = target[1]
            return
        switch = kind.removesuffix("-discharged")
        if switch not in SWITCHES:
            raise ValueError(f"unknown change: {change}")
        part, on = SWITCHES[switch]
        key = (part, *target)
        if on != (key in self.off):
            raise ValueError(f"{key} is so already")
        (self.off.remove if on else self.off.add)(key)


SWITCHES = {
    "connect-dgu": ("dgu", True),
    "disconnect-dgu": ("dgu", False),
    "connect-line": ("line", True),
    "disconnect-line": ("line", False),
    "load-on": ("load", True),
    "load-off": ("load", False),
}


def decode(document: Mapping[str, Any]) -> tuple[Microgrid, dict[str, float]]:
    """The microgrid of a document, without scenarios, and the anti-windup times of its DGUs, which are read here."""
    plain = {key: value for key, value in copy.deepcopy(dict(document)).items() if key != "scenario"}
    times = {}
    for name, node in plain["node"].items():
        raw = node.get("dgu", {}).pop("anti_windup", None)
        if raw is not None:
            times[name] = float(quantity(raw))
    return decode_all(json.dumps(plain).encode()), times


# --- the equations ----------------------------------------------------------------------------------------------


def turn(z: complex) -> Vector:
    """The matrix that multiplies by a complex number."""
    return np.array([[z.real, -z.imag], [z.imag, z.real]])


def floats(matrix: Iterable[Iterable[Any]]) -> Vector:
    return np.array([[float(x) for x in row] for row in matrix])


def diagonal(pair: Iterable[Any]) -> Vector:
    return np.diag([float(x) for x in pair])


def pair(values: Iterable[Any]) -> Vector:
    return np.array([float(x) for x in values])


@dataclass
class Inverter:
    """A filter R, L, C and u = KV V + KI I + Kx x + u0, with an integrator x' = sign (V - V*), none if Kx is None."""

    R: float
    L: float
    C: float
    KV: Vector
    KI: Vector
    Kx: Vector | None
    u0: Vector
    reference: Vector
    sign: float
    limits: Vector | None
    windup: float | None


def inverter_of(dgu: Dgu, windup: float | None) -> Inverter:
    law, reference = dgu.controller, pair(dgu.reference_volt)
    assert dgu.filter is not None
    R, L, C = (float(x) for x in (dgu.filter.resistance_ohm, dgu.filter.inductance_henry, dgu.filter.capacitance_farad))
    limits = None if dgu.limits_volt is None else pair(dgu.limits_volt)
    zero = np.zeros((2, 2))
    if isinstance(law, ConstantVoltage):
        return Inverter(R, L, C, zero, zero, None, reference, reference, 0.0, limits, None)
    if isinstance(law, StateFeedback):
        Kx = None if law.K13 is None else floats(law.K13)
        return Inverter(R, L, C, floats(law.K11), floats(law.K12), Kx, 0 * reference, reference, -1.0, limits, windup)
    assert isinstance(law, IdaPbc)
    own, w = law.design, float(law.design_w0)
    r, l, c = (float(x) for x in (own.resistance_ohm, own.inductance_henry, own.capacitance_farad))  # noqa: E741
    nu, ki = diagonal(law.nu), diagonal(law.ki)
    h = diagonal(law.alpha) @ np.linalg.inv(nu)
    KV = E - nu - l * ki
    u0 = -h @ (w * c * J) @ reference + (nu + l * ki) @ reference
    return Inverter(R, L, C, KV, h + r * E + w * l * J, h @ ki, u0, reference, 1.0, limits, windup)


@dataclass(frozen=True)
class Term:
    """coefficient max(v, cut)^exponent, a summand of the admittance of a load."""

    coefficient: complex
    exponent: float
    cut: int | None  # the number of the guard of its cut-off
    cut_volt: float


@dataclass
class Guard:
    """What divides modes: an axis of a terminal voltage M x + c at +-limit, or a load voltage |M x + c| at a cut-off."""

    kind: str  # "axis" or "cut"
    M: Vector
    c: Vector
    limit: float

    def value(self, x: Vector) -> float:
        y = self.M @ x + self.c
        return float(y[0]) if self.kind == "axis" else float(np.hypot(y[0], y[1]))

    def natural(self, x: Vector) -> int:
        value = self.value(x)
        if self.kind == "axis":
            return int(np.sign(value)) if abs(value) > self.limit else 0
        return int(value < self.limit)

    def violation(self, mode: int, x: Vector) -> float:
        """Positive where the mode must change."""
        value, slack = self.value(x), SWITCH * self.limit
        if self.kind == "cut":
            return (value - self.limit if mode else self.limit - value) - slack
        return (self.limit - mode * value if mode else abs(value) - self.limit) - slack

    def change(self, mode: int, x: Vector) -> int:
        if self.kind == "cut":
            return 1 - mode
        return 0 if mode else int(np.sign(self.value(x)))


class Phase:
    """The equations of what is connected: places of the parts, and for each mode x' = A x + b - G I_load(S x + s)."""

    def __init__(self, document: Mapping[str, Any], off: frozenset[Change]) -> None:
        self.document, self.off = document, off
        self.grid, self.windup = decode(document)
        grid, self.w = self.grid, float(self.grid.w0)
        self.nodes = {node.name: node for node in grid.nodes}
        self.dgus = {n.name: n.dgu for n in grid.nodes if n.dgu and ("dgu", n.name) not in off}
        self.loops = {name: dgu.controller for name, dgu in self.dgus.items() if isinstance(dgu.controller, LinearLoop)}
        self.inverters = {
            name: inverter_of(dgu, self.windup.get(name)) for name, dgu in self.dgus.items() if name not in self.loops
        }
        self.lines = {line.name: line for line in grid.lines if ("line", line.name) not in off}
        self.branches, self.static, self.laws = self._loads()
        self.capacitance = {name: self._capacitance(name) for name in self.nodes}
        self.at: dict[Part, slice] = {}
        self.size = 0
        for name in self.nodes:
            if name in self.loops:
                self._place(("loop", name), len(self.loops[name].F))
                continue
            self._place(("voltage", name), 2)
            if name in self.inverters:
                self._place(("current", name), 2)
                if self.inverters[name].Kx is not None:
                    self._place(("integrator", name), 2)
        for name in self.lines:
            self._place(("line", name), 2)
        for part in self.branches:
            self._place(part, 2)
        self._assemble()
        self._systems: dict[tuple[int, ...], System] = {}

    def _loads(self) -> tuple[dict[Part, Any], dict[str, list[Any]], dict[str, Any]]:
        """Series R-L loads by part, static loads by node, laws of currents by node: those that are on."""
        branches: dict[Part, Any] = {}
        static: dict[str, list[Any]] = {}
        laws: dict[str, Any] = {}
        for name, node in self.nodes.items():
            numbers = {"rl": 0, "static": 0}
            for index, raw in enumerate(self.document["node"][name].get("load", [])):
                on = ("load", name, index) not in self.off
                if raw["kind"] == "current":
                    if on:
                        assert node.current is not None
                        laws[name] = node.current.law
                    continue
                kind = "rl" if raw["kind"] == "rl" else "static"
                k = numbers[kind]
                numbers[kind] += 1
                if on and kind == "rl":
                    branches["branch", name, str(k)] = node.branches[k]
                elif on:
                    static.setdefault(name, []).append(node.loads[k])
        return branches, static, laws

    def _capacitance(self, name: str) -> float:
        """All capacitance at a node; of a linear loop only that beside its own."""
        total = float(self.nodes[name].capacitance_farad)
        if self.grid.line_legs_at_dgus or name not in self.dgus:
            total += sum(
                float(line.capacitance_farad) / 2
                for line in self.lines.values()
                for end in (line.start, line.end)
                if end == name
            )
        return total + (self.inverters[name].C if name in self.inverters else 0)

    def _place(self, part: Part, size: int) -> None:
        self.at[part] = slice(self.size, self.size + size)
        self.size += size

    def _pick(self, part: Part) -> Vector:
        return np.eye(self.size)[self.at[part]]

    def _assemble(self) -> None:
        """Everything linear, with terminal voltages left open: x' = A x + b + sum over inverters of T sat(u) + W u."""
        n = self.size
        A, b = np.zeros((n, n)), np.zeros(n)
        V: dict[str, Affine] = {}
        for name in self.nodes:
            if name in self.loops:
                reference = pair(self.dgus[name].reference_volt)
                V[name] = floats(self.loops[name].C) @ self._pick(("loop", name)), reference
            else:
                V[name] = self._pick(("voltage", name)), np.zeros(2)
        into = {name: np.zeros((2, n)) for name in self.nodes}
        ends = {("line", name): (line.start, line.end, line.branch) for name, line in self.lines.items()}
        series: dict[Part, Any] = {**ends, **{part: (part[1], None, x) for part, x in self.branches.items()}}
        for part, (start, end, branch) in series.items():
            R, L, me = float(branch.resistance_ohm), float(branch.inductance_henry), self.at[part]
            into[start] -= self._pick(part)
            A[me] += (V[start][0] - (R * E + self.w * L * J) @ self._pick(part)) / L
            b[me] += V[start][1] / L
            if end is not None:
                into[end] += self._pick(part)
                A[me] -= V[end][0] / L
                b[me] -= V[end][1] / L
        self.guards: list[Guard] = []
        self.axes: dict[str, tuple[int, int]] = {}
        self.u: dict[str, Affine] = {}
        for name, inv in self.inverters.items():
            me = self.at["current", name]
            current = self._pick(("current", name))
            into[name] += current
            A[me] -= (V[name][0] + (inv.R * E + self.w * inv.L * J) @ current) / inv.L
            u = inv.KV @ V[name][0] + inv.KI @ current
            if inv.Kx is not None:
                place = self.at["integrator", name]
                u = u + inv.Kx @ self._pick(("integrator", name))
                A[place] += inv.sign * V[name][0]
                b[place] -= inv.sign * inv.reference
            self.u[name] = u, inv.u0
            if inv.limits is not None:
                self.axes[name] = (len(self.guards), len(self.guards) + 1)
                self.guards += [Guard("axis", u[k : k + 1], inv.u0[k : k + 1], inv.limits[k]) for k in (0, 1)]
        self.loaded = [name for name in self.nodes if name in self.static or name in self.laws]
        self.S = np.vstack([V[name][0] for name in self.loaded]) if self.loaded else np.zeros((0, n))
        self.s = np.concatenate([V[name][1] for name in self.loaded]) if self.loaded else np.zeros(0)
        self.G = np.zeros((n, 2 * len(self.loaded)))
        for name in self.nodes:
            c, charging = self.capacitance[name], self.w * self.capacitance[name] * J
            if name in self.loops:
                loop, me = self.loops[name], self.at["loop", name]
                F, B, C = floats(loop.F), floats(loop.B), floats(loop.C)
                mass = np.linalg.inv(np.eye(len(F)) + c * B @ C)
                A[me] += mass @ (F @ self._pick(("loop", name)) + B @ (into[name] - charging @ V[name][0]))
                b[me] -= mass @ B @ charging @ V[name][1]
                input_ = mass @ B
            else:
                me = self.at["voltage", name]
                A[me] += into[name] / c - self.w * J @ V[name][0]
                input_ = E / c
            if name in self.loaded:
                k = 2 * self.loaded.index(name)
                self.G[me, k : k + 2] = input_
        self.terms: list[list[Term]] = [self._terms(name, V[name]) for name in self.loaded]
        self.A, self.b, self.V = A, b, V
        if self.guards:
            rows = [np.vstack([g.M, 0 * g.M]) if g.kind == "axis" else g.M for g in self.guards]
            shifts = [np.append(g.c, 0.0) if g.kind == "axis" else g.c for g in self.guards]
            kinds = np.array([g.kind == "axis" for g in self.guards])
            self.fences = kinds, np.array([g.limit for g in self.guards]), np.vstack(rows), np.concatenate(shifts)

    def _terms(self, name: str, V: Affine) -> list[Term]:
        out = []
        for load in self.static.get(name, ()):
            cut, cut_volt = None, 0.0
            if load.cutoff_volt is not None:
                cut, cut_volt = len(self.guards), float(load.cutoff_volt)
                self.guards.append(Guard("cut", V[0], V[1], cut_volt))
            if isinstance(load, ZipLoad):
                rows = [
                    (complex(float(p), -float(q)), e)
                    for (p, q), e in zip((load.Y, load.I, load.P), (0.0, -1.0, -2.0), strict=True)
                ]
            else:
                assert isinstance(load, ExpLoad)
                v0, np_, nq = float(load.V0_volt), float(load.np), float(load.nq)
                rows = [(complex(float(load.P0_watt) / v0**np_), np_ - 2), (-1j * float(load.Q0_var) / v0**nq, nq - 2)]
            out += [Term(c, e, cut, cut_volt) for c, e in rows if c]
        return out

    def mode(self, x: Vector) -> tuple[int, ...]:
        return tuple(guard.natural(x) for guard in self.guards)

    def near(self, mode: tuple[int, ...], x: Vector, y: Vector, slope: Vector, span: float) -> list[int]:
        """The guards that a step from x to y, with this slope at its end, may have met in between; generously."""
        if not self.guards:
            return []
        axis, limit, M, c = self.fences
        signs = np.array(mode)
        at = M @ np.stack([x, y, y - x, span * slope], 1)
        at[:, :2] += c[:, None]
        sizes = np.hypot(at[0::2], at[1::2])  # of an axis, the second row is zero
        travel = 3 * (sizes[:, 2] + sizes[:, 3])
        along = np.where((axis & (signs != 0))[:, None], signs[:, None] * at[0::2, :2], sizes[:, :2])
        inside = np.where(axis, signs == 0, signs == 1)
        margin = np.where(inside, limit - along.max(1), along.min(1) - limit)
        return [int(k) for k in np.flatnonzero(margin < travel)]

    def system(self, mode: tuple[int, ...]) -> System:
        if mode not in self._systems:
            self._systems[mode] = System(self, mode)
        return self._systems[mode]

    def voltage(self, x: Vector, name: str) -> Vector:
        M, c = self.V[name]
        return M @ x + c

    def asked(self, x: Vector, name: str) -> Vector:
        """The terminal voltage that the law of an inverter asks for."""
        M, c = self.u[name]
        return M @ x + c

    def applied(self, x: Vector, name: str) -> Vector:
        u, limits = self.asked(x, name), self.inverters[name].limits
        return u if limits is None else np.clip(u, -limits, limits)


class System:
    """The smooth system of one mode of a phase."""

    def __init__(self, phase: Phase, mode: tuple[int, ...]) -> None:
        self.phase = phase
        A, b = phase.A.copy(), phase.b.copy()
        for name, inv in phase.inverters.items():
            (M, c), me = phase.u[name], phase.at["current", name]
            free, held = E, np.zeros(2)
            if inv.limits is not None:
                signs = np.array([mode[k] for k in phase.axes[name]])
                free, held = np.diag(1.0 - abs(signs)), signs * inv.limits
            A[me] += free @ M / inv.L
            b[me] += (free @ c + held) / inv.L
            if inv.Kx is not None and inv.windup is not None and inv.limits is not None:
                # u = .. + Kx x: the integrator makes up for what is cut off, sat(u) - u, within the time T.
                back = np.linalg.inv(inv.Kx) / inv.windup
                place = phase.at["integrator", name]
                A[place] += back @ ((free - E) @ M)
                b[place] += back @ ((free - E) @ c + held)
        self.A, self.b, self.S, self.s, self.G = A, b, phase.S, phase.s, phase.G
        m = len(phase.loaded)
        self.fixed = np.zeros(m, complex)
        powers: list[tuple[int, complex, float]] = []
        for k, terms in enumerate(phase.terms):
            for term in terms:
                if term.exponent == 0:
                    self.fixed[k] += term.coefficient
                elif term.cut is not None and mode[term.cut]:
                    self.fixed[k] += term.coefficient * term.cut_volt**term.exponent
                else:
                    powers.append((k, term.coefficient, term.exponent))
        self.where = np.array([k for k, _, _ in powers], int)
        self.exponents = np.array([e for _, _, e in powers])
        self.spread = np.zeros((m, len(powers)), complex)
        for column, (k, coefficient, _) in enumerate(powers):
            self.spread[k, column] = coefficient
        self.laws = [(k, Law(phase.laws[name])) for k, name in enumerate(phase.loaded) if name in phase.laws]

    def rates(self, _: float, x: Vector) -> Vector:
        out: Vector = self.A @ x
        out += self.b
        if self.phase.loaded:
            V = (self.S @ x + self.s).view(complex)
            y = self.fixed
            if len(self.where):
                y = y + self.spread @ abs(V)[self.where] ** self.exponents
            current = y * V
            for k, law in self.laws:
                current[k] += law.current(V[k])
            out -= self.G @ current.view(float)
        return out

    def jacobian(self, _: float, x: Vector) -> Vector:
        if not self.phase.loaded:
            return self.A
        V = (self.S @ x + self.s).view(complex)
        v = abs(V)
        y, slope = self.fixed, np.zeros(len(V), complex)
        if len(self.where):
            y = y + self.spread @ v[self.where] ** self.exponents
            slope = self.spread @ (self.exponents * v[self.where] ** (self.exponents - 1))
        D = np.zeros((2 * len(V), 2 * len(V)))
        for k in range(len(V)):
            here = slice(2 * k, 2 * k + 2)
            D[here, here] = turn(y[k])
            if v[k]:
                z = slope[k] * V[k] / v[k]
                D[here, here] += np.outer([z.real, z.imag], [V[k].real, V[k].imag])
        for k, law in self.laws:
            here = slice(2 * k, 2 * k + 2)
            D[here, here] += law.jacobian(V[k])
        return self.A - self.G @ D @ self.S


class Law:
    """A current load in floats: quotients of polynomials in Vd and Vq."""

    def __init__(self, law: Any) -> None:
        def terms(p: Bivariate) -> list[tuple[int, int, float]]:
            return [(i, j, float(c)) for (i, j), c in p]

        self.tops, self.bottom = [terms(p) for p in law.numerators], terms(law.denominator)
        self.degree = max([i + j for p in (*self.tops, self.bottom) for i, j, _ in p], default=0)

    def powers(self, V: complex) -> tuple[list[float], list[float]]:
        """Of both components; by products, which overflow to infinity without an error."""
        out: tuple[list[float], list[float]] = [1.0], [1.0]
        for listed, x in zip(out, (float(V.real), float(V.imag)), strict=True):
            for _ in range(self.degree):
                listed.append(listed[-1] * x)
        return out

    def current(self, V: complex) -> complex:
        d, q = self.powers(V)
        a, b, below = (sum(c * d[i] * q[j] for i, j, c in p) for p in (*self.tops, self.bottom))
        return complex(a / below, b / below)

    def jacobian(self, V: complex) -> Vector:
        d, q = self.powers(V)

        def value(p: list[tuple[int, int, float]]) -> tuple[float, float, float]:
            """p and its two derivatives."""
            by_d = sum(i * c * d[i - 1] * q[j] for i, j, c in p if i)
            by_q = sum(j * c * d[i] * q[j - 1] for i, j, c in p if j)
            return sum(c * d[i] * q[j] for i, j, c in p), by_d, by_q

        (below, by_d, by_q), *rows = (value(p) for p in (self.bottom, *self.tops))
        return np.array([[pd / below - p * by_d / below**2, pq / below - p * by_q / below**2] for p, pd, pq in rows])


# --- where it starts ------------------------------------------------------------------------------------------------


def start_state(phase: Phase, start: str) -> Vector:
    x = np.zeros(phase.size)
    if start == "zero":
        if phase.loops:
            raise ValueError("the voltage of a linear loop is its reference where its states are zero")
        return x
    flat = flat_voltages(phase)
    for name, V in flat.items():
        if ("voltage", name) in phase.at:
            x[phase.at["voltage", name]] = V
    if start == "flat":
        return x
    if start != "equilibrium":
        raise ValueError(f"unknown start: {start}")
    return equilibrium(phase, x)


def flat_voltages(phase: Phase) -> dict[str, Vector]:
    """The reference of the nearest DGU, by number of lines; of several, of that which comes first in the spec."""
    near: dict[str, tuple[int, int]] = {}
    sources = [name for name in phase.nodes if name in phase.dgus]
    for order, source in enumerate(sources):
        distance = {source: 0}
        queue = [source]
        for name in queue:
            for line in phase.lines.values():
                for a, b in ((line.start, line.end), (line.end, line.start)):
                    if a == name and b not in distance:
                        distance[b] = distance[name] + 1
                        queue.append(b)
        for name, steps in distance.items():
            near[name] = min(near.get(name, (steps, order)), (steps, order))
    return {name: pair(phase.dgus[sources[order]].reference_volt) for name, (_, order) in near.items()}


def equilibrium(phase: Phase, x: Vector) -> Vector:
    """Newton's method from x. Raises: ArithmeticError if it does not converge."""
    for _ in range(100):
        system = phase.system(phase.mode(x))
        step = np.linalg.solve(system.jacobian(0, x), -system.rates(0, x))
        x = x + step
        modulus = moduli(phase, x)
        if np.all(abs(step) <= 1e-13 * modulus + 1e-15 * modulus.max()):
            return x
    raise ArithmeticError("Newton's method found no equilibrium")


def moduli(phase: Phase, x: Vector) -> Vector:
    """For each state the modulus of its part."""
    out = np.empty(phase.size)
    for place in phase.at.values():
        out[place] = np.linalg.norm(x[place])
    return out


# --- events -----------------------------------------------------------------------------------------------------------


def reset(before: Phase, after: Phase, x: Vector, change: Change) -> Vector:
    """The state right after one change, of which `before` and `after` are the equations."""
    out = np.zeros(after.size)
    for part, place in after.at.items():
        if part in before.at:
            out[place] = x[before.at[part]]
    kind, name = change[0], change[1]
    if kind == "connect-line":
        line = after.lines[name]
        for end in (line.start, line.end):
            if end in after.loops:
                loop, me = after.loops[end], after.at["loop", end]
                B, C, reference = floats(loop.B), floats(loop.C), pair(after.dgus[end].reference_volt)
                c0, c1 = before.capacitance[end], after.capacitance[end]
                kept = out[me] + c0 * B @ (reference + C @ out[me]) - c1 * B @ reference
                out[me] = np.linalg.solve(np.eye(len(B)) + c1 * B @ C, kept)
            else:
                out[after.at["voltage", end]] *= before.capacitance[end] / after.capacitance[end]
    if kind in ("connect-dgu", "connect-dgu-discharged", "disconnect-dgu", "reference", "controller") and (
        name in before.loops or name in after.loops
    ):
        raise ValueError("what a linear loop does then is not defined")
    if kind == "connect-dgu-discharged":
        out[after.at["voltage", name]] *= before.capacitance[name] / after.capacitance[name]
    if kind == "connect-dgu":
        inv, V = after.inverters[name], out[after.at["voltage", name]]
        out[after.at["current", name]] = current = after.w * inv.C * J @ V
        ask(after, out, name, V + (inv.R * E + after.w * inv.L * J) @ current)
    if kind == "controller":
        ask(after, out, name, before.applied(x, name))
    return out


def ask(phase: Phase, x: Vector, name: str, u: Vector) -> None:
    """Set the integrator of an inverter, if it has one, such that its law asks for u."""
    inv = phase.inverters[name]
    if inv.Kx is not None:
        place = phase.at["integrator", name]
        x[place] = 0
        x[place] = np.linalg.solve(inv.Kx, u - phase.asked(x, name))


# --- the run -----------------------------------------------------------------------------------------------------------


@dataclass
class Stretch:
    """The integration of one phase from t to end, with samples on the way."""

    phase: Phase
    x: Vector
    t: float
    end: float
    rtol: float
    method: str
    peaks: dict[Part, float]
    counts: dict[str, int]

    def solver(self, system: System, t: float, x: Vector, end: float, first: float, method: str) -> Any:
        rest = {"rtol": self.rtol, "atol": self.rtol * self.scale(), "first_step": min(first, end - t)}
        if method == "DOP853":
            return DOP853(system.rates, t, x, end, **rest)
        return Radau(system.rates, t, x, end, jac=system.jacobian, **rest)

    def scale(self) -> Vector:
        out = np.empty(self.phase.size)
        for part, place in self.phase.at.items():
            out[place] = self.peaks[part]
        return out

    def note(self, x: Vector) -> None:
        for part, place in self.phase.at.items():
            size = float(np.linalg.norm(x[place]))
            if not np.isfinite(size) or size > 1e12:
                raise ArithmeticError(f"{part} grows without bounds")
            self.peaks[part] = max(self.peaks[part], size)

    def run(self, samples: Sequence[float], record: Any) -> Vector:
        """The state at the end; `record(time, phase, x)` gets the samples, all in [t, end)."""
        pending = list(samples)
        while pending and pending[0] == self.t:
            record(pending.pop(0), self.phase, self.x)
        mode = self.phase.mode(self.x)
        system = self.phase.system(mode)
        modes = np.linalg.eigvals(system.jacobian(self.t, self.x))
        first = 0.1 / max(abs(modes))
        handover = self.handover(modes) if self.method == "auto" else self.end
        while self.t < self.end:
            system = self.phase.system(mode)
            method = self.method if self.method != "auto" else "DOP853" if self.t < handover else "Radau"
            solver = self.solver(system, self.t, self.x, self.end, first, method)
            self.counts["restarts"] = self.counts.get("restarts", 0) + 1
            while self.t < self.end:
                message = solver.step()
                if solver.status == "failed":
                    raise ArithmeticError(f"at {self.t} s: {message}")
                self.counts[method] = self.counts.get(method, 0) + 1
                found = self.crossing(mode, solver) if self.phase.guards else None
                t = solver.t if found is None else found[0]
                while pending and pending[0] <= t and pending[0] < self.end:
                    record(pending[0], self.phase, self.to(system, pending.pop(0), solver.t - self.t, method))
                x = solver.y if found is None else self.to(system, t, solver.t - self.t, method)
                first = solver.t - self.t
                self.t, self.x = t, x.copy()
                self.note(x)
                if found is not None:
                    k = found[1]
                    mode = (*mode[:k], self.phase.guards[k].change(mode[k], x), *mode[k + 1 :])
                    break
                solver.atol = self.rtol * self.scale()
                if method == "DOP853" and self.t >= handover:
                    break
        return self.x

    def handover(self, modes: Vector) -> float:
        """Until when DOP853 is to be used: to the end if that is cheap, else until ringing has died out."""
        steps_per_second = max(abs(modes)) / 4
        if (self.end - self.t) * steps_per_second < CHEAP:
            return self.end
        ringing = [-z.real for z in modes if abs(z.imag) > RINGING and z.real < 0]
        return self.t + min(DEAD / min(ringing, default=np.inf), DEAR / steps_per_second)

    def to(self, system: System, t: float, step: float, method: str) -> Vector:
        """The state at t, integrated from the last step's start, which is not more than a step before."""
        if t <= self.t:
            return self.x
        solver = self.solver(system, self.t, self.x, t, step, method)
        while solver.status == "running":
            solver.step()
        return solver.y

    def crossing(self, mode: tuple[int, ...], solver: Any) -> tuple[float, int] | None:
        """Where in the last step the mode first has to change, and which of its guards says so."""
        span = solver.t - self.t
        near = self.phase.near(mode, self.x, solver.y, solver.f, span)
        if not near:
            return None
        dense = solver.dense_output()
        times = [self.t, *(self.t + share * span for share in PROBES[:-1]), solver.t]
        states = [self.x, *dense(np.array(times[1:-1])).T, solver.y]
        for k in range(len(times) - 1):
            found = [
                (self.root(self.phase.guards[i], mode[i], dense, times[k : k + 2], states[k : k + 2]), i)
                for i in near
                if self.phase.guards[i].violation(mode[i], states[k + 1]) > 0
            ]
            if found:
                return min(found)
        return None

    @staticmethod
    def root(guard: Guard, mode: int, dense: Any, times: Sequence[float], states: Sequence[Vector]) -> float:
        """When the guard is first violated between two times, at the latter of which it is."""
        (left, right), (early, late) = times, states
        if guard.violation(mode, early) >= 0:
            return left

        def value(t: float) -> float:
            return guard.violation(mode, early if t == left else late if t == right else dense(t))

        return float(brentq(value, left, right, xtol=1e-16, rtol=1e-15))


def run(
    document: Mapping[str, Any],
    changes: Changes,
    start: str,
    end: float,
    samples: Iterable[float],
    off: Iterable[Change] = (),
    rtol: float = RTOL,
    method: str = "auto",
    counts: dict[str, int] | None = None,
    tiny: float = 1e-6,
) -> dict[Part, Vector]:
    """Samples of every part of a microgrid that there ever is, from 0 s to `end`.

    `off`: what is off at first, ("dgu", node), ("line", name), ("load", node, index). Changes at one time happen in their
    order. A complex array for each part, ("voltage", node), ("current", node) of a filter, ("integrator", node),
    ("line", name), ("branch", node, str(k)) for the k-th series R-L load, and a real one (samples, states) for
    ("loop", node); NaN where the part is not there. A sample at the time of an event is the state after it.
    """
    bench = Bench(copy.deepcopy({key: value for key, value in document.items() if key != "scenario"}), set(off))
    phase = bench.phase()
    x = start_state(phase, start)
    times = sorted(float(t) for t in samples)
    if times and not 0 <= times[0] <= times[-1] <= end:
        raise ValueError("samples outside of the run")
    volts = max(np.hypot(*pair(dgu.reference_volt)) for dgu in phase.dgus.values())
    out: dict[Part, Vector] = {}
    peaks: dict[Part, float] = {}
    counts = {} if counts is None else counts

    def record(t: float, phase: Phase, x: Vector) -> None:
        rows = [k for k, time in enumerate(times) if time == t]
        for name in phase.nodes:
            keep(("voltage", name), rows, complex(*phase.voltage(x, name)))
        for part, place in phase.at.items():
            if part[0] == "loop":
                if part not in out:
                    out[part] = np.full((len(times), place.stop - place.start), np.nan)
                out[part][rows] = x[place]
            elif part[0] != "voltage":
                keep(part, rows, complex(*x[place]))

    def keep(part: Part, rows: list[int], value: complex) -> None:
        if part not in out:
            out[part] = np.full(len(times), complex(np.nan, np.nan))
        out[part][rows] = value

    edges = sorted({0.0, *(float(t) for t, _ in changes), float(end)})
    if edges[0] < 0 or any(t >= end for t, _ in changes):
        raise ValueError("changes outside of the run")
    for left, right in pairwise(edges):
        for time, listed in changes:
            for change in listed if float(time) == left else ():
                bench.document = copy.deepcopy(bench.document)
                bench.edit(change)
                new = bench.phase()
                x, phase = reset(phase, new, x, change), new
        for part, place in phase.at.items():
            floor = volts * tiny * (0.01 if part[0] == "integrator" else 1)
            peaks[part] = max(peaks.get(part, floor), float(np.linalg.norm(x[place])))
        stretch = Stretch(phase, x, left, right, rtol, method, peaks, counts)
        with np.errstate(over="ignore", invalid="ignore"):  # steps that are far too long are rejected anyway
            x = stretch.run([t for t in dict.fromkeys(times) if left <= t < right], record)
    if times and times[-1] == end:
        record(end, phase, x)
    return out


def difference(a: Mapping[Part, Vector], b: Mapping[Part, Vector]) -> tuple[float, Part]:
    """The largest difference of two runs, relative to the largest modulus of its part in either, and the part."""
    worst = (0.0, ("nothing",))
    assert a.keys() == b.keys()
    for part in a:
        p, q = (x if x.ndim == 2 else np.stack([x.real, x.imag], 1) for x in (a[part], b[part]))
        assert np.array_equal(np.isnan(p), np.isnan(q)), part
        sizes = [np.nanmax(np.linalg.norm(x, axis=1), initial=0.0) for x in (p, q)]
        gap = np.nanmax(np.linalg.norm(p - q, axis=1), initial=0.0)
        if gap:
            worst = max(worst, (gap / max(sizes), part))
    return worst


# --- the same in the words of a spec -----------------------------------------------------------------------------------


def scenario_table(
    changes: Changes, start: str, end: str, off: Iterable[Change], times: Sequence[str]
) -> dict[str, Any]:
    """The scenario of a spec that says the same; `times` are those of `changes`, as text with a unit."""
    named = {"dgu": lambda t: t[0], "line": lambda t: t[0], "load": lambda t: {"load": t[0], "index": t[1]}}
    events = []
    for at, (_, listed) in zip(times, changes, strict=True):
        for kind, *target in listed:
            event: dict[str, Any] = {"at": at}
            switch = kind.removesuffix("-discharged")
            if switch in SWITCHES:
                part, on = SWITCHES[switch]
                event["connect" if on else "disconnect"] = named[part](target)
                if switch != kind:
                    event["filter"] = "discharged"
            elif kind == "load-set":
                event |= {"load": target[0], "index": target[1], "set": target[2]}
            else:
                event |= {kind: target[0], "set": target[1]}
            events.append(event)
    listed_off = [named[part](target) for part, *target in off]
    table: dict[str, Any] = {"end": end, "start": start}
    return {**table, **({"disconnected": listed_off} if listed_off else {}), "event": events}
