"""Where an island rests: a phasor diagram, the profile of voltages and angles, tables of what the kernel has proved."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from certify.report.figures import shorten_name
from certify.report.page.charts import padded, round_ticks, tick_text
from certify.report.page.subject import Subject
from certify.report.page.svg import Child, element, group, number, picture, polyline
from certify.report.page.words import short
from certify.rests import Rest

Point = tuple[float, float]
Window = tuple[float, float, float, float]

SHOWN_ISLANDS = 4
FLATTEST = 0.38  # height over width of a diagram
DRAWN = 400  # phasors
NAMED = 30  # of them with a name
ROWS = 40  # of a table
PROFILE = 60  # rows of the profile


@dataclass(frozen=True)
class Row:
    name: str
    d: str
    q: str
    size: str
    angle: str
    more: str = ""


@dataclass(frozen=True)
class IslandRest:
    """One island at rest: pictures, tables of rows, and how many rows each table leaves out."""

    first: str
    radius: str
    only_one: bool
    phasors: Markup
    closer: Markup | None
    profile: Markup
    voltages: tuple[Row, ...]
    lines: tuple[Row, ...]
    inverters: tuple[Row, ...]
    left_out: tuple[int, int, int]


def draw_rests(subject: Subject) -> tuple[tuple[IslandRest, ...], int]:
    """The islands that are proved to rest, and how many of those are left out."""
    found = [_island(subject, name, rest) for name, rest in list(subject.rests.items())[:SHOWN_ISLANDS]]
    return tuple(found), max(0, len(subject.rests) - SHOWN_ISLANDS)


def _island(subject: Subject, first: str, rest: Rest) -> IslandRest:
    V = rest.voltages
    forming = {name for name in V if subject.context.nodes[name].dgu}
    heavy = sorted(rest.lines, key=lambda name: -abs(rest.lines[name]))
    inverters = {
        name: f"{abs(rest.terminals[name]):,.6g} V at the terminals" if name in rest.terminals else ""
        for name in rest.inverters
    }
    tables = [
        _rows(V, list(V), "V"),
        _rows(rest.lines, heavy, "A"),
        _rows(rest.inverters, list(rest.inverters), "A", inverters),
    ]
    known = "exactly" if rest.radius <= 1e-40 else f"to {short(rest.radius)} V"
    return IslandRest(
        first,
        known,
        rest.only_one,
        _diagram(V, forming, None),
        _diagram(V, forming, _window(V)) if len(V) > 1 else None,
        _profile(V, forming),
        tables[0][:ROWS],
        tables[1][:ROWS],
        tables[2][:ROWS],
        (max(0, len(V) - ROWS), max(0, len(rest.lines) - ROWS), max(0, len(rest.inverters) - ROWS)),
    )


def _rows(
    phasors: Mapping[str, complex], names: Sequence[str], unit: str, more: Mapping[str, str] | None = None
) -> tuple[Row, ...]:
    return tuple(
        Row(
            name,
            f"{phasors[name].real:,.3f} {unit}".replace("-", "−"),
            f"{phasors[name].imag:,.3f} {unit}".replace("-", "−"),
            f"{abs(phasors[name]):,.3f} {unit}",
            f"{math.degrees(cmath.phase(phasors[name])):.4f}°".replace("-", "−"),
            (more or {}).get(name, ""),
        )
        for name in names[: ROWS + 1]
    )


def _window(V: Mapping[str, complex]) -> Window:
    """A window around the tips: left, bottom, right, top in volt."""
    xs, ys = [v.real for v in V.values()], [v.imag for v in V.values()]
    least = 1e-6 * max(abs(v) for v in V.values())
    return _framed(min(xs) - least, min(ys) - least, max(xs) + least, max(ys) + least, 0.16)


def _framed(left: float, bottom: float, right: float, top: float, room: float) -> Window:
    """A window with room around it, not higher than wide, and not much wider than high."""
    side = max(right - left, top - bottom) * (1 + 2 * room) or 1.0
    height = max((top - bottom) + 2 * room * side, FLATTEST * side)
    x, y = (left + right) / 2, (bottom + top) / 2
    return x - side / 2, y - height / 2, x + side / 2, y + height / 2


def _diagram(V: Mapping[str, complex], forming: set[str], window: Window | None) -> Markup:
    """Phasors in the dq plane, both axes in one scale; with a window only their tips."""
    size, left, bottom, top = 380.0, 58.0, 44.0, 12.0
    whole = max((abs(v) for v in V.values()), default=1.0) or 1.0
    if window is None:
        xs, ys = [0.0, *(v.real for v in V.values())], [0.0, *(v.imag for v in V.values())]
        window = _framed(min(xs), min(ys), max(xs), max(ys), 0.07)
        arrows = True
    else:
        arrows = False
    inner = size - left - 16
    deep = inner * (window[3] - window[1]) / (window[2] - window[0])
    kilo = 1e3 if whole >= 2e3 else 1.0

    def px(v: complex) -> tuple[float, float]:
        return (
            left + (v.real - window[0]) / (window[2] - window[0]) * inner,
            top + deep - (v.imag - window[1]) / (window[3] - window[1]) * deep,
        )

    parts: list[Child] = []
    for tick in round_ticks(window[0] / kilo, window[2] / kilo, 4):
        x, _ = px(complex(tick * kilo, window[1]))
        parts.append(element("line", x1=x, x2=x, y1=top, y2=top + deep, class_="grid zero" if not tick else "grid"))
        parts.append(element("text", tick_text(tick), x=x, y=top + deep + 17, class_="tick middle"))
    for tick in round_ticks(window[1] / kilo, window[3] / kilo, 4):
        _, y = px(complex(window[0], tick * kilo))
        parts.append(element("line", x1=left, x2=left + inner, y1=y, y2=y, class_="grid zero" if not tick else "grid"))
        parts.append(element("text", tick_text(tick), x=left - 7, y=y + 4, class_="tick end"))
    unit = "kV" if kilo > 1 else "V"
    height = top + deep + bottom
    parts.append(element("text", f"V d ({unit})", x=left + inner / 2, y=height - 6, class_="title middle"))
    turn = f"rotate(-90 13 {number(top + deep / 2)})"
    parts.append(element("text", f"V q ({unit})", x=13, y=top + deep / 2, class_="title middle", transform=turn))
    shown = dict(list(V.items())[:DRAWN])
    dots: list[Child] = []
    for name, v in shown.items():
        x, y = px(v)
        told = f"node {name}: {abs(v):,.6g} V at {math.degrees(cmath.phase(v)):.4f}°"
        kind = "tip dgu" if name in forming else "tip"
        if arrows:
            parts.append(element("path", d=polyline([px(0j), (x, y)]), class_="phasor"))
        dots.append(_tip(x, y, kind, told))
    if not arrows:
        dots += _names(shown, px, (left, top, left + inner, top + deep))
    label = "Phasors of the node voltages in the dq plane" if arrows else "The tips of these phasors, enlarged"
    return picture([*parts, *dots], size, height, label)


def _tip(x: float, y: float, kind: str, told: str) -> Markup:
    """A square where an inverter forms the voltage, else a disc."""
    title = element("title", told)
    if kind.endswith("dgu"):
        return element("rect", title, x=x - 4, y=y - 4, width=8, height=8, class_=kind)
    return element("circle", title, cx=x, cy=y, r=4, class_=kind)


def _names(
    V: Mapping[str, complex], px: Callable[[complex], Point], frame: tuple[float, float, float, float]
) -> list[Child]:
    """Names beside tips where there is room; none of more than a few."""
    if len(V) > NAMED:
        return []
    points = {name: px(v) for name, v in V.items()}
    taken = [(x, y, 9.0, 9.0) for x, y in points.values()]
    found: list[Child] = []
    for name, (x, y) in points.items():
        text = shorten_name(name)[:10]
        width = 6.6 * len(text)
        spots = [
            (x + dx * (9 + width / 2 if not dy else 6 + width / 2), y + dy * 12)
            for dx, dy in ((1, 0), (-1, 0), (0.4, -1), (0.4, 1), (-0.4, -1), (-0.4, 1))
        ]

        def cost(at: tuple[float, float], width: float = width) -> float:
            hit = sum(
                max(0.0, (width + w) / 2 - abs(at[0] - a)) * max(0.0, (13 + h) / 2 - abs(at[1] - b))
                for a, b, w, h in taken
            )
            outside = at[0] - width / 2 < frame[0] or at[0] + width / 2 > frame[2]
            return hit + (500.0 if outside or not frame[1] + 6 < at[1] < frame[3] - 6 else 0.0)

        at = min(spots, key=cost)
        taken.append((*at, width, 13.0))
        found.append(element("text", text, x=at[0], y=at[1] + 4, class_="note middle"))
    return found


def _profile(V: Mapping[str, complex], forming: set[str]) -> Markup:
    """|V| and the angle of each node, side by side, each in a scale that shows the differences."""
    names = list(V)[:PROFILE]
    row, top, left, half, gap = 22.0, 30.0, 92.0, 280.0, 34.0
    whole = max(abs(V[n]) for n in names)
    kilo = 1e3 if whole >= 2e3 else 1.0
    columns = (
        (f"|V| ({'kV' if kilo > 1 else 'V'})", {n: abs(V[n]) / kilo for n in names}),
        ("angle (degrees)", {n: math.degrees(cmath.phase(V[n])) for n in names}),
    )
    height = top + row * len(names) + 40
    bottom = top + row * len(names)
    parts: list[Child] = [element("text", "node", x=left - 12, y=top - 12, class_="note end")]
    for k, name in enumerate(names):
        y = top + row * k + row / 2
        parts.append(element("text", shorten_name(name)[:12], x=left - 12, y=y + 4, class_="note end"))
        parts.append(element("line", x1=left, x2=left + 2 * half + gap, y1=y, y2=y, class_="grid"))
    for column, (title, values) in enumerate(columns):
        low, high = padded(min(values.values()), max(values.values()), 0.08)
        start = left + column * (half + gap)
        for tick in round_ticks(low, high, 4):
            x = start + (tick - low) / (high - low) * half
            parts.append(element("line", x1=x, x2=x, y1=bottom, y2=bottom + 4, class_="axis"))
            parts.append(element("text", tick_text(tick), x=x, y=bottom + 17, class_="tick middle"))
        parts.append(element("line", x1=start, x2=start + half, y1=bottom, y2=bottom, class_="axis"))
        parts.append(element("text", title, x=start + half / 2, y=height - 4, class_="title middle"))
        dots = []
        for k, name in enumerate(names):
            x = start + (values[name] - low) / (high - low) * half
            told = f"node {name}: {values[name]:.7g}"
            dots.append(_tip(x, top + row * k + row / 2, "tip dgu" if name in forming else "tip", told))
        parts.append(group(dots))
    more = f", of {len(V):,} the first {len(names)}" if len(V) > len(names) else ""
    label = f"Modulus and angle of the voltage at each node{more}"
    return picture(parts, left + 2 * half + gap + 20, height, label, "chart wide")
