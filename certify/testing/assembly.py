"""Whole specs out of parts: one inverter alone, or nodes and lines; filters and laws are named as they are met."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import chain, count
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_quantity, shorten
from certify.kernel.spec import FORMAT, angular_frequency
from certify.testing.parts import Document
from certify.values import to_plain

FREQUENCY = "50 Hz"
BASE_VOLTAGE = "20 kV"
BAND = ("0.8 pu", "1.2 pu")  # where loads have to be monotone, and voltages have to be
REFERENCE = ("1 pu", "0 pu")
_KINDS = (("K11", "state-feedback"), ("alpha", "ida-pbc"), ("F", "linear"))
_SHORT = {"filter": "lc", "controller": "law"}  # the name of the first of each; then lc-2, ...


def w0(frequency: Any = FREQUENCY) -> Fraction:
    """The speed of the dq frame in rad/s that plant and controllers share: 2 pi f to 40 digits, exactly as in proofs.

    A design in Python that is to be exactly passive has to use this one.

    >>> float(w0("50 Hz"))
    314.1592653589793
    """
    try:
        return angular_frequency(parse_quantity(to_plain(frequency), "Hz", {}))
    except QuantityError as error:
        raise SpecError((Fault(error.code, "frequency", error.message),)) from None


def dgu_spec(
    filter: Mapping[str, Any] | None,
    controller: Mapping[str, Any],
    *,
    load: Mapping[str, Any] | Sequence[Mapping[str, Any]] = (),
    reference: Sequence[Any] = REFERENCE,
    frequency: Any = FREQUENCY,
    base_voltage: Any = BASE_VOLTAGE,
    voltage_band: Sequence[Any] = BAND,
    **more: Any,
) -> Document:
    """The spec of one inverter at node `a`, without lines: what a controller does with a filter, and with a load.

    `filter`: R, L, C and, if wanted, a tolerance; None for a linear loop, which holds its plant. `controller`: its
    keys as in a spec; `kind` may be left out if the names of its gains say it. Numbers are in SI and are taken
    exactly, floats and arrays of numpy as the shortest decimals that name them. `more`: other keys of a spec.

    Raises: SpecError for a value that no spec can hold.
    """
    dgu = {"filter": filter, "controller": controller, "reference": list(reference)}
    loads = [load] if isinstance(load, Mapping) else list(load)
    node = {
        "dgu": {key: value for key, value in dgu.items() if value is not None},
        **({"load": loads} if loads else {}),
    }
    top = {"frequency": frequency, "base_voltage": base_voltage, "voltage_band": list(voltage_band)}
    return network_spec({"a": node}, **top, **more)


def network_spec(
    nodes: Mapping[str, Mapping[str, Any]],
    lines: Iterable[Mapping[str, Any]] = (),
    *,
    frequency: Any = FREQUENCY,
    base_voltage: Any = BASE_VOLTAGE,
    voltage_band: Sequence[Any] = BAND,
    **more: Any,
) -> Document:
    """The spec of a network. A node has `dgu`, `load` (or a list of them) and `capacitance`, as far as there are any.

    The filter and the controller of a DGU may be tables: equal ones are written once and get a name. The `reference`
    is 1 pu along d if it is left out. A line has `from` and `to`; its `name` is made of them if it has none.
    Numbers as in `dgu_spec`. Raises: SpecError for a value that no spec can hold.
    """
    top: dict[str, Any] = {"format": FORMAT, "frequency": frequency, "base_voltage": base_voltage}
    top |= {"voltage_band": list(voltage_band), **more}
    document = {key: to_plain(value, key) for key, value in top.items() if value is not None}
    named: dict[str, dict[str, Any]] = {key: dict(document.pop(key, {})) for key in _SHORT}
    types = {"line_type": document.pop("line_type")} if "line_type" in document else {}
    table = {str(name): _node(to_plain(node, f"node.{name}"), named, f"node.{name}") for name, node in nodes.items()}
    listed = _lines([to_plain(line, f"line[{k}]") for k, line in enumerate(lines)])
    parts = {key: value for key, value in named.items() if value}
    return Document({**document, **parts, **types, "node": table, **({"line": listed} if listed else {})})


def _node(node: Any, named: dict[str, dict[str, Any]], path: str) -> dict[str, Any]:
    if not isinstance(node, Mapping):
        raise SpecError((Fault("S103", path, f"expected a table, got {shorten(node)}"),))
    result = dict(node)
    if isinstance(result.get("load"), Mapping):
        result["load"] = [result["load"]]
    if isinstance(result.get("dgu"), Mapping):
        dgu = {"reference": list(REFERENCE), **result["dgu"]}
        for key in _SHORT:
            if isinstance(dgu.get(key), Mapping):
                dgu[key] = _name(_with_kind(dgu[key]) if key == "controller" else dgu[key], key, named[key])
        result["dgu"] = {key: dgu[key] for key in ("filter", "controller", "reference", *dgu) if key in dgu}
    return result


def _with_kind(controller: Mapping[str, Any]) -> dict[str, Any]:
    kinds = [kind for gain, kind in _KINDS if gain in controller and "kind" not in controller]
    return {**({"kind": kinds[0]} if kinds else {}), **controller}


def _name(part: Mapping[str, Any], key: str, known: dict[str, Any]) -> str:
    """The name of an equal part, or a new one."""
    for name, other in known.items():
        if other == part:
            return name
    short = _SHORT[key]
    name = next(name for name in chain([short], (f"{short}-{k}" for k in count(2))) if name not in known)
    known[name] = dict(part)
    return name


def _lines(lines: list[Any]) -> list[dict[str, Any]]:
    taken = {line.get("name") for line in lines if isinstance(line, Mapping)}
    result = []
    for line in lines:
        entry = dict(line)
        if "name" not in entry and {"from", "to"} <= entry.keys():
            pair = f"{entry['from']}-{entry['to']}"
            names = chain([pair], (f"{pair}-{k}" for k in count(2)))
            name = next(name for name in names if name not in taken)
            taken.add(name)
            entry = {"name": name, **entry}
        result.append(entry)
    return result
