"""Maps of exponential and ZIP loads: which exponents or fractions are monotone on a band, for given power factors.

The verdicts that colour a map are the caller's, and exact; the border drawn over them is computed in floats.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from certify.kernel.reader import Pair
from certify.report.figures import COLOURS, FILLS, WORDS, range_text, style
from certify.report.load_margins import smallest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from certify.report.load_margins import Floats

# (np, nq, (Q0/P0)^2) or (Zp, Pp, (Q0/P0)^2), all exact -> "proved", "refuted" or "unknown". The square is rational
# for every rational power factor, and only the square enters the conditions.
Decide = Callable[[Fraction, Fraction, Fraction], str]


class Point(NamedTuple):
    """A load in a map, in the panel of the nearest power factor (None: in all), in the colour of its own verdict."""

    x: Fraction
    y: Fraction
    power_factor: Fraction | None = None
    verdict: str | None = None


FINE = 201  # points along an axis where a border is computed


def exponent_map(
    power_factors: Sequence[Fraction],
    band: Pair,
    decide: Decide,
    points: Sequence[tuple[Any, ...]] = (),
    cells: int = 61,
    span: tuple[Pair, Pair] = ((Fraction(0), Fraction(3)), (Fraction(0), Fraction(6))),
) -> Figure:
    """Which exponents (np, nq) are monotone on the band, one panel for each power factor, in cells x cells points.

    Units: `band` in per unit of V0. `decide(np, nq, (Q0/P0)^2)` colours each point; the border in closed form is drawn
    over it. `points`: loads (np, nq, power factor or None), drawn into the panel of the nearest power factor.
    Raises: ValueError for a power factor that is not in (0, 1], or none.
    """

    def border(ax: Axes, square: Fraction) -> None:
        for np_, nq in exponent_border(square, band, span[1]):
            ax.plot(np_, nq, color="black", linewidth=1.6)

    return _map(
        power_factors,
        decide,
        points,
        cells,
        span,
        border,
        title=f"Exponential loads P0 (V/V0)^np, Q0 (V/V0)^nq: monotone over {range_text(band)} pu?",
        labels=("exponent np of the active power (no unit)", "exponent nq of the reactive power (no unit)"),
    )


def exponent_border(square: Fraction, band: Pair, span: Pair) -> list[tuple[Floats, Floats]]:
    """The border of the monotone exponents for nq in `span`, as curves (np, nq); np is inf where there is no upper end.

    Monotone iff 4 (np - 1) v^(2 np) >= t^2 (nq - 2)^2 v^(2 nq) at both ends of the band, t = Q0/P0. With x = np - 1 and
    a = 2 ln v this is x exp(a x) >= c, c = t^2 (nq - 2)^2 v^(2 nq - 2) / 4: x >= W(a c) / a, the principal branch of
    Lambert's function, and, if v < 1, also x <= W(a c) / a with the lower branch.
    """
    import numpy
    from scipy.special import lambertw

    nq = numpy.union1d(numpy.linspace(float(span[0]), float(span[1]), 8 * FINE), [2.0])
    lower, upper = numpy.zeros_like(nq), numpy.full_like(nq, numpy.inf)
    for v in map(float, band):
        a, c = 2 * numpy.log(v), float(square) * (nq - 2) ** 2 * v ** (2 * nq - 2) / 4
        if a == 0:
            lower = numpy.maximum(lower, c)
            continue
        first, second = (lambertw(a * c, branch).real / a for branch in (0, -1))
        lower = numpy.maximum(lower, numpy.where(a * c >= -numpy.exp(-1), first, numpy.inf))
        if a < 0:
            upper = numpy.minimum(upper, numpy.where(c > 0, second, numpy.inf))
    curves = []
    for run in numpy.split(numpy.arange(len(nq)), numpy.flatnonzero(numpy.diff(lower <= upper)) + 1):
        if lower[run[0]] <= upper[run[0]]:  # along its upper ends and back along its lower ones; tips are closed
            back, last = run[::-1], run[-1:] if run[-1] < len(nq) - 1 else run[:0]
            gap = [] if run[0] > 0 else [numpy.nan]
            np_ = numpy.concatenate((upper[back], gap, lower[run], upper[last]))
            curves.append((1 + np_, numpy.concatenate((nq[back], gap, nq[run], nq[last]))))
    return curves


def fraction_map(
    power_factors: Sequence[Fraction],
    band: Pair,
    decide: Decide,
    points: Sequence[tuple[Any, ...]] = (),
    cells: int = 61,
    span: tuple[Pair, Pair] = ((Fraction(-1, 2), Fraction(3, 2)), (Fraction(-1, 2), Fraction(3, 2))),
) -> Figure:
    """Which ZIP fractions (Zp, Pp), Ip = 1 - Zp - Pp, the same for Q, are monotone on the band; one panel each.

    Units: `band` in per unit of V0. `decide(Zp, Pp, (Q0/P0)^2)` colours each point; the border is drawn over it from
    floats. The triangle is where no fraction is negative. `points`: loads (Zp, Pp, power factor or None).
    Raises: ValueError for a power factor that is not in (0, 1], or none.
    """
    import numpy

    v = numpy.linspace(float(band[0]), float(band[1]), 33)[:, None, None]

    def border(ax: Axes, square: Fraction) -> None:
        x, y = (numpy.linspace(float(a), float(b), FINE) for a, b in span)
        Z, P = x[None, None, :], y[None, :, None]
        current = (1 - Z - P) / v
        least = smallest(Z + current + P / v**2, Z - P / v**2, float(square) ** 0.5 * (current + 2 * P / v**2))
        drawn = ax.contour(x, y, least.min(axis=0), levels=[0.0], colors="black", linewidths=1.6)
        drawn.set_capstyle("butt")  # else the ends are as another package that draws may have left them
        ax.plot([0, 1, 0, 0], [0, 0, 1, 0], color="black", linewidth=1, linestyle=(0, (4, 2)))
        for corner, text, ha in (
            ((1, 0), "only impedance", "left"),
            ((0, 1), "only power", "center"),
            ((0, 0), "only current", "right"),
        ):
            up = -9 if corner[0] else 9
            where: dict[str, Any] = {"textcoords": "offset points", "ha": ha, "va": "center", "fontsize": 8.5}
            ax.annotate(text, corner, xytext=({"left": -30, "right": -6}.get(ha, 0), up), **where)

    return _map(
        power_factors,
        decide,
        points,
        cells,
        span,
        border,
        title=f"ZIP loads, the same fractions for P and Q: monotone over {range_text(band)} pu?",
        labels=("share Zp of constant impedance (no unit)", "share Pp of constant power (no unit)"),
        dashed="inside, no share is negative",
    )


def _map(
    power_factors: Sequence[Fraction],
    decide: Decide,
    points: Sequence[tuple[Any, ...]],
    cells: int,
    span: tuple[Pair, Pair],
    border: Callable[[Any, Fraction], None],
    title: str,
    labels: tuple[str, str],
    dashed: str | None = None,
) -> Figure:
    """One panel for each power factor: the cells by their verdicts, the border, the loads, and a common legend."""
    import numpy
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if not power_factors or not all(0 < pf <= 1 for pf in power_factors) or cells < 2:
        raise ValueError("need at least one power factor, each above 0 and at most 1, and 2 cells or more")
    names, marked = list(WORDS), [Point(*point) for point in points]
    x, y = ([a + (b - a) * Fraction(k, cells - 1) for k in range(cells)] for a, b in span)
    half = [float(b - a) / (cells - 1) / 2 for a, b in span]
    (left, right), (bottom, top) = ((float(a) - h, float(b) + h) for (a, b), h in zip(span, half, strict=True))
    columns = min(len(power_factors), 3)
    rows = -(-len(power_factors) // columns)
    used: set[str] = set()
    with style():
        figure = Figure(figsize=(max(3.5 * columns, 6.4) + 0.7, 3.5 * rows + 1.5), layout="constrained")
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        figure.suptitle(title)
        for ax, pf in zip(grid.flat, power_factors, strict=False):
            square = 1 / pf**2 - 1
            codes = [[names.index(decide(a, b, square)) for a in x] for b in y]
            used |= {names[code] for row in codes for code in row}
            ax.imshow(
                numpy.array(codes),
                cmap=ListedColormap([FILLS[name] for name in names]),
                vmin=0,
                vmax=len(names) - 1,
                origin="lower",
                extent=(left, right, bottom, top),
                aspect="auto",
                interpolation="nearest",
            )
            border(ax, square)
            near = (p for p in marked if p.power_factor is None or _nearest(p.power_factor, power_factors) == pf)
            _scatter(ax, [p._replace(power_factor=None) for p in near], span)
            ax.set_xlim(left, right)
            ax.set_ylim(bottom, top)
            ax.set_title(f"power factor {float(pf):.4g}")
        for k, ax in enumerate(grid.flat):
            ax.set_visible(k < len(power_factors))
            if k + columns >= len(power_factors):  # the last one of its column
                ax.tick_params(labelbottom=True)
                ax.set_xlabel(labels[0])
            if k % columns == 0:
                ax.set_ylabel(labels[1])
        handles: list[Any] = [
            Patch(facecolor=FILLS[n], edgecolor="#808080", label=WORDS[n]) for n in names if n in used
        ]
        handles.append(Line2D([], [], color="black", linewidth=1.6, label="border"))
        if dashed:
            handles.append(Line2D([], [], color="black", linewidth=1, linestyle=(0, (4, 2)), label=dashed))
        if marked:
            each = "" if all(p.power_factor is None for p in marked) else ", in the panel of the nearest power factor"
            handles.append(Line2D([], [], **_MARK, label=f"{len(marked):,} loads{each}"))
            for verdict in sorted({p.verdict for p in marked if p.verdict}):
                face = {"markerfacecolor": COLOURS[verdict]}
                handles.append(Line2D([], [], **_MARK | face, label=f"of which by its own data {WORDS[verdict]}"))
        figure.legend(handles=handles, loc="outside lower center", ncols=4 if columns == 3 else 2)
    return figure


_MARK: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 3.6,
    "markerfacecolor": "white",
    "markeredgecolor": "black",
    "markeredgewidth": 0.6,
}


def _scatter(ax: Axes, points: Sequence[Point], span: tuple[Pair, Pair]) -> None:
    """The loads, equal ones once; those outside of the map are counted in its corner."""
    shown = {p for p in points if all(a <= c <= b for c, (a, b) in zip((p.x, p.y), span, strict=True))}
    for verdict in sorted({p.verdict or "" for p in shown}):
        places = sorted((p.x, p.y) for p in shown if (p.verdict or "") == verdict)
        face = {"markerfacecolor": COLOURS.get(verdict, "white")}
        ax.plot([float(a) for a, _ in places], [float(b) for _, b in places], **_MARK | face)
    outside = sum(p not in shown for p in points)
    if outside:
        where: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "va": "top", "fontsize": 9}
        ax.annotate(f"{outside:,} outside of the map", (0.98, 0.98), **where)


def _nearest(pf: Fraction, power_factors: Sequence[Fraction]) -> Fraction:
    return min(power_factors, key=lambda other: (abs(other - abs(pf)), other))
