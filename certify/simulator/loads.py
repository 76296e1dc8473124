"""The currents that the static loads of a network draw, all at once, in floats: (P - jQ) / v^2 V (THEORY 1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy
from numpy.typing import NDArray

from certify.kernel.spec import ExpLoad, Node, ZipLoad
from certify.simulator.compiled import compiled

Array = NDArray[numpy.floating[Any]]
Phasors = NDArray[numpy.complex128]
Table = tuple[Any, Phasors, Array]
FLOOR = 0.01  # of the upper end of the band: where a load without a cut-off becomes an impedance in simulations


class StaticLoads:
    """The static loads at some nodes, added up at each: currents in ampere of voltages in volt, and their slopes.

    `zips` and `exps` are layers: each has one load at most of a node, as positions of nodes, complex coefficients and
    real ones. Below its cut-off a load is the impedance that it is there; one without a cut-off has that at `FLOOR`,
    because a constant power has no meaning at no voltage. `formulas` has the currents that are given by formulas of Vd
    and Vq: of each the position, and its terms c Vd^i Vq^j as rows (which, i, j, c), which being 0 and 1 for the
    numerators of I_d and I_q and 2 for their denominator. There is a layer of each, if need be an empty one.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.size = len(nodes)
        loads = [[x for x in node.loads if isinstance(x, ZipLoad)] for node in nodes]
        others = [[x for x in node.loads if isinstance(x, ExpLoad)] for node in nodes]
        lows = [FLOOR * _top(node) for node in nodes]
        self.zips: tuple[Table, ...] = tuple(_zip_table(layer) for layer in _layers(loads, lows))
        self.exps: tuple[Table, ...] = tuple(_exp_table(layer) for layer in _layers(others, lows))
        given = [(k, node) for k, node in enumerate(nodes) if node.current]
        self.formulas = numpy.array([k for k, _ in given], dtype=numpy.int64)
        self.terms = tuple(_terms(node) for _, node in given) or (numpy.zeros((0, 4)),)

    def currents(self, V: Phasors) -> Phasors:
        """What is drawn at each node, in ampere. Shape (m, k) of voltages at m times to the same."""
        return draw(V, self.zips, self.exps, self.formulas, self.terms)

    def slopes(self, V: Phasors) -> Array:
        """d (I_d, I_q) / d (V_d, V_q) at each node, in siemens. Shape (k,) to (k, 2, 2).

        I = Y(v) V, so dI = Y dV + Y'(v) V <V, dV> / v. At a cut-off it is that from above, at no voltage zero.
        """
        Y, steep = numpy.zeros((2, self.size), dtype=complex)
        v = abs(V)
        for at, (Y0, I0, P), (cutoff,) in ((at, loads.T, low.T) for at, loads, low in self.zips):
            u, above = _clipped(v[at], cutoff)
            Y[at] += numpy.where(u < numpy.inf, Y0 + (I0 + P / u) / u, 0)
            steep[at] += numpy.where(above, -(I0 + 2 * P / u) / u**2, 0)
        for at, (P0, Q0), (V0, np_, nq, cutoff) in ((at, loads.T, numbers.T) for at, loads, numbers in self.exps):
            u, above = _clipped(v[at], cutoff)
            there = numpy.where(u < numpy.inf, u, V0)
            P, Q = (numpy.where(u < numpy.inf, x * (there / V0) ** n / there**2, 0) for x, n in ((P0, np_), (Q0, nq)))
            Y[at] += P + Q
            steep[at] += numpy.where(above, ((np_ - 2) * P + (nq - 2) * Q) / u, 0)
        safe = numpy.where(v > 0, v, 1)
        with_d, with_q = steep * V * V.real / safe, steep * V * V.imag / safe
        J = numpy.empty((self.size, 2, 2))
        J[:, 0, 0], J[:, 1, 0] = (Y + with_d).real, (Y + with_d).imag
        J[:, 0, 1], J[:, 1, 1] = (1j * Y + with_q).real, (1j * Y + with_q).imag
        for k, terms in zip(self.formulas, self.terms, strict=False):
            J[k] += _formula_slope(terms, float(V[k].real), float(V[k].imag))
        return J


def straight_and_turned(slopes: Array) -> tuple[Phasors, Phasors]:
    """Real matrices J, (k, 2, 2), as complex numbers: J dV is straight dV + turned conj(dV). Shape (k,) twice."""
    dd, dq, qd, qq = slopes.reshape(-1, 4).T.astype(complex)
    return (dd + qq + 1j * (qd - dq)) / 2, (dd - qq + 1j * (qd + dq)) / 2


@compiled
def draw(V: Phasors, zips: Any, exps: Any, formulas: Any, terms: Any) -> Phasors:
    """What all loads draw, in ampere; the tables are those of `StaticLoads`. Shape (m, k) to the same."""
    total = numpy.zeros_like(V)
    for at, loads, cutoff in zips:
        add_zips(V, at, loads, cutoff, total)
    for at, loads, numbers in exps:
        add_exps(V, at, loads, numbers, total)
    for n in range(len(formulas)):
        add_formula(V, formulas[n], terms[n], total)
    return total


@compiled
def add_zips(V: Phasors, at: Any, loads: Phasors, cutoff: Array, total: Phasors) -> None:
    """Add the currents Y V + I V/v + P V/v^2 of a layer of ZIP loads; coefficients are active - j reactive."""
    own = V[:, at]
    v = numpy.maximum(numpy.abs(own), cutoff[:, 0])
    v = numpy.where(v > 0.0, v, numpy.inf)  # no voltage, no direction of a current
    total[:, at] += (loads[:, 0] + (loads[:, 1] + loads[:, 2] / v) / v) * own


@compiled
def add_exps(V: Phasors, at: Any, loads: Phasors, numbers: Array, total: Phasors) -> None:
    """Add the currents of a layer of exponential loads: P0 (v/V0)^np - j Q0 (v/V0)^nq, by v^2 times V."""
    own = V[:, at]
    v = numpy.maximum(numpy.abs(own), numbers[:, 3])
    v = numpy.where(v > 0.0, v, numbers[:, 0])  # without a voltage `own` is zero
    u = v / numbers[:, 0]
    total[:, at] += (loads[:, 0] * u ** numbers[:, 1] + loads[:, 1] * u ** numbers[:, 2]) / (v * v) * own


@compiled
def add_formula(V: Phasors, at: int, terms: Array, total: Phasors) -> None:
    """Add a current that is given by a formula: numerators by their denominator."""
    x, y = V[:, at].real, V[:, at].imag
    sums = numpy.zeros((3, len(x)))
    for n in range(len(terms)):
        sums[int(terms[n, 0])] += terms[n, 3] * x ** terms[n, 1] * y ** terms[n, 2]
    total[:, at] += (sums[0] + 1j * sums[1]) / sums[2]


def _clipped(v: Array, cutoff: Array) -> tuple[Array, NDArray[numpy.bool_]]:
    """The voltage at which the admittance of a load is taken, infinite for none; and whether that is its own."""
    u = numpy.maximum(v, cutoff)
    return numpy.where(u > 0, u, numpy.inf), (v >= cutoff) & (v > 0)


def _top(node: Node) -> float:
    """The largest voltage of the claim on a node's loads."""
    if node.current:
        d, q = node.current.centre_volt
        return abs(complex(float(d), float(q))) + float(node.current.radius_volt)
    return float(node.band_volt[1]) if node.band_volt else 0.0


def _layers(loads: Sequence[Sequence[Any]], lows: Sequence[float]) -> list[list[tuple[int, Any, float]]]:
    """The first loads of all nodes, the second ones, and so on, each with the position of its node and its cut-off."""
    depth = max(1, *map(len, loads)) if loads else 1
    return [
        [(k, own[n], float(own[n].cutoff_volt or lows[k])) for k, own in enumerate(loads) if len(own) > n]
        for n in range(depth)
    ]


def _zip_table(layer: list[tuple[int, Any, float]]) -> Table:
    rows = [[complex(float(p), -float(q)) for p, q in (x.Y, x.I, x.P)] for _, x, _ in layer]
    lows = [[low] for _, _, low in layer]
    return _positions(layer), numpy.array(rows, dtype=complex).reshape(-1, 3), numpy.array(lows).reshape(-1, 1)


def _exp_table(layer: list[tuple[int, Any, float]]) -> Table:
    rows = [[complex(float(x.P0_watt)), complex(0, -float(x.Q0_var))] for _, x, _ in layer]
    numbers = [[float(x.V0_volt), float(x.np), float(x.nq), low] for _, x, low in layer]
    return _positions(layer), numpy.array(rows, dtype=complex).reshape(-1, 2), numpy.array(numbers).reshape(-1, 4)


def _positions(layer: list[tuple[int, Any, float]]) -> Any:
    return numpy.array([k for k, _, _ in layer], dtype=numpy.int64)


def _terms(node: Node) -> Array:
    """The terms of a load given by formulas of its current: rows (which, i, j, c)."""
    law = node.current.law if node.current else None
    if law is None:
        raise ValueError("no load of this node is given by its current")
    parts = enumerate((*law.numerators, law.denominator))
    return numpy.array([[which, i, j, float(c)] for which, part in parts for (i, j), c in part], dtype=float)


def _formula_slope(terms: Array, x: float, y: float) -> Array:
    """The Jacobian of (numerators / denominator) at one voltage, by the quotient rule."""
    sums = numpy.zeros((3, 3))  # values, and slopes by x and y, of both numerators and the denominator
    for which, i, j, c in terms:
        own = sums[int(which)]
        own[0] += c * x**i * y**j
        own[1] += c * i * x ** (i - 1) * y**j if i else 0.0
        own[2] += c * j * x**i * y ** (j - 1) if j else 0.0
    n, (g, *slopes) = sums[:2, 0], sums[2]
    return numpy.array([(sums[:2, k + 1] * g - n * slope) / g**2 for k, slope in enumerate(slopes)]).T
