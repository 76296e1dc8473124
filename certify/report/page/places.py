"""Where the nodes of a network stand in a picture: near what they are joined to, lines apart from nodes and lines.

Each island is placed by itself: a radial one as a tidy tree, if that is not too wide, else by springs (Kamada and
Kawai), then improved step by step. Everything is deterministic.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy
from numpy.typing import NDArray

Point = tuple[float, float]
Size = tuple[float, float]
Floats = NDArray[numpy.float64]

GAP = 34.0  # between cards
STEPS = 40  # rounds of tries
WORK = 1600  # of them times nodes
SEEDS = 2  # attempts while lines cross that need not
TOUCHING, OVER, CROSSING = 120.0, 150.0, 300.0  # what each costs, of cards and lines
WIDER = 1.6  # than it will be is the picture without crossings that improvement begins with
LARGE = 80  # nodes, beyond which a picture is not improved
WIDEST = 2000.0  # of a tidy tree
WIDTH = 1060.0  # of a picture: islands are put beside each other up to it


@dataclass(frozen=True)
class Placed:
    """The middles of the nodes, and the size of the picture around them."""

    at: Mapping[str, Point]
    width: float
    height: float


def place(sizes: Mapping[str, Size], edges: Sequence[tuple[str, str]], margin: float = 24.0) -> Placed:
    """Places for cards of these sizes in pixels, joined by these edges (both ends differ).

    The result does not depend on anything but the arguments.
    """
    islands = _islands(list(sizes), edges)
    at: dict[str, Point] = {}
    x = y = margin
    row, width = 0.0, 0.0
    for names in sorted(islands, key=len, reverse=True):
        own = set(names)
        places = _island({n: sizes[n] for n in names}, [e for e in edges if e[0] in own])
        w, h = _extent(places, sizes)
        if x > margin and x + w > WIDTH:
            x, y, row = margin, y + row + GAP, 0.0
        at |= {name: (px + x, py + y) for name, (px, py) in places.items()}
        row, width, x = max(row, h), max(width, x + w), x + w + GAP
    return Placed(at, width + margin, y + row + margin)


def _islands(names: Sequence[str], edges: Sequence[tuple[str, str]]) -> list[list[str]]:
    import networkx

    order = {name: k for k, name in enumerate(names)}  # numbers: the hashes of texts change from run to run
    graph: Any = networkx.Graph()
    graph.add_nodes_from(range(len(names)))
    graph.add_edges_from((order[a], order[b]) for a, b in edges)
    return [[names[k] for k in part] for part in sorted(map(sorted, networkx.connected_components(graph)))]


def _extent(places: dict[str, Point], sizes: Mapping[str, Size]) -> Size:
    """Moves places so that their cards begin at (0, 0); the size of all of them."""
    left = min(x - sizes[n][0] / 2 for n, (x, _) in places.items())
    top = min(y - sizes[n][1] / 2 for n, (_, y) in places.items())
    for name, (x, y) in places.items():
        places[name] = x - left, y - top
    return (
        max(x + sizes[n][0] / 2 for n, (x, _) in places.items()),
        max(y + sizes[n][1] / 2 for n, (_, y) in places.items()),
    )


def _island(sizes: Mapping[str, Size], edges: Sequence[tuple[str, str]]) -> dict[str, Point]:
    names = list(sizes)
    if len(names) == 1:
        return {names[0]: (0.0, 0.0)}
    pairs = list(dict.fromkeys((min(e), max(e)) for e in edges))
    if len(pairs) == len(names) - 1:
        found = _tree(sizes, pairs)
        if _extent(found, sizes)[0] > WIDTH:
            found = _tree(sizes, pairs, both_ways=True)
        if _extent(found, sizes)[0] <= WIDEST:
            return found
    starts = _springs(sizes, pairs)
    if len(names) > LARGE:
        return starts[0]
    tries = [(seed, start) for seed in range(SEEDS) for start in starts] if len(starts) > 1 else [(0, starts[0])]
    best: tuple[float, dict[str, Point]] | None = None
    for seed, start in tries:
        crossings, found = _improved(start, sizes, pairs, seed)
        if best is None or crossings < best[0]:
            best = crossings, found
        if not best[0]:
            break
    return _laid_flat(best[1] if best else starts[0], sizes, pairs)


def _laid_flat(
    found: dict[str, Point], sizes: Mapping[str, Size], pairs: Sequence[tuple[str, str]]
) -> dict[str, Point]:
    """The same turned, if it is higher than wide and nothing touches then that did not before."""
    width, height = _extent(found, sizes)
    turned = {name: (y * 1.08, x) for name, (x, y) in found.items()}
    if height > width and _Crowd(turned, sizes, pairs).crossings() <= _Crowd(found, sizes, pairs).crossings():
        return turned
    return found


# --- radial networks --------------------------------------------------------------------------------------------------


def _tree(sizes: Mapping[str, Size], pairs: Sequence[tuple[str, str]], both_ways: bool = False) -> dict[str, Point]:
    """From one end of a longest path to the right, or from its middle to both sides.

    Leaves stand one below the other, and every node amid its children.
    """
    near: dict[str, list[str]] = {name: [] for name in sizes}
    for a, b in pairs:
        near[a].append(b)
        near[b].append(a)
    root = _walk(near, next(iter(sizes)))[0][-1]
    order, parent = _walk(near, root)
    if both_ways:
        path = [order[-1]]
        while (above := parent[path[-1]]) is not None:
            path.append(above)
        root = path[len(path) // 2]
        order, parent = _walk(near, root)
    depth: dict[str, int] = {}
    children: dict[str, list[str]] = {name: [] for name in sizes}
    for name in order:
        above = parent[name]
        depth[name] = 0 if above is None else depth[above] + 1
        if above is not None:
            children[above].append(name)
    column = [max(sizes[n][0] for n in sizes if depth[n] == k) for k in range(max(depth.values()) + 1)]
    x = [0.0]
    for before, after in pairwise(column):
        x.append(x[-1] + (before + after) / 2 + GAP * 1.4)
    leaves: dict[str, int] = {}
    for name in reversed(order):
        leaves[name] = sum(leaves[child] for child in children[name]) or 1
    sides: dict[int, list[str]] = {1: [], -1: []}
    for child in sorted(children[root], key=lambda c: -leaves[c]) if both_ways else children[root]:
        fuller = sum(leaves[c] for c in sides[1]) > sum(leaves[c] for c in sides[-1])
        sides[-1 if both_ways and fuller else 1].append(child)
    places: dict[str, Point] = {}
    for side, branches in sides.items():
        _hang(branches, children, sizes, {n: side * x[depth[n]] for n in sizes}, places)
    heights = [places[child][1] for child in sides[1]]
    places[root] = 0.0, (heights[0] + heights[-1]) / 2
    if sides[-1]:  # the two sides begin at the same height
        other = [places[child][1] for child in sides[-1]]
        shift = places[root][1] - (other[0] + other[-1]) / 2
        for name, (at, y) in places.items():
            if at < 0:
                places[name] = at, y + shift
    return places


def _walk(near: Mapping[str, list[str]], root: str) -> tuple[list[str], dict[str, str | None]]:
    """Breadth first: the nodes in order, the last one farthest, and the parent of each."""
    order, parent = [root], dict[str, str | None]({root: None})
    for name in order:
        for other in near[name]:
            if other not in parent:
                parent[other] = name
                order.append(other)
    return order, parent


def _hang(
    roots: Sequence[str],
    children: Mapping[str, list[str]],
    sizes: Mapping[str, Size],
    x: Mapping[str, float],
    places: dict[str, Point],
) -> None:
    """Depth first, without recursion, because a feeder may be long."""
    free = 0.0
    stack = [(name, False) for name in reversed(roots)]
    while stack:
        name, done = stack.pop()
        if not children[name]:
            places[name] = x[name], free + sizes[name][1] / 2
            free += sizes[name][1] + GAP * 0.7
        elif done:
            middles = [places[child][1] for child in children[name]]
            places[name] = x[name], (middles[0] + middles[-1]) / 2
        else:
            stack += [(name, True), *((child, False) for child in reversed(children[name]))]


# --- meshed networks --------------------------------------------------------------------------------------------------


def _springs(sizes: Mapping[str, Size], pairs: Sequence[tuple[str, str]]) -> list[dict[str, Point]]:
    """Places in which distances are as the ways through the network.

    If the lines need not cross, one that begins so, and one without distances, come first.
    """
    import networkx

    names = list(sizes)
    order = {name: k for k, name in enumerate(names)}
    graph: Any = networkx.Graph()
    graph.add_nodes_from(range(len(names)))
    graph.add_edges_from((order[a], order[b]) for a, b in pairs)
    # long ways count less than in proportion, so that a long feeder bends instead of running out of the picture
    apart = networkx.all_pairs_shortest_path_length(graph)
    ways = {a: {b: float(d) ** 0.85 for b, d in row.items()} for a, row in apart}
    typical = sum(math.hypot(*size) for size in sizes.values()) / len(sizes)
    raws: list[Any] = [networkx.kamada_kawai_layout(graph, dist=ways)]
    if len(sizes) <= LARGE and networkx.check_planarity(graph)[0]:
        drawn = networkx.planar_layout(graph)
        raws = [drawn, networkx.kamada_kawai_layout(graph, dist=ways, pos=drawn), *raws]
    lengths = [(typical + GAP * 2) * (WIDER if k == 0 < len(raws) - 1 else 1) for k in range(len(raws))]
    return [_scaled({names[k]: p for k, p in raw.items()}, pairs, x) for raw, x in zip(raws, lengths, strict=True)]


def _scaled(raw: Mapping[str, Any], pairs: Sequence[tuple[str, str]], length: float) -> dict[str, Point]:
    """In pixels, lines of this length on average; the longer side lies flat, as a page has it."""
    spans = [max(float(p[k]) for p in raw.values()) - min(float(p[k]) for p in raw.values()) for k in (0, 1)]
    x, y = (1, 0) if spans[1] > spans[0] else (0, 1)
    scale = length / max(sum(math.dist(raw[a], raw[b]) for a, b in pairs) / len(pairs), 1e-9)
    return {n: (round(float(p[x]) * scale * 1.12, 1), round(float(p[y]) * scale * 0.88, 1)) for n, p in raw.items()}


def _improved(
    places: dict[str, Point], sizes: Mapping[str, Size], pairs: Sequence[tuple[str, str]], seed: int
) -> tuple[float, dict[str, Point]]:
    """Moves nodes one by one where fewer lines cross each other or run over nodes, and lengths stay alike.

    Returns the number of crossings, lines over nodes among them, too.
    """
    crowd = _Crowd(places, sizes, pairs)
    rng = random.Random(seed)
    steps = max(4, min(STEPS, WORK // len(places)))
    for step in range(steps):
        reach = crowd.length * 1.6 * (1 - step / steps)
        for k in range(len(places)):
            least = crowd.cost(k, crowd.at[k])
            for _ in range(2):
                angle, far = rng.random() * math.tau, rng.random() * reach
                moved = crowd.at[k] + numpy.round([far * math.cos(angle), far * math.sin(angle)], 1)
                cost = crowd.cost(k, moved)
                if cost < least - 1e-9:
                    least, crowd.at[k] = cost, moved
    found = {name: (float(x), float(y)) for name, (x, y) in zip(places, crowd.at, strict=True)}
    return crowd.crossings(), found


class _Crowd:
    """Cards and lines in a picture, and what it costs that one stands where it does. `at`: (n, 2) in pixels."""

    def __init__(
        self, places: Mapping[str, Point], sizes: Mapping[str, Size], pairs: Sequence[tuple[str, str]]
    ) -> None:
        index = {name: k for k, name in enumerate(places)}
        self.at = numpy.array(list(places.values()), dtype=float)
        self.half = numpy.array([sizes[name] for name in places]) / 2
        self.pairs = numpy.array([(index[a], index[b]) for a, b in pairs])
        self.ends = [numpy.unique(self.pairs[(self.pairs == k).any(axis=1)]) for k in range(len(places))]
        self.ends = [near[near != k] for k, near in enumerate(self.ends)]
        self.length = float(numpy.hypot(*(2 * self.half).T).mean()) + GAP * 1.6

    def cost(self, k: int, at: Floats) -> float:
        others = numpy.arange(len(self.at)) != k
        apart = numpy.abs(self.at[others] - at) - self.half[others] - self.half[k]
        far = numpy.maximum(numpy.hypot(*(self.at[others] - at).T), 1.0)
        touch = (apart < GAP * 0.6).all(axis=1)
        total = float(
            numpy.where(touch, TOUCHING + (GAP - apart.max(axis=1)) / GAP, 0.08 * (self.length / far) ** 2).sum()
        )
        near = self.ends[k]
        goals = self.at[near]
        total += float(((numpy.hypot(*(goals - at).T) / self.length - 1) ** 2).sum())
        over = _runs_over(at, goals[:, None], self.at[None], self.half[None])
        over[:, k] = False
        over[numpy.arange(len(near)), near] = False
        rest = self.pairs[(self.pairs != k).all(axis=1)]
        p, q = self.at[rest[:, 0]], self.at[rest[:, 1]]
        total += OVER * (int(over.sum()) + int(_runs_over(p, q, at, self.half[k]).sum()))
        apart_from = (rest[None] != near[:, None, None]).all(axis=2)
        return total + CROSSING * int((_cross(at, goals[:, None], p[None], q[None]) & apart_from).sum())

    def crossings(self) -> float:
        """Of lines with lines, and of lines with cards."""
        p, q = self.at[self.pairs[:, 0]], self.at[self.pairs[:, 1]]
        shared = (self.pairs[:, None, :, None] == self.pairs[None, :, None, :]).any(axis=(2, 3))
        over = _runs_over(p[:, None], q[:, None], self.at[None], self.half[None], 0.0)
        for column in self.pairs.T:
            over[numpy.arange(len(self.pairs)), column] = False
        return int((_cross(p[:, None], q[:, None], p[None], q[None]) & ~shared).sum()) / 2 + int(over.sum())


def _runs_over(p: Floats, q: Floats, middle: Floats, half: Floats, room: float = 7.0) -> Any:
    """Whether straight lines meet cards, with some room around them. Shapes (.., 2), broadcast; result (..)."""
    run = q - p
    run = numpy.where(numpy.abs(run) < 1e-9, 1e-9, run)
    ends = numpy.stack(((-half - room - (p - middle)) / run, (half + room - (p - middle)) / run))
    low, high = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    return numpy.maximum(low, 0.0) < numpy.minimum(high, 1.0)


def _cross(p: Floats, q: Floats, r: Floats, s: Floats) -> Any:
    """Whether straight lines without a common end cross. Shapes (.., 2), broadcast; result (..)."""

    def side(a: Floats, b: Floats, c: Floats) -> Floats:
        u, v = b - a, c - a
        found: Floats = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        return found

    return (side(p, q, r) * side(p, q, s) < 0) & (side(r, s, p) * side(r, s, q) < 0)


def lines_over_cards(
    placed: Placed, sizes: Mapping[str, Size], edges: Sequence[tuple[str, str]]
) -> list[tuple[tuple[str, str], str]]:
    """The lines that run over a card of a node that they do not end at."""
    found = []
    for a, b in edges:
        p, q = numpy.array(placed.at[a]), numpy.array(placed.at[b])
        for name, middle in placed.at.items():
            over = _runs_over(p, q, numpy.array(middle), numpy.array(sizes[name]) / 2, 0.0)
            if name not in (a, b) and bool(over):
                found.append(((a, b), name))
    return found
