"""Labels beside curves, moved apart where they would touch."""

from __future__ import annotations

from collections.abc import Sequence


def spread(heights: Sequence[float], gap: float) -> list[float]:
    """Heights at least `gap` apart, in the same order and each group that touches around its mean.

    >>> [round(x, 2) for x in spread([0.5, 0.1, 0.5], 0.1)]
    [0.45, 0.1, 0.55]
    """
    order = sorted(range(len(heights)), key=heights.__getitem__)
    groups: list[list[float]] = []  # of what each height would be if the gaps before it were taken away
    for rank, i in enumerate(order):
        groups.append([heights[i] - rank * gap])
        while len(groups) > 1 and _mean(groups[-2]) > _mean(groups[-1]):
            last = groups.pop()
            groups[-1] += last
    places = list(heights)
    for rank, (i, base) in enumerate(zip(order, (_mean(g) for g in groups for _ in g), strict=True)):
        places[i] = base + rank * gap
    return places


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
