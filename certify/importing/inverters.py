"""Filter and controller of each DGU: taken from another spec, or placeholders scaled to rating and voltage."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.importing.network import Network, Source
from certify.importing.numbers import quantity, root, round_to
from certify.importing.settings import Settings
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten

# Per unit of an inverter's own rating: common sizes of an LC filter.
SERIES_RESISTANCE, SERIES_REACTANCE, SHUNT_SUSCEPTANCE = Fraction(1, 200), Fraction(1, 10), Fraction(1, 20)

# Formulas of the filter, so that passivity is exact for every filter: the triple X = 1/(10 L), Bm = 1, H = -10 w0 L.
# An error of the voltage then decays at about w0, one of the current at 10 w0, and the DGU looks like 10 w0 L ohm.
PLACEHOLDERS: dict[str, dict[str, Any]] = {
    "ida-pbc": {"kind": "ida-pbc", "alpha": "-10*w0*L", "nu": 1, "ki": "1/(10*L)"},
    "pi": {
        "kind": "state-feedback",
        "K11": "-1/10",
        "K12": [["R - 10*w0*L", "-w0*L"], ["w0*L", "R - 10*w0*L"]],
        "K13": "w0",
    },
}
PLACEHOLDER_NAME = "placeholder"


@dataclass(frozen=True)
class Inverters:
    """Tables of the spec, and for each source the names of its filter and controller. `comments` stand above them."""

    filters: dict[str, dict[str, Any]]
    controllers: dict[str, dict[str, Any]]
    names: tuple[tuple[str, str], ...]
    comments: tuple[str, ...]


def equip(network: Network, settings: Settings, off_level: frozenset[str]) -> Inverters:
    """A filter and a controller for each source of a referred network; `off_level`: buses whose factor is not one.

    Raises: SpecError I024 if what was named is not there, or does not fit.
    """
    return _copied(network, settings, off_level) if settings.filters else _designed(network, settings)


def _designed(network: Network, settings: Settings) -> Inverters:
    kind = settings.controller or "ida-pbc"
    if kind not in PLACEHOLDERS:
        text = (
            f"{shorten(kind)} is no built-in controller: {', '.join(PLACEHOLDERS)}; or name a spec with --filter-from"
        )
        raise SpecError((Fault("I024", "--controller", text),))
    nominal = {bus.name: bus.nominal_volt for bus in network.buses}
    share = _share(network)
    filters: dict[str, dict[str, Any]] = {}
    by_value: dict[tuple[str, ...], str] = {}
    names = []
    for source in network.sources:
        rating = source.rating_va or share
        impedance = nominal[source.bus] ** 2 / rating
        values = (
            quantity(round_to(SERIES_RESISTANCE * impedance, 3), "ohm"),
            quantity(round_to(SERIES_REACTANCE * impedance / _w0(network), 3), "H"),
            quantity(round_to(SHUNT_SUSCEPTANCE / (impedance * _w0(network)), 3), "F"),
        )
        if values not in by_value:
            by_value[values] = f"placeholder-{len(by_value) + 1}"
            filters[by_value[values]] = dict(zip("RLC", values, strict=True))
        names.append((by_value[values], PLACEHOLDER_NAME))
    comments = (
        "PLACEHOLDERS, to be replaced by your inverters: the source has no filters or controllers. Each LC filter has",
        "0.5 % R, 10 % X_L and 5 % B_C of the inverter's rating (that of its rows, or else an equal share of all",
        "loads); the gains are formulas of the filter for which a DGU is passive whatever its values.",
        "`--filter-from SPEC` takes your own instead.",
    )
    return Inverters(filters, {PLACEHOLDER_NAME: PLACEHOLDERS[kind]}, tuple(names), comments)


def _share(network: Network) -> Fraction:
    """VA of a source without a rating: an equal share of all that loads draw, and at least 1 kVA."""
    total = [sum((abs(load.apparent[k]) for load in network.loads), Fraction(0)) for k in (0, 1)]
    apparent = root(total[0] ** 2 + total[1] ** 2) / max(len(network.sources), 1)
    return max(round_to(apparent, 2), Fraction(1000))


def _w0(network: Network) -> Fraction:
    from certify.kernel.spec import angular_frequency

    return angular_frequency(network.frequency_hertz)


def _copied(network: Network, settings: Settings, off_level: frozenset[str]) -> Inverters:
    filter_name = _chosen(settings.filters, settings.filter, "filter", settings.taken_from)
    controller_name = _chosen(settings.controllers, settings.controller, "controller", settings.taken_from)
    filter_, controller = settings.filters[filter_name], settings.controllers[controller_name]
    faults = [
        Fault(
            "I024", f"{settings.taken_from}: {path}", "a value in pu means something else here; write it with its unit"
        )
        for path, table in ((f"filter.{filter_name}", filter_), (f"controller.{controller_name}", controller))
        if _has_pu(table)
    ]
    for source in network.sources:
        if source.bus in off_level:
            text = "the inverter is behind a transformer from the side that all is referred to; its filter would change"
            faults.append(Fault("I024", _where(source), text))
    if faults:
        raise SpecError(tuple(faults))
    comments = (f"Filter and controller of all DGUs, from {settings.taken_from}.",)
    names = ((filter_name, controller_name),) * len(network.sources)
    return Inverters({filter_name: filter_}, {controller_name: controller}, names, comments)


def _chosen(tables: Any, name: str | None, kind: str, file: str) -> str:
    listed = ", ".join(map(str, list(tables)[:8])) or "none"
    if name is None:
        if len(tables) == 1:
            return str(next(iter(tables)))
        raise SpecError((Fault("I024", f"--{kind}", f"{file} has {len(tables)} of them ({listed}); name one"),))
    if name not in tables:
        raise SpecError((Fault("I024", f"--{kind}", f"{shorten(name)} is no {kind} of {file}, which has {listed}"),))
    return name


def _has_pu(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_has_pu, value.values()))
    if isinstance(value, list):
        return any(map(_has_pu, value))
    return isinstance(value, str) and value.rstrip().endswith("pu")


def _where(source: Source) -> str:
    return source.origins[0] if source.origins else source.bus
