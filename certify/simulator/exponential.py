"""An exponential integrator for small networks: linear dynamics exactly, load currents by collocation (THEORY 12).

In the modes of the linearised network, y' = lambda y + N(t) with N the rest of the load currents. Over a window of time
N is a polynomial through its values at Chebyshev points, and against that the modes are integrated exactly, however
stiff they are or fast they ring; the values come from a few sweeps of fixed-point iteration. Windows are a power of two
of the shortest apart, so that what depends on lambda h is computed once for each length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy
import scipy.linalg
from numpy.polynomial import chebyshev, legendre

from certify.simulator.compiled import compiled
from certify.simulator.flow import Flow
from certify.simulator.loads import draw, straight_and_turned
from certify.simulator.plant import Array, Phasors, to_phasors

POINTS = 12  # of a window, both ends included
QUADRATURES = ((4.0, 14), (24.0, 36))  # |lambda h| up to which so many nodes are enough; beyond, see `_steady`
SWEEPS = 12
SETTLED = 0.05  # of the tolerance: a change from one sweep to the next with which they end
HONEST = 8.0  # how many times the error the estimate of it may be: measured
DEEPEST = 36  # the shortest window is the first one by two to this
FIRST = 8.0  # |lambda h| of the fastest mode in the first window
SMOOTH = 4.0  # |lambda h| up to which a mode is interpolated between the points of a window


@dataclass(frozen=True)
class _Rule:
    """What depends on the number of points only; time runs from 0 to 1."""

    points: Array
    values: Array  # of the Chebyshev polynomials at the points, (points, degrees)
    coefficients: Array  # their inverse: the Lagrange polynomials
    slopes: Array  # coefficients to those of the derivative, strictly upper triangular
    high: Array  # values of the part of the two highest degrees
    barycentric: Array


@lru_cache(maxsize=4)
def _rule(q: int) -> _Rule:
    k = numpy.arange(q)
    points = (1 - numpy.cos(numpy.pi * k / (q - 1))) / 2
    values = chebyshev.chebvander(2 * points - 1, q - 1)
    coefficients = numpy.linalg.inv(values)
    slopes = numpy.zeros((q, q))
    for n in range(1, q):
        slopes[:n, n] = 2 * chebyshev.chebder(numpy.eye(q)[n])[:n]
    signs = (-1.0) ** k
    signs[[0, -1]] /= 2
    return _Rule(points, values, coefficients, slopes, values[:, -2:] @ coefficients[-2:], signs)


@lru_cache(maxsize=8)
def _quadrature(q: int, nodes: int) -> tuple[Array, Array]:
    """For integrals from 0 to each point: how far before it the nodes are, and Lagrange polynomials by weights.

    Shapes (points, nodes) and (points, nodes, points).
    """
    rule = _rule(q)
    x, weights = legendre.leggauss(nodes)
    shares, weights = (x + 1) / 2, weights / 2
    places = rule.points[:, None] * shares[None, :]
    inside = chebyshev.chebvander(2 * places - 1, q - 1) @ rule.coefficients
    return rule.points[:, None] - places, inside * weights[None, :, None] * rule.points[:, None, None]


def _weights(z: Phasors) -> Phasors:
    """Of each mode z = lambda h: integrals of e^(z (c_i - s)) l_j(s) from 0 to c_i. Shape (points, points, modes)."""
    rule, size = _rule(POINTS), numpy.abs(z)
    W = numpy.empty((POINTS, POINTS, len(z)), dtype=complex)
    least = -1.0
    for most, nodes in QUADRATURES:
        some = (size > least) & (size <= most)
        if some.any():
            before, inside = _quadrature(POINTS, nodes)
            grown = numpy.exp(before[:, None, :] * z[some][None, :, None])
            W[:, :, some] = (grown @ inside).transpose(0, 2, 1)
        least = most
    large = size > least
    if large.any():
        R = _steady(z[large])
        W[:, :, large] = R - numpy.exp(rule.points[:, None, None] * z[large]) * R[:1]
    return W


def _steady(z: Phasors) -> Phasors:
    """The polynomials R with R' = z R + l_j, at the points. Shape (points, points, modes)."""
    rule = _rule(POINTS)
    C = _solved(rule.slopes, rule.coefficients, z).reshape(POINTS, -1)
    return (rule.values.astype(complex) @ C).reshape(POINTS, POINTS, len(z))


@compiled
def _solved(slopes: Array, coefficients: Array, z: Phasors) -> Phasors:
    """The coefficients of R: highest degrees first, because nothing is a derivative of anything higher."""
    q = len(slopes)
    C = numpy.zeros((q, q, len(z)), dtype=numpy.complex128)
    for n in range(q - 1, -1, -1):
        for k in range(n + 1, q, 2):  # the slope of a polynomial that is even is odd
            C[n] += slopes[n, k] * C[k]
        C[n] = (C[n] - coefficients[n].reshape(-1, 1)) / z
    return C


@compiled
def _parts(y: Phasors) -> Array:
    """Real and imaginary parts next to each other, along the last axis. (.., m) to (.., 2 m)."""
    out = numpy.empty((y.shape[0], 2 * y.shape[1]))
    out[:, ::2] = y.real
    out[:, 1::2] = y.imag
    return out


@compiled
def _forces(y: Phasors, linear: Any, tables: Any) -> Phasors:
    """What drives the modes beside their own decay: the rest of the loads, and a constant. (q, m) to the same.

    Loads draw i + a dV + b conj(dV) by the linear law at the origin, which the modes have already.
    """
    seen, entry, constant, reference, straight, turned, drawn = linear
    pairs = _parts(y) @ seen
    off = pairs[:, ::2] + 1j * pairs[:, 1::2]
    rest = drawn + straight * off + turned * numpy.conj(off) - draw(reference + off, *tables)
    entered = _parts(rest) @ entry
    return entered[:, ::2] + 1j * entered[:, 1::2] + constant


@compiled
def _settle(
    y: Phasors, h: float, level: Any, high: Array, linear: Any, tables: Any, shapes: Any, weights: Array
) -> tuple[bool, float, Phasors, Phasors, Phasors]:
    """Sweeps over a window from the modes y until its end settles, weights being the error that a window may add.

    Returns whether it does, its error as a share of that, the modes at the points without forces and with them, (q, m),
    and these.
    """
    E, W = level
    parts, sizes = shapes
    grown = E * y
    values, forces = grown, grown
    previous = numpy.inf
    for _ in range(SWEEPS):
        forces = _forces(values, linear, tables)
        new = grown + h * (W * forces).sum(axis=1)
        change = (numpy.abs(_parts(new[-1:] - values[-1:]) @ parts)[0] / weights).max()
        values = new
        if not change < 1e3 * previous:  # it grows, or is no number
            break
        if change <= SETTLED:
            # sizes are added up: what is left out is like the highest degrees in size, and not in its signs
            left_out = h * (numpy.abs(W[-1]) * numpy.abs(high @ forces)).sum(axis=0)
            return True, (sizes @ left_out / weights).max() / HONEST, grown, values, forces
        previous = change
    return False, numpy.inf, grown, values, forces


class Modes:
    """A flow in the modes of its linearisation at a state `origin`: x = origin + Re(shapes y).

    Of two conjugate modes one is kept. `condition` is that of the shapes, states weighed by `scale`.
    """

    def __init__(self, flow: Flow, origin: Array, scale: Array) -> None:
        self.flow, self.origin, plant = flow, origin, flow.plant
        jacobian = flow.jacobian(origin).toarray()
        values, vectors = scipy.linalg.eig(jacobian / scale[:, None] * scale[None, :])
        # LAPACK has conjugate pairs next to each other, the one above the axis first
        keep = values.imag >= 0
        inverse = numpy.linalg.inv(vectors)
        self.condition = float(numpy.linalg.norm(vectors, 1) * numpy.linalg.norm(inverse, 1))
        left = inverse / scale[None, :]
        vectors = vectors * scale[:, None]
        self.values = values[keep]
        self.shapes = numpy.where(self.values.imag > 0, 2.0, 1.0) * vectors[:, keep]
        self.left = left[keep]
        self.parts = numpy.ascontiguousarray(_as_real(self.shapes).T)  # (2 m, n), from interleaved parts
        self.sizes = numpy.abs(self.shapes)
        V = to_phasors(plant.S @ origin + plant.s)
        self.linear = (
            numpy.ascontiguousarray(_as_real(plant.S @ self.shapes).T),
            numpy.ascontiguousarray((self.left @ plant.D.toarray()).T).view(float),
            self.left @ flow.rates(origin),
            V,
            *straight_and_turned(plant.loads.slopes(V)),
            plant.loads.currents(V[None, :])[0],
        )
        loads = plant.loads
        self.tables = loads.zips, loads.exps, loads.formulas, loads.terms
        self._levels: dict[float, tuple[Phasors, Phasors]] = {}
        self._steady: dict[float, tuple[Any, Phasors]] = {}

    def level(self, h: float) -> tuple[Phasors, Phasors]:
        """Growth over a window and its weights, for one length of windows."""
        if h not in self._levels:
            z = self.values * h
            self._levels[h] = numpy.exp(_rule(POINTS).points[:, None] * z[None, :]), _weights(z)
        return self._levels[h]

    def steady(self, h: float) -> tuple[Any, Phasors]:
        """Which modes are no polynomials over a window, and what forces alone make of them: see `_steady`."""
        if h not in self._steady:
            rough = numpy.abs(self.values * h) > SMOOTH
            self._steady[h] = rough, _steady(self.values[rough] * h)
        return self._steady[h]

    def to_modes(self, x: Array) -> Phasors:
        return self.left @ (x - self.origin)

    def to_states(self, y: Phasors) -> Array:
        """States of modes. Shape (.., m) to (.., n)."""
        return self.origin + numpy.ascontiguousarray(y).view(float) @ self.parts


@dataclass(frozen=True)
class Window:
    """The motion over a stretch of time, which may be looked at anywhere within it.

    `grown`, `values`: the modes at the points without forces and with them, `forces` these, all of shape (q, m).
    """

    modes: Modes
    start: float
    length: float
    grown: Phasors
    values: Phasors
    forces: Phasors

    @property
    def end(self) -> float:
        return self.start + self.length

    @property
    def last(self) -> Array:
        """The state at the end."""
        return self.modes.to_states(self.values[-1])

    def modes_at(self, times: Array) -> Phasors:
        """Shape (t,) of times in s to (t, m)."""
        share = (times - self.start) / self.length
        z = self.modes.values * self.length
        growth = numpy.exp(share[:, None] * z)
        between = _interpolation(_rule(POINTS), share)
        forced = between @ (self.values - self.grown)
        rough, R = self.modes.steady(self.length)
        if rough.any():  # no polynomial, but the sum of one and of what decays from it
            steady = self.length * (R * self.forces[:, rough]).sum(axis=1)
            forced[:, rough] = between @ steady - growth[:, rough] * steady[0]
        return growth * self.values[0] + forced

    def states(self, times: Array) -> Array:
        """Shape (t,) of times in s to (t, n)."""
        return self.modes.to_states(self.modes_at(times))

    def ripple(self, rows: Array, slow: float) -> Array:
        """How large the part of rows @ x is that turns faster than `slow` in rad a window. Shape (g, n) to (g,)."""
        fast = numpy.abs(self.modes.values.imag) * self.length > slow
        if not fast.any():
            return numpy.zeros(len(rows))
        largest = numpy.abs(self.values[:, fast]).max(axis=0)
        return numpy.abs(rows @ self.modes.shapes[:, fast]) @ largest


def _interpolation(rule: _Rule, share: Array) -> Array:
    """Values at the points of a window to values at other places of it. Shape (t, q)."""
    off = share[:, None] - rule.points[None, :]
    exact = off == 0
    with numpy.errstate(divide="ignore", invalid="ignore"):
        terms = rule.barycentric / off
        result = terms / terms.sum(axis=1, keepdims=True)
    hit = exact.any(axis=1)
    result[hit] = exact[hit].astype(float)
    return result


class Exponential:
    """Advances a flow from a state at time 0, window by window, up to about `span` in s each.

    Their lengths are powers of two, so that what depends on them is computed once for each.

    `tolerance` bounds the error that a window adds, as a share of the weights given with it.
    """

    def __init__(self, modes: Modes, x: Array, span: float, tolerance: float) -> None:
        self.modes, self.span, self.tolerance = modes, span, tolerance
        self.y, self.time = modes.to_modes(x), 0.0
        fastest = float(numpy.abs(modes.values).max(initial=0.0))
        self.unit = 2.0 ** math.floor(math.log2(min(span, FIRST / fastest if fastest else span)))
        self.depth = 0
        self.rejected = 0
        self.last: Window | None = None

    def advance(self, weights: Array) -> Window:
        """The next window, of an error within the tolerance for states of these sizes, (n,).

        Raises: FloatingPointError if the motion cannot be followed, because it grows beyond all bounds.
        """
        while self.depth <= DEEPEST:
            window, error = self._attempt(math.ldexp(self.unit, -self.depth), weights)
            if window is not None and error <= 1:
                self.y, self.time, self.last = window.values[-1], window.end, window
                # twice the length makes the error of the highest degrees 2^POINTS times as large
                if error < 2.0 ** (2 - POINTS) * 16 and window.length < self.span:
                    self.depth -= 1
                return window
            self.rejected += 1
            self.depth += 1
        raise FloatingPointError("no window is short enough")

    def shorten(self) -> None:
        """Go back to the start of the last window; the next one will be half as long."""
        if self.last is not None:
            self.y, self.time = self.last.values[0], self.last.start
            self.depth = round(math.log2(self.unit / self.last.length)) + 1
            self.rejected += 1

    def _attempt(self, h: float, weights: Array) -> tuple[Window | None, float]:
        """A window of one length, None if the sweeps do not settle, and its error as a share of the tolerance."""
        modes = self.modes
        with numpy.errstate(all="ignore"):  # what is no number is turned down
            settled, error, grown, values, forces = _settle(
                self.y,
                h,
                modes.level(h),
                _rule(POINTS).high.astype(complex),
                modes.linear,
                modes.tables,
                (modes.parts, modes.sizes),
                self.tolerance * weights,
            )
        return (Window(modes, self.time, h, grown, values, forces) if settled else None), float(error)


def _as_real(shapes: Phasors) -> Array:
    """Re(shapes y) as a real matrix of the interleaved parts of y. (n, m) to (n, 2 m)."""
    result = numpy.empty((shapes.shape[0], 2 * shapes.shape[1]))
    result[:, ::2], result[:, 1::2] = shapes.real, -shapes.imag
    return result
