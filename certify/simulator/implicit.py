"""Radau IIA collocation of high order for large networks: stiff, ringing and slow motion alike (THEORY 12).

Over a window the states are a polynomial whose slope is right at s points, the last of them its end; the method is
L-stable, of order 2 s - 1 at the end of a window and s within. Of the s n equations the linear part is solved in one
go: the inverse of the coefficients has a real and (s - 1)/2 pairs of complex eigenvalues, and each is one shifted
system, reduced to the nodes (`nodal`). What loads draw beside their slopes is iterated upon, at the nodes alone.
Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, IV.8; J. Comput. Appl. Math. 111 (1999) 93.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy
from numpy.polynomial import legendre

from certify.simulator.flow import Flow
from certify.simulator.nodal import Loads, Nodal, Shifted
from certify.simulator.plant import Array, Phasors

STAGES = (
    11  # 300 nodes ringing for 50 ms at 1e-6: 2.2 s with 5, 1.5 s with 7, 1.1 s with 9, 0.93 s with 11, 0.94 s with 13
)
UNITS = 1 << 53  # windows are whole multiples of the span by this
ITERATIONS = 10
SETTLED = 0.03  # of the tolerance: a change of the states with which iterations end
AIM = 0.6  # of the tolerance: the error for which the next window is made
KEPT_LEVELS = 3  # lengths of windows of which the factors are kept
EXACT = 0.01  # of that change: what is left of it in some windows, for the error not to be that of the iteration
EVERY = 4  # windows of one length: one of so many is exact


@dataclass(frozen=True)
class _Rule:
    """The coefficients of one number of stages; time runs from 0 to 1."""

    points: Array  # (s,), the last is 1
    shifts: Phasors  # (k,): the eigenvalues of the inverse coefficients, the real one first, one of each pair
    forward: Phasors  # (s, k): stages are Re(forward W)
    back: Phasors  # (k, s): from the stages' right-hand sides to those of the systems
    entry: Phasors  # (k,): back times ones
    slope: Phasors  # (k,): the polynomial's slope at the start is Re(slope W) / h
    legendre: Phasors  # (s + 1, k): to the polynomial's coefficients
    high: Array  # (2, s): from values at the points to the part of the two highest degrees, on its own scale
    defect: Array  # (s + 2,): those of the integral of the defect that is 1 at the start and 0 at the points
    height: float  # the largest value of that integral


@lru_cache(maxsize=8)
def _rule(s: int) -> _Rule:
    top = numpy.zeros(s + 1)
    top[s - 1 :] = -1, 1
    x = numpy.sort(legendre.legroots(top))  # P_s - P_(s-1): the points of Radau, on the right
    x[-1] = 1.0
    values = legendre.legvander(x, s - 1)
    integrals = numpy.stack([legendre.legval(x, legendre.legint(e, lbnd=-1)) for e in numpy.eye(s)], axis=1) / 2
    A = integrals @ numpy.linalg.inv(values)
    shifts, T = numpy.linalg.eig(numpy.linalg.inv(A))
    keep = numpy.flatnonzero(shifts.imag >= 0)
    keep = keep[numpy.argsort(shifts.imag[keep])]
    back = numpy.linalg.inv(T)
    forward = numpy.where(shifts.imag[keep] > 0, 2.0, 1.0) * T[:, keep]
    through = numpy.linalg.inv(legendre.legvander(numpy.concatenate([[-1.0], x]), s))  # values to coefficients
    slopes = 2 * (legendre.legvander(numpy.array([-1.0]), s - 1) @ legendre.legder(through, axis=0))[0]
    # (P_s - P_(s-1)) is zero at the points, and 2 (-1)^s at the start
    defect = legendre.legint(top / (2 * (-1) ** s), lbnd=-1) / 2
    height = float(numpy.abs(legendre.legval(numpy.linspace(-1, 1, 1001), defect)).max())
    return _Rule(
        (x + 1) / 2,
        shifts[keep],
        forward,
        back[keep],
        back[keep].sum(axis=1),
        slopes[1:] @ forward,
        through[:, 1:] @ forward,
        numpy.linalg.inv(values)[-2:],
        defect,
        height,
    )


@dataclass(frozen=True)
class Window:
    """The motion over a stretch of time, which may be looked at anywhere within it."""

    nodal: Nodal
    rule: _Rule
    start: float
    length: float
    first: Array  # the state at the start, (n,)
    last: Array
    waves: Phasors  # (k, n), in the nodal order: kept states, then local ones
    correction: Array  # what the defect adds, (n,), in the nodal order

    @property
    def end(self) -> float:
        return self.start + self.length

    def states(self, times: Array) -> Array:
        """Shape (t,) of times in s to (t, n): the polynomial through the stages, and the defect that it has left."""
        places = 2 * (times - self.start) / self.length - 1
        share = legendre.legvander(places, len(self.rule.points)) @ self.rule.legendre
        off = _combined(share, self.waves)
        off += legendre.legval(places, self.rule.defect)[:, None] * self.correction
        result = numpy.repeat(self.first[None, :], len(times), axis=0)
        result[:, self.nodal.kept] += off[:, : len(self.nodal.kept)]
        result[:, self.nodal.local] += off[:, len(self.nodal.kept) :]
        return result

    def ripple(self, rows: Array, slow: float) -> Array:
        """What of rows @ x turns faster than `slow` in rad a window: nothing that a polynomial has. (g, n) to (g,)."""
        assert slow > len(self.rule.points)
        return numpy.zeros(len(rows))


@dataclass
class _Level:
    """The factors for one length of windows, with the slopes of the loads at one state."""

    loads: Loads
    systems: list[Shifted]
    gain: float = numpy.inf  # of the iteration: a change of states to its estimate from the loads' change
    rate: float = numpy.inf  # of the iteration: an estimate to that before it
    stale: bool = False
    used: int = 0
    error: float = 1.0  # of the last window, as a share of the tolerance


class Collocation:
    """Advances a flow from a state at time 0, window by window. One window ends at `span`, in s, and others beyond it.

    `tolerance` bounds the error that a window adds, as a share of the weights given with it.
    """

    def __init__(self, flow: Flow, x: Array, span: float, tolerance: float, stages: int = STAGES) -> None:
        self.flow, self.x, self.span, self.tolerance = flow, x.astype(float), span, tolerance
        self.nodal, self.rule = Nodal(flow), _rule(stages)
        self.position, self.units = 0, 0
        self.rejected, self.factored, self.iterations, self.windows = 0, 0, 0, 0
        self._levels: dict[int, _Level] = {}
        self._rates = flow.rates(self.x)
        self.last: Window | None = None

    @property
    def done(self) -> bool:
        return self.position >= UNITS

    def advance(self, weights: Array) -> Window:
        """The next window, of an error within the tolerance for states of these sizes, (n,).

        Raises: FloatingPointError if the motion cannot be followed, because it grows beyond all bounds.
        """
        if not self.units:
            self.units = self._first(weights)
        while self.units >= 1:
            left = UNITS - self.position
            units = left if 0 < left <= 1.01 * self.units else self.units
            window, error, ratio = self._attempt(units, weights)
            if window is not None and error <= 1:
                self._take(window.last, units)
                self.last = window
                self._lengthen(units, ratio)
                return window
            self.rejected += 1
            self.units = _rounded(units * min(ratio, 0.75))
        raise FloatingPointError("no window is short enough")

    def _first(self, weights: Array) -> int:
        """A length of the first window over which states change by about their weights, by their first derivatives."""
        slope = float((numpy.abs(self._rates) / weights).max(initial=0.0))
        bend = float((numpy.abs(self.flow.jacobian(self.x) @ self._rates) / weights).max(initial=0.0))
        if not numpy.isfinite(slope + bend):
            raise FloatingPointError("the state is beyond all bounds")
        fraction = 1 / max(1.0, self.span * max(slope, numpy.sqrt(bend)))
        return min(UNITS, _rounded(UNITS * fraction))

    def shorten(self) -> None:
        """Go back to the start of the last window; the next one will be half as long."""
        if self.last is not None:
            units = round(self.last.length / self.span * UNITS)
            self._take(self.last.first, -units)
            self.units = max(1, _rounded(units / 2))
            self.rejected += 1
            self.last = None

    def _take(self, x: Array, units: int) -> None:
        self.x, self.position = x, self.position + units
        self._rates = self.flow.rates(x)
        self.windows += 1 if units > 0 else -1

    def _lengthen(self, units: int, ratio: float) -> None:
        """Longer windows cost new factors: by less than two only after some windows of a length."""
        level = self._levels.get(units)
        if ratio >= 2 or (ratio >= 1.45 and level is not None and level.used >= EVERY):
            self.units = min(UNITS, max(self.units, _rounded(units * min(ratio, 8.0))))

    def _level(self, units: int) -> _Level:
        """The factors for a length of windows, made at the present state unless they are there."""
        if units not in self._levels:
            while len(self._levels) >= KEPT_LEVELS:
                del self._levels[next(iter(self._levels))]
            h = self.span * (units / UNITS)
            loads = self.nodal.loads(self.x[self.nodal.kept])
            systems = [self.nodal.shifted(complex(shift) / h, loads) for shift in self.rule.shifts]
            self._levels[units] = _Level(loads, systems)
            self.factored += 1
        level = self._levels.pop(units)
        self._levels[units] = level  # the last one is the one used last
        return level

    def _attempt(self, units: int, weights: Array) -> tuple[Window | None, float, float]:
        """A window of one length, its error as a share of the tolerance, and by how much the next may be longer.

        The window is None if the iteration does not settle.
        """
        fresh = units not in self._levels
        try:
            level = self._level(units)
        except (RuntimeError, numpy.linalg.LinAlgError) as error:  # singular, or not finite
            raise FloatingPointError("the equations of a window are singular") from error
        h, rule, nodal = self.span * (units / UNITS), self.rule, self.nodal
        f_kept, f_local, w = self._rates[nodal.kept], self._rates[nodal.local], weights[nodal.kept] * self.tolerance
        V = nodal.voltages(self.x[None, nodal.kept])
        exact = level.used % EVERY == EVERY - 1 and (level.error < 2 * SETTLED or level.used == EVERY - 1)
        settled = SETTLED * (EXACT if exact else 1.0)
        level.used += 1
        start = level.loads.remainder(V)
        seen, pushes = nodal.seen(w), nodal.pushes(w * numpy.abs(level.systems[0].diagonal))
        constants = [a * f_kept + s.gathering @ (a * f_local) for a, s in zip(rule.entry, level.systems, strict=True)]
        W = numpy.array([s.nodes(_real(r, s)) for r, s in zip(constants, level.systems, strict=True)])
        moved = _combined(rule.forward, nodal.read(W))
        stages = V.view(float) + moved
        forces = numpy.zeros_like(moved)
        before = old = numpy.inf
        for count in range(ITERATIONS):
            new = (level.loads.remainder(stages.view(complex)) - start).view(float)
            drawn = new - forces
            forces = new
            expected = float((numpy.abs(drawn).max(axis=0, initial=0.0) * pushes).max(initial=0.0))
            if not numpy.isfinite(expected):
                break
            if old < numpy.inf:
                level.rate = max(expected / old, 0.5 * level.rate if level.rate < numpy.inf else 0.0)
            if expected * level.gain > settled:
                self.iterations += 1
                pushed = nodal.push(_mixed(-rule.back, drawn))
                added = numpy.array([s.nodes(_real(r, s)) for r, s in zip(pushed, level.systems, strict=True)])
                W += added
                moved = _combined(rule.forward, nodal.read(added))
                stages += moved
                change = float((numpy.abs(moved).max(axis=0) / seen).max())
                level.gain = max(change / expected, 0.5 * level.gain if level.gain < numpy.inf else 0.0)
                if not change < 0.5 * before:
                    break
                before, old = change, expected
                if count >= 3:  # the slopes of the loads are of another time
                    level.stale = True
                # loads take as long as the systems: what they would say next is known from other windows
                if exact or expected * level.rate * level.gain > 0.5 * settled:
                    continue
            # a load that meets its cut-off bends within a window, and its slope at the start knows nothing of that
            bent = numpy.abs(rule.high @ forces).sum(axis=0) * pushes
            bend = float(bent.max(initial=0.0)) * (level.gain if level.gain < numpy.inf else 1.0)
            return self._finish(level, h, W, weights, bend)
        if not fresh:  # once more with slopes at the present state
            del self._levels[units]
            return self._attempt(units, weights)
        return None, numpy.inf, 0.5

    def _finish(
        self, level: _Level, h: float, W: Phasors, weights: Array, bend: float
    ) -> tuple[Window | None, float, float]:
        """The window of a settled iteration, its error and what the next length may be; `bend` is one of its errors."""
        rule, nodal = self.rule, self.nodal
        f_local = self._rates[nodal.local]
        rest = [
            s.inverse @ (a * f_local) + s.following @ z for a, s, z in zip(rule.entry, level.systems, W, strict=True)
        ]
        waves = numpy.concatenate([W, numpy.array(rest)], axis=1)
        order = numpy.concatenate([nodal.kept, nodal.local])
        ends, slopes = _combined(numpy.stack([rule.forward[-1], rule.slope]), waves)
        last = self.x.copy()
        last[order] += ends
        # the slope at the start is off by the defect; damped as the motion itself damps what is stiff
        off = slopes / h - self._rates[order]
        shift = float(rule.shifts[0].real)
        p = len(nodal.kept)
        damped = -shift * numpy.concatenate(level.systems[0].solve(off[:p], off[p:]))
        error = max(bend, rule.height * float((numpy.abs(damped) / weights[order]).max()) / self.tolerance)
        level.error = error
        if not (numpy.isfinite(error) and numpy.isfinite(last).all()):
            return None, numpy.inf, 0.5
        start = self.span * (self.position / UNITS)
        window = Window(nodal, rule, start, h, self.x, last, waves, damped)
        if level.stale:
            self._levels = {units: kept for units, kept in self._levels.items() if kept is not level}
        return window, error, float((AIM / max(error, 1e-300)) ** (1 / (len(rule.points) + 1)))


def _rounded(units: float) -> int:
    """The nearest length below that recurs: a power of the root of two. 0 if there is none."""
    return int(2 ** (numpy.floor(2 * numpy.log2(units) + 1e-9) / 2)) if units >= 1 else 0


def _combined(factors: Phasors, waves: Phasors) -> Array:
    """Re(factors waves). Shapes (m, k) and (k, n) to (m, n)."""
    planes = numpy.concatenate([waves.real, waves.imag])
    return numpy.concatenate([factors.real, -factors.imag], axis=1) @ planes


def _mixed(factors: Phasors, values: Array) -> Phasors:
    """factors values. Shapes (k, m) and (m, n) to (k, n)."""
    result = numpy.empty((len(factors), values.shape[1]), dtype=complex)
    result.real, result.imag = factors.real @ values, factors.imag @ values
    return result


def _real(r: Phasors, system: Shifted) -> Phasors | Array:
    """The right-hand side of a system in its own arithmetic."""
    return r if numpy.iscomplexobj(system.diagonal) else numpy.ascontiguousarray(r.real)
