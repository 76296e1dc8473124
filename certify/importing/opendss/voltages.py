"""Nominal voltages of buses, which a script states for transformers, sources and loads only."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from fractions import Fraction

from certify.importing.network import ExpRow, ZipRow
from certify.importing.opendss.branches import Parts
from certify.importing.opendss.elements import Element, Unreadable, refuse
from certify.kernel.errors import Fault


def nominal_volts(
    buses: Sequence[str],
    elements: Sequence[Element],
    parts: Parts,
    rows: Sequence[ZipRow | ExpRow],
    places: Sequence[str],
) -> dict[str, Fraction]:
    """Nominal voltages, one for all buses that no transformer separates.

    That is the rating of the windings there (the most frequent of them), else of the voltage sources, else of the
    loads. A level without any of these is connected to none that has one; without a DGU of `places` it is no part of
    an island, and may have any. Raises: SpecError I051.
    """
    level = _levels(buses, parts)
    rated: dict[str, list[Counter[Fraction]]] = defaultdict(lambda: [Counter(), Counter(), Counter()])
    faults = []
    for element in elements:
        if not element.enabled or element.kind not in ("transformer", "vsource", "generator", "pvsystem", "storage"):
            continue
        try:
            if element.kind == "transformer":
                for bus, kv in zip(element.buses, element.numbers("kVs"), strict=True):
                    rated[level.get(bus, "")][0][1000 * kv] += 1
            else:
                key, rank = ("BasekV", 1) if element.kind == "vsource" else ("kV", 2)
                rated[level.get(element.buses[0], "")][rank][1000 * element.number(key)] += 1
        except Unreadable as error:
            faults.append(Fault("I051", element.name, str(error)))
    for row in rows:
        rated[level[row.bus]][2][row.nominal_volt] += 1
    found: dict[str, Fraction] = {}
    fed = {level[bus] for bus in places}
    for name in dict.fromkeys(level.values()):
        counts = next((counter for counter in rated[name] if counter), None)
        if counts is None and name not in fed:
            found[name] = Fraction(1)
        elif counts is None or max(counts) <= 0:
            bus = next(bus for bus in buses if level[bus] == name)
            faults.append(
                Fault("I051", bus, "no nominal voltage: no transformer, source or load of this level has one")
            )
        else:
            found[name] = counts.most_common(1)[0][0]
    refuse(faults)
    return {bus: found[level[bus]] for bus in buses}


def _levels(buses: Sequence[str], parts: Parts) -> dict[str, str]:
    """For each bus one that stands for all it is connected to without a transformer."""
    parent = {bus: bus for bus in buses}

    def root(name: str) -> str:
        while parent[name] != name:
            parent[name] = parent[parent[name]]
            name = parent[name]
        return name

    transformers = {name for name, _ in ((b.origins[0], b) for b in parts.branches) if name.startswith("transformer.")}
    for branch in parts.branches:
        if branch.origins[0] not in transformers:
            parent[root(branch.end)] = root(branch.start)
    return {bus: root(bus) for bus in buses}
