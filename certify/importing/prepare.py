"""What of a network is kept on its island: parts with a DGU, without dead ends, each bus with a capacitance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

from certify.importing.network import NONE, Branch, Network, Note, Unmapped, ZipRow
from certify.importing.numbers import quantity
from certify.importing.settings import Settings
from certify.kernel.errors import Fault, SpecError


def prepare(network: Network, settings: Settings) -> Network:
    """The parts that a DGU feeds, with the capacitances that were stated. Raises: SpecError I020, I021, I022."""
    check(network)
    network = without_loops(energised(network))
    network = with_capacitances(network, settings)
    return network if settings.bus_capacitance else without_dead_ends(network)


def check(network: Network) -> None:
    """Every branch passive, every name known: what no later step looks at again. Raises: SpecError."""
    known = {bus.name for bus in network.buses}
    faults = []
    for branch in network.branches:
        where = _element(branch.origins, branch.name)
        if branch.inductance_henry <= 0:
            faults.append(Fault("I020", where, f"inductance {quantity(branch.inductance_henry, 'H')} is not positive"))
        if branch.resistance_ohm <= 0:
            faults.append(Fault("I020", where, f"resistance {quantity(branch.resistance_ohm, 'ohm')} is not positive"))
        if branch.capacitance_farad < 0 or branch.ratio <= 0:
            faults.append(Fault("I020", where, "a negative capacitance, or a ratio that is not positive"))
        faults += [Fault("I004", where, f"no bus {end}") for end in (branch.start, branch.end) if end not in known]
    for part in (*network.loads, *network.sources):
        if part.bus not in known:
            faults.append(Fault("I004", _element(part.origins, part.bus), f"no bus {part.bus}"))
    for bus in network.buses:
        if bus.nominal_volt <= 0 or bus.capacitance_farad < 0:
            faults.append(
                Fault("I003", _element(bus.origins, bus.name), "nominal voltage not positive, or negative capacitance")
            )
    if not network.sources:
        faults.append(Fault("I021", "", "no DGU: an island needs at least one inverter that forms it"))
    if faults:
        raise SpecError(tuple(faults))


def energised(network: Network) -> Network:
    """Without what no DGU is connected to."""
    beside: dict[str, list[str]] = defaultdict(list)
    for branch in network.branches:
        beside[branch.start].append(branch.end)
        beside[branch.end].append(branch.start)
    reached = {source.bus for source in network.sources}
    waiting = list(reached)
    while waiting:
        for other in beside[waiting.pop()]:
            if other not in reached:
                reached.add(other)
                waiting.append(other)
    lost = [
        *(bus.origins for bus in network.buses if bus.name not in reached),
        *(branch.origins for branch in network.branches if branch.start not in reached),
        *(load.origins for load in network.loads if load.bus not in reached),
    ]
    return replace(
        network,
        buses=tuple(bus for bus in network.buses if bus.name in reached),
        branches=tuple(branch for branch in network.branches if branch.start in reached),
        loads=tuple(load for load in network.loads if load.bus in reached),
        unmapped=(*network.unmapped, *_all(lost, "no DGU is connected to it")),
    )


def without_loops(network: Network) -> Network:
    """Branches with both ends at one bus carry nothing: their capacitances stay, at the bus, and what they draw."""
    loops = [b for b in network.branches if b.start == b.end and b.ratio == 1 and not b.shift_degree % 360]
    buses = {bus.name: bus for bus in network.buses}
    loads, unmapped = list(network.loads), list(network.unmapped)
    for loop in loops:
        bus = buses[loop.start]
        if loop.capacitance_farad:
            more = bus.capacitance_farad + loop.capacitance_farad
            bus = buses[bus.name] = replace(bus, capacitance_farad=more, origins=(*bus.origins, *loop.origins))
        if loop.shunt_siemens != NONE:
            g, b = (part * bus.nominal_volt**2 for part in loop.shunt_siemens)
            loads.append(ZipRow(bus.name, bus.nominal_volt, (g, b), origins=loop.origins))
        if not loop.capacitance_farad and loop.shunt_siemens == NONE:
            unmapped += _all([loop.origins], "both ends at one bus")
    return replace(
        network,
        buses=tuple(buses.values()),
        branches=tuple(branch for branch in network.branches if branch not in loops),
        loads=tuple(loads),
        unmapped=tuple(unmapped),
    )


def with_capacitances(network: Network, settings: Settings) -> Network:
    """Stated capacitances for lines without one, and then for buses that are left without."""
    notes = list(network.notes)
    branches, buses = network.branches, network.buses
    if settings.line_capacitance:
        per_metre = settings.line_capacitance
        bare = [b for b in branches if b.length_metre is not None and not b.capacitance_farad]
        if not bare:
            notes.append(Note("", "--line-capacitance has no effect: each line of some length has its own capacitance"))
        notes += [Note(_element(b.origins, b.name), f"capacitance stated: {quantity(per_metre, 'F/km')}") for b in bare]
        branches = tuple(
            replace(b, capacitance_farad=per_metre * b.length_metre)
            if b.length_metre is not None and not b.capacitance_farad
            else b
            for b in branches
        )
    network = replace(network, branches=branches)
    if settings.bus_capacitance:
        value, held = settings.bus_capacitance, capacitive(network)
        bare_buses = [bus for bus in buses if bus.name not in held]
        if not bare_buses:
            notes.append(Note("", "--bus-capacitance has no effect: no bus is left without a capacitance"))
        notes += [Note(_element(b.origins, b.name), f"capacitance stated: {quantity(value, 'F')}") for b in bare_buses]
        buses = tuple(bus if bus.name in held else replace(bus, capacitance_farad=value) for bus in buses)
    return replace(network, buses=buses, notes=tuple(notes))


def capacitive(network: Network) -> set[str]:
    """Buses whose voltage is a state: with a DGU, a capacitance of their own, or one from a branch."""
    held = {bus.name for bus in network.buses if bus.capacitance_farad} | {source.bus for source in network.sources}
    for branch in network.branches:
        if branch.capacitance_farad:
            held |= {branch.start, branch.end}
    return held


def without_dead_ends(network: Network) -> Network:
    """Without parts that have no load, DGU or capacitance and hang on one bus: nothing flows into them.

    A magnetising current of such a part goes with it.
    """
    needed = {load.bus for load in network.loads} | capacitive(network)
    ends = [(branch.start, branch.end) for branch in network.branches]
    gone: set[str] = set()
    while True:
        more = _hanging({bus.name for bus in network.buses} - gone, needed, ends)
        if not more:
            break
        gone |= more
    unmapped = _all((bus.origins for bus in network.buses if bus.name in gone), "a dead end: no load, DGU, capacitance")
    for branch in network.branches:
        if {branch.start, branch.end} & gone:
            extra = "; what it draws by itself is left out too" if branch.shunt_siemens != NONE else ""
            unmapped += _all([branch.origins], "leads to a dead end only" + extra)
    return replace(
        network,
        buses=tuple(bus for bus in network.buses if bus.name not in gone),
        branches=tuple(branch for branch in network.branches if not {branch.start, branch.end} & gone),
        unmapped=(*network.unmapped, *unmapped),
    )


def _hanging(names: set[str], needed: set[str], ends: Iterable[tuple[str, str]]) -> set[str]:
    """Groups of buses that are not needed with at most one neighbour outside, and single ones with one neighbour."""
    beside: dict[str, set[str]] = defaultdict(set)
    for start, end in ends:
        if start in names and end in names:
            beside[start].add(end)
            beside[end].add(start)
    result = {name for name in names - needed if len(beside[name]) <= 1}
    seen: set[str] = set()
    for name in names - needed:
        if name in seen:
            continue
        group, border, waiting = {name}, set[str](), [name]
        while waiting:
            for other in beside[waiting.pop()] - group:
                if other in needed:
                    border.add(other)
                else:
                    group.add(other)
                    waiting.append(other)
        seen |= group
        if len(border) <= 1:
            result |= group
    return result


def joined(network: Network) -> Network:
    """Junctions of just two branches, without load, DGU or capacitance, taken out: the branches are in series.

    For branches that are referred to one side already; exact, because both carry the same current.
    """
    branches = {branch.name: branch for branch in network.branches}
    buses = {bus.name: bus for bus in network.buses}
    held = {load.bus for load in network.loads} | capacitive(network)
    at: dict[str, list[str]] = defaultdict(list)
    for branch in network.branches:
        at[branch.start].append(branch.name)
        at[branch.end].append(branch.name)
    notes = []
    for name in list(buses):
        if name in held or len(at[name]) != 2 or any(branches[b].shunt_siemens != NONE for b in at[name]):
            continue
        first, second = (branches[b] for b in at[name])
        ends = [b.end if b.start == name else b.start for b in (first, second)]
        bus = buses.pop(name)
        del branches[first.name], branches[second.name]
        label = f"{first.name} + {second.name}"[:64].strip(" .:+-")
        while label in branches:
            label = label[:60] + "-2"
        origins = (*first.origins, *bus.origins, *second.origins)
        branches[label] = Branch(
            label,
            ends[0],
            ends[1],
            first.resistance_ohm + second.resistance_ohm,
            first.inductance_henry + second.inductance_henry,
            origins=origins,
        )
        for end, old in zip(ends, (first, second), strict=True):
            at[end][at[end].index(old.name)] = label
        notes.append(Note(_element(bus.origins, name), "a junction of two branches, which are now one in series"))
    return replace(
        network,
        buses=tuple(buses.values()),
        branches=tuple(branches.values()),
        notes=(*network.notes, *notes),
    )


def require_capacitances(network: Network) -> None:
    """Every bus has a voltage that is a state. Raises: SpecError I022 with the branches that have no capacitance."""
    held = capacitive(network)
    found: dict[str, list[str]] = {"--line-capacitance": [], "--bus-capacitance": []}
    beside: dict[str, list[str]] = {option: [] for option in found}
    at_bus: dict[str, list[Branch]] = defaultdict(list)
    for branch in network.branches:
        at_bus[branch.start].append(branch)
        at_bus[branch.end].append(branch)
    for bus in network.buses:
        if bus.name not in held:
            at = at_bus[bus.name]
            lines = [branch for branch in at if branch.length_metre is not None]
            option = "--line-capacitance" if lines else "--bus-capacitance"
            found[option].append(_element(bus.origins, bus.name))
            beside[option] += [_element(branch.origins, branch.name) for branch in lines or at]
    faults = [
        Fault("I022", _some(names), f"no capacitance here: none of {_some(beside[option])} has any; state it: {option}")
        for option, names in found.items()
        if names
    ]
    if faults:
        raise SpecError(tuple(faults))


def _some(names: Iterable[str]) -> str:
    """The first names of many."""
    once = list(dict.fromkeys(names))
    return ", ".join(once[:6]) + (f" and {len(once) - 6} more" if once[6:] else "")


def _all(origins: Iterable[tuple[str, ...]], reason: str) -> list[Unmapped]:
    return [Unmapped(element, reason) for group in origins for element in group]


def _element(origins: tuple[str, ...], name: str) -> str:
    return origins[0] if origins else name
