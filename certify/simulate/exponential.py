"""An exponential integrator for small networks: linear dynamics exactly, load currents by collocation (THEORY 12).

In the modes of the linearised network, y' = lambda y + N(t) with N the rest of the load currents. Over a window of time
N is a polynomial through its values at Chebyshev points, and against that the modes are integrated exactly, however
stiff they are or fast they ring; the values come from a few sweeps of fixed-point iteration. Windows are a power of two
of the shortest apart, so that what depends on lambda h is computed once for each length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy
import scipy.linalg
from numpy.polynomial import chebyshev, legendre

from certify.simulate.compiled import compiled
from certify.simulate.flow import Flow
from certify.simulate.plant import Array, Phasors, to_phasors

POINTS = 12  # of a window, both ends included
QUADRATURE = 40
SWEEPS = 12
SETTLED = 0.05  # of the tolerance: a change from one sweep to the next with which they end
HONEST = 8.0  # how many times the error the estimate of it may be: measured
DEEPEST = 44  # the shortest window is the span by two to this
FIRST = 8.0  # |lambda h| of the fastest mode in the first window
SMALL = 24.0  # |lambda h| up to which weights come from quadrature; beyond, from a polynomial solution
SMOOTH = 4.0  # |lambda h| up to which a mode is interpolated between the points of a window


@dataclass(frozen=True)
class _Rule:
    """What depends on the number of points only; time runs from 0 to 1."""

    points: Array
    differentiate: Array
    inside: Array  # (points, points, quadrature): the Lagrange polynomials between 0 and each point
    shares: Array  # quadrature nodes of (0, 1)
    weights: Array
    high: Array  # values of the part of the two highest degrees
    barycentric: Array


@lru_cache(maxsize=4)
def _rule(q: int) -> _Rule:
    k = numpy.arange(q)
    angles = numpy.pi * k / (q - 1)
    points = (1 - numpy.cos(angles)) / 2
    to_coefficients = numpy.linalg.inv(chebyshev.chebvander(2 * points - 1, q - 1))
    nodes, weights = legendre.leggauss(QUADRATURE)
    shares, weights = (nodes + 1) / 2, weights / 2
    places = points[:, None] * shares[None, :]
    inside = numpy.einsum("igc,cj->igj", chebyshev.chebvander(2 * places - 1, q - 1), to_coefficients)
    slopes = numpy.stack(
        [2 * chebyshev.chebval(2 * points - 1, chebyshev.chebder(c)) for c in to_coefficients.T], axis=1
    )
    high = chebyshev.chebvander(2 * points - 1, q - 1)[:, -2:] @ to_coefficients[-2:]
    signs = (-1.0) ** k
    signs[[0, -1]] /= 2
    return _Rule(points, slopes, inside, shares, weights, high, signs)


def _weights(z: Phasors, rule: _Rule) -> tuple[Phasors, Phasors]:
    """Of each mode z = lambda h: integrals of e^(z (c_i - s)) l_j(s) from 0 to c_i, and the polynomial solutions.

    Shapes (points, points, modes) twice. The second, R with R' = z R + l_j, is zero where it is not used.
    """
    q, n = len(rule.points), len(z)
    W, R = numpy.zeros((2, q, q, n), dtype=complex)
    small = numpy.abs(z) <= SMALL
    if small.any():
        reach = rule.points[:, None] * (1 - rule.shares)[None, :]
        grown = numpy.exp(reach[:, None, :] * z[small][None, :, None]) * rule.weights
        W[:, :, small] = (grown @ rule.inside * rule.points[:, None, None]).transpose(0, 2, 1)
    rough = numpy.abs(z) > SMOOTH
    if rough.any():
        systems = rule.differentiate[None, :, :] - z[rough][:, None, None] * numpy.eye(q)[None, :, :]
        R[:, :, rough] = numpy.linalg.inv(systems).transpose(1, 2, 0)
    large = ~small
    W[:, :, large] = R[:, :, large] - numpy.exp(rule.points[:, None, None] * z[large]) * R[:1][:, :, large]
    return W, R


@compiled
def _sweep(grown: Phasors, forces: Phasors, W: Phasors, h: float) -> Phasors:
    """The modes at the points of a window under given forces. Shapes (q, m), (q, m), (q, q, m)."""
    return grown + h * (W * forces).sum(axis=1)


@compiled
def _remainder(
    V: Phasors, drawn: Phasors, reference: Phasors, straight: Phasors, turned: Phasors, at: Phasors
) -> Phasors:
    """What loads draw beside the linear law i + a dV + b conj(dV): with its sign as a force."""
    off = V - reference
    return at + straight * off + turned * numpy.conj(off) - drawn


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
        self.condition = float(numpy.linalg.cond(vectors))
        left = numpy.linalg.inv(vectors) / scale[None, :]
        vectors = vectors * scale[:, None]
        self.values = values[keep]
        self.shapes = numpy.where(self.values.imag > 0, 2.0, 1.0) * vectors[:, keep]
        self.left = left[keep]
        self.shapes_real = numpy.ascontiguousarray(_as_real(self.shapes).T)  # (2 m, n), from interleaved parts
        self.sizes = numpy.abs(self.shapes)
        self.seen_real = numpy.ascontiguousarray(_as_real(plant.S @ self.shapes).T)
        self.entry_real = numpy.ascontiguousarray((self.left @ plant.D.toarray()).T).view(float)
        self.constant = self.left @ flow.rates(origin)
        self.V = to_phasors(plant.S @ origin + plant.s)
        # J dV of a real matrix J as straight dV + turned conj(dV)
        dd, dq, qd, qq = plant.loads.slopes(self.V).reshape(-1, 4).T.astype(complex)
        self.straight, self.turned = (dd + qq + 1j * (qd - dq)) / 2, (dd - qq + 1j * (qd + dq)) / 2
        self.drawn = plant.loads.currents(self.V[None, :])[0]
        self._levels: dict[float, tuple[Phasors, Phasors, Phasors]] = {}

    def level(self, h: float) -> tuple[Phasors, Phasors, Phasors]:
        """Growth over a window and its weights, for one length of windows."""
        if h not in self._levels:
            rule = _rule(POINTS)
            z = self.values * h
            self._levels[h] = (numpy.exp(rule.points[:, None] * z[None, :]), *_weights(z, rule))
        return self._levels[h]

    def to_modes(self, x: Array) -> Phasors:
        return self.left @ (x - self.origin)

    def to_states(self, y: Phasors) -> Array:
        """States of modes. Shape (.., m) to (.., n)."""
        return self.origin + numpy.ascontiguousarray(y).view(float) @ self.shapes_real

    def forces(self, y: Phasors) -> Phasors:
        """What drives the modes beside their own decay: the rest of the loads, and a constant. (q, m) to the same."""
        if not self.V.size:
            return numpy.broadcast_to(self.constant, y.shape).copy()
        V = self.V + (y.view(float) @ self.seen_real).view(complex)
        n = _remainder(V, self.flow.plant.loads.currents(V), self.V, self.straight, self.turned, self.drawn)
        return (n.view(float) @ self.entry_real).view(complex) + self.constant


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
        rough = numpy.abs(z) > SMOOTH
        if rough.any():  # no polynomial, but the sum of one and of what decays from it
            _, _, R = self.modes.level(self.length)
            steady = self.length * (R[:, :, rough] * self.forces[:, rough]).sum(axis=1)
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
    """Advances a flow from a state at time 0, window by window, all of lengths `unit` 2^-k in s.

    `tolerance` bounds the error that a window adds, as a share of the weights given with it.
    """

    def __init__(self, modes: Modes, x: Array, unit: float, tolerance: float) -> None:
        self.modes, self.unit, self.tolerance = modes, unit, tolerance
        self.y, self.time = modes.to_modes(x), 0.0
        fastest = float(numpy.abs(modes.values).max(initial=0.0))
        self.depth = max(0, min(DEEPEST, int(numpy.ceil(numpy.log2(max(1.0, fastest * unit / FIRST))))))
        self.rejected = 0
        self.last: Window | None = None

    def advance(self, weights: Array) -> Window:
        """The next window, of an error within the tolerance for states of these sizes, (n,).

        Raises: FloatingPointError if the motion cannot be followed, because it grows beyond all bounds.
        """
        while self.depth <= DEEPEST:
            window, error = self._attempt(self.unit / 2**self.depth, weights)
            if window is not None and error <= 1:
                self.y, self.time, self.last = window.values[-1], window.end, window
                # twice the length makes the error of the highest degrees 2^POINTS times as large
                if error < 2.0 ** (2 - POINTS) * 16 and self.depth:
                    self.depth -= 1
                return window
            self.rejected += 1
            self.depth += 1
        raise FloatingPointError("no window is short enough")

    def shorten(self) -> None:
        """Go back to the start of the last window; the next one will be half as long."""
        if self.last is not None:
            self.y, self.time = self.last.values[0], self.last.start
            self.depth = round(float(numpy.log2(self.unit / self.last.length))) + 1
            self.rejected += 1

    def _attempt(self, h: float, weights: Array) -> tuple[Window | None, float]:
        """A window of one length, None if the sweeps do not settle, and its error as a share of the tolerance."""
        modes = self.modes
        E, W, _ = modes.level(h)
        grown = E * self.y
        values, previous = grown, numpy.inf

        def size(y: Phasors) -> float:
            return float(numpy.abs(y.view(float) @ modes.shapes_real / weights).max(initial=0.0)) / self.tolerance

        for _ in range(SWEEPS):
            forces = modes.forces(values)
            new = _sweep(grown, forces, W, h)
            change = size(new[-1] - values[-1])
            values = new
            if not change < 1e3 * previous:  # it grows, or is no number
                return None, numpy.inf
            if change <= SETTLED:
                # sizes are added up: what is left out is like the highest degrees in size, and not in its signs
                left_out = h * (numpy.abs(W[-1]) * numpy.abs(_rule(POINTS).high @ forces)).sum(axis=0)
                error = float((modes.sizes @ left_out / weights).max(initial=0.0)) / (HONEST * self.tolerance)
                return Window(modes, self.time, h, grown, values, forces), error
            previous = change
        return None, numpy.inf


def _as_real(shapes: Phasors) -> Array:
    """Re(shapes y) as a real matrix of the interleaved parts of y. (n, m) to (n, 2 m)."""
    result = numpy.empty((shapes.shape[0], 2 * shapes.shape[1]))
    result[:, ::2], result[:, 1::2] = shapes.real, -shapes.imag
    return result
