"""An OpenDSS script as a `Network`: every element of the circuit is in it, or among what is left out, or a fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from certify.importing.names import unique
from certify.importing.network import ZERO, Bus, ExpRow, Network, Note, Unmapped, ZipRow
from certify.importing.opendss.branches import READERS, Parts, add_element
from certify.importing.opendss.circuit import Circuit, run_engine
from certify.importing.opendss.elements import Element, Unreadable, refuse
from certify.importing.opendss.generating import GENERATING, Place, add_others, find_places, to_source
from certify.importing.opendss.loads import to_rows
from certify.importing.opendss.voltages import nominal_volts
from certify.importing.settings import Placement, Settings
from certify.kernel.errors import Fault

# What draws nothing, and what acts only as time goes by or once the engine solves.
METERS = ("monitor", "energymeter", "sensor")
CONTROLS = {
    "regcontrol": "a control; the tap of its transformer stays as the script leaves it",
    "capcontrol": "a control; the steps of its capacitor stay as the script leaves them",
    **dict.fromkeys(("swtcontrol", "relay", "recloser", "fuse"), "a control; its switch stays as the script leaves it"),
    **dict.fromkeys(
        ("invcontrol", "expcontrol", "storagecontroller", "gendispatcher", "upfccontrol", "espvlcontrol"),
        "a control; a DGU has that of the spec",
    ),
}
SHAPES = ("Yearly", "Daily", "Duty")


def read_network(path: Path, settings: Settings, placement: Placement) -> Network:
    """The network of a script.

    What `placement` leaves out is named by classes or elements, such as `pvsystem` or `load.a`. Loads get the part of
    `settings.band_pu` on which their models hold.

    Raises: SpecError with every fault (I007, I040 to I053).
    """
    return to_network(run_engine(path), path.name, settings, placement)


def to_network(circuit: Circuit, file: str, settings: Settings, placement: Placement) -> Network:
    """See `read_network`."""
    parts = Parts(notes=_notes_of_script(circuit))
    on = _kept(circuit.elements, placement.leave_out, parts)
    for element in on:
        if element.kind in READERS:
            add_element(element, circuit.frequency_hertz, parts)
        elif element.kind in METERS:
            parts.unmapped.append(Unmapped(element.name, "a meter"))
        elif element.kind in CONTROLS:
            parts.unmapped.append(Unmapped(element.name, CONTROLS[element.kind]))
        elif element.kind not in ("load", *GENERATING):
            parts.fault("I050", element, f"elements of the class {element.kind} have no counterpart in a spec")
    loads = _connected([element for element in on if element.kind == "load"], parts)
    rows, notes, faults = to_rows(loads, circuit.load_multiplier, settings.band_pu)
    parts.notes += notes + [Note(e.name, "its load shape is ignored") for e in loads if any(map(e.text, SHAPES))]
    parts.faults += faults
    generating = [element for element in on if element.kind in GENERATING]
    buses = list(dict.fromkeys(bus for element in on for bus in element.buses if bus))
    places = find_places(generating, placement, buses, parts)
    rows += add_others(generating, places, circuit.generator_multiplier, settings.band_pu, parts)
    if not parts.faults and not rows and not parts.branches:
        parts.faults.append(Fault("I046", "", "the circuit has no line, no transformer and no load that is on"))
    refuse(parts.faults)
    return _named(circuit, file, parts, rows, places)


def _notes_of_script(circuit: Circuit) -> list[Note]:
    commands = [f"`{command}`" for command in circuit.left_out]
    few = [commands[k : k + 8] for k in range(0, len(commands), 8)]
    notes = [Note("", f"not run of the script: {', '.join(part)}") for part in few]
    for option, value in (("loadmult", circuit.load_multiplier), ("genmult", circuit.generator_multiplier)):
        if value != 1:
            notes.append(Note("", f"powers are those of {option} = {float(value):g}"))
    return notes


def _kept(elements: Sequence[Element], leave_out: Sequence[str], parts: Parts) -> list[Element]:
    """Elements that are on and not to go."""
    wanted = {name.strip().lower() for name in leave_out}
    unused = wanted - {name for element in elements for name in (element.name, element.kind)}
    parts.faults += [Fault("I054", "--leave-out", f"the circuit has no {name!r}") for name in sorted(unused)]
    kept = []
    for element in elements:
        if not element.enabled:
            parts.unmapped.append(Unmapped(element.name, "disabled"))
        elif {element.name, element.kind} & wanted:
            parts.unmapped.append(Unmapped(element.name, "left out as asked for"))
        else:
            kept.append(element)
    return kept


def _connected(loads: Sequence[Element], parts: Parts) -> list[Element]:
    """Loads without those that are open; one that is open in some phases only is a fault."""
    kept = []
    for load in loads:
        states = load.open[0]
        if all(states):
            parts.unmapped.append(Unmapped(load.name, f"open at {load.buses[0]}"))
        elif any(states):
            parts.fault("I047", load, "open in some of its phases only")
        else:
            kept.append(load)
    return kept


def _named(
    circuit: Circuit, file: str, parts: Parts, rows: Sequence[ZipRow | ExpRow], places: Sequence[Place]
) -> Network:
    """The network with names that a spec accepts, and a nominal voltage for each bus."""
    used = [end for branch in parts.branches for end in (branch.start, branch.end)]
    used += [row.bus for row in rows] + [place.bus for place in places]
    used += [shunt.bus for shunt in parts.shunts] + list(parts.capacitances)
    buses = list(dict.fromkeys(used))
    names = dict(zip(buses, unique((bus, f"bus {k}") for k, bus in enumerate(buses)), strict=True))
    nominal = nominal_volts(buses, [e for e in circuit.elements if e.enabled], parts, rows, [p.bus for p in places])
    labels = unique((branch.name, f"branch {k}") for k, branch in enumerate(parts.branches))
    shunts = []
    for shunt in parts.shunts:
        square = nominal[shunt.bus] ** 2
        pair = (shunt.siemens[0] * square, shunt.siemens[1] * square)
        shunts.append(ZipRow(names[shunt.bus], nominal[shunt.bus], impedance=pair, origins=(shunt.origin,)))
    for row in rows:
        if not Fraction(17, 20) <= row.nominal_volt / nominal[row.bus] <= Fraction(23, 20):
            text = f"rated for {float(row.nominal_volt / 1000):g} kV at a bus of {float(nominal[row.bus] / 1000):g} kV"
            parts.notes.append(Note(row.origins[0], text))
    try:
        sources = tuple(to_source(place, names[place.bus], nominal[place.bus]) for place in places)
    except Unreadable as error:
        refuse((Fault("I051", "--dgus-at", str(error)),))
    return Network(
        circuit.name,
        f"{file} by OpenDSS ({circuit.version})",
        circuit.frequency_hertz,
        tuple(_bus(bus, names[bus], nominal[bus], parts) for bus in buses),
        tuple(
            replace(branch, name=label, start=names[branch.start], end=names[branch.end])
            for branch, label in zip(parts.branches, labels, strict=True)
        ),
        (*(replace(row, bus=names[row.bus]) for row in rows), *shunts),
        sources,
        tuple(parts.unmapped),
        tuple(parts.notes),
    )


def _bus(bus: str, name: str, nominal: Fraction, parts: Parts) -> Bus:
    farad, origins = parts.capacitances.get(bus, (ZERO, ()))
    return Bus(name, nominal, origins, farad)
