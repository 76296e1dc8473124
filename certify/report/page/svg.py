"""Elements of SVG as safe markup: every text and attribute is escaped, colours are left to the style sheet."""

from __future__ import annotations

import math
from collections.abc import Iterable

from markupsafe import Markup, escape

Child = Markup | str
Value = str | float | None


def number(x: float) -> str:
    """A coordinate to a tenth of a pixel.

    >>> number(3.0), number(-0.04), number(2.25)
    ('3', '0', '2.2')
    """
    text = f"{x:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text


def element(name: str, *children: Child, **attributes: Value) -> Markup:
    """An element. A name in Python stands for one in SVG: `stroke_width` for stroke-width, `class_` for class.

    >>> element("text", "a < b", x=1.25, class_="name")
    Markup('<text x="1.2" class="name">a &lt; b</text>')
    """
    given = []
    for key, value in attributes.items():
        if value is not None:
            text = number(value) if isinstance(value, int | float) else str(value)
            given.append(f' {key.rstrip("_").replace("_", "-")}="{escape(text)}"')
    inner = "".join(str(escape(child)) for child in children)
    head = f"<{name}{''.join(given)}"
    return Markup(f"{head}>{inner}</{name}>" if inner else f"{head}/>")


def group(children: Iterable[Child], **attributes: Value) -> Markup:
    return element("g", *children, **attributes)


def polyline(points: Iterable[tuple[float, float]]) -> str:
    """The path data of a line through points; it is broken where a point is no number.

    >>> polyline([(0, 0), (1, 2), (float("nan"), 0), (3, 4)])
    'M0 0L1 2M3 4'
    """
    parts, pen = [], "M"
    for x, y in points:
        if not (math.isfinite(x) and math.isfinite(y)):
            pen = "M"
            continue
        parts.append(f"{pen}{number(x)} {number(y)}")
        pen = "L"
    return "".join(parts)


def picture(children: Iterable[Child], width: float, height: float, title: str, class_: str = "chart") -> Markup:
    """A picture that is as wide as there is room, and read aloud by its title."""
    return element(
        "svg",
        *children,
        viewBox=f"0 0 {number(width)} {number(height)}",
        class_=class_,
        role="img",
        aria_label=title,
        width=width,
        height=height,
    )
