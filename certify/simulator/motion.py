"""The motion of a microgrid from a state: smooth pieces between limits, and between the events of a scenario.

A component of an inverter's voltage that meets its limit, or comes back from it, ends a piece: the time is located, and
the motion goes on with the flow that has this component held, or free. Rates are continuous there, so nothing jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy
from scipy.optimize import brentq, minimize_scalar

from certify.simulator.exponential import Exponential, Modes
from certify.simulator.flow import Flow, find_rest, flow_at, free_flow
from certify.simulator.implicit import Collocation
from certify.simulator.plant import TITLES, Array, Plant, to_phasors
from certify.simulator.starts import flat_state

LOOKS = 32  # at the limits within a window
SLACK = 1e-10  # of a limit, by which it is passed before a piece ends: so that a piece does not end as it begins
ROUNDING = 1e-12  # of the terms of a control law, likewise
STILL = 40  # pieces without length for each component, after which nothing is going to move
CRAWL = 3000  # windows in a phase: if as many more are to come, they are too short for the method
PATTERNS = 24  # of components at their limits, of which the modes are kept; twice as many are too many for them
SMALLEST = 1e-4  # of the largest of its kind is what a state is measured by if it is small itself
BOUND = 1e6  # times its natural size makes a state diverge
MODAL_STATES = 300  # up to which a network is followed in its modes
MODAL_CONDITION = 1e7
LONGEST = 100.0  # s: what windows of collocation are shares of


class Diverged(Exception):
    """The motion cannot be followed beyond `at_second`: it has left all bounds, or the law of a load ends there."""

    def __init__(self, at_second: float, reason: str) -> None:
        super().__init__(f"diverged at t = {at_second:.9g} s: {reason}")
        self.at_second, self.reason = at_second, reason


class Window(Protocol):
    """A stretch of motion as an integrator gives it; times count from where the integrator began."""

    @property
    def start(self) -> float: ...
    @property
    def end(self) -> float: ...
    @property
    def last(self) -> Array: ...
    def states(self, times: Array) -> Array: ...
    def ripple(self, rows: Array, slow: float) -> Array: ...


class Stepper(Protocol):
    rejected: int

    def advance(self, weights: Array) -> Window: ...
    def shorten(self) -> None: ...


@dataclass(frozen=True)
class Piece:
    """Motion in one flow from `start` to `end`, in s of the whole; `states` at any times of that, (t,) to (t, n)."""

    flow: Flow
    window: Window
    offset: float
    start: float
    end: float

    def states(self, times: Array) -> Array:
        return self.window.states(times - self.offset)

    @property
    def last(self) -> Array:
        if self.end - self.offset == self.window.end:
            return self.window.last
        return self.states(numpy.array([self.end]))[0]


class Follower:
    """Follows one plant, between two events. `rest` is an equilibrium without limits, if one has been found."""

    def __init__(self, plant: Plant, x: Array, tolerance: float, method: str | None = None) -> None:
        self.plant, self.tolerance = plant, tolerance
        self.rest = find_rest(free_flow(plant), x)
        if self.rest is None:
            self.rest = find_rest(free_flow(plant), flat_state(plant))
        self.natural = natural_sizes(plant, self.rest)
        self.guarded = numpy.flatnonzero(numpy.isfinite(plant.limits))
        self.rows = plant.K[self.guarded].toarray() if len(self.guarded) else numpy.zeros((0, plant.size))
        # rounding is worth some of the terms of u, which may be far larger than a limit
        terms = numpy.abs(self.rows) @ self.natural + numpy.abs(plant.k[self.guarded])
        self.slack = SLACK * plant.limits[self.guarded] + ROUNDING * terms
        self.known: dict[bytes, Modes] = {}
        self.method = method or ("exponential" if plant.size <= MODAL_STATES else "collocation")
        self.windows = self.rejected = self.switches = self.found = 0

    def pieces(self, x: Array, start: float, end: float) -> Iterator[Piece]:
        """The motion from a state at `start`, in s, up to `end`. Raises: Diverged."""
        flow, now = flow_at(self.plant, x), start
        rest = self.rest if self.rest is not None and self.method == "exponential" else numpy.zeros_like(x)
        weights = numpy.maximum(_moduli(x - rest), SMALLEST * self.natural)
        still = 0
        while now < end:
            stepper = self._stepper(flow, x, end - start)
            offset = now
            while now < end:
                if self.method == "exponential" and self._crawls(now - start, end - now):
                    self.method = "collocation"
                    break
                try:
                    window = stepper.advance(weights)
                except FloatingPointError:
                    raise self._diverged(now, x) from None
                until = min(offset + window.end, end)
                crossing = self._crossing(flow, window, until - offset)
                if crossing is None:
                    stepper.shorten()
                    continue
                until, crossed = (until, -1) if crossing[1] < 0 else (offset + crossing[0], crossing[1])
                still = still + 1 if until <= now else 0
                if still > STILL * (1 + len(self.guarded)):
                    if self.method == "collocation":
                        raise Diverged(now, "inverters go in and out of their limits, and no time passes")
                    # the rounding of the modes may be in the way, and this needs none
                    self.method, still = "collocation", 0
                    break
                piece = Piece(flow, window, offset, now, until)
                self.windows += 1
                yield piece
                x, now = piece.last, until
                weights = numpy.maximum(weights, _moduli(x - rest))
                if not self._bounded(x):
                    raise self._left(piece)
                if crossed >= 0:
                    held = flow.held.copy()
                    held[crossed] = 0.0 if held[crossed] else numpy.sign((self.plant.asked(x))[crossed])
                    flow = Flow(self.plant, held)
                    self.switches += 1
                    break
            self.rejected += stepper.rejected

    def _crawls(self, done: float, left: float) -> bool:
        """Whether so many windows have been needed that as many more would have to follow, for the seconds left."""
        return self.windows > CRAWL and self.windows % 100 == 0 and left * CRAWL > done * self.windows

    def _stepper(self, flow: Flow, x: Array, unit: float) -> Stepper:
        if self.method == "exponential":
            key = flow.held.tobytes()
            if key not in self.known:
                self.found += 1
                while len(self.known) >= PATTERNS:
                    self.known.pop(next(iter(self.known)))
                self.known[key] = Modes(flow, x if self.rest is None else self.rest, self.natural)
            modes = self.known[key]
            if modes.condition <= MODAL_CONDITION and self.found <= 2 * PATTERNS:
                return Exponential(modes, x, unit, self.tolerance)
            self.method = "collocation"  # no basis of modes, next to none, or too many of them
        return Collocation(flow, x, min(unit, LONGEST), self.tolerance)

    def _margins(self, flow: Flow, states: Array) -> Array:
        """How far each guarded component is from where the flow changes, in volt. Shape (t, n) to (t, g)."""
        u = states @ self.rows.T + self.plant.k[self.guarded]
        limits, held = self.plant.limits[self.guarded], flow.held[self.guarded]
        return numpy.where(held == 0, limits - numpy.abs(u), held * u - limits) + self.slack

    def _crossing(self, flow: Flow, window: Window, until: float) -> tuple[float, int] | None:
        """When the first component leaves the flow, and which: (until, -1) if none does, None if that is unclear."""
        if not len(self.guarded):
            return until, -1
        times = numpy.linspace(window.start, until, LOOKS + 1)
        margins = self._margins(flow, window.states(times))
        ripple = window.ripple(self.rows, LOOKS * 0.8)
        if ((margins.min(axis=0) <= 2 * ripple) & (ripple > self.slack)).any():
            return None
        # between looks a margin may dip below zero: where a parabola through three has its least value nearby, and that
        # is less than half of what changes there, look closer
        before, middle, after = margins[:-2], margins[1:-1], margins[2:]
        bend = before - 2 * middle + after
        with numpy.errstate(divide="ignore", invalid="ignore"):
            bottom = middle - (after - before) ** 2 / (8 * bend)
            near = numpy.abs(after - before) <= 2 * bend  # within the three
        three = numpy.stack([before, middle, after])
        change = three.max(axis=0) - three.min(axis=0)
        dips = (bend > 0) & near & (bottom < change / 2)

        def margin(t: float, g: int) -> float:
            return float(self._margins(flow, window.states(numpy.array([t])))[0, g])

        found: list[tuple[float, int]] = []
        for g in map(int, numpy.flatnonzero((margins < 0).any(axis=0) | dips.any(axis=0))):
            brackets = [
                (times[k], times[k + 1]) for k in numpy.flatnonzero((margins[:-1, g] >= 0) & (margins[1:, g] < 0))
            ]
            for k in numpy.flatnonzero(dips[:, g]):
                options = {"xatol": 1e-9 * (times[k + 2] - times[k])}
                span = (times[k], times[k + 2])
                low = minimize_scalar(margin, args=(g,), bounds=span, method="bounded", options=options)
                if low.fun < 0:
                    brackets.append((times[k], float(low.x)))
            if margins[0, g] < 0:
                found.append((window.start, g))
            elif brackets:
                a, b = min(brackets)
                found.append((_root(partial(margin, g=g), a, b), g))
        if not found:
            return until, -1
        time, g = min(found)
        return time, int(self.guarded[g])

    def _bounded(self, x: Array) -> bool:
        return bool((numpy.abs(x) <= BOUND * self.natural).all())

    def _left(self, piece: Piece) -> Diverged:
        """When in a piece the motion has left all bounds."""
        low, high = piece.start, piece.end
        while high - low > 1e-9 * piece.end and high - low > 1e-6 * (piece.end - piece.start):
            middle = (low + high) / 2
            inside = self._bounded(piece.states(numpy.array([middle]))[0])
            low, high = (middle, high) if inside else (low, middle)
        return self._diverged(high, piece.states(numpy.array([high]))[0])

    def _diverged(self, time: float, x: Array) -> Diverged:
        """Why the motion ends: a load without a cut-off that draws its power at no voltage, or the largest state."""
        V = numpy.abs(to_phasors(self.plant.loaded_voltages(x)))
        drawn = numpy.abs(to_phasors(self.plant.drawn(x)))
        beyond = numpy.abs(x) / self.natural
        if len(V) and numpy.isfinite(x).all() and beyond.max() <= BOUND:
            if not numpy.isfinite(drawn).all():
                k = int(numpy.argmin(numpy.isfinite(drawn)))
                return Diverged(time, f"the load of node {self.plant.loaded[k]} has no current at {V[k]:.3g} V")
            k = int(numpy.argmin(V))
            reason = f"the loads of node {self.plant.loaded[k]} draw {drawn[k]:.3g} A at {V[k]:.3g} V"
            return Diverged(time, f"{reason}; no step is short enough from here")
        worst = int(numpy.argmax(numpy.nan_to_num(beyond, nan=numpy.inf)))
        part = next(part for part, at in self.plant.slices.items() if at.start <= worst < at.stop)
        return Diverged(time, f"{TITLES[part[0]].format(*part[1:])} has reached {x[worst]:.3g} in size")


def _root(margin: Callable[[float], float], a: float, b: float) -> float:
    """Where a margin that is positive at a and negative at b is zero; rounding may have it otherwise at the ends."""
    if margin(a) <= 0:
        return a
    if margin(b) >= 0:
        return b
    root, _ = brentq(margin, a, b, xtol=1e-15 * max(b, 1e-12), rtol=1e-14, maxiter=200, full_output=True, disp=False)
    return float(root)


def natural_sizes(plant: Plant, rest: Array | None) -> Array:
    """How large each state is taken to be, at least: that of a voltage of the size of the references.

    A current is as large as it is in a lossless resonance with the capacitance at its end; an integrator as what makes
    its law ask for that voltage; and each as the largest of its kind at rest.
    """
    references = [abs(complex(*map(float, node.dgu.reference_volt))) for node in plant.grid.nodes if node.dgu]
    V = max(references)
    sizes = numpy.full(plant.size, 1.0)
    for part, at in plant.slices.items():
        if part[0] == "voltage":
            sizes[at] = V
        elif part[0] == "current":
            inverter = plant.inverters[part[1]]
            sizes[at] = V * numpy.sqrt(plant.capacitances[part[1]] / inverter.inductance_henry)
        elif part[0] == "integrator":
            gain = float(numpy.abs(plant.inverters[part[1]].gains[2]).max())
            sizes[at] = V / gain if gain else V
        elif part[0] == "loop":
            sizes[at] = V / max(float(numpy.abs(plant.loops[part[1]].C).max()), 1e-300)
        else:
            start, _, _, L = plant.branches[part]
            sizes[at] = V * numpy.sqrt(max(plant.capacitances[start], 1e-12) / L)
    if rest is not None:
        largest: dict[str, float] = {}
        for part, at in plant.slices.items():
            largest[part[0]] = max(largest.get(part[0], 0.0), float(numpy.abs(rest[at]).max(initial=0.0)))
        for part, at in plant.slices.items():
            sizes[at] = numpy.maximum(sizes[at], largest[part[0]])
    return sizes


def _moduli(x: Array) -> Array:
    """Of each state its size, or that of its neighbour if that is larger: two parts of a complex number are one."""
    size = numpy.abs(x)
    even = len(x) // 2 * 2
    pairs = size[:even].reshape(-1, 2).max(axis=1)
    size[:even] = numpy.repeat(pairs, 2)
    return size
