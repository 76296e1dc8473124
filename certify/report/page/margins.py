"""Load margins over voltage, a chart for each node with static loads: how far its current is from not being monotone.

Curves are in floats; the status beside them is the kernel's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from markupsafe import Markup

from certify.kernel.claims import Claim
from certify.kernel.model import LoadLaw, Pieces, PowerTerm
from certify.kernel.spec import Node
from certify.report.page.charts import Axis, Chart, padded, tick_text
from certify.report.page.subject import Subject
from certify.report.page.words import STATUSES

SHOWN = 24  # charts
STEPS = 96  # of the voltage
AROUND = Fraction(1, 8)  # of the band on either side is shown as well
LEAST = Fraction(1, 20)  # of the upper end of a band is the least voltage drawn: nearer to 0 V margins have no bound
ALIKE = 30.0  # so many times may extents differ that are drawn in one scale
UNITS = ((1.0, "S"), (1e-3, "mS"), (1e-6, "µS"), (1e-9, "nS"), (1e-12, "pS"))


@dataclass(frozen=True)
class Panel:
    """The chart of one node, and nodes with the same law and band, which share it."""

    node: str
    claim: Claim
    alike: tuple[str, ...]
    picture: Markup
    least: str
    where: str


@dataclass(frozen=True)
class Margins:
    panels: tuple[Panel, ...]
    remark: str


@dataclass(frozen=True)
class _Course:
    """Margins in siemens over voltages in volt, where the claim is made, and voltages of a witness."""

    node: Node
    claim: Claim
    points: tuple[tuple[float, float], ...]
    band: tuple[float, float]
    witness: tuple[float, ...]
    label: str
    alike: tuple[str, ...] = ()

    @property
    def inside(self) -> list[float]:
        return [y for x, y in self.points if self.band[0] <= x <= self.band[1] and math.isfinite(y)]


def draw_margins(subject: Subject) -> Margins:
    """A chart for each node with static loads, those first that are not proved; equal ones are drawn once."""
    same: dict[object, list[Node]] = {}
    for node in subject.grid.nodes:
        if node.has_static_load:
            status = subject.claims[f"load/{node.name}"].status
            same.setdefault((node.loads, node.band_volt, node.current, status), []).append(node)
    groups = sorted(same.values(), key=lambda nodes: STATUSES.index(subject.claims[f"load/{nodes[0].name}"].status))
    courses = [_course(subject, nodes) for nodes in groups[:SHOWN]]
    if not courses:
        return Margins((), "")
    extents = [max(map(abs, course.inside), default=0.0) for course in courses]
    known = [x for x in extents if x > 0]
    one_scale = bool(known) and max(known) <= ALIKE * min(known)
    common = _range([y for course in courses for y in course.inside])
    panels = tuple(_panel(course, common if one_scale else _range(course.inside)) for course in courses)
    remark = "All charts have the same scale." if one_scale else "Scales differ, since the loads differ in size."
    if len(courses) == 1:
        remark = ""
    if len(groups) > SHOWN:
        remark += f" Left out: {len(groups) - SHOWN:,} more nodes with other loads."
    return Margins(panels, remark.strip())


def _range(values: Sequence[float]) -> tuple[float, float]:
    """A range of margins with zero in it."""
    low, high = min([0.0, *values]), max([0.0, *values])
    return padded(low, high, 0.08) if high > low else (-1.0, 1.0)


def _course(subject: Subject, nodes: Sequence[Node]) -> _Course:
    node = nodes[0]
    claim = subject.claims[f"load/{node.name}"]
    witness = tuple(
        abs(float(value))
        for name, value, _ in claim.facts
        if name in ("voltage of the pair", "linearisation not passive at")
    )
    alike = tuple(other.name for other in nodes[1:])
    if node.current is not None:
        points, band = _disk_points(subject, node)
        label = "from the centre of the disk along d (V)"
        return _Course(node, claim, points, band, (), label, alike)
    pieces = subject.context.pieces(node.name)
    return _Course(node, claim, _points(pieces), _ends(pieces), witness, "|V| (kV)", alike)


def _ends(pieces: Pieces) -> tuple[float, float]:
    return float(pieces[0][0][0]), float(pieces[-1][0][1])


def _points(pieces: Pieces) -> tuple[tuple[float, float], ...]:
    """Margins over the band and a little beyond, each part of the band by its own law."""
    low, high = pieces[0][0][0], pieces[-1][0][1]
    room = (high - low) * AROUND
    found: list[tuple[float, float]] = []
    for k, ((a, b), law) in enumerate(pieces):
        start = max(a - room if k == 0 else a, high * LEAST)
        end = b + room if k == len(pieces) - 1 else b
        if start < end:
            volts = [float(start) + (float(end) - float(start)) * j / STEPS for j in range(STEPS + 1)]
            found += [(math.nan, math.nan)] * bool(found) + list(zip(volts, law_margins(law, volts), strict=True))
    return tuple(found)


def law_margins(law: LoadLaw, volts: Sequence[float]) -> list[float]:
    """Smallest eigenvalue of the symmetric part of dI/dV in siemens at voltages in volt, in floats."""
    import numpy

    from certify.report.load_margins import load_margins

    base = Fraction(volts[len(volts) // 2])
    relative = load_margins([(law, base)], numpy.array(volts) / float(base))[0]
    whole = math.hypot(*(_power(part, float(base)) for part in (law.active, law.reactive)))
    biggest = max((abs(float(x.coefficient)) for x in (*law.active, *law.reactive)), default=0.0)
    if whole <= 1e-12 * biggest:  # as load_margins has it: nothing is drawn there, and the unit is 1 VA / V0^2
        whole = 1.0
    return [float(y) * whole / float(base) ** 2 for y in relative]


def _power(terms: Sequence[PowerTerm], v: float) -> float:
    return math.fsum(float(x.coefficient) * (v / float(x.base_volt)) ** float(x.exponent) for x in terms)


def _disk_points(subject: Subject, node: Node) -> tuple[tuple[tuple[float, float], ...], tuple[float, float]]:
    """Margins of a load given by its current along the d axis through the disk, by differences in exact arithmetic."""
    law, centre, radius = subject.context.disk(node.name)
    step = radius / 4096
    found = []
    for k in range(-STEPS // 2, STEPS // 2 + 1):
        off = radius * Fraction(2 * k, STEPS)
        V = centre[0] + off, centre[1]
        try:
            columns = []
            for d, q in ((step, Fraction(0)), (Fraction(0), step)):
                up, down = law.current((V[0] + d, V[1] + q)), law.current((V[0] - d, V[1] - q))
                columns.append([float((a - b) / (2 * step)) for a, b in zip(up, down, strict=True)])
            (a, c), (b, d_) = columns
            found.append((float(off), (a + d_) / 2 - math.hypot((a - d_) / 2, (b + c) / 2)))
        except ZeroDivisionError:
            found.append((float(off), math.nan))
    return tuple(found), (-float(radius), float(radius))


def _panel(course: _Course, extent: tuple[float, float]) -> Panel:
    size = max(map(abs, extent))
    scale, unit = next(((s, u) for s, u in UNITS if size >= s), UNITS[-1])
    kilo = 1e3 if course.label.endswith("(kV)") and course.band[1] >= 1e3 else 1.0
    label = course.label if kilo > 1 else course.label.replace("(kV)", "(V)")
    xs = [x for x, _ in course.points if math.isfinite(x)]
    chart = Chart(
        Axis(label, min(xs) / kilo, max(xs) / kilo, count=4),
        Axis(f"margin ({unit})", extent[0] / scale, extent[1] / scale, count=4),
        width=340,
        height=210,
        left=66,
    )
    chart.band(course.band[0] / kilo, course.band[1] / kilo, title="where the claim is made")
    if extent[0] < 0:
        chart.below(0.0)
    status = course.claim.status
    points = [(x / kilo, y / scale) for x, y in course.points]
    chart.curve(points, f"status {status}", title=f"margin of the load at node {course.node.name}")
    for volts in course.witness:
        near = min((p for p in points if math.isfinite(p[0])), key=lambda p: abs(p[0] - volts / kilo))
        chart.dot(volts / kilo, near[1], "spot refuted", title=f"a voltage of the counterexample: {volts:.6g} V")
    least = min(course.inside, default=math.nan)
    told = f"{tick_text(float(f'{least / scale:.3g}'))} {unit}" if math.isfinite(least) else "unknown"
    title = (
        f"Margin of the load at node {course.node.name}, least in the band {told}: the claim is {course.claim.status}"
    )
    where = "on this line through the disk" if course.node.current else "in the band"
    return Panel(course.node.name, course.claim, course.alike, chart.render(title), told, where)
