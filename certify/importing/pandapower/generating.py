"""Where the DGUs of a network of pandapower are, and which of its rows they are."""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from typing import TYPE_CHECKING

from certify.importing.network import Note, Source
from certify.importing.pandapower.loads import rating
from certify.importing.pandapower.rows import Row
from certify.kernel.errors import Fault
from certify.kernel.quantity import shorten

if TYPE_CHECKING:
    from certify.importing.pandapower.read import _Reader

# What may become a DGU, by the words of --dgus-at.
SOURCES = {"generators": "gen", "storage": "storage", "static-generators": "sgen", "ext-grid": "ext_grid"}


def read_sources(net: _Reader) -> dict[str, Source]:
    """A DGU at each place that was asked for; rows of sources at its bus are that DGU."""
    rows = [
        row
        for table in SOURCES.values()
        if table not in net.placement.leave_out
        for row in net.tables.get(table, ())
        if net.flag(row, "in_service") and net.whole(row, "bus") in net.node
    ]
    at: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        at[net.node[net.whole(row, "bus")]].append(row)
    places = _named_places(net)
    for kind in net.placement.kinds:
        found = [net.node[net.whole(row, "bus")] for row in rows if row.table == SOURCES[kind]]
        if not found:
            net.faults.append(Fault("I007", "--dgus-at", f"no {kind} in service; {_choices(net, at)}"))
        places += found
    if not net.placement.kinds and not net.placement.buses:
        net.faults.append(Fault("I007", "", f"say with --dgu or --dgus-at where they are; {_choices(net, at)}"))
    return {node: _source(net, node, at[node]) for node in dict.fromkeys(places)}


def _named_places(net: _Reader) -> list[str]:
    places = []
    for text in net.placement.buses:
        index = int(text) if text.isascii() and text.isdecimal() else None
        named = [row.index for row in net.tables.get("bus", ()) if net.text(row, "name") == text]
        if index in net.node:
            places.append(net.node[index])
            others = [f"bus {k}" for k in named if k != index]
            if others:
                text_of = f"--dgu {text} is the index of this bus; it is the name of {', '.join(others[:3])}"
                net.notes.append(Note(f"bus {index}", text_of))
        elif len(named) == 1 and named[0] in net.node:
            places.append(net.node[named[0]])
        else:
            reason = "is out of service" if {index, *named} & net.out_of_service else "is not there"
            reason = "names several buses; give its index" if len(named) > 1 else reason
            net.faults.append(Fault("I007", "--dgu", f"bus {shorten(text)} {reason}"))
    return places


def _choices(net: _Reader, at: dict[str, list[Row]]) -> str:
    """What the network has that may be a DGU."""
    counts = []
    for kind, table in SOURCES.items():
        buses = sorted({net.whole(row, "bus") or 0 for rows in at.values() for row in rows if row.table == table})
        if buses:
            shown = ", ".join(map(str, buses[:8])) + (", .." if buses[8:] else "")
            counts.append(f"{kind} at buses {shown}")
    return f"the network has {'; '.join(counts)}" if counts else "the network has no sources; name buses with --dgu"


def _source(net: _Reader, node: str, rows: list[Row]) -> Source:
    rated = [rating(net, row) for row in rows]
    volts = {net.number(row, "vm_pu", "> 0"): row for row in rows if row.table in ("gen", "ext_grid")}
    if len(volts) > 1:
        row = list(volts.values())[-1]
        net.fault("I025", row, "vm_pu", "another voltage than that of another source at this bus")
    angles = [net.number(row, "va_degree", default=Fraction(0)) for row in rows if row.table == "ext_grid"]
    return Source(
        node,
        sum((x for x in rated if x), Fraction(0)) or None,
        next(iter(volts), Fraction(1)),
        angles[0] if angles else None,
        tuple(row.label for row in rows),
    )
