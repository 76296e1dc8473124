"""The currents that the static loads of a network draw, all at once, in floats: (P - jQ) / v^2 V (THEORY 1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy
from numpy.typing import NDArray

from certify.kernel.spec import ExpLoad, Node, ZipLoad
from certify.simulate.compiled import compiled

Array = NDArray[numpy.floating[Any]]
Phasors = NDArray[numpy.complex128]
Polynomial = list[tuple[int, int, float]]  # i, j, c of c Vd^i Vq^j
Table = tuple[Any, Phasors, Array]
FLOOR = 0.01  # of the upper end of the band: where a load without a cut-off becomes an impedance in simulations


class StaticLoads:
    """The static loads at some nodes, added up at each: currents in ampere of voltages in volt, and their slopes.

    `zips` and `exps` are layers: each has one load at most of a node, as positions of nodes, complex coefficients and
    real ones. Below its cut-off a load is the impedance that it is there; one without a cut-off has that at `FLOOR`,
    because a constant power has no meaning at no voltage. Currents given by formulas of Vd and Vq are beside them.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.size = len(nodes)
        loads = [[x for x in node.loads if isinstance(x, ZipLoad)] for node in nodes]
        others = [[x for x in node.loads if isinstance(x, ExpLoad)] for node in nodes]
        lows = [FLOOR * float(node.band_volt[1]) if node.band_volt else 0.0 for node in nodes]
        self.zips: tuple[Table, ...] = tuple(_zip_table(layer) for layer in _layers(loads, lows))
        self.exps: tuple[Table, ...] = tuple(_exp_table(layer) for layer in _layers(others, lows))
        self.formulas = [(k, _polynomials(node)) for k, node in enumerate(nodes) if node.current]

    def currents(self, V: Phasors) -> Phasors:
        """What is drawn at each node, in ampere. Shape (m, k) of voltages at m times to the same."""
        total = numpy.zeros_like(V)
        for at, loads, cutoff in self.zips:
            add_zips(V, at, loads, cutoff, total)
        for at, loads, numbers in self.exps:
            add_exps(V, at, loads, numbers, total)
        for k, (d, q, below) in self.formulas:
            x, y = V[:, k].real, V[:, k].imag
            total[:, k] += (_value(d, x, y) + 1j * _value(q, x, y)) / _value(below, x, y)
        return total

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
        for k, polynomials in self.formulas:
            J[k] += _formula_slope(polynomials, float(V[k].real), float(V[k].imag))
        return J


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


def _clipped(v: Array, cutoff: Array) -> tuple[Array, NDArray[numpy.bool_]]:
    """The voltage at which the admittance of a load is taken, infinite for none; and whether that is its own."""
    u = numpy.maximum(v, cutoff)
    return numpy.where(u > 0, u, numpy.inf), (v >= cutoff) & (v > 0)


def _layers(loads: Sequence[Sequence[Any]], lows: Sequence[float]) -> list[list[tuple[int, Any, float]]]:
    """The first loads of all nodes, the second ones, and so on, each with the position of its node and its cut-off."""
    depth = max(map(len, loads), default=0)
    return [
        [(k, own[n], float(own[n].cutoff_volt or lows[k])) for k, own in enumerate(loads) if len(own) > n]
        for n in range(depth)
    ]


def _zip_table(layer: list[tuple[int, Any, float]]) -> Table:
    rows = [[complex(float(p), -float(q)) for p, q in (x.Y, x.I, x.P)] for _, x, _ in layer]
    return numpy.array([k for k, _, _ in layer]), numpy.array(rows), numpy.array([[low] for _, _, low in layer])


def _exp_table(layer: list[tuple[int, Any, float]]) -> Table:
    rows = [[complex(float(x.P0_watt)), complex(0, -float(x.Q0_var))] for _, x, _ in layer]
    numbers = [[float(x.V0_volt), float(x.np), float(x.nq), low] for _, x, low in layer]
    return numpy.array([k for k, _, _ in layer]), numpy.array(rows), numpy.array(numbers)


def _polynomials(node: Node) -> tuple[Polynomial, ...]:
    """Numerators of I_d and I_q, and their denominator, of a load given by formulas of its current."""
    law = node.current.law if node.current else None
    if law is None:
        raise ValueError("no load of this node is given by its current")
    return tuple([(i, j, float(c)) for (i, j), c in p] for p in (*law.numerators, law.denominator))


def _value(polynomial: Polynomial, x: Any, y: Any) -> Any:
    return sum((c * x**i * y**j for i, j, c in polynomial), 0.0 * x)


def _formula_slope(polynomials: tuple[Polynomial, ...], x: float, y: float) -> Array:
    """The Jacobian of (numerators / denominator) at one voltage, by the quotient rule."""
    n, g = numpy.array([_value(p, x, y) for p in polynomials[:2]]), _value(polynomials[2], x, y)
    by_x, by_y = (
        [[(i - a, j - b, c * (i if a else j)) for i, j, c in p if (i if a else j)] for p in polynomials]
        for a, b in ((1, 0), (0, 1))
    )
    slopes = [[_value(p, x, y) for p in part] for part in (by_x, by_y)]
    return numpy.array([(numpy.array(s[:2]) * g - n * s[2]) / g**2 for s in slopes]).T
