"""The simulated cross-check of a certificate: a motion in floats from a telling start, drawn, with what it agrees with.

It is evidence and no proof; only a contradiction would mean something for certain: that one of the two is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy
from markupsafe import Markup

from certify.crosscheck.claimed import Claimed
from certify.crosscheck.energy import Storage
from certify.crosscheck.falsify import LONGEST_SECOND, MAX_STATES, Falsifier
from certify.crosscheck.findings import worst
from certify.crosscheck.model import find_reference
from certify.crosscheck.run import Checked, CrossCheck
from certify.report.crosscheck import KINDS
from certify.report.events import event_in_words
from certify.report.figures import shorten_name
from certify.report.page.charts import Axis, Chart, padded
from certify.report.page.subject import Progress, Subject
from certify.report.page.words import short
from certify.rests import read_region
from certify.simulation import TOLERANCE, Course, Simulation, Stage, simulate_course
from certify.simulator.motion import Diverged, Piece
from certify.simulator.plant import Array

MAX_NODES = 400  # beyond which nothing is simulated for a page
MAX_PIECES = 2000  # of a motion: one that rings for ever is followed as far as that, the same on every machine
SAMPLES = 4000
FIRST = 1e-6  # of the time that is followed is where a logarithmic axis begins
ATTEMPTS = 2  # to break the region, on each island
COLUMNS = 280  # of a picture; in each the least and the largest value is drawn
NAMED = 4
TIGHT = 18.0  # pixels between events that have no room for their numbers
DRAWN = 24  # more curves one by one
DISTURBED = 0.01
ISLANDS = 3
SHARE = 0.999  # of the level c at the start
SECONDS = 1.0  # are followed if nothing says for how long


@dataclass(frozen=True)
class Agreement:
    """What was compared, in how many places, and the figure that is nearest to its limit."""

    title: str
    count: int
    value: str
    limit: str
    where: str
    agrees: bool


@dataclass(frozen=True)
class Phase:
    """What was compared in one phase; of a scenario there are several."""

    title: str
    outcome: str
    agreements: tuple[Agreement, ...]
    remarks: tuple[str, ...]

    @property
    def agreeing(self) -> int:
        return sum(agreement.agrees for agreement in self.agreements)


@dataclass(frozen=True)
class Motion:
    """A motion as a page shows it: how it starts and why so, pictures with captions, and what agrees."""

    start: str
    pictures: tuple[tuple[Markup, str], ...] = ()
    phases: tuple[Phase, ...] = ()
    contradictions: tuple[str, ...] = ()
    left_out: str = ""


@dataclass(frozen=True)
class _Followed:
    """A motion and what the cross-check has seen of it. `levels`: first node, start, end and c, phase by phase."""

    course: Course
    simulation: Simulation
    checked: Sequence[Checked]
    levels: tuple[tuple[str, float, float, float], ...]
    log: bool


def show_motion(subject: Subject, scenario: str | None = None, progress: Progress | None = None) -> Motion:
    """Simulate from what is most telling, and compare with the certificate.

    Without a scenario that is the edge of the proved region, else a small disturbance of where the network rests, else
    the spec's first scenario. The phases of a scenario are proved for it. Raises: SpecError for bad input; Rejected.
    """
    if len(subject.grid.nodes) > MAX_NODES and scenario is None:
        count = len(subject.grid.nodes)
        return Motion("", left_out=f"Nothing is simulated: {count:,} nodes are more than {MAX_NODES}.")
    if scenario is not None:
        return _scenario(subject, scenario, "as asked for", progress)
    course = Course(subject.spec)
    plant = course.plant(course.phases[0])
    rest = find_reference(claimed := Claimed(plant, subject.certificate, subject.verdict))
    if rest is None:
        if subject.scenarios:
            return _scenario(subject, subject.scenarios[0], "because the simulator finds no equilibrium", progress)
        text = "flat: each node at the reference of the nearest DGU, no currents, because no equilibrium was found"
        return _show(_follow(subject, Course(subject.spec), None, progress), text)
    falsifier = Falsifier(storage := Storage(claimed, rest), TOLERANCE) if plant.size <= MAX_STATES else None
    x = falsifier.edge_state(SHARE) if falsifier and storage.first else None
    if x is not None:
        text = f"the edge of the proved region, H = {SHARE:g} c, moved as far as that goes towards what sets c"
    else:
        x = rest.copy()
        for name in plant.nodes:
            if ("voltage", name) in plant.slices:
                x[plant.slices["voltage", name]] *= 1 + DISTURBED
        text = f"all voltages {100 * DISTURBED:g} % above where the simulator rests, because no region is proved"
    end = falsifier.end if falsifier else SECONDS
    end = end if end < LONGEST_SECOND or subject.status("microgrid") == "proved" else 2 * SECONDS
    own = Course(subject.spec, end_second=Fraction(end).limit_denominator(10**6))
    return _show(_follow(subject, own, own.spread(plant, x[None, :])[0], progress), text)


def _follow(subject: Subject, course: Course, state: Array | None, progress: Progress | None) -> _Followed:
    times = numpy.concatenate([[0.0], numpy.geomspace(FIRST * course.end, course.end, SAMPLES)])
    times[-1] = course.end
    cross_check = CrossCheck(course.phases, {1: subject.certificate}, TOLERANCE, ATTEMPTS)
    observe = _up_to(MAX_PIECES, cross_check.see)
    simulation = simulate_course(course, start=state, samples=times, observe=observe, progress=progress)
    checked = cross_check.finish()
    levels = tuple((first, 0.0, course.end, r.level) for first, r in subject.regions.items() if r.level is not None)
    return _Followed(course, simulation, checked, levels, True)


def _up_to(count: int, see: Callable[[Stage, Piece], None]) -> Callable[[Stage, Piece], None]:
    """The same observer, that ends the motion after so many pieces."""
    left = count

    def observe(stage: Stage, piece: Piece) -> None:
        nonlocal left
        see(stage, piece)
        left -= 1
        if left <= 0:
            raise Diverged(piece.end, f"it rings too fast to be followed further for a page (pieces: {count:,})")

    return observe


def _scenario(subject: Subject, name: str, why: str, progress: Progress | None) -> Motion:
    from certify.report.scenario import prove_phases

    course = Course(subject.spec, name)
    proved = prove_phases(subject.spec, course.phases)
    certificates = {entry.phase.number: entry.certificate.data for entry in proved}
    cross_check = CrossCheck(course.phases, certificates, TOLERANCE, ATTEMPTS)
    observe = _up_to(MAX_PIECES * len(course.phases), cross_check.see)
    simulation = simulate_course(course, samples=SAMPLES // 2, observe=observe, progress=progress)
    checked = cross_check.finish()
    levels = []
    for entry in proved:
        for claim in entry.certificate.verdict.claims:
            if claim.kind == "region" and claim.facts and (level := read_region(claim).level) is not None:
                span = float(entry.phase.start_second), float(entry.phase.end_second)
                levels.append((claim.id.partition("/")[2], *span, level))
    text = (
        f"scenario {name} of the spec, {why}, from its own start ({simulation.start}); its phases were proved for this"
    )
    return _show(_Followed(course, simulation, checked, tuple(levels), False), text)


def _show(followed: _Followed, start: str) -> Motion:
    checked, simulation = followed.checked, followed.simulation
    pictures = []
    if len(simulation.times) > 1:
        pictures.append(_voltages(followed))
        pictures += _storages(followed)
    bad = []
    for entry in checked:
        for found in entry.contradictions:
            where = f"phase {entry.number}: " if len(checked) > 1 else ""
            bad.append(f"{where}{KINDS[found.kind]}: {found.where}, {found.value:.3g} where at most {found.limit:.3g}")
    if simulation.diverged is not None:
        start += f". Not followed beyond t = {simulation.diverged.at_second:.4g} s: {simulation.diverged.reason}"
    phases = tuple(_phase(entry, followed.course, len(checked) > 1) for entry in checked)
    return Motion(f"{start}.", tuple(pictures), phases, tuple(bad))


def _phase(entry: Checked, course: Course, several: bool) -> Phase:
    agreements = []
    for kind, title in KINDS.items():
        own = [found for found in entry.findings if found.kind == kind]
        if own and (most := worst(own)) is not None:
            unit = f" {most.unit}" if most.unit else ""
            value = "never grows" if kind == "storage" and most.value <= 0 else f"{short(max(most.value, 0.0))}{unit}"
            agreements.append(
                Agreement(title, len(own), value, f"{short(most.limit)}{unit}", most.where, all(f.agrees for f in own))
            )
    remarks = []
    tried = [attempt for attempt in entry.attempts.tried if attempt.inside]
    if tried and (best := entry.attempts.best) is not None:
        failed = "none did" if not entry.attempts.findings else f"{len(entry.attempts.findings)} contradictions"
        remarks.append(
            f"{len(tried)} attempts to break the region, {failed}: the best, a {best.kind} from H = {best.share:g} c, "
            f"came to {100 * best.edge:.3g} % of what the region allows."
        )
        beyond = [a for a in entry.attempts.tried if not a.inside]
        back = [f"{a.share:g} c" for a in beyond if a.returned]
        remarks.append(f"Beyond the region, where nothing is claimed, it returned from {', '.join(back) or 'none'}.")
    if entry.reason:
        remarks.append(f"{entry.reason[:1].upper()}{entry.reason[1:]}.")
    title = ""
    if several:
        phase = course.phases[entry.number - 1]
        told = "; ".join(event_in_words(event) for event in phase.events[:4])
        title = f"Phase {phase.number}, {phase.span}{f': {told}' if told else ''}"
    return Phase(title, entry.outcome, tuple(agreements), tuple(remarks))


# --- pictures ---------------------------------------------------------------------------------------------------------


def _envelope(chart: Chart, times: Array, values: Array) -> list[tuple[float, float]]:
    """At most two points for each column of a picture: nothing that the curve does in between is lost."""
    good = numpy.isfinite(times)
    times, values = times[good], values[good]
    columns = numpy.floor(numpy.array([chart.x.share(float(t)) for t in times]) * COLUMNS)
    points: list[tuple[float, float]] = []
    edges = numpy.flatnonzero(numpy.diff(columns)) + 1
    for part in numpy.split(numpy.arange(len(times)), edges):
        own = values[part]
        if not len(part) or numpy.isnan(own).any():
            points.append((math.nan, math.nan))
            continue
        for k in sorted({int(own.argmin()), int(own.argmax())}):
            points.append((float(times[part[k]]), float(own[k])))
    return points


def _draw_range(chart: Chart, times: Array, values: Array) -> None:
    """The least and the largest of many curves in each column of a picture; values (curves, t)."""
    good = numpy.flatnonzero(numpy.isfinite(values).any(axis=0))
    columns = numpy.floor(numpy.array([chart.x.share(float(t)) for t in times[good]]) * COLUMNS)
    low: list[tuple[float, float]] = []
    high: list[tuple[float, float]] = []
    for part in numpy.split(good, numpy.flatnonzero(numpy.diff(columns)) + 1):
        at = float(times[part[0]])
        low.append((at, float(numpy.nanmin(values[:, part]))))
        high.append((at, float(numpy.nanmax(values[:, part]))))
    chart.area(low, high, "range", f"{len(values)} other nodes")


def _time_axis(followed: _Followed) -> Axis:
    end = float(followed.simulation.times[-1])
    if followed.log:
        return Axis("time after the start (s), logarithmic", FIRST * followed.course.end, end, log=True)
    return Axis("time (s)", 0.0, end)


def _mark_events(chart: Chart, followed: _Followed) -> None:
    if followed.log:
        return
    last = -math.inf
    for phase in followed.course.phases[1:]:
        at = float(phase.start_second)
        room = chart.px(at) - last
        if room > TIGHT:
            last = chart.px(at)
        text = f"phase {phase.number}" if room > 3 * TIGHT else f"{phase.number}"
        chart.upright(at, text if room > TIGHT else "")


def _voltages(followed: _Followed) -> tuple[Markup, str]:
    simulation = followed.simulation
    names = [node.name for node in followed.course.whole.nodes]
    times = simulation.times.copy()
    if followed.log:
        times[0] = FIRST * followed.course.end
    sizes: Mapping[str, Any] = {name: numpy.abs(simulation.phasor("voltage", name)) for name in names}
    finite = numpy.concatenate([v[numpy.isfinite(v)] for v in sizes.values()])
    kilo = 1e3 if len(finite) and finite.max() >= 2e3 else 1.0
    low, high = padded(float(finite.min()) / kilo, float(finite.max()) / kilo)
    chart = Chart(
        _time_axis(followed), Axis(f"|V| ({'kV' if kilo > 1 else 'V'})", low, high), height=300, right=118, width=760
    )
    _mark_events(chart, followed)
    moved = sorted(names, key=lambda name: -float(numpy.nanmax(sizes[name]) - numpy.nanmin(sizes[name])))
    named = moved[:NAMED]
    many = moved[NAMED:] if len(moved) > NAMED + DRAWN else []
    if many:
        _draw_range(chart, times, numpy.array([sizes[name] / kilo for name in many]))
    for name in [] if many else moved[NAMED:][::-1]:
        chart.curve(_envelope(chart, times, sizes[name] / kilo), "others", title=f"node {name}")
    for k, name in enumerate(named):  # what moves most lies behind
        chart.curve(_envelope(chart, times, sizes[name] / kilo), f"thin c{k}", title=f"node {name}")
    chart.legend = [(f"node {shorten_name(name)[:9]}", f"thin c{k}") for k, name in enumerate(named)]
    others = f"; the other {len(names) - NAMED} are grey" if len(names) > NAMED else ""
    others += ": shown is the range of them" if many else ""
    caption = f"Voltage at each node; named are those that move most, in order{others}."
    return chart.render("Modulus of the node voltages over time, simulated"), caption


def _storages(followed: _Followed) -> list[tuple[Markup, str]]:
    """H over time with the level c, a picture for each island."""
    found = []
    islands = list(dict.fromkeys(first for entry in followed.checked for first in entry.islands))
    for first in islands[:ISLANDS]:
        parts = []
        for entry in followed.checked:
            if first in entry.islands and len(entry.times):
                parts.append((entry.times, entry.storages[:, entry.islands.index(first)]))
        levels = [level for level in followed.levels if level[0] == first]
        positive = [float(x) for _, H in parts for x in H if x > 0]
        if not positive:
            continue
        high = max([*positive, *(c for *_, c in levels)])
        low = max(min(positive), 1e-14 * high)
        chart = Chart(
            _time_axis(followed),
            Axis("H (J), logarithmic", low / 3, high * 6, log=True),
            height=260,
            right=118,
            width=760,
        )
        _mark_events(chart, followed)
        for _, start, end, c in levels:
            if followed.log:
                chart.level(c, f"level c = {c:.6g} J: what begins below it is proved to return")
            else:
                chart.curve([(start, c), (end, c)], "limit", title=f"level c = {c:.6g} J of this phase")
        for k, (times, H) in enumerate(parts):
            own = numpy.maximum(times, FIRST * followed.course.end) if followed.log else times
            last = k == len(parts) - 1
            chart.curve(_envelope(chart, own, H), "c0", "H" if last else "", title="H of the certificate")
        where = f" on the island of node {first}" if len(islands) > 1 else ""
        level = "" if levels else " No level is proved."
        caption = (
            f"Storage H{where}, with the storage functions of the certificate. It may not grow within a phase.{level}"
        )
        if levels and not followed.log:
            caption += " Dashed: the level c of each phase."
        found.append((chart.render(f"Storage H over time{where}, simulated"), caption))
    return found
