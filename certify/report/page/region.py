"""The region of attraction: its level, what sets it, and what it means for the voltage of each node."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from certify.kernel.claims import Claim
from certify.kernel.spec import Node
from certify.report.figures import shorten_name
from certify.report.page.charts import round_ticks, tick_text
from certify.report.page.subject import Subject
from certify.report.page.svg import Child, element, picture
from certify.rests import Region, Rest

SHOWN_ISLANDS = 8
SHOWN_NODES = 40
ROW = 25.0


@dataclass(frozen=True)
class IslandRegion:
    """The region of one island, None if none is proved; the picture has the nodes nearest to their limits."""

    first: str
    nodes: int
    claim: Claim
    region: Region | None
    why: str
    lines: tuple[tuple[str, float], ...]
    picture: Markup | None
    left_out: int


def draw_regions(subject: Subject) -> tuple[tuple[IslandRegion, ...], int]:
    """The islands with their regions, and how many are left out."""
    found = []
    for island in subject.context.islands[:SHOWN_ISLANDS]:
        first = island[0]
        claim, region = subject.claims[f"region/{first}"], subject.regions.get(first)
        rest = subject.rests.get(first)
        image, left_out = None, 0
        if region is not None and rest is not None and region.level is not None:
            nodes = sorted((n for n in island if n in region.nodes), key=lambda n: _room(subject, n, region, rest))
            left_out = max(0, len(nodes) - SHOWN_NODES)
            shown = [n for n in island if n in set(nodes[:SHOWN_NODES])]
            image = _bars(subject, shown, region, rest)
        lines = sorted(region.lines.items(), key=lambda entry: entry[1])[:3] if region else []
        found.append(
            IslandRegion(first, len(island), claim, region, _why(subject, claim, region), tuple(lines), image, left_out)
        )
    return tuple(found), max(0, len(subject.context.islands) - SHOWN_ISLANDS)


def _why(subject: Subject, claim: Claim, region: Region | None) -> str:
    if region is None:
        from certify.diagnostics import DIAGNOSTICS

        note = subject.notes.get(claim.id, "P216")
        return DIAGNOSTICS[note].why
    if region.level is None:
        return "No load's band and no inverter's limit bounds H: the motion returns from everywhere."
    if region.limit.startswith("the terminal"):
        return f"What sets c is {region.limit}: {region.margin:.6g} V are left there up to the limit of the inverter."
    return (
        f"What sets c is {region.limit}: its load voltage is {region.margin:.6g} V away from the end of its band, and "
        "nowhere else does less energy carry a voltage to where a claim ends."
    )


def _band(subject: Subject, name: str) -> tuple[float, float] | None:
    """The moduli between which the claim about the loads at a node is made."""
    node: Node = subject.context.nodes[name]
    return (float(node.band_volt[0]), float(node.band_volt[1])) if node.band_volt else None


def _room(subject: Subject, name: str, region: Region, rest: Rest) -> float:
    """What is left of the way to the end of the band when a node is as far off as the region allows; small first."""
    band, V = _band(subject, name), abs(rest.voltages.get(name, 0j))
    if band is None:
        return float("inf")
    return min(V - band[0], band[1] - V) - region.nodes[name]


def _bars(subject: Subject, names: list[str], region: Region, rest: Rest) -> Markup:
    """For each node its band as a track, the proved reach around where it rests as a bar, all in one scale."""
    left, right, width, top = 92.0, 112.0, 760.0, 26.0
    sizes = {n: abs(rest.voltages[n]) for n in names}
    lows = [max(0.0, sizes[n] - region.nodes[n]) for n in names]
    highs = [sizes[n] + region.nodes[n] for n in names]
    for name in names:
        band = _band(subject, name)
        if band:
            lows.append(band[0])
            highs.append(band[1])
    low, high = min(lows), max(highs)
    room = (high - low) * 0.03 or 1.0
    low, high = max(0.0, low - room), high + room
    kilo = 1e3 if high >= 2e3 else 1.0

    def px(v: float) -> float:
        return left + (min(max(v, low), high) - low) / (high - low) * (width - left - right)

    height = top + ROW * len(names) + 44
    bottom = top + ROW * len(names)
    parts: list[Child] = []
    for tick in round_ticks(low / kilo, high / kilo, 7):
        at = px(tick * kilo)
        parts.append(element("line", x1=at, x2=at, y1=top - 4, y2=bottom, class_="grid"))
        parts.append(element("text", tick_text(tick), x=at, y=bottom + 16, class_="tick middle"))
    title = f"|V| ({'kV' if kilo > 1 else 'V'})"
    parts.append(element("text", title, x=(left + width - right) / 2, y=height - 6, class_="title middle"))
    parts.append(element("text", "may be off by", x=width - 4, y=top - 10, class_="note end"))
    parts.append(element("text", "node", x=left - 12, y=top - 10, class_="note end"))
    for k, name in enumerate(names):
        y = top + ROW * k + ROW / 2
        band, V, reach = _band(subject, name), sizes[name], region.nodes[name]
        limiting = region.limit == f"node {name}"
        if band:
            a, b = px(band[0]), px(band[1])
            parts.append(
                element(
                    "rect",
                    element("title", f"band of the load at node {name}: {band[0]:g} V to {band[1]:g} V"),
                    x=a,
                    y=y - 8,
                    width=b - a,
                    height=16,
                    class_="track",
                )
            )
        a, b = px(V - reach), px(V + reach)
        parts.append(
            element(
                "rect",
                element("title", f"node {name} may be off by {reach:.6g} V, all else at rest"),
                x=a,
                y=y - 4.5,
                width=max(b - a, 1.5),
                height=9,
                class_=f"reach{' limiting' if limiting else ''}",
            )
        )
        parts.append(element("line", x1=px(V), x2=px(V), y1=y - 10, y2=y + 10, class_="rest"))
        parts.append(
            element(
                "text", shorten_name(name)[:12], x=left - 12, y=y + 4, class_=f"note end{' strong' if limiting else ''}"
            )
        )
        told = f"{f'{reach:,.0f}' if reach >= 1000 else f'{reach:.4g}'} V{' ← c' if limiting else ''}"
        parts.append(element("text", told, x=width - 4, y=y + 4, class_=f"note end{' strong' if limiting else ''}"))
    label = f"How far the voltage of each of {len(names)} nodes may be off, within its band"
    return picture(parts, width, height, label, "chart wide")
