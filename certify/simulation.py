"""Simulating a spec: its scenario, phase by phase, from a start, with everything that happens on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from numbers import Real
from typing import Any

import numpy

from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.claims import to_text
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_quantity, shorten
from certify.kernel.reader import read_document
from certify.kernel.spec import Microgrid
from certify.phases import Phase, indices_of_loads, read_phases, series_loads
from certify.simulator.motion import Diverged, Follower, Piece
from certify.simulator.plant import TITLES, Array, Part, Phasors, Plant
from certify.simulator.resets import Switchboard, after_events
from certify.simulator.scenario import STARTS, decode_scenarios, law_reader
from certify.simulator.starts import start_state
from certify.values import to_plain

DEFAULT_END = Fraction(1)
DEFAULT_SAMPLES = 1000
TOLERANCE = 1e-8
TOLERANCES = (Fraction(1, 10**13), Fraction(1, 100))
MAX_SECONDS = 10**9
METHODS = ("exponential", "collocation")
MAX_NUMBERS = 1 << 27  # of all samples together: 1 GiB
AXES = ("d", "q")
Second = Fraction | float | str
Progress = Callable[[float, float], None]  # s that are done, and all of them


@dataclass(frozen=True)
class Stage:
    """One phase of a simulation: its network as equations, and the state right after the events at its start."""

    phase: Phase
    plant: Plant
    first: Array
    follower: Follower


@dataclass(frozen=True, eq=False, repr=False)
class Simulation:
    """States over time, in SI; NaN where a part is off. In floats: what is seen here is evidence, and no proof.

    `times`: (t,) in s. `states`: (t, n), the columns of each part at `parts`. `diverged` says when and where the motion
    left all bounds, if it did: the times end there. `phases` has an entry for each, as far as it was simulated: the
    number of windows, of switchings in and out of limits, the method.

    >>> motion = simulate("specs/two-inverters.toml", end="20 ms", samples=10)
    >>> motion.voltages["a"].dtype, motion.line_currents["a-b"].shape
    (dtype('complex128'), (11,))
    """

    start: str
    times: Array
    states: Array
    parts: Mapping[Part, slice]
    phases: list[dict[str, Any]] = field(default_factory=list)
    diverged: Diverged | None = None

    @property
    def voltages(self) -> dict[str, Phasors]:
        """Of each node, V_d + j V_q in volt over time, by its name. Shapes (t,)."""
        return self._phasors("voltage")

    @property
    def inverter_currents(self) -> dict[str, Phasors]:
        """Of each inverter the current of its filter, I_d + j I_q in ampere, by its node. Shapes (t,)."""
        return self._phasors("current")

    @property
    def line_currents(self) -> dict[str, Phasors]:
        """Of each line, from its start to its end, I_d + j I_q in ampere, by its name. Shapes (t,)."""
        return self._phasors("line")

    def _phasors(self, kind: str) -> dict[str, Phasors]:
        return {part[1]: self.phasor(*part) for part in self.parts if part[0] == kind}

    def __repr__(self) -> str:
        end = f"{self.times[-1]:g} s" if len(self.times) else "nothing"
        lost = f"; diverged at {self.diverged.at_second:g} s" if self.diverged else ""
        return f"<Simulation in floats: {len(self.times):,} samples of {len(self.columns):,} states up to {end}{lost}>"

    @property
    def columns(self) -> tuple[str, ...]:
        """The name of each column of `states`."""
        return column_names(self.parts)

    def part(self, *part: str) -> Array:
        """The states of one part, such as ("line", "12"). Shape (t, 2), of a linear loop (t, n)."""
        return self.states[:, self.parts[part]]

    def phasor(self, *part: str) -> Phasors:
        """A part as complex numbers x_d + j x_q. Shape (t,)."""
        pairs = self.part(*part)
        return pairs[:, 0] + 1j * pairs[:, 1]


def column_names(parts: Mapping[Part, slice]) -> tuple[str, ...]:
    """How the states of parts are called, such as "voltage at node 1, d"."""
    return tuple(
        f"{TITLES[part[0]].format(*part[1:])}, {AXES[k] if part[0] != 'loop' else k}"
        for part, at in parts.items()
        for k in range(at.stop - at.start)
    )


class Course:
    """A scenario of a spec made ready for simulation; without a scenario, one phase of `end_second`.

    `parts` are the places of all states that there ever are, with everything on. Raises: SpecError.
    """

    def __init__(self, spec: bytes, scenario: str | None = None, end_second: Fraction | None = None) -> None:
        self.whole: Microgrid = decode_all(spec)
        document = read_document(spec)
        self.start = "flat"
        if scenario is None:
            self.phases: tuple[Phase, ...] = (Phase(1, Fraction(0), end_second or DEFAULT_END, (), (), spec),)
        else:
            self.phases = read_phases(spec, scenario)
            self.start = decode_scenarios(document)[scenario].start
        if end_second is not None:
            self.phases = _until(self.phases, end_second)
        self.end = float(self.phases[-1].end_second)
        self._branches, self._law = series_loads(document, ()), law_reader(document)
        self.parts: dict[Part, slice] = {}
        self._spec, self._everything = spec, Plant(self.whole)
        size = 0
        for part, at in self._everything.slices.items():
            for own in [part] if part[0] != "loop" else [("voltage", part[1]), part]:
                width = 2 if own[0] == "voltage" else at.stop - at.start
                self.parts[own] = slice(size, size + width)
                size += width
        self.size = size

    def plant(self, phase: Phase) -> Plant:
        """The equations of a phase; its R-L loads are numbered as if all of them were on."""
        if phase.spec is self._spec:
            return self._everything
        off = indices_of_loads(phase.gone)
        numbers = {
            name: [str(n) for n, k in enumerate(where) if k not in off.get(name, ())]
            for name, where in self._branches.items()
        }
        return Plant(decode_all(phase.spec), numbers)

    def motion(self, x: Array | None, tolerance: float, method: str | None = None) -> Iterator[tuple[Stage, Piece]]:
        """The motion from a state of the first phase, or from the start. Raises: Diverged, SpecError."""
        stage: Stage | None = None
        for phase in self.phases:
            plant = self.plant(phase)
            if x is None:
                x = self.begin(plant, self.start)
            elif stage is not None:
                board = Switchboard(self.whole, self._branches, self._law, stage.phase.gone, stage.phase.settings)
                x = after_events(board, stage.plant, plant, phase.events, x)
            stage = Stage(phase, plant, x, Follower(plant, x, tolerance, method))
            for piece in stage.follower.pieces(x, float(phase.start_second), float(phase.end_second)):
                yield stage, piece
                x = piece.last

    def begin(self, plant: Plant, start: str) -> Array:
        """A state to start from. Raises: SpecError U006 if there is no equilibrium to start from."""
        first = start_state(plant, start)
        if first is None:
            message = "no equilibrium inside the limits of the inverters was found; start from flat or zero"
            raise SpecError((Fault("U006", "--start", message),))
        return first

    def spread(self, plant: Plant, states: Array) -> Array:
        """States of a phase in the columns of the whole, NaN where a part is off. Shape (t, n) to (t, size)."""
        out = numpy.full((len(states), self.size), numpy.nan)
        for part, at in plant.slices.items():
            out[:, self.parts[part]] = states[:, at]
        for name, loop in plant.loops.items():
            out[:, self.parts["voltage", name]] = states[:, plant.slices["loop", name]] @ loop.C.T + loop.reference
        return out

    def gather(self, plant: Plant, state: Array) -> Array:
        """The reverse of `spread` for one state: what a plant needs of it. Shape (size,) to (n,)."""
        x = numpy.empty(plant.size)
        for part, at in plant.slices.items():
            x[at] = state[self.parts[part]]
        return x


def _until(phases: tuple[Phase, ...], end: Fraction) -> tuple[Phase, ...]:
    """The phases up to a time in s. Raises: SpecError U005 if that is after their end, or not after their start."""
    if end <= 0:
        raise SpecError((Fault("U005", "--end", f"{to_text(end)} s is not after the start"),))
    if end > phases[-1].end_second:
        message = f"{to_text(end)} s is after the end of the scenario, {to_text(phases[-1].end_second)} s"
        raise SpecError((Fault("U005", "--end", message),))
    kept = [phase for phase in phases if phase.start_second < end]
    return (*kept[:-1], replace(kept[-1], end_second=end))


def sample_times(course: Course, count: int) -> Array:
    """`count` times after the start, evenly spaced up to the end, and those of the events. Shape (t,)."""
    starts = [float(phase.start_second) for phase in course.phases]
    return numpy.unique(numpy.concatenate([numpy.linspace(0.0, course.end, count + 1), starts]))


def simulate(
    spec: SpecSource,
    scenario: str | None = None,
    *,
    end: Second | None = None,
    start: str | Array | None = None,
    samples: int | Array = DEFAULT_SAMPLES,
    tolerance: float = TOLERANCE,
    method: str | None = None,
    progress: Progress | None = None,
    observe: Callable[[Stage, Piece], None] | None = None,
) -> Simulation:
    """Simulate a scenario of a spec, or without one the spec as it is, from 0 s to `end`.

    `spec`: see `certify.inputs.to_bytes`. `end`: seconds as a number, or text such as "20 ms"; by default the end of
    the scenario, or 1 s. All others are those of `simulate_course`: `start` is "flat", "zero", "equilibrium" or a
    state, `samples` how many or the times in s, `tolerance` the share of its size that a step may add to the error of a
    state.
    The simulator has equations of its own and works in floats: what it shows is evidence, and no proof.
    Raises: SpecError for bad input. A motion that leaves all bounds is no error: see `Simulation.diverged`.

    >>> motion = simulate("specs/single-inverter.toml", end=0.1, samples=100)
    >>> motion
    <Simulation in floats: 101 samples of 8 states up to 0.1 s>
    >>> bool(470 < abs(motion.voltages["bus"][-1]) < 490)
    True
    """
    text = to_bytes(spec)
    require_options(start, samples, tolerance, method)
    return simulate_course(
        Course(text, scenario, to_seconds(end)),
        start=start,
        samples=samples,
        tolerance=tolerance,
        method=method,
        progress=progress,
        observe=observe,
    )


def to_seconds(time: Second | None) -> Fraction | None:
    """A time as given, exactly. Raises: SpecError U005 if it is none.

    >>> to_seconds("20 ms"), to_seconds(0.1)
    (Fraction(1, 50), Fraction(1, 10))
    """
    if time is None:
        return None
    try:
        seconds = time if isinstance(time, Fraction) else parse_quantity(to_plain(time), "s", {})
    except (QuantityError, SpecError) as error:
        reason = error.message if isinstance(error, QuantityError) else error.faults[0].message
        raise SpecError((Fault("U005", "--end", reason),)) from None
    if not 0 < seconds <= MAX_SECONDS:
        message = f"expected a time after 0 s, up to {MAX_SECONDS:.0e} s, got {shorten(str(time))}"
        raise SpecError((Fault("U005", "--end", message),))
    return seconds


def require_options(start: object, samples: object, tolerance: object, method: object) -> None:
    """What a simulation can be asked for. Raises: SpecError U005 and U006 with every fault."""
    faults = []
    if isinstance(start, str) and start not in STARTS:
        faults.append(Fault("U006", "--start", f"expected {', '.join(STARTS)} or a state, got {shorten(start)}"))
    if isinstance(samples, int) and (samples < 1 or isinstance(samples, bool)):
        faults.append(Fault("U005", "--samples", f"expected a number from 1 up, got {shorten(samples)}"))
    low, high = TOLERANCES
    if isinstance(tolerance, bool) or not isinstance(tolerance, Real) or not low <= tolerance <= high:
        expected = f"expected {float(low):.0e} to {float(high):.0e}"
        faults.append(Fault("U005", "--tolerance", f"{expected}, got {shorten(str(tolerance))}"))
    if method is not None and method not in METHODS:
        faults.append(Fault("U005", "--method", f"expected {' or '.join(METHODS)}, got {shorten(str(method))}"))
    if faults:
        raise SpecError(tuple(faults))


def simulate_course(
    course: Course,
    *,
    start: str | Array | None = None,
    samples: int | Array = DEFAULT_SAMPLES,
    tolerance: float = TOLERANCE,
    method: str | None = None,
    progress: Progress | None = None,
    observe: Callable[[Stage, Piece], None] | None = None,
) -> Simulation:
    """Simulate what has been made ready.

    `start`: "flat", "zero" or "equilibrium" (default: that of the scenario, or "flat"), or a state in the columns of
    `Course.parts`, in SI. `samples`: how many after the start, or the times in s themselves. `tolerance`: what each
    step may add to the error of a state, as a share of the largest size it has had. `method`: "exponential" or
    "collocation"; by default the first for small networks. `observe` is shown each piece of motion, in order, and may
    look at it as often as it likes: `Piece.states`.
    Raises: SpecError for bad input. A motion that leaves all bounds is no error: see `Simulation.diverged`.
    """
    count = samples if isinstance(samples, int) else len(samples)
    if count * course.size > MAX_NUMBERS:
        message = f"{count} samples of {course.size} states are more than {MAX_NUMBERS} numbers; take fewer"
        raise SpecError((Fault("U007", "--samples", message),))
    times = sample_times(course, samples) if isinstance(samples, int) else numpy.asarray(samples, dtype=float)
    bad = [t for t in (times[0], times[-1]) if not 0 <= t <= course.end] if len(times) else [numpy.nan]
    if bad or not (numpy.diff(times) >= 0).all():
        message = f"the times of samples have to rise, from 0 s to {course.end:g} s at most"
        raise SpecError((Fault("U005", "--samples", message),))
    x = None
    if isinstance(start, str):
        course.start = start
    elif start is not None:
        if numpy.shape(start) != (course.size,):
            message = f"a state of {numpy.size(start)} numbers, where {course.size} are expected"
            raise SpecError((Fault("U006", "--start", message),))
        x = course.gather(course.plant(course.phases[0]), numpy.asarray(start, dtype=float))
        if not numpy.isfinite(x).all():
            raise SpecError((Fault("U006", "--start", "not all of what is on is given by a finite number"),))
    states = numpy.full((len(times), course.size), numpy.nan)
    phases: list[dict[str, Any]] = []
    diverged: Diverged | None = None
    done = 0
    last: tuple[Stage, Piece] | None = None
    try:
        for stage, piece in course.motion(x, tolerance, method):
            until = int(numpy.searchsorted(times, piece.end, "left"))
            if until > done:
                states[done:until] = course.spread(stage.plant, piece.states(times[done:until]))
                done = until
            if last is None or last[0] is not stage:
                phases.append({})
            last = stage, piece
            phases[-1] = summary(stage)
            if observe:
                observe(stage, piece)
            if progress:
                progress(piece.end, course.end)
    except Diverged as error:
        diverged = error
        done = min(done, int(numpy.searchsorted(times, error.at_second, "right")))
    if last and diverged is None and done < len(times):
        states[done:] = course.spread(last[0].plant, last[1].states(times[done:]))
        done = len(times)
    begun = course.start if x is None else "given"
    return Simulation(begun, times[:done], states[:done], course.parts, phases, diverged)


def summary(stage: Stage) -> dict[str, Any]:
    """How a phase was followed: its number, time and method, how many windows and switchings it took."""
    follower, phase = stage.follower, stage.phase
    return {
        "number": phase.number,
        "start": float(phase.start_second),
        "end": float(phase.end_second),
        "method": follower.method,
        "windows": follower.windows,
        "rejected": follower.rejected,
        "switches": follower.switches,
    }
