"""Charts as inline SVG: axes with round ticks, curves, bands, and labels that do not touch.

Colours, dashes and the colour of text are classes of the style sheet, so that a chart follows the theme of its page.
Curves of one chart differ by colour and dash.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from markupsafe import Markup

from certify.report.page.svg import Child, element, number, picture, polyline
from certify.report.placing import spread

LINE = 15.0  # height of a line of text
GLYPH = 6.3  # width of a character


def round_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """About `count` round numbers from low to high.

    >>> round_ticks(0, 10), round_ticks(-0.3, 0.4, 4)
    ([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], [-0.2, 0.0, 0.2, 0.4])
    """
    span = high - low
    if not (math.isfinite(span) and span > 0):
        return [low]
    raw = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1, 2, 2.5, 5, 10) if power * m >= raw * 0.999)
    digits = max(0, 2 - math.floor(math.log10(step)))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(k * step, digits) + 0.0 for k in range(first, last + 1)]


def decade_ticks(low: float, high: float, count: int = 7) -> list[float]:
    """Powers of ten from low to high, at most about `count`.

    >>> decade_ticks(2e-6, 3)
    [1e-05, 0.0001, 0.001, 0.01, 0.1, 1.0]
    """
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    step = max(1, math.ceil((last - first) / count))
    return [float(f"1e{k}") for k in range(first, last + 1) if k % step == 0]


def tick_text(x: float) -> str:
    """
    >>> tick_text(20000.0), tick_text(1e-05), tick_text(0.25), tick_text(-3.0)
    ('20,000', '10⁻⁵', '0.25', '−3')
    """
    size = abs(x)
    if size and (size >= 1e6 or size < 1e-3):
        mantissa, exponent = f"{x:.6g}".split("e") if "e" in f"{x:.6g}" else f"{x:e}".split("e")
        power = "10" + str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        mantissa = f"{float(mantissa):g}"
        text = power if mantissa == "1" else f"−{power}" if mantissa == "-1" else f"{mantissa}·{power}"
    else:
        text = f"{x:,.6f}".rstrip("0").rstrip(".") if size < 1000 else f"{x:,.0f}"
    return text.replace("-", "−")


@dataclass(frozen=True)
class Axis:
    """What an axis shows, from `low` to `high`. `symlog`: linear up to this size, logarithmic beyond."""

    label: str
    low: float
    high: float
    log: bool = False
    symlog: float | None = None
    count: int = 5

    def share(self, value: float) -> float:
        """Where a value is along the axis, 0 to 1."""
        low, high, x = (self._bent(v) for v in (self.low, self.high, value))
        return (x - low) / (high - low) if high != low else 0.5

    def _bent(self, x: float) -> float:
        if self.log:
            return math.log10(x) if x > 0 else math.nan
        if self.symlog is not None:
            bent = abs(x) / self.symlog
            return math.copysign(bent if bent <= 1 else 1 + math.log10(bent), x)
        return x

    def ticks(self) -> list[float]:
        if self.log:
            return decade_ticks(self.low, self.high, self.count + 2)
        if self.symlog is not None:
            sizes = [self.symlog * 10.0**k for k in range(12)]
            sizes = sizes[:: max(1, sum(s <= max(-self.low, self.high) for s in sizes) // 4)]
            found = [-s for s in reversed(sizes)] + [0.0] + sizes
            return [x for x in found if self.low <= x <= self.high]
        return round_ticks(self.low, self.high, self.count)


@dataclass
class Chart:
    """A chart that is drawn piece by piece, from back to front, and then `render`ed.

    `right` is the room for labels at the ends of curves.
    """

    x: Axis
    y: Axis
    width: float = 660.0
    height: float = 280.0
    left: float = 62.0
    right: float = 16.0
    top: float = 14.0
    bottom: float = 44.0
    parts: list[Child] = field(default_factory=list)
    labels: list[tuple[float, str, str]] = field(default_factory=list)
    legend: list[tuple[str, str]] = field(default_factory=list)  # instead of labels, where the ends of curves meet

    def px(self, x: float) -> float:
        return self.left + self.x.share(x) * (self.width - self.left - self.right)

    def py(self, y: float) -> float:
        """Clipped a little outside of the frame, so that a pole does not blow up the file."""
        share = self.y.share(y)
        if math.isfinite(share):
            share = min(max(share, -0.5), 1.5)
        return self.height - self.bottom - share * (self.height - self.top - self.bottom)

    @property
    def ends(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of the frame in pixels."""
        return self.left, self.width - self.right, self.top, self.height - self.bottom

    def band(self, low: float, high: float, class_: str = "band", title: str = "") -> None:
        """A range of x."""
        _, _, top, bottom = self.ends
        a, b = (min(max(self.px(v), self.left), self.width - self.right) for v in (low, high))
        self.parts.append(
            element("rect", *_titled(title), x=min(a, b), y=top, width=abs(b - a), height=bottom - top, class_=class_)
        )

    def below(self, y: float, class_: str = "bad") -> None:
        """The part of the frame below a value of y."""
        left, right, _, bottom = self.ends
        at = min(max(self.py(y), self.top), bottom)
        self.parts.append(element("rect", x=left, y=at, width=right - left, height=bottom - at, class_=class_))

    def curve(self, points: Sequence[tuple[float, float]], class_: str, label: str = "", title: str = "") -> None:
        """A curve, named at its right end if it has a label."""
        placed = [(self.px(x), self.py(y)) for x, y in points]
        path = element("path", *_titled(title), d=polyline(placed), class_=f"curve {class_}")
        self.parts.append(self._clipped(path))
        known = [p for p in placed if all(map(math.isfinite, p))]
        if label and known:
            self.labels.append((min(max(known[-1][1], self.top), self.height - self.bottom), label, class_))

    def area(
        self, low: Sequence[tuple[float, float]], high: Sequence[tuple[float, float]], class_: str, title: str = ""
    ) -> None:
        """What lies between two curves without gaps."""
        outline = [(self.px(x), self.py(y)) for x, y in (*low, *reversed(high))]
        self.parts.append(self._clipped(element("path", *_titled(title), d=f"{polyline(outline)}z", class_=class_)))

    def level(self, y: float, text: str, class_: str = "level") -> None:
        """A horizontal line with its meaning above it."""
        left, right, _, _ = self.ends
        at = self.py(y)
        self.parts.append(element("line", x1=left, x2=right, y1=at, y2=at, class_=class_))
        if text:
            self.parts.append(element("text", text, x=right - 4, y=at - 5, class_="note end"))

    def upright(self, x: float, text: str = "", class_: str = "level") -> None:
        """A vertical line with its meaning at its top."""
        _, right, top, bottom = self.ends
        at = self.px(x)
        self.parts.append(element("line", x1=at, x2=at, y1=top, y2=bottom, class_=class_))
        if text:
            late = at + 6 + GLYPH * len(text) > right
            side = {"x": at - 5 if late else at + 5, "class_": "note end" if late else "note"}
            self.parts.append(element("text", text, y=top + 11, **side))

    def dot(self, x: float, y: float, class_: str, text: str = "", title: str = "", radius: float = 4.5) -> None:
        at = self.px(x), self.py(y)
        self.parts.append(element("circle", *_titled(title or text), cx=at[0], cy=at[1], r=radius, class_=class_))
        if text:
            late = at[0] + 10 + GLYPH * len(text) > self.width - self.right
            side = {"x": at[0] - 9 if late else at[0] + 9, "class_": "note strong end" if late else "note strong"}
            self.parts.append(element("text", text, y=at[1] + 4, **side))

    def _clipped(self, child: Child) -> Markup:
        """Cut at the frame: a picture inside of the picture needs no name of its own, as a clip path would."""
        left, right, top, bottom = self.ends
        size = {"x": left, "y": top, "width": right - left, "height": bottom - top}
        return element("svg", child, viewBox=" ".join(map(number, size.values())), **size)

    def render(self, title: str) -> Markup:
        left, right, top, bottom = self.ends
        grid: list[Child] = []
        for value in self.y.ticks():
            at = self.py(value)
            grid.append(element("line", x1=left, x2=right, y1=at, y2=at, class_="grid zero" if not value else "grid"))
            grid.append(element("text", tick_text(value), x=left - 7, y=at + 4, class_="tick end"))
        for value in self.x.ticks():
            at = self.px(value)
            grid.append(element("line", x1=at, x2=at, y1=bottom, y2=bottom + 4, class_="axis"))
            grid.append(element("text", tick_text(value), x=at, y=bottom + 17, class_="tick middle"))
        frame: list[Child] = [
            element("line", x1=left, x2=right, y1=bottom, y2=bottom, class_="axis"),
            element("text", self.x.label, x=(left + right) / 2, y=self.height - 6, class_="title middle"),
        ]
        middle = (top + bottom) / 2
        frame.append(
            element(
                "text", self.y.label, x=13, y=middle, class_="title middle", transform=f"rotate(-90 13 {middle:.1f})"
            )
        )
        behind = [part for part in self.parts if str(part).startswith("<rect")]
        others = [part for part in self.parts if not str(part).startswith("<rect")]
        inside = [*behind, *grid, *others, *frame, *self._named()]
        return picture(inside, self.width, self.height, title)

    def _named(self) -> list[Child]:
        """The names of curves right of the frame, each with a short line in the colour of its curve."""
        right = self.width - self.right
        places = spread([at for at, _, _ in self.labels], LINE - 1)
        found: list[Child] = []
        for k, (text, class_) in enumerate(self.legend):
            y = self.top + 8 + k * (LINE + 3)
            found.append(element("path", d=polyline([(right + 4, y), (right + 22, y)]), class_=f"curve {class_}"))
            found.append(element("text", text, x=right + 27, y=y + 4, class_="note"))
        for (at, text, class_), place in zip(self.labels, places, strict=True):
            path = polyline([(right + 2, at), (right + 9, place), (right + 20, place)])
            found.append(element("path", d=path, class_=f"curve {class_}"))
            found.append(element("text", text, x=right + 24, y=place + 4, class_="note"))
        return found


def _titled(title: str) -> list[Child]:
    return [element("title", title)] if title else []


def padded(low: float, high: float, share: float = 0.06) -> tuple[float, float]:
    """A range with room at both ends; of a single value one around it.

    >>> padded(0.0, 1.0, 0.1)
    (-0.1, 1.1)
    """
    room = (high - low) * share
    if room <= abs(high) * 1e-12:
        room = abs(high) * share or 1.0
    return low - room, high + room
