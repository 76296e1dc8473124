"""The text of a spec: commented TOML, the same bytes for the same network."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

from certify.importing.inverters import Inverters
from certify.importing.names import clean, comment
from certify.importing.network import NONE, Branch, Bus, ExpRow, Network, Source, ZipRow
from certify.importing.numbers import DIGITS, decimal, from_float, quantity
from certify.importing.referring import Level, describe
from certify.importing.settings import Settings
from certify.kernel.quantity import NumberText
from certify.kernel.spec import FORMAT

MOST_LISTED = 20  # elements named in one line of a comment


def lines_of(
    network: Network, settings: Settings, inverters: Inverters, levels: tuple[Level, ...], base: Fraction
) -> Iterator[str]:
    """The lines of the spec of a prepared and referred network."""
    yield from _head(network, settings, levels, base)
    yield ""
    yield from (f"# {line}" for line in inverters.comments)
    for kind, tables in (("filter", inverters.filters), ("controller", inverters.controllers)):
        for name, table in tables.items():
            yield f"[{kind}.{_key(name)}]"
            yield from _table(table)
            yield ""
    types = _line_types(network.branches)
    yield from _types(types)
    yield from _nodes(network, settings, inverters, base)
    yield from _branches(network.branches, types)


def _head(network: Network, settings: Settings, levels: tuple[Level, ...], base: Fraction) -> Iterator[str]:
    yield f"# {comment(network.name or 'A network')}, imported from {comment(network.origin)}."
    yield "# Voltages are from line to line, powers of all three phases, impedances of one phase. Numbers are the"
    yield "# decimals of the source; what is no finite decimal (L = X/w0, magnetising currents, values referred to"
    yield f"# another voltage) is rounded to {DIGITS} digits."
    for line in describe(levels):
        yield f"# Referred: {line}."
    groups = grouped((u.element, u.reason) for u in network.unmapped)
    if groups:
        yield "# Left out:"
        yield from (f"#   {listed(elements)}: {comment(reason)}" for reason, elements in groups.items())
    groups = grouped((n.element, n.text) for n in network.notes)
    if groups:
        yield "# Notes:"
        for text, elements in groups.items():
            which = listed([element for element in elements if element])
            yield f"#   {which}: {comment(text)}" if which else f"#   {comment(text)}"
    yield ""
    yield f'format = "{FORMAT}"'
    if network.name:
        yield f"name = {_string(comment(network.name, 190))}"
    yield f'frequency = "{decimal(settings.frequency or network.frequency_hertz)} Hz"'
    yield f'base_voltage = "{quantity(base, "V")}"'
    low, high = settings.band_pu
    yield f'voltage_band = ["{decimal(low)} pu", "{decimal(high)} pu"]'


def grouped(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Elements by what is said of them, both in their first order."""
    groups: dict[str, list[str]] = defaultdict(list)
    for element, text in dict.fromkeys(pairs):
        groups[text].append(element)
    return groups


def listed(elements: Iterable[str]) -> str:
    """Names of elements in one line; of many only the first."""
    names = [comment(element, 80) for element in elements]
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more


def _line_types(branches: tuple[Branch, ...]) -> dict[tuple[Fraction, Fraction, Fraction], tuple[str, str]]:
    """Lines with equal values per metre share a type: its name, and what it is called in the source."""
    types: dict[tuple[Fraction, Fraction, Fraction], tuple[str, str]] = {}
    taken: set[str] = set()
    for branch in branches:
        key = _per_metre(branch)
        if key is None or key in types:
            continue
        base = clean(branch.kind, "line") if branch.kind else "line"
        name, number = base, 2
        while name.lower() in taken:
            name, number = f"{base}-{number}", number + 1
        taken.add(name.lower())
        types[key] = (name, branch.kind)
    return types


def _per_metre(branch: Branch) -> tuple[Fraction, Fraction, Fraction] | None:
    if branch.length_metre is None:
        return None
    length = branch.length_metre
    return branch.resistance_ohm / length, branch.inductance_henry / length, branch.capacitance_farad / length


def _types(types: dict[tuple[Fraction, Fraction, Fraction], tuple[str, str]]) -> Iterator[str]:
    if types:
        yield "# Lines"
    for (r, l, c), (name, kind) in types.items():  # noqa: E741
        yield f"[line_type.{_key(name)}]" + (f"  # {comment(kind)}" if kind and kind != name else "")
        yield f'R = "{quantity(r, "ohm/km")}"'
        yield f'L = "{quantity(l, "H/km")}"'
        yield f'C = "{quantity(c, "F/km")}"'
        yield ""


def _nodes(network: Network, settings: Settings, inverters: Inverters, base: Fraction) -> Iterator[str]:
    sources = {s.bus: (s, names) for s, names in zip(network.sources, inverters.names, strict=True)}
    loads: dict[str, list[ZipRow | ExpRow]] = defaultdict(list)
    for load in network.loads:
        loads[load.bus].append(load)
    shunts = _shunts(network.branches)
    yield "# Buses; each row of a load table is one load"
    for bus in network.buses:
        yield f"[node.{_key(bus.name)}]" + _origin(bus.origins, bus.name)
        if bus.capacitance_farad:
            yield f'capacitance = "{quantity(bus.capacitance_farad, "F")}"'
        if bus.name in sources:
            source, (filter_, controller) = sources[bus.name]
            yield (
                f"dgu = {{ filter = {_string(filter_)}, controller = {_string(controller)}, "
                f"reference = {_reference(source, bus, base)} }}" + _origin(source.origins, "")
            )
        rows = [(_load(load, settings, base), _origin(load.origins, "")) for load in loads[bus.name]]
        pair, elements = shunts.get(bus.name, (NONE, ()))
        if pair != NONE:
            text = f'{{ kind = "zip", Y = {_siemens(pair)}{_band(settings.band_pu, bus.nominal_volt, base)} }}'
            rows.append((text, f"  # half of what {listed(elements)} draws by itself"))
        if rows:
            yield "load = ["
            yield from (f"  {text},{origin}" for text, origin in rows)
            yield "]"
        yield ""


def _shunts(branches: tuple[Branch, ...]) -> dict[str, tuple[tuple[Fraction, Fraction], tuple[str, ...]]]:
    """Half of each branch's conductance and magnetising susceptance at either end, added up at each bus."""
    at: dict[str, tuple[tuple[Fraction, Fraction], tuple[str, ...]]] = {}
    for branch in branches:
        if branch.shunt_siemens != NONE:
            for end in (branch.start, branch.end):
                (g, b), elements = at.get(end, (NONE, ()))
                half = (g + branch.shunt_siemens[0] / 2, b + branch.shunt_siemens[1] / 2)
                at[end] = (half, (*elements, branch.origins[0] if branch.origins else branch.name))
    return at


def _reference(source: Source, bus: Bus, base: Fraction) -> str:
    modulus = source.reference_pu * bus.nominal_volt
    angle = math.radians(float(source.angle_degree or 0))
    parts = (
        [modulus * from_float(round(f(angle), 15)) for f in (math.cos, math.sin)] if angle else [modulus, Fraction(0)]
    )
    return "[" + ", ".join(f'"{_volts(part, base)}"' for part in parts) + "]"


def _volts(volt: Fraction, base: Fraction) -> str:
    """In pu where that is short, as it is for all buses of the side that is referred to."""
    text = decimal(volt / base)
    return f"{text} pu" if len(text) <= 12 else quantity(volt, "V")


def _load(load: ZipRow | ExpRow, settings: Settings, base: Fraction) -> str:
    band = _band(load.band_pu or settings.band_pu, load.nominal_volt, base, load.band_pu is not None)
    if load.impedance_below:
        band += ', below = "constant-impedance"'
    if isinstance(load, ExpRow):
        parts = [f'P0 = "{quantity(load.P0_watt, "W")}", np = {decimal(load.np)}']
        if load.Q0_var:
            parts.append(f'Q0 = "{quantity(load.Q0_var, "var")}", nq = {decimal(load.nq)}')
        if load.nominal_volt != base:
            parts.append(f'V0 = "{quantity(load.nominal_volt, "V")}"')
        return f'{{ kind = "exp", {", ".join(parts)}{band} }}'
    v = load.nominal_volt
    parts = []
    if load.impedance != NONE:
        parts.append(f"Y = {_siemens((load.impedance[0] / v**2, load.impedance[1] / v**2))}")
    if load.current != NONE:
        parts.append(f"I = {_pair((load.current[0] / v, load.current[1] / v), 'A', 'A')}")
    if load.power != NONE or not parts:
        parts.append(f"P = {_pair(load.power, 'W', 'var')}")
    return f'{{ kind = "zip", {", ".join(parts)}{band} }}'


def _band(band_pu: tuple[Fraction, Fraction], nominal: Fraction, base: Fraction, always: bool = False) -> str:
    """A band of its own where 1 pu of the load is not that of the spec, or where it is stated."""
    if nominal == base and not always:
        return ""
    low, high = (quantity(share * nominal, "V") for share in band_pu)
    return f', band = ["{low}", "{high}"]'


def _siemens(pair: tuple[Fraction, Fraction]) -> str:
    return _pair(pair, "S", "S")


def _pair(pair: tuple[Fraction, Fraction], first: str, second: str) -> str:
    return f'["{quantity(pair[0], first)}", "{quantity(pair[1], second)}"]'


def _branches(
    branches: tuple[Branch, ...], types: dict[tuple[Fraction, Fraction, Fraction], tuple[str, str]]
) -> Iterator[str]:
    for branch in branches:
        yield "[[line]]" + _origin(branch.origins, branch.name)
        yield f"name = {_string(branch.name)}"
        yield f"from = {_string(branch.start)}"
        yield f"to = {_string(branch.end)}"
        key = _per_metre(branch)
        if key is not None and branch.length_metre is not None:
            yield f"type = {_string(types[key][0])}"
            yield f'length = "{decimal(branch.length_metre / 1000)} km"'
        else:
            yield f'R = "{quantity(branch.resistance_ohm, "ohm")}"'
            yield f'L = "{quantity(branch.inductance_henry, "H")}"'
            yield f'C = "{quantity(branch.capacitance_farad, "F")}"'
        yield ""


def _origin(origins: tuple[str, ...], name: str) -> str:
    """A comment that names what a part was in the source, without repeating its name."""
    shown = [origin.removesuffix(f" ({name})") for origin in origins]
    return f"  # {listed(shown)}" if shown and shown != [name] else ""


def _table(table: dict[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        yield f"{_key(key)} = {_value(value)}"


def _value(value: Any) -> str:
    """A value of a spec in TOML; numbers as they were written."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, NumberText | int):
        return str(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return _string(str(value))


def _key(name: str) -> str:
    bare = name.isascii() and name.replace("-", "a").replace("_", "a").isalnum()
    return name if bare else _string(name)


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)  # what TOML escapes in a basic string, JSON escapes alike
