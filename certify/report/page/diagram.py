"""The network as a picture: cards of nodes with their DGU and loads, lines between them, a verdict on each.

A verdict is told by colour, by a mark of its own shape, and by the dash of a line. Each part is a link to its claim.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from certify.kernel.spec import Line, Microgrid, Node
from certify.report.figures import shorten_name
from certify.report.page.places import Placed, Point, Size, place
from certify.report.page.subject import Subject
from certify.report.page.svg import Child, element, group, number
from certify.report.page.words import STATUSES, name_of

CARDS = 70  # nodes, up to which each has a card
DOTS = 300  # nodes, up to which each has a dot
AROUND = 40  # nodes shown around what is not proved in a larger network
GLYPH, SYMBOL, HEAD = 7.6, 26.0, 24.0
WIDE = 1100.0  # pixels: a wider picture may be moved in its frame, so that it stays readable
LONGEST = 14  # characters of a name in the picture


@dataclass(frozen=True)
class Diagram:
    """The picture, None if there is none, with cards or else dots, and what is left out of it, "" if nothing is."""

    picture: Markup | None
    left_out: str
    legend: tuple[str, ...]
    cards: bool = True


def draw_network(subject: Subject) -> Diagram:
    """The picture of a network: whole, as dots, or what is around the parts that are not proved."""
    grid = subject.grid
    count = len(grid.nodes)
    legend = tuple(s for s in STATUSES if any(c.status == s for c in subject.verdict.claims))
    if count <= CARDS:
        return Diagram(_cards(subject, grid.nodes, grid.lines), "", legend)
    if count <= DOTS:
        text = f"{count:,} nodes are drawn as dots; named are those with a part that is not proved."
        return Diagram(_dots(subject), text, legend, cards=False)
    nodes = _around(grid, _open_nodes(subject))
    if not nodes:
        text = f"The network has {count:,} nodes and {len(grid.lines):,} lines, too many to draw; all parts are proved."
        return Diagram(None, text, legend)
    kept = {node.name for node in nodes}
    lines = [line for line in grid.lines if line.start in kept and line.end in kept]
    text = (
        f"Of {count:,} nodes only {len(nodes)} are drawn: those with a part that is not proved"
        f"{' (the first ones)' if len(nodes) >= AROUND else ''}, and their neighbours. All other parts may be found "
        "among the claims."
    )
    return Diagram(_cards(subject, nodes, lines), text, legend)


def _open_nodes(subject: Subject) -> list[str]:
    """The nodes that a part that is not proved stands at, in the order of the claims."""
    found: dict[str, None] = {}
    ends = {line.name: line.start for line in subject.grid.lines}
    for claim in subject.verdict.claims:
        kind, _, name = claim.id.partition("/")
        if claim.status != "proved" and kind in ("dgu", "load", "line", "branch"):
            name = ends[name] if kind == "line" else name.rpartition("/")[0] if kind == "branch" else name
            found[name] = None
    return list(found)


def _around(grid: Microgrid, names: Sequence[str]) -> list[Node]:
    """These nodes and their neighbours, not many in all."""
    middle = set(names[: AROUND // 2])
    kept = set(middle)
    for line in grid.lines:
        for one, other in ((line.start, line.end), (line.end, line.start)):
            if one in middle and len(kept) < AROUND:
                kept.add(other)
    return [node for node in grid.nodes if node.name in kept]


# --- cards ------------------------------------------------------------------------------------------------------------


def _symbols(subject: Subject, node: Node) -> list[tuple[str, str]]:
    """Shape and claim of everything at a node that there is a claim about."""
    found = [("dgu", f"dgu/{node.name}")] if node.dgu else []
    found += [("load", f"load/{node.name}")] if node.has_static_load else []
    found += [("coil", f"branch/{node.name}/{k}") for k in range(len(node.branches))]
    return [(shape, claim) for shape, claim in found if claim in subject.claims]


def _short(name: str) -> str:
    text = shorten_name(name)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _cards(subject: Subject, nodes: Sequence[Node], lines: Sequence[Line]) -> Markup:
    symbols = {node.name: _symbols(subject, node) for node in nodes}
    sizes: dict[str, Size] = {}
    for node in nodes:
        width = max(46.0, GLYPH * len(_short(node.name)) + 20, SYMBOL * len(symbols[node.name]) + 18)
        sizes[node.name] = width, HEAD + (32.0 if symbols[node.name] else 0.0)
    placed = place(sizes, [(line.start, line.end) for line in lines])
    paths = _paths(placed, lines)
    parts: list[Child] = []
    taken: list[tuple[Point, Size]] = [(placed.at[name], sizes[name]) for name in sizes]
    labels: list[Child] = []
    for line in lines:
        curve = paths[line.name]
        text = _short(line.name)
        size = (GLYPH * 0.86 * len(text) + 28, 18.0)
        spot = _label_spot(curve, size, taken, [c for name, c in paths.items() if name != line.name])
        taken.append((spot, size))
        parts.append(_line(subject, line, curve))
        labels.append(_line_label(subject, line, text, spot, size))
    cards = [_card(subject, node, placed.at[node.name], sizes[node.name], symbols[node.name]) for node in nodes]
    what = f"{len(nodes)} nodes and {len(lines)} lines, each with its verdict"
    return element(
        "svg",
        *parts,
        *labels,
        *cards,
        viewBox=f"0 0 {number(placed.width)} {number(placed.height)}",
        width=placed.width,
        height=placed.height,
        class_=f"network {'large' if placed.width > WIDE else 'middling' if placed.width > WIDE / 2 else 'small'}",
        role="group",
        aria_label=f"The network: {what}",
    )


Curve = tuple[Point, Point, Point]  # a quadratic one: start, control, end


def _paths(placed: Placed, lines: Sequence[Line]) -> dict[str, Curve]:
    """Straight lines between middles; several between the same two nodes are bent apart."""
    bundles: dict[frozenset[str], list[Line]] = {}
    for line in lines:
        bundles.setdefault(frozenset((line.start, line.end)), []).append(line)
    found: dict[str, Curve] = {}
    for bundle in bundles.values():
        ends = sorted((bundle[0].start, bundle[0].end))
        p, q = placed.at[ends[0]], placed.at[ends[1]]
        away = math.dist(p, q) or 1.0
        across = -(q[1] - p[1]) / away, (q[0] - p[0]) / away
        for k, line in enumerate(bundle):
            bend = (k - (len(bundle) - 1) / 2) * 64
            found[line.name] = p, ((p[0] + q[0]) / 2 + across[0] * bend, (p[1] + q[1]) / 2 + across[1] * bend), q
    return found


def _on(curve: Curve, t: float) -> Point:
    a, b, c = (1 - t) ** 2, 2 * t * (1 - t), t**2
    p, q, r = curve
    return a * p[0] + b * q[0] + c * r[0], a * p[1] + b * q[1] + c * r[1]


def _label_spot(curve: Curve, size: Size, taken: Sequence[tuple[Point, Size]], others: Iterable[Curve]) -> Point:
    """Where on its line a label touches nothing, or least."""
    points = [_on(other, k / 24) for other in others for k in range(25)]

    def cost(t: float) -> tuple[float, float]:
        x, y = _on(curve, t)
        touching = sum(
            max(0.0, (size[0] + s[0]) / 2 + 2 - abs(x - p[0])) * max(0.0, (size[1] + s[1]) / 2 + 2 - abs(y - p[1]))
            for p, s in taken
        )
        crossing = sum(abs(x - px) < size[0] / 2 + 2 and abs(y - py) < size[1] / 2 + 2 for px, py in points)
        return touching + 30.0 * crossing, abs(t - 0.5)

    return _on(curve, min((k / 20 for k in range(3, 18)), key=cost))


def _link(subject: Subject, claim: str, children: Iterable[Child], what: str, class_: str) -> Markup:
    status = subject.claims[claim].status
    title = f"{what}: {status}"
    return element(
        "a",
        element("title", title),
        *children,
        href=f"#{subject.anchors[claim]}",
        aria_label=f"{title}, show its claim",
        class_=f"part {class_} {status}",
    )


def _line(subject: Subject, line: Line, curve: Curve) -> Markup:
    p, q, r = curve
    d = f"M{number(p[0])} {number(p[1])}Q{number(q[0])} {number(q[1])} {number(r[0])} {number(r[1])}"
    return element("path", d=d, class_=f"wire {subject.claims[f'line/{line.name}'].status}")


def _line_label(subject: Subject, line: Line, text: str, at: Point, size: Size) -> Markup:
    x, y = at[0] - size[0] / 2, at[1] - size[1] / 2
    status = subject.claims[f"line/{line.name}"].status
    plate = element("rect", x=x, y=y, width=size[0], height=size[1], rx=9, class_="plate")
    inside = [plate, mark(status, x + 10, at[1], 6.0), element("text", text, x=x + 19, y=at[1] + 4, class_="tick")]
    what = f"line {line.name}, from node {line.start} to node {line.end}"
    return _link(subject, f"line/{line.name}", inside, what, "label")


def _card(subject: Subject, node: Node, at: Point, size: Size, symbols: Sequence[tuple[str, str]]) -> Markup:
    x, y = at[0] - size[0] / 2, at[1] - size[1] / 2
    worst = [s for s in STATUSES if any(subject.claims[claim].status == s for _, claim in symbols)]
    state = worst[0] if worst else "none"
    parts: list[Child] = [
        element("rect", x=x, y=y, width=size[0], height=size[1], rx=6, class_=f"card {state}"),
        element(
            "text", element("title", f"node {node.name}"), _short(node.name), x=at[0], y=y + 17, class_="name middle"
        ),
    ]
    step = SYMBOL + 4
    left = at[0] - step * (len(symbols) - 1) / 2
    for k, (shape, claim) in enumerate(symbols):
        middle = left + k * step, y + HEAD + 13
        status = subject.claims[claim].status
        inside = [SHAPES[shape](*middle), mark(status, middle[0] + 9.5, middle[1] + 7.5, 6.4)]
        parts.append(_link(subject, claim, inside, name_of(claim), "symbol"))
    return group(parts)


def _dgu(x: float, y: float) -> Markup:
    """A source of alternating voltage."""
    wave = f"M{number(x - 6)} {number(y)}q3 -7 6 0t6 0"
    return group([element("circle", cx=x, cy=y, r=11, class_="shape"), element("path", d=wave, class_="stroke")])


def _load(x: float, y: float) -> Markup:
    """An arrow to the ground."""
    return element("path", d=f"M{number(x - 10)} {number(y - 8)}h20l-10 17z", class_="shape")


def _coil(x: float, y: float) -> Markup:
    """The turns of an inductance."""
    turns = f"M{number(x - 11)} {number(y + 3)}a3.6 4 0 0 1 7.3 0a3.6 4 0 0 1 7.3 0a3.6 4 0 0 1 7.3 0"
    box = element("rect", x=x - 12, y=y - 9, width=24, height=18, rx=3, class_="shape")
    return group([box, element("path", d=turns, class_="stroke")])


SHAPES = {"dgu": _dgu, "load": _load, "coil": _coil}


def mark(status: str, x: float, y: float, r: float) -> Markup:
    """The mark of a status: a disc with a tick, a diamond with a cross, a ring with a question mark, half a disc."""
    at = f"{number(x)} {number(y)}"
    if status == "proved":
        tick = f"M{number(x - r * 0.5)} {number(y)}l{number(r * 0.36)} {number(r * 0.42)}"
        tick += f"l{number(r * 0.66)} -{number(r * 0.8)}"
        parts = [element("circle", cx=x, cy=y, r=r), element("path", d=tick, class_="sign")]
    elif status == "refuted":
        s, c = r * 1.35, r * 0.42
        body = (
            f"M{number(x)} {number(y - s)}l{number(s)} {number(s)}l-{number(s)} {number(s)}l-{number(s)} -{number(s)}z"
        )
        cross = (
            f"M{number(x - c)} {number(y - c)}l{number(2 * c)} {number(2 * c)}"
            f"M{number(x - c)} {number(y + c)}l{number(2 * c)} -{number(2 * c)}"
        )
        parts = [element("path", d=body), element("path", d=cross, class_="sign")]
    elif status == "conditional":
        half = f"M{at}m0 -{number(r)}a{number(r)} {number(r)} 0 0 1 0 {number(2 * r)}z"
        parts = [element("circle", cx=x, cy=y, r=r, class_="open"), element("path", d=half)]
    else:
        parts = [
            element("circle", cx=x, cy=y, r=r, class_="open"),
            element("text", "?", x=x, y=y + r * 0.68, class_="query middle"),
        ]
    return group(parts, class_=f"mark {status}")


# --- dots -------------------------------------------------------------------------------------------------------------


def _dots(subject: Subject) -> Markup:
    """Every node as a dot; those with a part that is not proved are marked, named and linked."""
    grid = subject.grid
    sizes: Mapping[str, Size] = {node.name: (12.0, 12.0) for node in grid.nodes}
    placed = place(sizes, [(line.start, line.end) for line in grid.lines])
    paths = _paths(placed, grid.lines)
    wires = [_line(subject, line, paths[line.name]) for line in grid.lines]
    dots: list[Child] = []
    marks: list[Child] = []
    for node in grid.nodes:
        x, y = placed.at[node.name]
        claims = [claim for _, claim in _symbols(subject, node)]
        bad = [claim for claim in claims if subject.claims[claim].status != "proved"]
        if bad:
            inside = [
                mark(subject.claims[bad[0]].status, x, y, 7),
                element("text", _short(node.name), x=x + 12, y=y + 4, class_="name"),
            ]
            marks.append(_link(subject, bad[0], inside, name_of(bad[0]), "symbol"))
        else:
            title = element("title", f"node {node.name}: {'all proved' if claims else 'no claim'}")
            dots.append(element("circle", title, cx=x, cy=y, r=4 if node.dgu else 2.6, class_="dot proved"))
    return element(
        "svg",
        *wires,
        *dots,
        *marks,
        viewBox=f"0 0 {number(placed.width)} {number(placed.height)}",
        width=placed.width,
        height=placed.height,
        class_="network",
        role="group",
        aria_label=f"The network: {len(grid.nodes)} nodes and {len(grid.lines)} lines",
    )
