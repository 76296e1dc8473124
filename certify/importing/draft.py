"""From a network to a spec: prepared, referred to one side, equipped with inverters, written and read again."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from fractions import Fraction

from certify.importing.inverters import equip
from certify.importing.network import NONE, ExpRow, Network, Note, Source, Unmapped, ZipRow
from certify.importing.numbers import decimal
from certify.importing.prepare import joined, prepare, require_capacitances
from certify.importing.referring import Level, refer
from certify.importing.settings import Settings
from certify.importing.text import lines_of
from certify.kernel.errors import Fault, SpecError
from certify.kernel.spec import Microgrid, decode


@dataclass(frozen=True)
class Draft:
    """A spec that decodes, and how it came about. `mapped`: elements of the foreign network that are in it.

    `levels`: the voltage levels that there were, and how they are referred. `counts`: what the spec has, by kind;
    `constant_power`: load rows with a part that no voltage changes.
    """

    spec: bytes
    microgrid: Microgrid
    mapped: tuple[str, ...]
    unmapped: tuple[Unmapped, ...]
    notes: tuple[Note, ...]
    levels: tuple[Level, ...]
    counts: dict[str, int]
    constant_power: int


def to_spec(network: Network, settings: Settings) -> Draft:
    """The spec of a network. Raises: SpecError with what is missing or contradicts itself (I003, I004, I020 to I025).

    >>> from fractions import Fraction as F
    >>> from certify.importing import Branch, Bus, Network, Settings, Source, ZipRow
    >>> network = Network(
    ...     "two buses", "an example", F(50), (Bus("a", F(400)), Bus("b", F(400))),
    ...     (Branch("ab", "a", "b", F("0.1"), F("0.0003"), F("1e-6"), length_metre=F(1000)),),
    ...     (ZipRow("b", F(400), impedance=(F(3000), F(1000))),), (Source("a", F(10000)),),
    ... )
    >>> draft = to_spec(network, Settings())
    >>> draft.microgrid.nodes[1].loads[0].Y
    (Fraction(3, 160), Fraction(1, 160))
    """
    if settings.frequency not in (None, network.frequency_hertz):
        text = f"reactances are those at {decimal(network.frequency_hertz)} Hz: inductances keep their values"
        network = replace(network, notes=(*network.notes, Note("", f"another frequency than in the source; {text}")))
    prepared = prepare(network, settings)
    referred, levels, base = refer(prepared)
    referred = joined(referred)
    require_capacitances(referred)
    absent = {u.element for u in referred.unmapped}
    referred = replace(referred, notes=tuple(n for n in dict.fromkeys(referred.notes) if n.element not in absent))
    off_level = frozenset(name for level in levels if level.factor != 1 for name in level.buses)
    referred = replace(referred, sources=_with_references(referred, settings))
    inverters = equip(referred, settings, off_level)
    mapped = tuple(
        dict.fromkeys(
            element
            for part in (*referred.buses, *referred.branches, *referred.loads, *referred.sources)
            for element in part.origins
        )
    )
    text = "\n".join(lines_of(referred, settings, inverters, levels, base)) + "\n"
    spec = text.encode()
    counts = {
        "nodes": len(referred.buses),
        "DGUs": len(referred.sources),
        "lines": len(referred.branches),
        "load rows": len(referred.loads),
    }
    constant = sum(_has_constant_power(load) for load in referred.loads)
    # What is written is read again by the rules of every spec: an import never leaves a file that `prove` refuses.
    return Draft(spec, decode(spec), mapped, referred.unmapped, referred.notes, levels, counts, constant)


def _has_constant_power(load: ZipRow | ExpRow) -> bool:
    if isinstance(load, ZipRow):
        return load.power != NONE
    return (not load.np and bool(load.P0_watt)) or (not load.nq and bool(load.Q0_var))


def _with_references(network: Network, settings: Settings) -> tuple[Source, ...]:
    """Sources with stated references. Raises: SpecError I025 for a bus without a DGU, or two DGUs at one bus."""
    sources = network.sources
    stated: dict[str, Fraction] = {}
    known = {source.bus for source in sources}
    faults = []
    for name, value in settings.references.items():
        bus = network.aliases.get(name, name) if name else ""
        if bus in stated:
            faults.append(Fault("I025", "--reference", f"twice for bus {bus}, which is also called {name}"))
        stated[bus] = value
    faults += [Fault("I025", "--reference", f"no DGU at bus {name}") for name in stated if name and name not in known]
    faults += [
        Fault("I025", name, f"{count} DGUs at one bus")
        for name, count in Counter(s.bus for s in sources).items()
        if count > 1
    ]
    if faults:
        raise SpecError(tuple(faults))
    common = stated.get("")
    return tuple(replace(s, reference_pu=stated.get(s.bus, common or s.reference_pu)) for s in sources)
