"""An oracle for the equilibria of a network in 60 digits, from Kirchhoff's laws alone.

It reads a spec as a plain document and shares nothing with `certify`. A DGU with integral action holds its node at the
reference; an inverter held at a constant terminal voltage (controller kind "constant") is that voltage behind
R + j w0 L. At every other node k

    sum of line currents + j w0 C_k V_k + static loads (P - jQ) / v^2 V_k + series branches V_k / (R + j w0 L) = 0.

The nodes with a fixed voltage cut a network into clusters of nodes that know nothing of each other: the equilibria are
all combinations of those of the clusters. Of a cluster they are sought in floats: along the curve of equilibria over the
level of the loads, from none through the nose and back; by deflated Newton steps from low, mixed and random voltages;
and, if the cluster is a chain fed at one end, by a scan over the voltage at the other end, which determines all others up
to a common angle, so that nothing is missed but for pairs of roots closer than the scan. Each is refined in mpmath, with a
factor of the Jacobian in floats as the preconditioner, and then judged by its line currents anew.

"Unit" below is the largest voltage of a cluster without static loads; floats work in units of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import islice, product
from typing import Any

import numpy as np
import scipy.sparse as sparse
from mpmath import mp, mpc, mpf
from scipy.optimize import brentq, minimize_scalar
from scipy.sparse.linalg import splu

DIGITS = 60
ENOUGH = mpf("1e-50")  # relative residual at which the refinement may stop
ACCEPTED = mpf("1e-42")  # above it, there is no solution
DENSE = 40  # clusters of so many nodes are solved by dense matrices
Vector = np.ndarray[Any, Any]
Rational = tuple[Fraction, Fraction]  # a complex number

# --- reading --------------------------------------------------------------------------------------------------

_PREFIXES = {"f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9, "T": 12}
_UNITS = {"ohm", "H", "F", "S", "V", "A", "W", "var", "VA", "Hz", "s", "m"}


def quantity(raw: object, per_unit: Fraction | None = None) -> Fraction:
    """A number, or text with a unit, in SI. `per_unit`: what 1 pu is. Raises: ValueError for anything else.

    >>> quantity("1.8 mH"), quantity("0.343 ohm/km"), quantity("0.9 pu", Fraction(20000)), quantity(50)
    (Fraction(9, 5000), Fraction(343, 1000000), Fraction(18000, 1), Fraction(50, 1))
    """
    if isinstance(raw, int | Fraction) and not isinstance(raw, bool):
        return Fraction(raw)
    match = re.fullmatch(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(\S*)", raw) if isinstance(raw, str) else None
    if not match:
        raise ValueError(f"no exact number: {raw!r}")
    value, unit = Fraction(match[1]), match[2]
    if unit == "pu":
        if per_unit is None:
            raise ValueError(f"pu is not defined here: {raw!r}")
        return value * per_unit
    for part, sign in zip(unit.split("/") if unit else [], (1, -1), strict=False):
        if part not in _UNITS:
            if part[1:] not in _UNITS:
                raise ValueError(f"unknown unit: {raw!r}")
            value *= Fraction(10) ** (sign * _PREFIXES[part[0]])
    return value


def angular_frequency(frequency: Fraction) -> Fraction:
    """2 pi f in rad/s, rounded to 40 significant digits.

    >>> angular_frequency(Fraction(50)) == Fraction("314.1592653589793238462643383279502884197")
    True
    """
    with mp.workdps(120):
        return Fraction(mp.nstr(2 * mp.pi * frequency.numerator / frequency.denominator, 40, strip_zeros=False))


@dataclass(frozen=True)
class Load:
    """A static load at a node: P - jQ = sum of c (v / base)^e over its terms (c, e, base).

    Units: c in watt and var, base in volt. `band`: its voltages in volt. With `cut_off` it is the impedance that it is at
    the lower end of the band wherever the voltage is lower.
    """

    terms: tuple[tuple[Rational, Fraction, Fraction], ...]
    band: Rational
    cut_off: bool


@dataclass(frozen=True)
class Dgu:
    """`held`: the reference is the constant terminal voltage; otherwise it is the voltage of the node. Ohm, henry, volt."""

    held: bool
    resistance: Fraction
    inductance: Fraction
    reference: Rational
    limits: Rational | None


@dataclass(frozen=True)
class Node:
    """`capacitance`: all of it, in farad; `branches`: R in ohm and L in henry of series loads."""

    name: str
    capacitance: Fraction
    loads: tuple[Load, ...]
    branches: tuple[Rational, ...]
    dgu: Dgu | None

    @property
    def fixed(self) -> bool:
        return self.dgu is not None and not self.dgu.held

    @property
    def band(self) -> Rational | None:
        """Where the voltages of all static loads are inside their bands, in volt; None without static loads."""
        if not self.loads:
            return None
        low = max(Fraction(-1) if load.cut_off else load.band[0] for load in self.loads)
        return low, min(load.band[1] for load in self.loads)


@dataclass(frozen=True)
class Line:
    name: str
    start: str
    end: str
    resistance: Fraction
    inductance: Fraction


@dataclass(frozen=True)
class Network:
    """The steady state of a network: w0 in rad/s; the nodes and lines in the order of the spec."""

    w0: Fraction
    nodes: tuple[Node, ...]
    lines: tuple[Line, ...]

    @cached_property
    def by_name(self) -> dict[str, Node]:
        return {node.name: node for node in self.nodes}

    def islands(self) -> list[Network]:
        """The connected parts, each with its nodes in the order of the spec."""
        names = [node.name for node in self.nodes]
        return [self.part(set(group)) for group in connected(names, self.lines)]

    def part(self, names: set[str]) -> Network:
        """The nodes with these names and the lines among them."""
        nodes = tuple(node for node in self.nodes if node.name in names)
        return replace(self, nodes=nodes, lines=tuple(line for line in self.lines if {line.start, line.end} <= names))

    def clusters(self) -> list[Cluster]:
        free = [node.name for node in self.nodes if not node.fixed]
        among = [line for line in self.lines if not (self.by_name[line.start].fixed or self.by_name[line.end].fixed)]
        return [Cluster(self, group) for group in connected(free, among)]


def connected(names: Iterable[str], lines: Iterable[Line]) -> list[tuple[str, ...]]:
    """Groups of names that lines connect, in the order of the names."""
    order = list(names)
    neighbours: dict[str, list[str]] = {name: [] for name in order}
    for line in lines:
        neighbours[line.start].append(line.end)
        neighbours[line.end].append(line.start)
    group: dict[str, int] = {}
    for first in order:
        if first in group:
            continue
        number, todo = len(group), [first]
        while todo:
            name = todo.pop()
            if name not in group:
                group[name] = number
                todo += neighbours[name]
    groups: dict[int, list[str]] = {}
    for name in order:
        groups.setdefault(group[name], []).append(name)
    return [tuple(members) for members in groups.values()]


def read_network(document: Mapping[str, Any]) -> Network:
    """The network of a spec document: numbers are int, Fraction or text.

    Raises: ValueError for a controller that is neither constant nor with integral action; KeyError if a part is missing.
    """
    base = quantity(document["base_voltage"]) if "base_voltage" in document else None

    def volts(raw: Sequence[object]) -> Rational:
        return quantity(raw[0], base), quantity(raw[1], base)

    common = volts(document["voltage_band"]) if "voltage_band" in document else None
    legs_at_dgus = document.get("line_legs", "included") == "included"
    table = document["node"]
    capacitances = {name: quantity(node.get("capacitance", 0)) for name, node in table.items()}
    lines = []
    for line in document.get("line", []):
        source, length = line, Fraction(1)
        if "type" in line:
            source, length = document["line_type"][line["type"]], quantity(line["length"])
        R, L, C = (quantity(source[key]) * length for key in "RLC")
        for end in (line["from"], line["to"]):
            if legs_at_dgus or "dgu" not in table[end]:
                capacitances[end] += C / 2
        lines.append(Line(line["name"], line["from"], line["to"], R, L))

    def dgu(raw: Mapping[str, Any]) -> tuple[Dgu, Fraction]:
        controller = document["controller"][raw["controller"]]
        kind = controller["kind"]
        if kind not in ("constant", "ida-pbc") and not (kind == "state-feedback" and "K13" in controller):
            raise ValueError(f"a DGU of kind {kind} does not determine its voltage here")
        R, L, C = (quantity(document["filter"][raw["filter"]][key]) for key in "RLC")
        limits = volts(raw["limits"]) if "limits" in raw else None
        return Dgu(kind == "constant", R, L, volts(raw["reference"]), limits), C

    def load(raw: Mapping[str, Any]) -> Load:
        band = volts(raw["band"]) if "band" in raw else common
        if band is None:
            raise ValueError("a load without a band")
        terms: list[tuple[Rational, Fraction, Fraction]] = []
        if raw["kind"] == "zip":
            for key, exponent in (("Y", 2), ("I", 1), ("P", 0)):
                p, q = (quantity(x) for x in raw.get(key, (0, 0)))
                terms.append(((p, -q), Fraction(exponent), Fraction(1)))
        elif raw["kind"] == "exp":
            V0 = quantity(raw["V0"], base) if "V0" in raw else base
            if V0 is None:
                raise ValueError("an exponential load without V0")
            terms.append(((quantity(raw["P0"]), Fraction(0)), quantity(raw["np"]), V0))
            terms.append(((Fraction(0), -quantity(raw.get("Q0", 0))), quantity(raw.get("nq", 0)), V0))
        else:
            raise ValueError(f"a load of kind {raw['kind']}")
        return Load(tuple(term for term in terms if any(term[0])), band, "below" in raw)

    nodes = []
    for name, raw in table.items():
        source = None
        if "dgu" in raw:
            source, of_filter = dgu(raw["dgu"])
            capacitances[name] += of_filter
        all_loads = raw.get("load", [])
        branches = tuple((quantity(x["R"]), quantity(x["L"])) for x in all_loads if x["kind"] == "rl")
        static = tuple(load(x) for x in all_loads if x["kind"] != "rl")
        nodes.append(Node(name, capacitances[name], static, branches, source))
    return Network(angular_frequency(quantity(document["frequency"])), tuple(nodes), tuple(lines))


# --- in many digits -------------------------------------------------------------------------------------------


def to_mpf(x: Fraction) -> mpf:
    return mpf(x.numerator) / x.denominator


def to_mpc(x: Rational) -> mpc:
    return mpc(to_mpf(x[0]), to_mpf(x[1]))


def impedance(w0: Fraction, resistance: Fraction, inductance: Fraction) -> mpc:
    return to_mpc((resistance, w0 * inductance))


def load_admittance(loads: Sequence[Load], v: mpf) -> mpc:
    """The current of static loads over the voltage, in siemens, at a modulus v in volt."""
    total = mpc(0)
    for load in loads:
        at = max(v, to_mpf(load.band[0])) if load.cut_off else v
        for coefficient, exponent, base in load.terms:
            power = exponent - 2
            ratio = at / to_mpf(base)
            value = ratio**power.numerator if power.denominator == 1 else mp.power(ratio, to_mpf(power))
            total += to_mpc(coefficient) * value / to_mpf(base) ** 2
    return total


@dataclass(frozen=True)
class Solution:
    """An equilibrium in 60 digits, by name: volt and ampere, d + jq.

    A line's current runs from `from` to `to`; a DGU's is that of its inductance, so it feeds the filter's capacitance too.
    `residual`: the largest sum of the currents at a node relative to the sum of their sizes.
    """

    voltages: dict[str, mpc]
    line_currents: dict[str, mpc]
    dgu_currents: dict[str, mpc]
    terminal_voltages: dict[str, mpc]
    residual: mpf


def solution_at(network: Network, voltages: Mapping[str, mpc]) -> Solution:
    """All currents at given voltages of all nodes, line by line; whether it is an equilibrium, `residual` tells."""
    with mp.workdps(DIGITS):
        w0 = to_mpf(network.w0)
        out: dict[str, list[mpc]] = {node.name: [] for node in network.nodes}
        line_currents = {}
        for line in network.lines:
            Z = impedance(network.w0, line.resistance, line.inductance)
            current = (voltages[line.start] - voltages[line.end]) / Z
            line_currents[line.name] = current
            out[line.start].append(current)
            out[line.end].append(-current)
        residual = mpf(0)
        dgu_currents, terminal = {}, {}
        for node in network.nodes:
            V = voltages[node.name]
            currents = out[node.name]
            currents.append(mpc(0, w0 * to_mpf(node.capacitance)) * V)
            currents.append(load_admittance(node.loads, abs(V)) * V)
            currents += [V / impedance(network.w0, *branch) for branch in node.branches]
            if node.dgu:
                Z = impedance(network.w0, node.dgu.resistance, node.dgu.inductance)
                reference = to_mpc(node.dgu.reference)
                I = (reference - V) / Z if node.dgu.held else mp.fsum(currents)  # noqa: E741
                dgu_currents[node.name], terminal[node.name] = I, V + Z * I
                if node.dgu.held:
                    currents.append(-I)
                else:  # that the voltage is the reference is what there is to check
                    residual = max(residual, abs(V - reference) / abs(reference))
                    continue
            size = sum((abs(x) for x in currents), mpf(0))
            if size:
                residual = max(residual, abs(mp.fsum(currents)) / size)
        return Solution(dict(voltages), line_currents, dgu_currents, terminal, residual)


def in_bands(network: Network, voltages: Mapping[str, mpc]) -> bool:
    """Whether the voltage of each node with static loads is strictly inside their bands; other nodes may be missing."""
    with mp.workdps(DIGITS):
        for node in network.nodes:
            if node.band and node.name in voltages:
                low, high = node.band
                if not to_mpf(low) < abs(voltages[node.name]) < to_mpf(high):
                    return False
    return True


def in_limits(network: Network, solution: Solution) -> bool:
    """Whether the terminal voltage of each DGU with limits is within them, axis by axis."""
    for node in network.nodes:
        if node.dgu and node.dgu.limits:
            u = solution.terminal_voltages[node.name]
            if abs(u.real) > to_mpf(node.dgu.limits[0]) or abs(u.imag) > to_mpf(node.dgu.limits[1]):
                return False
    return True


# --- one unknown node: a closed form --------------------------------------------------------------------------


def _times(a: Rational, b: Rational) -> Rational:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _inverse(a: Rational) -> Rational:
    size = a[0] ** 2 + a[1] ** 2
    return a[0] / size, -a[1] / size


def closed_form(network: Network) -> tuple[mpc, ...]:
    """The voltages that the only node without a fixed one can have, highest first: none, one or two, exactly as many.

    The loads there are constant powers and admittances without cut-off: with Y all admittances at the node, J the currents
    that feed it and c = P - jQ, Y V + c / conj(V) = J, so s = v^2 solves |Y|^2 s^2 + (2 Re(Y conj(c)) - |J|^2) s + |c|^2 = 0,
    whose discriminant is rational. Two nodes with a line between a DGU and such a load are the usual case.

    Raises: ValueError if the network is of another shape.
    """
    free = [node for node in network.nodes if not node.fixed]
    if len(free) != 1 or any(load.cut_off for load in free[0].loads):
        raise ValueError("not a single node without a fixed voltage, or a load with cut-off")
    node = free[0]
    Y: Rational = (Fraction(0), network.w0 * node.capacitance)
    J: Rational = (Fraction(0), Fraction(0))
    c: Rational = (Fraction(0), Fraction(0))
    feeds: list[tuple[Rational, Rational]] = []  # voltage, impedance
    for line in network.lines:
        if node.name in (line.start, line.end):
            other = network.by_name[line.end if line.start == node.name else line.start]
            if other.dgu is None:
                raise ValueError("a node without a fixed voltage")
            feeds.append((other.dgu.reference, (line.resistance, network.w0 * line.inductance)))
    if node.dgu:
        feeds.append((node.dgu.reference, (node.dgu.resistance, network.w0 * node.dgu.inductance)))
    feeds += [((Fraction(0), Fraction(0)), (R, network.w0 * L)) for R, L in node.branches]
    for voltage, Z in feeds:
        y = _inverse(Z)
        fed = _times(y, voltage)
        Y, J = (Y[0] + y[0], Y[1] + y[1]), (J[0] + fed[0], J[1] + fed[1])
    for load in node.loads:
        for coefficient, exponent, base in load.terms:
            if exponent == 2:
                Y = (Y[0] + coefficient[0] / base**2, Y[1] + coefficient[1] / base**2)
            elif exponent == 0:
                c = (c[0] + coefficient[0], c[1] + coefficient[1])
            else:
                raise ValueError("neither a constant power nor a constant admittance")
    first = Y[0] ** 2 + Y[1] ** 2
    half = Y[0] * c[0] + Y[1] * c[1] - (J[0] ** 2 + J[1] ** 2) / 2
    last = c[0] ** 2 + c[1] ** 2
    discriminant = half**2 - first * last
    if discriminant < 0 or half >= 0:
        return ()
    with mp.workdps(DIGITS + 10):
        larger = (-to_mpf(half) + mp.sqrt(to_mpf(discriminant))) / to_mpf(first)
        smaller = to_mpf(last / first) / larger
        squares = [larger, smaller] if discriminant and last else [larger]
        return tuple(to_mpc(J) / (to_mpc(Y) + to_mpc(c) / s) for s in squares)


# --- clusters -------------------------------------------------------------------------------------------------


class Cluster:
    """The nodes of a network that depend on each other: A V + load currents + b = 0.

    Shapes: A (n, n) complex, siemens; b (n,) complex, ampere; voltages (n,) complex, volt.
    """

    def __init__(self, network: Network, names: tuple[str, ...]) -> None:
        self.network, self.names = network, names
        self.nodes = [network.by_name[name] for name in names]
        self.count = n = len(names)
        position = {name: k for k, name in enumerate(names)}
        with mp.workdps(DIGITS):
            self.diagonal, self.source = [mpc(0)] * n, [mpc(0)] * n
            self.links: list[tuple[int, int, mpc]] = []
            for k, node in enumerate(self.nodes):
                self.diagonal[k] += mpc(0, to_mpf(network.w0 * node.capacitance))
                for branch in node.branches:
                    self.diagonal[k] += 1 / impedance(network.w0, *branch)
                if node.dgu:
                    y = 1 / impedance(network.w0, node.dgu.resistance, node.dgu.inductance)
                    self.diagonal[k] += y
                    self.source[k] -= y * to_mpc(node.dgu.reference)
            for line in network.lines:
                ends = position.get(line.start), position.get(line.end)
                if ends == (None, None):
                    continue
                y = 1 / impedance(network.w0, line.resistance, line.inductance)
                for here, other in (ends, ends[::-1]):
                    if here is not None:
                        self.diagonal[here] += y
                        if other is None:
                            fixed = network.by_name[line.end if ends[0] == here else line.start].dgu
                            self.source[here] -= y * to_mpc(fixed.reference)  # type: ignore[union-attr]
                if ends[0] is not None and ends[1] is not None:
                    self.links.append((ends[0], ends[1], y))
        self._to_floats()

    def _to_floats(self) -> None:
        n = self.count
        rows = [*range(n), *(i for i, _, _ in self.links), *(j for _, j, _ in self.links)]
        columns = [*range(n), *(j for _, j, _ in self.links), *(i for i, _, _ in self.links)]
        values = [complex(x) for x in self.diagonal] + [-complex(y) for _, _, y in self.links] * 2
        self.A = sparse.csc_matrix((values, (rows, columns)), shape=(n, n))
        self.b = np.array([complex(x) for x in self.source])
        linear = sparse.bmat([[self.A.real, -self.A.imag], [self.A.imag, self.A.real]]).tocsc()
        self.linear: Any = linear.toarray() if n <= DENSE else linear
        terms = [
            (k, complex(float(c[0]), float(c[1])), float(e), float(base), float(load.band[0]) if load.cut_off else 0.0)
            for k, node in enumerate(self.nodes)
            for load in node.loads
            for c, e, base in load.terms
        ]
        self.at = np.array([t[0] for t in terms], dtype=int)
        self.coefficients = np.array([t[1] for t in terms], dtype=complex)
        self.powers, self.bases, self.cuts = (np.array([t[k] for t in terms], dtype=float) for k in (2, 3, 4))
        self.no_load = to_complex(self.solve(self.linear, to_real(-self.b)))
        self.unit = float(np.max(np.abs(self.no_load)))

    # In floats.

    def admittances(self, v: Vector) -> tuple[Vector, Vector]:
        """Y(v) of the static loads at each node, and its derivative. Shapes: (.., n). Units: S and S/V."""
        here = v[..., self.at]
        at = np.maximum(np.maximum(here, self.cuts), 1e-9 * self.unit)
        y = self.coefficients * (at / self.bases) ** (self.powers - 2) / self.bases**2
        slope = np.where(here >= self.cuts, (self.powers - 2) * y / at, 0)
        Y, dY = np.zeros(v.shape, dtype=complex), np.zeros(v.shape, dtype=complex)
        for k, node in enumerate(self.at):
            Y[..., node] += y[..., k]
            dY[..., node] += slope[..., k]
        return Y, dY

    def residual(self, V: Vector, level: float = 1.0) -> tuple[Vector, Vector]:
        """The sum of the currents at each node, with static loads times `level`; and the load currents. Ampere."""
        load = self.admittances(np.abs(V))[0] * V
        return self.A @ V + self.b + level * load, load

    def jacobian(self, V: Vector, level: float = 1.0) -> Any:
        """Of the residual, real: (2n, 2n), first all d, then all q; dense or sparse."""
        n, v = self.count, np.maximum(np.abs(V), 1e-9 * self.unit)
        Y, dY = self.admittances(v)
        along = dY * V / v
        upper = (Y.real + along.real * V.real, -Y.imag + along.real * V.imag)
        blocks = (*upper, Y.imag + along.imag * V.real, Y.real + along.imag * V.imag)
        d, q = np.arange(n), np.arange(n, 2 * n)
        if n <= DENSE:
            J = self.linear.copy()
            for rows, columns, block in zip((d, d, q, q), (d, q, d, q), blocks, strict=True):
                J[rows, columns] += level * block
            return J
        values = level * np.concatenate(blocks)
        rows, columns = np.concatenate([d, d, q, q]), np.concatenate([d, q, d, q])
        return self.linear + sparse.csc_matrix((values, (rows, columns)), shape=(2 * n, 2 * n))

    @staticmethod
    def solve(matrix: Any, right: Vector) -> Vector:
        """Raises: ArithmeticError for a singular matrix."""
        try:
            if isinstance(matrix, np.ndarray):
                found = np.linalg.solve(matrix, right)
            else:
                found = splu(matrix.tocsc()).solve(right)
        except (np.linalg.LinAlgError, RuntimeError) as fault:
            raise ArithmeticError(str(fault)) from fault
        if not np.all(np.isfinite(found)):
            raise ArithmeticError("not finite")
        return np.asarray(found)

    def newton(self, start: Vector, known: Sequence[Vector] = (), steps: int = 40) -> Vector | None:
        """A solution near `start`, or elsewhere, but away from those known: their deflation only scales a Newton step."""
        V = start.copy()
        for _ in range(steps):
            try:
                step = to_complex(self.solve(self.jacobian(V), -to_real(self.residual(V)[0])))
            except ArithmeticError:
                return None
            size = float(np.max(np.abs(step))) / self.unit
            if size < 1e-9 and not (known and self.is_among(V, known)):
                return V + step
            shrink = 1.0
            for other in known:
                away = (V - other) / self.unit
                distance = max(float(np.vdot(away, away).real), 1e-30)
                slope = -2 / distance**2 * float(np.vdot(away, step / self.unit).real) / (1 / distance + 1)
                shrink -= slope
            factor = 1 / shrink if abs(shrink) > 1e-3 else 1e3
            V = V + step * factor * min(1.0, 0.3 / max(abs(factor) * size, 1e-300))
            if float(np.max(np.abs(V))) > 20 * self.unit:
                return None
        return None

    def is_among(self, V: Vector, known: Iterable[Vector], within: float = 1e-7) -> bool:
        return any(float(np.max(np.abs(V - other))) < within * self.unit for other in known)

    # The curve of equilibria over the level of the loads.

    def correct(self, V: Vector, level: float, tangent: Vector, scale: float) -> tuple[Vector, float, int] | None:
        """Back to the curve across its tangent: voltages, level and steps taken, or None."""
        for count in range(1, 9):
            E, load = self.residual(V, level)
            try:
                step = self.solve(self.bordered(V, level, load, tangent, scale), np.append(-to_real(E), 0.0))
            except ArithmeticError:
                return None
            V, level = V + to_complex(step[:-1]), level + step[-1] * scale
            size = max(float(np.max(np.abs(step[:-1]))) / self.unit, abs(step[-1]))
            if size > 1:
                return None
            if size < 1e-9:
                return V, float(level), count
        return None

    def bordered(self, V: Vector, level: float, load: Vector, tangent: Vector, scale: float) -> Any:
        J, column = self.jacobian(V, level), to_real(load)[:, None] * scale
        row = np.append(tangent[:-1] / self.unit**2 / self.count, tangent[-1])[None, :]
        if isinstance(J, np.ndarray):
            return np.block([[J, column], [row[:, :-1], row[:, -1:]]])
        return sparse.bmat([[J, sparse.csc_matrix(column)], [sparse.csc_matrix(row[:, :-1]), row[:, -1:]]])

    def tangent(self, V: Vector, level: float, previous: Vector, scale: float) -> Vector:
        """The direction of the curve, of length one: volts (2n), and the level in units of `scale`."""
        load = self.residual(V, level)[1]
        t = self.solve(self.bordered(V, level, load, previous, scale), np.append(np.zeros(2 * self.count), 1.0))
        length = np.sqrt(np.sum(t[:-1] ** 2) / self.unit**2 / self.count + t[-1] ** 2)
        return np.asarray(t / length)

    def trace(self, most: int = 250, highest: float = 40) -> Iterator[tuple[float, Vector, bool]]:
        """Level, voltages, and whether it is a nose, along the curve from no static loads at all; noses are points too.

        Ends where the level falls to nearly nothing or grows beyond `highest`, or voltages beyond 5 units.
        """
        V, level = self.no_load, 0.0
        yield level, V, False
        effect = self.solve(self.linear, to_real(self.residual(V)[1]))
        drop = float(np.max(np.abs(effect))) / self.unit
        if not drop:
            return
        scale = 0.1 / drop  # the level that shifts voltages by about a tenth
        t = self.tangent(V, level, np.append(np.zeros(2 * self.count), 1.0), scale)
        length = 0.1
        try:
            for _ in range(most):
                step = self.advance(V, level, t, scale, length)
                while step is None and length > 1e-6:
                    length /= 3
                    step = self.advance(V, level, t, scale, length)
                if step is None:
                    return
                following, after, count = step
                turned = self.tangent(following, after, t, scale)
                if t[-1] * turned[-1] < 0:
                    nose = self.nose(V, level, t, scale, length)
                    if nose:
                        yield nose[1], nose[0], True
                V, level, t = following, after, turned
                yield level, V, False
                back = level < 0.02 and t[-1] < 0
                if back or level > highest or float(np.max(np.abs(V))) > 5 * self.unit:
                    return
                length = min(length * (1.5 if count <= 3 else 0.7), 0.25)
        except ArithmeticError:
            return

    def advance(
        self, V: Vector, level: float, t: Vector, scale: float, length: float
    ) -> tuple[Vector, float, int] | None:
        return self.correct(V + length * to_complex(t[:-1]), level + length * t[-1] * scale, t, scale)

    def nose(self, V: Vector, level: float, t: Vector, scale: float, length: float) -> tuple[Vector, float] | None:
        """Where the level turns, at most `length` ahead: the zero of its slope, by bisection with regula falsi."""
        low, high, at_low, at_high = 0.0, length, float(t[-1]), None
        best = None
        for k in range(40):
            middle = (
                (low + high) / 2 if at_high is None or k % 3 == 2 else low - at_low * (high - low) / (at_high - at_low)
            )
            step = self.advance(V, level, t, scale, middle)
            if step is None:
                return best
            slope = float(self.tangent(step[0], step[1], t, scale)[-1])
            best = step[0], step[1]
            if abs(slope) < 1e-9:
                break
            if slope * float(t[-1]) > 0:
                low, at_low = middle, slope
            else:
                high, at_high = middle, slope
        return best

    # Chains that are fed at one end.

    def chain(self) -> list[int] | None:
        """The nodes from the free to the fed end, if each is linked to the next only and no other one is fed."""
        neighbours: list[set[int]] = [set() for _ in self.nodes]
        for i, j, _ in self.links:
            neighbours[i].add(j)
            neighbours[j].add(i)
        fed = [k for k in range(self.count) if self.b[k]]
        if len(fed) != 1 or self.count > 8 or any(len(x) > 2 for x in neighbours):
            return None
        order = [fed[0]]
        while True:
            onwards = [k for k in neighbours[order[-1]] if k not in order]
            if not onwards:
                break
            order.append(onwards[0])
        return order[::-1] if len(order) == self.count and len(neighbours[fed[0]]) <= 1 else None

    def shoot(self, order: Sequence[int], v: Vector) -> tuple[Vector, Vector]:
        """From moduli v at the free end, all voltages up to a common angle, and log |J| of the current J to be fed.

        Shapes: v (m,); voltages (m, n); logarithms (m,), relative to the current that is fed.
        """
        V = np.zeros((len(v), self.count), dtype=complex)
        V[:, order[0]] = v
        A = self.dense_A
        with np.errstate(all="ignore"):
            for here, onwards in zip(order, [*order[1:], None], strict=True):
                Y = self.admittances(np.abs(V))[0][:, here]
                needed = V @ A[here] + Y * V[:, here]
                if onwards is None:
                    break
                V[:, onwards] = -needed / A[here, onwards]
            return V * (-self.b[order[-1]] / needed / np.abs(self.b[order[-1]] / needed))[:, None], np.log(
                np.abs(needed / self.b[order[-1]])
            )

    @cached_property
    def dense_A(self) -> Vector:
        return np.asarray(self.A.toarray())

    def scan(self, order: Sequence[int], points: int = 6000) -> list[Vector]:
        """All voltages that feed the chain as it is fed, in floats."""
        grid = self.unit * np.unique(np.concatenate([np.geomspace(1e-7, 20, points), np.linspace(1e-3, 2, points)]))
        values = self.shoot(order, grid)[1]

        def value(x: float) -> float:
            return float(self.shoot(order, np.array([x]))[1][0])

        finite = np.isfinite(values)
        with np.errstate(all="ignore"):
            changes = finite[:-1] & finite[1:] & (values[:-1] * values[1:] <= 0)
            size = np.abs(values)
            dips = (size[1:-1] <= np.minimum(size[:-2], size[2:])) & (size[1:-1] < 0.1)
            dips &= (values[:-2] * values[1:-1] > 0) & (values[1:-1] * values[2:] > 0)
        brackets = [(grid[k], grid[k + 1]) for k in np.nonzero(changes)[0]]
        for k in np.nonzero(dips)[0] + 1:  # a pair of roots between three points of equal sign
            if np.isfinite(values[k - 1] + values[k + 1]):
                sign = np.sign(values[k])
                dip = minimize_scalar(
                    lambda x, sign=sign: sign * value(x),
                    bounds=(grid[k - 1], grid[k + 1]),
                    method="bounded",
                    options={"xatol": 1e-12 * grid[k]},
                )
                if dip.fun < 0:
                    brackets += [(grid[k - 1], dip.x), (dip.x, grid[k + 1])]
        roots = [brentq(value, a, b, xtol=1e-14 * b, rtol=1e-14) for a, b in brackets if value(a) * value(b) <= 0]
        return [self.shoot(order, np.array([root]))[0][0] for root in roots]

    # All together.

    def starts(self, high: Vector, rng: np.random.Generator) -> Iterator[Vector]:
        """Voltages to try: as without loads, all low, one low, random."""
        n = self.count
        yield self.no_load
        for factor in (0.5, 0.2, 0.05):
            yield factor * high
        if self.chain():  # the scan does the rest
            return
        lowest = list(np.argsort(np.abs(high)))
        some = lowest if n <= 12 else [*lowest[:4], *rng.choice(n, 4, replace=False)]
        for k in some if n <= 120 else some[:3]:
            V = high.copy()
            V[k] *= 0.1
            yield V
        for _ in range(20 if n <= 12 else 8 if n <= 60 else 3):
            moduli = np.exp(rng.uniform(np.log(0.03), np.log(1.3), n))
            yield self.no_load * moduli * np.exp(1j * rng.uniform(-1, 1, n))

    def find(self, seed: int = 0, thorough: bool = True) -> Found:
        """The equilibria that can be found; without `thorough` no further than the curve over the level."""
        if not len(self.at):
            return Found(self, tuple(x for x in [self.refine(self.no_load)] if x), True, None)
        rng = np.random.default_rng(seed)
        known: list[Vector] = []
        high, nose = None, None
        before: tuple[float, Vector] | None = None
        for level, V, is_nose in self.trace():
            if before and (before[0] - 1) * (level - 1) <= 0 and level != before[0]:
                share = (1 - before[0]) / (level - before[0])
                there = self.newton(before[1] + share * (V - before[1]))
                if there is not None and not self.is_among(there, known):
                    known.append(there)
                    high = there if nose is None else high
            nose = level if is_nose and nose is None else nose
            before = level, V
        for start in self.starts(self.no_load if high is None else high, rng) if thorough else ():
            there = self.newton(start, known)
            if there is not None and not self.is_among(there, known):
                known.append(there)
            if len(known) >= (40 if self.count <= DENSE else 10):
                break
        order = self.chain()
        for there in self.scan(order) if order else ():
            if not self.is_among(there, known, 1e-6):
                known.append(there)
        refined: list[list[mpc]] = []
        for V in sorted(known, key=lambda V: (V is not high, -float(np.sum(np.abs(V))))):
            exact = self.refine(V)
            if exact and not any(self.distance(exact, other) < mpf("1e-20") * self.unit for other in refined):
                refined.append(exact)
        return Found(self, tuple(refined), high is not None, nose)

    @staticmethod
    def distance(a: Sequence[mpc], b: Sequence[mpc]) -> mpf:
        return max(abs(x - y) for x, y in zip(a, b, strict=True))

    # In many digits.

    def exact_residual(self, V: Sequence[mpc]) -> tuple[list[mpc], mpf]:
        """The sums of the currents in ampere, and the largest relative to the sizes of its terms."""
        total = [y * x + b for y, x, b in zip(self.diagonal, V, self.source, strict=True)]
        for i, j, y in self.links:
            total[i] -= y * V[j]
            total[j] -= y * V[i]
        for k, node in enumerate(self.nodes):
            if node.loads:
                total[k] += load_admittance(node.loads, abs(V[k])) * V[k]
        sizes = [abs(y * x) + abs(b) for y, x, b in zip(self.diagonal, V, self.source, strict=True)]
        return total, max(abs(E) / size for E, size in zip(total, sizes, strict=True))

    def refine(self, start: Iterable[complex | mpc], steps: int = 30) -> list[mpc] | None:
        """The solution next to `start` in 60 digits, by Newton steps that are solved in floats; None if there is none.

        Every step gains as many digits as the Jacobian in floats has: ten and more, fewer close to a nose.
        """
        with mp.workdps(DIGITS):
            V = [mpc(x) for x in start]
            best, idle = mp.inf, 0
            for _ in range(steps):
                if any(not x for x in V):
                    return None
                E, size = self.exact_residual(V)
                if size < ENOUGH:
                    return V
                idle = 0 if size < best / 2 else idle + 1
                if idle > 6:
                    break
                best = min(best, size)
                # In floats the residual may be too small to be squared: scale it to about one.
                largest = max(max(abs(x.real), abs(x.imag)) for x in E)
                right = np.array([complex(x / largest) for x in E])
                try:
                    step = to_complex(self.solve(self.jacobian(np.array([complex(x) for x in V])), -to_real(right)))
                except ArithmeticError:
                    return None
                V = [x + largest * mpc(s) for x, s in zip(V, step, strict=True)]
            return V if self.exact_residual(V)[1] < ACCEPTED else None


def to_real(x: Vector) -> Vector:
    return np.concatenate([x.real, x.imag])


def to_complex(x: Vector) -> Vector:
    n = len(x) // 2
    return np.asarray(x[:n] + 1j * x[n:])


# --- the whole network ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """The solutions of a cluster. `high`: the first is the one that the loads reach when they grow from nothing.

    `nose`: the level, in terms of the loads as they are, at which that one ends, if it was met.
    """

    cluster: Cluster
    solutions: tuple[list[mpc], ...]
    high: bool
    nose: float | None


@dataclass(frozen=True)
class Equilibria:
    """What was found of a network, cluster by cluster."""

    network: Network
    clusters: tuple[Found, ...]

    @property
    def share(self) -> float | None:
        """The loads as a share of the level at which the high equilibrium ends; None if that was not met."""
        noses = [found.nose for found in self.clusters if found.nose is not None]
        return 1 / min(noses) if noses else None

    @property
    def count(self) -> int:
        """How many there are in all combinations."""
        count = 1
        for found in self.clusters:
            count *= len(found.solutions)
        return count

    def voltages(self, only_in_bands: bool = False) -> Iterator[dict[str, mpc]]:
        """All combinations, that of the first ones first; maybe only those with every load inside its band."""
        with mp.workdps(DIGITS):
            fixed = {n.name: to_mpc(n.dgu.reference) for n in self.network.nodes if n.dgu and n.fixed}
            parts = [[dict(zip(f.cluster.names, V, strict=True)) for V in f.solutions] for f in self.clusters]
            if only_in_bands:
                if not in_bands(self.network, fixed):
                    return
                parts = [[part for part in some if in_bands(self.network, part)] for some in parts]
        for chosen in product(*parts):
            together = dict(fixed)
            for part in chosen:
                together |= part
            yield {node.name: together[node.name] for node in self.network.nodes}

    def solutions(self, limit: int = 64, only_in_bands: bool = False) -> list[Solution]:
        """At most `limit` of the combinations, with all currents."""
        return [solution_at(self.network, V) for V in islice(self.voltages(only_in_bands), limit)]

    @property
    def high(self) -> Solution | None:
        """The equilibrium that the loads reach when they grow from nothing, if there is one."""
        if not all(found.high and found.solutions for found in self.clusters):
            return None
        return self.solutions(1)[0]


def find_equilibria(network: Network, seed: int = 0, thorough: bool = True) -> Equilibria:
    """All equilibria that can be found. Without `thorough`: those on the curve over the level of the loads, and on chains."""
    found = [cluster.find(seed, thorough) for cluster in network.clusters()]
    if len(found) == 1 and found[0].cluster.count == 1 and not found[0].solutions:
        try:
            double = closed_form(network)
        except ValueError:
            double = ()
        if len(double) == 1:  # at a nose exactly, where Newton steps do not arrive
            found = [replace(found[0], solutions=([double[0]],))]
    return Equilibria(network, tuple(found))


def find_near(network: Network, voltages: Mapping[str, Fraction | Rational | complex | mpc]) -> Solution | None:
    """The equilibrium next to given voltages of all nodes (pairs of rationals, or complex), or None."""
    with mp.workdps(DIGITS):
        start = {name: to_mpc(x) if isinstance(x, tuple) else mpc(x) for name, x in voltages.items()}
        found = {n.name: to_mpc(n.dgu.reference) for n in network.nodes if n.dgu and n.fixed}
        for cluster in network.clusters():
            V = cluster.refine(start[name] for name in cluster.names)
            if V is None:
                return None
            found |= dict(zip(cluster.names, V, strict=True))
        return solution_at(network, {node.name: found[node.name] for node in network.nodes})


def largest_level(network: Network, lowest: float = 0.2, highest: float = 2.5) -> tuple[float, bool]:
    """How far the static loads can grow along the high equilibrium, as a factor; and whether a nose ends it.

    Without a nose it is the level at which a voltage leaves [lowest, highest] units, or at which the curve was left.
    """
    best, ends = float("inf"), False
    for cluster in network.clusters():
        last = 0.0
        for level, V, is_nose in cluster.trace(120, 1e9):
            v = np.abs(V) / cluster.unit
            last = level
            out = bool(np.min(v) < lowest or np.max(v) > highest)
            if is_nose or out:
                if level < best:
                    best, ends = level, is_nose
                break
        else:
            if len(cluster.at) and last < best:
                best, ends = last, False
    return best, ends
