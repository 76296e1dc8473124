"""Pictures of loads: margins of monotonicity over the voltage; with the maps of `load_maps`.

A verdict is the caller's, and exact, if it is given; curves are computed in floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from certify.kernel.model import LoadLaw
from certify.kernel.reader import Pair
from certify.report.figures import COLOURS, DASHES, WORDS, range_text, save, shorten_name, style
from certify.report.load_maps import exponent_map, fraction_map
from certify.report.load_margins import load_margins
from certify.report.placing import spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from certify.report.load_margins import Floats

__all__ = ["exponent_map", "fraction_map", "margin_figure", "save"]

LABELLED = 8  # loads that are named at their curves
THIN = 300  # loads whose curves are still drawn one by one
STEPS = 160  # of the voltage; half of it for more than THIN loads
LEADER: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.7, "shrinkA": 1, "shrinkB": 0, "relpos": (0, 0.5)}


def margin_figure(
    laws: Sequence[tuple[str, LoadLaw, Fraction]],
    band: Pair,
    statuses: Sequence[str] | None = None,
    span: Pair = (Fraction(1, 2), Fraction(13, 10)),
    title: str | None = None,
) -> Figure:
    """Margin of monotonicity over the voltage, for any number of loads (name, law, V0 in volt).

    Units: `band` and `span` in per unit of each load's V0; margins as `load_margins` has them.
    `statuses`: the exact verdict of each load on the band, "proved", "refuted" or "unknown"; without it floats decide.
    More than 8 loads: thin curves under quantiles, and the share of loads that are monotone from v to the band's top.
    Raises: ValueError if the numbers of loads and statuses differ, there is no load, or a range is not one.
    """
    import numpy
    from matplotlib.figure import Figure

    if not laws or (statuses is not None and len(statuses) != len(laws)):
        raise ValueError(f"need at least one load and a status for each, got {len(laws)} loads")
    if not (0 < band[0] < band[1] and 0 < span[0] < span[1]):
        raise ValueError("a range of voltages must be positive, the lower end first")
    span = (min(span[0], band[0]), max(span[1], band[1]))
    low, high = map(float, band)
    steps = STEPS if len(laws) <= THIN else STEPS // 2
    v = numpy.union1d(numpy.linspace(float(span[0]), float(span[1]), steps + 1), [low, high])
    margins = load_margins([(law, V0) for _, law, V0 in laws], v)
    inside = (v >= low) & (v <= high)
    if statuses is None:
        statuses = ["refuted" if bad else "proved" for bad in numpy.asarray((margins[:, inside] < 0).any(axis=1))]
    many = len(laws) > LABELLED
    with style():
        figure = Figure(figsize=(8.4, 7.2 if many else 4.8), layout="constrained")
        axes = figure.subplots(1 + many, 1, sharex=True, squeeze=False, height_ratios=(3, 2)[: 1 + many])[:, 0]
        figure.suptitle(title or _summary(statuses, band))
        for ax in axes:
            ax.axvspan(low, high, color="#EFEFEF", zorder=0, label=f"band, {range_text(band)} pu")
            ax.grid(axis="y")
            ax.set_xlim(float(span[0]), float(span[1]))
        axes[0].axhline(0, color="black", linewidth=1.2, label="zero: below, not monotone")
        _set_view(axes[0], margins, inside)
        axes[0].set_ylabel("margin: smallest eigenvalue of\nthe Jacobian, in |S(V0)| / V0²")
        axes[-1].set_xlabel("voltage |V| / V0 (pu)")
        if len(laws) <= THIN:
            _draw_curves(axes[0], v, margins, statuses, many)
        if many:
            _draw_quantiles(axes[0], v, margins)
            _draw_shares(axes[1], v, margins, low, high)
        else:
            _name_curves(axes[0], v, margins, [name for name, _, _ in laws], statuses)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _draw_curves(ax: Axes, v: Floats, margins: Floats, statuses: Sequence[str], many: bool) -> None:
    seen: set[str] = set()
    width, alpha = (0.9, 0.9 if len(margins) <= 60 else 0.35) if many else (1.9, 1.0)
    for curve, status in zip(margins, statuses, strict=True):
        label = None if status in seen else f"{WORDS[status]} over the band"
        seen.add(status)
        style: Any = DASHES[status]
        ax.plot(v, curve, color=COLOURS[status], linestyle=style, linewidth=width, alpha=alpha, label=label)


def _draw_quantiles(ax: Axes, v: Floats, margins: Floats) -> None:
    import numpy

    q = numpy.quantile(numpy.ascontiguousarray(margins.T), (0.05, 0.25, 0.5, 0.75, 0.95), axis=1)
    shade: dict[str, Any] = {"color": "#009E73", "linewidth": 0}
    ax.fill_between(v, q[0], q[4], alpha=0.12, label="5 to 95 % of the loads", **shade)
    ax.fill_between(v, q[1], q[3], alpha=0.18, label="25 to 75 % of the loads", **shade)
    ax.plot(v, q[2], color="#00664B", linewidth=2.2, label="median")


def _draw_shares(ax: Axes, v: Floats, margins: Floats, low: float, high: float) -> None:
    """Share of loads without a negative margin from v up to the top of the band, over v."""
    import numpy

    below = v <= high
    worst = numpy.minimum.accumulate(margins[:, below][:, ::-1], axis=1)[:, ::-1]
    share = 100 * (worst >= 0).mean(axis=0)
    ax.plot(v[below], share, color=COLOURS["proved"], linewidth=2.2)
    at = float(share[v[below] == low][0])
    ax.plot([low], [at], "o", color=COLOURS["proved"])
    under = at > 50
    ax.annotate(
        f"{at:.3g} % over the whole band",
        (low, at),
        xytext=(-8, -8 if under else 8),
        textcoords="offset points",
        ha="right",
        va="top" if under else "bottom",
    )
    ax.set_ylim(-3, 103)
    ax.set_ylabel("share of loads monotone from v\nup to the top of the band (%)")


def _set_view(ax: Axes, margins: Floats, inside: Any) -> None:
    """Limits that show what happens in the band, and zero; outside, curves may leave the picture."""
    import numpy

    ends = (0.0, 1.0) if len(margins) <= LABELLED else (0.02, 0.98)
    lowest, highest = (float(numpy.quantile(x, q)) for q in ends for x in [margins[:, inside]])
    room = 0.6 * max(highest - lowest, 0.5)
    bottom = min(0.0, lowest, max(lowest - room, float(margins.min())))
    top = max(0.0, highest, min(highest + room, float(margins.max())))
    if top - bottom > 8:
        ax.set_yscale("symlog", linthresh=1)
        ax.set_ylim(bottom * 1.3 - 0.1, top * 1.3 + 0.1)
        ax.yaxis.set_major_formatter(lambda y, _: f"{y:g}")
    else:
        pad = 0.04 * max(top - bottom, 0.1)
        ax.set_ylim(bottom - pad, top + pad)


def _name_curves(ax: Axes, v: Floats, margins: Floats, names: Sequence[str], statuses: Sequence[str]) -> None:
    """Names at the right ends of the curves, moved apart where they would touch."""
    to_axes = ax.transScale + ax.transLimits
    ends = [min(max(float(to_axes.transform((v[-1], curve[-1]))[1]), 0.0), 1.0) for curve in margins]
    places = spread(ends, 0.055)
    for i, name in enumerate(names):
        ax.annotate(
            shorten_name(name),
            (1.0, ends[i]),
            xycoords="axes fraction",
            xytext=(1.035, places[i]),
            textcoords="axes fraction",
            va="center",
            fontsize=9,
            color=COLOURS[statuses[i]],
            parse_math=False,
            arrowprops={**LEADER, "color": COLOURS[statuses[i]]},
        )


def _summary(statuses: Sequence[str], band: Pair) -> str:
    """The counts, as the title of a figure."""
    passed, unknown = (sum(status == kind for status in statuses) for kind in ("proved", "unknown"))
    text = f"{passed:,} of {len(statuses):,} loads are monotone over {range_text(band)} pu"
    return text + (f", {unknown:,} undecided" if unknown else "")
