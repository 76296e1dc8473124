"""Pictures of a simulation: voltages, errors against references, terminal voltages within limits, and storage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy

from certify.report.figures import shorten_name, style
from certify.settling import PhaseCourse
from certify.simulation import AXES, Course, Simulation
from certify.simulator.plant import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMED = 8  # curves that are drawn one by one, and named; of more their quantiles
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#595959", "#000000")
DASHES: tuple[Any, ...] = ("-", "-", "-", "-", "-", "-", (0, (5, 1.6)), (0, (1, 1.2)))
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
ZOOM = 5  # bands in each direction
LABELLED_EVENTS = 6  # more are lines without text
GLYPH = 0.0078  # width of a character of such text, as a share of the panel's
OFF = complex(numpy.nan, numpy.nan)
Storage = tuple[Array, Array, str]  # times in s, H in J, what is said of it


def draw_figures(
    course: Course,
    simulation: Simulation,
    phases: Sequence[PhaseCourse],
    title: str,
    storage: Storage | None = None,
) -> dict[str, Figure]:
    """The figures by name: "voltages", "errors"; "zoom" if any error comes near zero; "terminals" if there are limits;
    "storage" if H is given.

    Needs at least two samples. More than 8 DGUs: quantiles over all that are on, and the one that is farthest off.
    """
    names = [node.name for node in course.whole.nodes if node.dgu]
    elsewhere = {n.name: abs(simulation.phasor("voltage", n.name)) for n in course.whole.nodes if not n.dgu}
    V = {name: simulation.phasor("voltage", name) for name in names}
    references = _references(simulation.times, phases, names)
    errors = {name: V[name] - references[name] for name in names}
    idle = {}  # where a DGU is off, its node's voltage is not its own
    for name in names:
        off = numpy.isnan(references[name])
        if off.any() and numpy.isfinite(V[name][off]).any():
            idle[name] = numpy.where(off, V[name], OFF)
        V[name] = numpy.where(off, OFF, V[name])
    band = max((dgu.band_volt for entry in phases for dgu in entry.dgus), default=1.0)
    events = _events(phases)
    with style():
        figures = {
            "voltages": _voltages(simulation.times, V, idle, elsewhere, events, title),
            "errors": _errors(simulation.times, errors, band, events, title),
        }
        finals = [max(map(abs, dgu.final_volt)) for entry in phases for dgu in entry.dgus]
        if min(finals, default=0.0) <= ZOOM * band:  # else there is but noise to see
            figures["zoom"] = _zoom(simulation.times, errors, band, events, title)
        shares = terminal_shares(course, simulation)
        if shares:
            figures["terminals"] = _terminals(simulation.times, shares, events, title)
        if storage is not None:
            figures["storage"] = _storage(storage, events, title)
    return figures


def terminal_shares(course: Course, simulation: Simulation) -> dict[str, Array]:
    """Of each DGU with limits what its law asks for as a share of them, d and q: (t, 2); NaN where it is off."""
    shares: dict[str, Array] = {}
    times = simulation.times
    for phase in course.phases:
        rows = (times >= float(phase.start_second)) & (
            (times < float(phase.end_second)) | (phase.end_second == course.phases[-1].end_second)
        )
        plant = course.plant(phase)
        if not rows.any() or not numpy.isfinite(plant.limits).any():
            continue
        states = numpy.empty((int(rows.sum()), plant.size))
        for part, at in plant.slices.items():
            states[:, at] = simulation.states[rows][:, course.parts[part]]
        u = (plant.K @ states.T).T + plant.k
        for j, name in enumerate(plant.inverters):
            own = slice(2 * j, 2 * j + 2)
            if numpy.isfinite(plant.limits[own]).any():
                kept = shares.setdefault(name, numpy.full((len(times), 2), numpy.nan))
                kept[rows] = u[:, own] / plant.limits[own]
    return shares


def _references(times: Array, phases: Sequence[PhaseCourse], names: Sequence[str]) -> dict[str, Any]:
    """The reference of each DGU over time, NaN where it is off. Shape (t,)."""
    found = {name: numpy.full(len(times), complex(numpy.nan, numpy.nan)) for name in names}
    for entry in phases:
        rows = times >= float(entry.phase.start_second)
        on = {dgu.node: dgu.reference_volt for dgu in entry.dgus}
        for name in names:
            found[name][rows] = on.get(name, OFF)
    return found


def _events(phases: Sequence[PhaseCourse]) -> list[tuple[float, str]]:
    from certify.report.events import event_in_words

    found = []
    for entry in phases:
        if entry.phase.events:
            told = event_in_words(entry.phase.events[0]).split(":")[0]
            more = len(entry.phase.events) - 1
            found.append((float(entry.phase.start_second), shorten_name(told) + (f" and {more} more" if more else "")))
    return found


def _frame(rows: int, times: Array, events: Sequence[tuple[float, str]], title: str) -> tuple[Figure, list[Axes]]:
    """A figure with panels over time, one above the other, in which events are marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 1.6 + 2.5 * rows), layout="constrained")
    axes = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    figure.suptitle(title, parse_math=False)
    for ax in axes:
        ax.grid(axis="y")
        ax.set_xlim(float(times[0]), float(times[-1]))
        for at, _ in events:
            ax.axvline(at, color="#8C8C8C", linewidth=0.8, linestyle=(0, (4, 2)), zorder=0.5)
    for (at, text), (side, level) in zip(events, _label_places(times, events), strict=False):
        axes[0].annotate(
            text,
            (at, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2 * side, 2 + 9 * level),
            textcoords="offset points",
            ha="left" if side > 0 else "right",
            va="bottom",
            fontsize=7.5,
            color="#595959",
            parse_math=False,
        )
    axes[-1].set_xlabel("time (s)")
    return figure, axes


def _label_places(times: Array, events: Sequence[tuple[float, str]]) -> list[tuple[int, int]]:
    """On which side of its line, 1 or -1, and in which row the text of each event has room; none if there are many."""
    if len(events) > LABELLED_EVENTS:
        return []
    places: list[tuple[int, int]] = []
    ends: list[list[tuple[float, float]]] = []  # of the texts in each row, as shares of the width
    for at, text in events:
        width, x = GLYPH * len(text), (at - float(times[0])) / float(times[-1] - times[0])
        side = -1 if x + width > 1 else 1  # else the text would leave the picture
        left, right = sorted((x, x + side * width))
        level = next((k for k, row in enumerate(ends) if all(right < a or left > b for a, b in row)), len(ends))
        ends += [[]] * (level == len(ends))
        ends[level] = [*ends[level], (left, right)]
        places.append((side, level))
    return places


def _draw(ax: Axes, times: Array, curves: Mapping[str, Array], label: str) -> None:
    """Curves one by one, or quantiles of many and the one that is farthest from zero at the end."""
    if len(curves) <= NAMED:
        for k, (name, curve) in enumerate(curves.items()):
            told = f"{label} {shorten_name(name)}"
            ax.plot(times, curve, color=COLOURS[k], linestyle=DASHES[k], linewidth=1.3, label=told)
        return
    stacked = numpy.stack([*curves.values()])
    on = numpy.isfinite(stacked).any(axis=0)
    q = numpy.full((len(QUANTILES), len(times)), numpy.nan)
    q[:, on] = numpy.nanquantile(stacked[:, on], QUANTILES, axis=0)
    plural = f"{len(curves)} {label}s"
    shade: dict[str, Any] = {"color": "#0072B2", "linewidth": 0}
    ax.fill_between(times, q[0], q[-1], alpha=0.12, label=f"all {plural}", **shade)
    ax.fill_between(times, q[1], q[-2], alpha=0.20, label="5 to 95 % of them", **shade)
    ax.fill_between(times, q[2], q[-3], alpha=0.30, label="25 to 75 %", **shade)
    ax.plot(times, q[3], color="#004C78", linewidth=1.4, label="median")


def _draw_farthest(ax: Axes, times: Array, errors: Mapping[str, Any], axis: int) -> None:
    """If there are many, the DGU that is farthest off at the end."""
    if len(errors) > NAMED:
        last = {name: abs(e[-1]) for name, e in errors.items() if numpy.isfinite(e[-1])}
        if last:
            name = max(last, key=lambda x: last[x])
            label = f"farthest at the end: {shorten_name(name)}"
            ax.plot(times, (errors[name].real, errors[name].imag)[axis], color="#D55E00", linewidth=1.1, label=label)


def _finish(figure: Figure, axes: Sequence[Axes]) -> Figure:
    """One legend for all panels."""
    entries: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= {label: handle for label, handle in zip(labels, handles, strict=True) if label not in entries}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4, fontsize=9)
    return figure


def _voltages(
    times: Array,
    V: Mapping[str, Any],
    idle: Mapping[str, Any],
    others: Mapping[str, Array],
    events: Sequence[tuple[float, str]],
    title: str,
) -> Figure:
    figure, axes = _frame(2 + bool(others), times, events, f"Voltages: {title}")
    for k, axis in enumerate(AXES):
        _draw(axes[k], times, {name: (x.real, x.imag)[k] / 1e3 for name, x in V.items()}, "DGU")
        for j, name in enumerate(V if len(V) <= NAMED else ()):
            if name in idle:
                told = "while its DGU is off"
                y = (idle[name].real, idle[name].imag)[k] / 1e3
                axes[k].plot(times, y, color=COLOURS[j], linestyle=(0, (1, 1.2)), linewidth=1.1, label=told)
        axes[k].set_ylabel(f"V {axis} at DGUs (kV)")
    if others:
        stacked = numpy.stack([*others.values()]) / 1e3
        shade: dict[str, Any] = {"color": "#009E73", "linewidth": 0, "alpha": 0.25, "label": "nodes without DGU"}
        axes[2].fill_between(times, stacked.min(axis=0), stacked.max(axis=0), **shade)
        axes[2].plot(times, numpy.median(stacked, axis=0), color="#00664B", linewidth=1.2, label="their median")
        axes[2].set_ylabel("|V| elsewhere (kV)")
    return _finish(figure, axes)


def _errors(
    times: Array, errors: Mapping[str, Any], band: float, events: Sequence[tuple[float, str]], title: str
) -> Figure:
    """Linear within the band, by decades outside of it: what is exponential is straight, and keeps its sign."""
    figure, axes = _frame(2, times, events, f"Errors: {title}")
    largest = max((float(numpy.nanmax(abs(e))) for e in errors.values() if numpy.isfinite(e).any()), default=band)
    top = 1.5 * max(largest, 10 * band)
    decades = 10.0 ** numpy.arange(numpy.floor(numpy.log10(band)) + 1, numpy.log10(top))
    decades = decades[decades > 2.5 * band]
    decades = decades[:: max(1, round(len(decades) / 5))]
    for k, axis in enumerate(AXES):
        ax = axes[k]
        ax.axhspan(-band, band, color="#EFEFEF", zorder=0, label=f"band, ±{band:g} V")
        _draw(ax, times, {name: (e.real, e.imag)[k] for name, e in errors.items()}, "DGU")
        _draw_farthest(ax, times, errors, k)
        ax.set_yscale("symlog", linthresh=band, linscale=0.7)
        ax.set_ylim(-top, top)
        ax.set_yticks([*-decades[::-1], -band, 0.0, band, *decades])
        ax.set_yticks([], minor=True)
        ax.yaxis.set_major_formatter(lambda y, _: f"{y:g}")
        ax.set_ylabel(f"V {axis} - V* {axis} (V)")
    return _finish(figure, axes)


def _zoom(
    times: Array, errors: Mapping[str, Any], band: float, events: Sequence[tuple[float, str]], title: str
) -> Figure:
    figure, axes = _frame(2, times, events, f"Errors around zero: {title}")
    for k, axis in enumerate(AXES):
        ax = axes[k]
        ax.axhspan(-band, band, color="#EFEFEF", zorder=0, label=f"band, ±{band:g} V")
        _draw(ax, times, {name: (e.real, e.imag)[k] for name, e in errors.items()}, "DGU")
        _draw_farthest(ax, times, errors, k)
        ax.set_ylim(-ZOOM * band, ZOOM * band)
        ax.set_ylabel(f"V {axis} - V* {axis} (V)")
    return _finish(figure, axes)


def _terminals(times: Array, shares: Mapping[str, Array], events: Sequence[tuple[float, str]], title: str) -> Figure:
    """What laws ask for over what inverters can apply; beyond 100 % that is cut off."""
    figure, axes = _frame(2, times, events, f"Terminal voltages: {title}")
    for k, axis in enumerate(AXES):
        ax = axes[k]
        asked = {name: 100 * x[:, k] for name, x in shares.items()}
        known = numpy.concatenate([x[numpy.isfinite(x)] for x in asked.values()])
        for sign in (-1, 1):
            ax.axhline(sign * 100, color="black", linewidth=1.0, label="limits of the inverter" if sign > 0 else None)
        _draw(ax, times, asked, "DGU")
        ax.set_ylim(1.08 * min(known.min(initial=0.0), -110.0), 1.08 * max(known.max(initial=0.0), 110.0))
        ax.set_ylabel(f"u {axis} asked for (% of limit)")
    return _finish(figure, axes)


def _storage(storage: Storage, events: Sequence[tuple[float, str]], title: str) -> Figure:
    times, H, label = storage
    figure, (ax,) = _frame(1, times, events, f"Storage: {title}")
    figure.set_size_inches(8.4, 4.4)
    positive = H[numpy.isfinite(H) & (H > 0)]
    breaks = numpy.searchsorted(times, [at for at, _ in events])  # H jumps there, and does not grow towards it
    ax.plot(numpy.insert(times, breaks, numpy.nan), numpy.insert(H, breaks, numpy.nan), color=COLOURS[0], label=label)
    if len(positive):
        ax.set_yscale("log")
        low, high = float(positive.min()), float(positive.max())
        ax.set_ylim(max(low, high * 1e-24) / 2, high * 2)  # below that there is but rounding
    ax.set_ylabel("H (J)")
    return _finish(figure, [ax])
