"""How a simulation settles: errors of the DGUs against their references, watched closely while it runs.

The DGU at a node has *settled* at a time if from then on both axes of the error V - V* stay within its band, up to the
end of the phase: the last time at which the larger of |e_d| and |e_q| is outside counts, not the first inside. (Or, if
asked for, the modulus of the error instead of the larger axis.) A phase in which it has not settled by its end is
counted on through the next ones, as long as the DGU is on and its reference the same: up to the first phase at the end
of which it has. What later events did to it is then in that time as well.

Samples are too coarse for that. Here each piece of motion is looked at so often that all oscillations of a size that
matters have many points in each period, and the last crossing of the band is located in the dense output.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy
from scipy.optimize import brentq

from certify.phases import Phase
from certify.simulation import Simulation, Stage
from certify.simulator.motion import Piece
from certify.simulator.plant import Array

LOOKS = 32  # at least, at a window
MOST_LOOKS = 1 << 13
PER_PERIOD = 16  # looks, of an oscillation that matters
UNSEEN = 0.02  # of the band, or of SHARE of a voltage: oscillations up to this size need not be resolved
SHARE = 1e-4
MOST_NUMBERS = 1 << 24  # of the states at all looks, and of the matrix of all voltages
XTOL = 1e-12  # s, to which a crossing is located


@dataclass(frozen=True)
class DguCourse:
    """The error of one DGU in one phase, in V. `final_volt` is that at its end, with signs.

    `outside_second`: the last time outside of the band, None if there is none. `settled` says whether it is inside at
    the end. `later`: if not, the time at which it finally settles, and the number of the phase in which it does.
    """

    node: str
    reference_volt: complex
    band_volt: float
    largest_volt: tuple[float, float]
    final_volt: tuple[float, float]
    outside_second: float | None
    settled: bool
    later: tuple[float, int] | None = None


@dataclass(frozen=True)
class PhaseCourse:
    """A phase as it went. `lowest` and `highest`: |V| at nodes without a DGU and where, None if there is no such node.

    `off_rest`: the largest distance of a voltage, in V, from the equilibrium without limits, at the end, and the node;
    None if no equilibrium was found. `complete` is False if the motion diverged before the end.
    """

    phase: Phase
    until_second: float
    dgus: tuple[DguCourse, ...]
    lowest: tuple[float, str] | None
    highest: tuple[float, str] | None
    off_rest: tuple[float, str] | None
    complete: bool = True

    def settling_second(self, dgu: DguCourse) -> float | None:
        """From the start of the phase; 0 if the error never is outside of the band, None if it is at the end."""
        if not (dgu.settled and self.complete):
            return None
        return 0.0 if dgu.outside_second is None else dgu.outside_second - float(self.phase.start_second)


@dataclass
class _Open:
    """What has been seen of the phase that is being followed. Arrays have an entry for each of its DGUs."""

    stage: Stage
    bands: Array
    by_modulus: bool = False
    piece: Piece | None = None
    largest: Array = field(default_factory=lambda: numpy.zeros(0))  # (k, 2)
    brackets: dict[int, tuple[Piece, float, float]] = field(default_factory=dict)  # of the last crossing
    lowest: tuple[float, str] | None = None
    highest: tuple[float, str] | None = None

    def __post_init__(self) -> None:
        plant = self.stage.plant
        self.names = list(plant.nodes)
        self.dgus = [k for k, node in enumerate(plant.grid.nodes) if node.dgu]
        self.others = [k for k, node in enumerate(plant.grid.nodes) if not node.dgu]
        self.references = numpy.array([[*map(float, n.dgu.reference_volt)] for n in plant.grid.nodes if n.dgu])
        self.largest = numpy.zeros((len(self.dgus), 2))

    @cached_property
    def rows(self) -> Array:
        """The matrix of all voltages, (2 nodes, n), or none of its rows if that is large."""
        matrix, _ = self.stage.plant.voltages
        rows, columns = matrix.shape
        dense: Array = matrix.toarray() if rows * columns <= MOST_NUMBERS else numpy.zeros((0, columns))
        return dense

    @cached_property
    def unseen(self) -> Array:
        """For each row the size of oscillations that need not be resolved, in V."""
        sizes = numpy.full(len(self.names), SHARE * float(numpy.abs(self.references).max()))
        sizes[self.dgus] = numpy.minimum(sizes[self.dgus], self.bands)
        return UNSEEN * numpy.repeat(sizes, 2)[: len(self.rows)]

    def voltages(self, states: Array) -> Array:
        """All voltages in states. Shape (t, n) to (t, nodes, 2)."""
        matrix, offsets = self.stage.plant.voltages
        V: Array = (matrix @ states.T).T + offsets
        return V.reshape(len(states), -1, 2)

    def excess(self, piece: Piece, time: float, k: int) -> float:
        """How far the error of a DGU is outside of its band, in V."""
        V = self.voltages(piece.states(numpy.array([time])))[0, self.dgus[k]]
        return float(self.measured(V - self.references[k]).max() - self.bands[k])

    def measured(self, errors: Array) -> Array:
        """What must stay within the band: the size of each axis, or one modulus. (.., 2) to the same, or (.., 1)."""
        return numpy.hypot(errors[..., :1], errors[..., 1:]) if self.by_modulus else numpy.abs(errors)

    def looks(self, piece: Piece) -> Array:
        """The times at which a piece is looked at, both ends included."""
        window, count = piece.window, LOOKS
        while count < MOST_LOOKS and 2 * count * self.stage.plant.size <= MOST_NUMBERS:
            if (window.ripple(self.rows, count * 2 * numpy.pi / PER_PERIOD) <= self.unseen).all():
                break
            count *= 2
        share = (piece.end - piece.start) / (window.end - window.start)
        return numpy.linspace(piece.start, piece.end, max(4, int(numpy.ceil(count * share))) + 1)

    def see(self, piece: Piece) -> None:
        self.piece = piece
        times = self.looks(piece)
        V = self.voltages(piece.states(times))
        self._see_errors(piece, times, V[:, self.dgus] - self.references)
        if self.others:
            size = numpy.hypot(*numpy.moveaxis(V[:, self.others], -1, 0))
            low, high = int(size.min(axis=0).argmin()), int(size.max(axis=0).argmax())
            least, most = float(size[:, low].min()), float(size[:, high].max())
            if self.lowest is None or least < self.lowest[0]:
                self.lowest = least, self.names[self.others[low]]
            if self.highest is None or most > self.highest[0]:
                self.highest = most, self.names[self.others[high]]

    def _see_errors(self, piece: Piece, times: Array, errors: Array) -> None:
        """Take note of errors, (t, k, 2): of what is largest, and of the last crossing of the band."""
        sizes = numpy.abs(errors)
        peaks, where = _peaks(sizes)
        self.largest = numpy.maximum(self.largest, numpy.maximum(sizes.max(axis=0), peaks.max(axis=0, initial=0.0)))
        if self.by_modulus:
            sizes = self.measured(errors)
            peaks, where = _peaks(sizes)
        outside = sizes.max(axis=2) > self.bands
        beside = peaks.max(axis=2) > self.bands
        step = times[1] - times[0]
        for k in map(int, numpy.flatnonzero(outside.any(axis=0) | beside.any(axis=0))):
            seen = outside[:, k].copy()
            seen[1:-1] |= beside[:, k]
            j = int(numpy.flatnonzero(seen)[-1])
            low = times[j]
            if not outside[j, k]:
                axis = int(peaks[j - 1, k].argmax())
                low = times[j] + step * where[j - 1, k, axis]
            self.brackets[k] = piece, float(low), float(times[min(j + 1, len(times) - 1)])

    def close(self, complete: bool) -> PhaseCourse:
        """The phase as it went, at its end."""
        phase, piece = self.stage.phase, self.piece
        assert piece is not None
        last = piece.last
        V = self.voltages(last[None, :])[0]
        final = V[self.dgus] - self.references
        inside = self.measured(final).max(axis=1, initial=0.0) <= self.bands
        dgus = tuple(
            DguCourse(
                self.names[node],
                complex(*self.references[k]),
                float(self.bands[k]),
                (float(self.largest[k, 0]), float(self.largest[k, 1])),
                (float(final[k, 0]), float(final[k, 1])),
                self._crossing(k),
                bool(inside[k]) and complete,
            )
            for k, node in enumerate(self.dgus)
        )
        off_rest = None
        if self.stage.follower.rest is not None:
            off = numpy.hypot(*(V - self.voltages(self.stage.follower.rest[None, :])[0]).T)
            off_rest = float(off.max()), self.names[int(off.argmax())]
        return PhaseCourse(phase, piece.end, dgus, self.lowest, self.highest, off_rest, complete)

    def _crossing(self, k: int) -> float | None:
        """The last time at which a DGU is outside of its band."""
        if k not in self.brackets:
            return None
        piece, low, high = self.brackets[k]
        if high <= low or self.excess(piece, low, k) <= 0 or self.excess(piece, high, k) > 0:
            return low if high <= low or self.excess(piece, high, k) <= 0 else high
        return float(brentq(lambda t: self.excess(piece, t, k), low, high, xtol=XTOL))


def _peaks(sizes: Array) -> tuple[Array, Array]:
    """How large sizes, (t, ..), get between looks, by parabolas, and where, in steps; (t - 2, ..), 0 if at no top."""
    before, middle, after = sizes[:-2], sizes[1:-1], sizes[2:]
    bend = 2 * middle - before - after
    with numpy.errstate(divide="ignore", invalid="ignore"):
        top = (middle >= before) & (middle >= after) & (bend > 0)
        peaks = numpy.where(top, middle + (after - before) ** 2 / (8 * bend), 0.0)
        where = numpy.where(top, (after - before) / (2 * bend), 0.0)
    return peaks, where


class Watch:
    """An observer for `simulate`: what becomes of the errors. `bands` gives V for a DGU by node and reference.

    `by_modulus`: settled is what has |V - V*| within its band, instead of both axes.
    """

    def __init__(self, bands: Callable[[str, complex], float], by_modulus: bool = False) -> None:
        self._bands, self._by_modulus = bands, by_modulus
        self._open: _Open | None = None
        self._closed: list[PhaseCourse] = []

    def __call__(self, stage: Stage, piece: Piece) -> None:
        if self._open is None or self._open.stage is not stage:
            if self._open:
                self._closed.append(self._open.close(True))
            dgus = [(node.name, node.dgu) for node in stage.plant.grid.nodes if node.dgu]
            bands = [self._bands(name, complex(*map(float, dgu.reference_volt))) for name, dgu in dgus]
            self._open = _Open(stage, numpy.array(bands), self._by_modulus)
        self._open.see(piece)

    def result(self, simulation: Simulation) -> tuple[PhaseCourse, ...]:
        """All phases as far as they were followed, each DGU with the time at which it finally settles."""
        phases = [*self._closed]
        if self._open:
            phases.append(self._open.close(simulation.diverged is None))
        return tuple(
            replace(entry, dgus=tuple(replace(dgu, later=_later(dgu, phases[k + 1 :])) for dgu in entry.dgus))
            for k, entry in enumerate(phases)
        )


def _later(dgu: DguCourse, phases: list[PhaseCourse]) -> tuple[float, int] | None:
    """When a DGU that has not settled by the end of its phase finally does, and in which of the phases after it."""
    if dgu.settled:
        return None
    for entry in phases:
        found = next((other for other in entry.dgus if other.node == dgu.node), None)
        if found is None or found.reference_volt != dgu.reference_volt or not entry.complete:
            return None
        if found.settled:
            start = float(entry.phase.start_second)
            return (start if found.outside_second is None else found.outside_second), entry.phase.number
    return None
