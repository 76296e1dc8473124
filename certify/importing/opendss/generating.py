"""What feeds a circuit: places for DGUs, and generators that stay loads of negative power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from certify.importing.network import ZERO, Note, Pair, Source, Unmapped, ZipRow
from certify.importing.opendss.branches import Parts, unbalanced
from certify.importing.opendss.elements import Element, Unreadable
from certify.importing.opendss.loads import Holds, within
from certify.importing.settings import Placement
from certify.kernel.errors import Fault

# The kinds that --dgus-at takes, and the classes that they are here.
CLASSES = {"generators": "generator", "storage": "storage", "static-generators": "pvsystem", "ext-grid": "vsource"}
GENERATING = tuple(CLASSES.values())


@dataclass(frozen=True)
class Place:
    """A bus with a DGU, and what stands there in the circuit."""

    bus: str
    elements: tuple[Element, ...]


def find_places(generating: Sequence[Element], placement: Placement, buses: Sequence[str], parts: Parts) -> list[Place]:
    """One place for each bus that is named, and for each with an element of a kind that is."""
    at: dict[str, list[Element]] = {}
    for name in placement.buses:
        bus = name.lower()
        if bus not in buses:
            parts.faults.append(Fault("I007", "--dgu", f"{name!r} is no bus of the circuit"))
        at.setdefault(bus, [])
    for kind in placement.kinds:
        chosen = [element for element in generating if element.kind == CLASSES[kind]]
        if not chosen:
            text = f"{kind} are of the class {CLASSES[kind]}, and the circuit has none that is on"
            parts.faults.append(Fault("I007", "--dgus-at", text))
        for element in chosen:
            at.setdefault(element.buses[0], [])
    if not placement.buses and not placement.kinds:
        have = ", ".join(f"{e.name} at bus {e.buses[0]}" for e in generating[:6]) + (", ..." if generating[6:] else "")
        parts.faults.append(Fault("I007", "", "no place for a DGU is named" + (f"; there are {have}" if have else "")))
    for element in generating:
        if element.buses[0] in at:
            at[element.buses[0]].append(element)
    return [Place(bus, tuple(elements)) for bus, elements in at.items()]


def add_others(
    generating: Sequence[Element], places: Sequence[Place], multiplier: Fraction, band_pu: Pair, parts: Parts
) -> list[ZipRow]:
    """What becomes of elements that are not at a place: the grid goes, generators are loads of negative power.

    What a PV system or a storage feeds in is decided by much that is not in a spec, so it has to be said that it is
    to go.
    """
    rows = []
    taken = {element.name for place in places for element in place.elements}
    for element in generating:
        if element.name in taken:
            if not element.is_three_phase or (element.kind == "vsource" and element.terminal(1) != (0, 0, 0)):
                parts.fault("I047", element, unbalanced(element))
        elif element.kind == "vsource":
            parts.unmapped.append(Unmapped(element.name, "the grid: the network is an island"))
        elif element.kind == "generator" and element.properties["Model"] in (1, 2):
            try:
                row = _negative_load(element, multiplier, band_pu, parts)
            except Unreadable as error:
                parts.fault("I051", element, str(error))
            else:
                rows += [row] if row else []
        else:
            what = f"generator of model {element.properties['Model']}" if element.kind == "generator" else element.kind
            parts.fault("I050", element, f"a {what} that is no DGU has no counterpart in a spec")
    return rows


def _negative_load(generator: Element, multiplier: Fraction, band_pu: Pair, parts: Parts) -> ZipRow | None:
    """A generator of constant power (model 1) or constant admittance (model 2)."""
    if not generator.is_three_phase:
        parts.fault("I047", generator, unbalanced(generator))
        return None
    if generator.text("DispMode").lower() != "default":
        parts.fault("I050", generator, "it is dispatched by load or price, which a spec does not know")
        return None
    factor = multiplier if generator.text("Status").lower() != "fixed" else Fraction(1)
    pair = (-1000 * factor * generator.number("kW"), -1000 * factor * generator.number("kvar"))
    row = ZipRow(generator.buses[0], 1000 * generator.number("kV"), origins=(generator.name,))
    if generator.properties["Model"] == 1:
        row = replace(row, power=pair)
        holds = Holds(generator.number("VMinpu"), generator.number("VMaxpu"))
    else:
        row, holds = replace(row, impedance=pair), Holds(ZERO, None)
    parts.notes.append(Note(generator.name, "no DGU: a load of negative power"))
    limited, notes, faults = within(row, holds, generator.name, band_pu)
    parts.notes += notes
    parts.faults += faults
    return limited if isinstance(limited, ZipRow) else None


def to_source(place: Place, name: str, nominal: Fraction) -> Source:
    """The DGU of a bus: rated as all that stands there; at a voltage source with its voltage and angle.

    Raises: Unreadable.
    """
    grid = [element for element in place.elements if element.kind == "vsource"]
    ratings = [1000 * element.number("kVA") for element in place.elements if element.kind != "vsource"]
    reference, angle = Fraction(1), None
    if grid:
        reference = 1000 * grid[0].number("BasekV") * grid[0].number("pu") / nominal
        angle = grid[0].number("Angle")
    origins = tuple(element.name for element in place.elements)
    return Source(name, None if grid else sum(ratings, ZERO) or None, reference, angle, origins)
