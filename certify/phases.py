"""The phases of a scenario: what a microgrid is from one event to the next, each as a spec of its own.

A DGU that is off is left out of its node, which keeps its loads and the legs of its lines; a line that is off is left
out with its capacitance. Numbers are passed on as they are written, so nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby, pairwise
from typing import Any

from certify.editing import to_json
from certify.inputs import decode_all
from certify.kernel.claims import to_text
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import read_document
from certify.simulate.scenario import Event, Scenario, decode_scenarios

MAX_TOTAL_BYTES = 1 << 28  # of the specs of all phases together
SHOWN_NAMES = 12


@dataclass(frozen=True)
class Phase:
    """A stretch of time without events: `events` are those at its start, `spec` is what there is from then on.

    `number` counts from 1, `off` names the DGUs and lines that are off, and `spec` has the format of a spec, as JSON.
    """

    number: int
    start_second: Fraction
    end_second: Fraction
    events: tuple[Event, ...]
    off: tuple[str, ...]
    spec: bytes

    @property
    def span(self) -> str:
        return f"{to_text(self.start_second)} s to {to_text(self.end_second)} s"


def read_phases(spec: bytes, name: str) -> tuple[Phase, ...]:
    """The phases of one scenario of a spec, each found to be a microgrid.

    Raises: SpecError with every fault of the spec; if it has no such scenario; with every fault of any phase.
    """
    decode_all(spec)
    document = read_document(spec)
    scenarios = decode_scenarios(document)
    if name not in scenarios:
        listed = ", ".join(list(scenarios)[:SHOWN_NAMES]) + (", ..." if len(scenarios) > SHOWN_NAMES else "")
        known = f"there are: {listed}" if scenarios else "the spec has none"
        raise SpecError((Fault("U002", "--scenario", f"{shorten(name)} is no scenario of this spec; {known}"),))
    phases = split_scenario(document, scenarios[name])
    require_microgrids(phases, name)
    return phases


def split_scenario(document: dict[str, Any], scenario: Scenario) -> tuple[Phase, ...]:
    """The phases of a scenario, in order of time; events at the same time make one new phase.

    `document` is what `read_document` returns for a spec without faults, `scenario` one of it.
    Raises: SpecError S003 if the specs of all phases together are absurdly large.
    """
    parts = {key: value for key, value in document.items() if key != "scenario"}
    listed = document["scenario"][scenario.name].get("event", [])
    off = dict.fromkeys(scenario.disconnected)  # in the order in which they were switched off
    at = {time: tuple(events) for time, events in groupby(scenario.events, key=lambda event: event.at_second)}
    phases: list[Phase] = []
    total = 0
    for start, end in pairwise((*sorted({Fraction(0), *at}), scenario.end_second)):
        for event in at.get(start, ()):
            if event.action == "connect":
                del off[event.target]
            elif event.action == "disconnect":
                off[event.target] = None
            else:
                parts["node"] = _with_load(parts["node"], event.target, listed[event.position]["set"])
        spec = to_json(_without(parts, off), "{\n ").encode()
        total += len(spec)
        if total > MAX_TOTAL_BYTES:
            message = f"the specs of its phases are larger than {MAX_TOTAL_BYTES} bytes together"
            raise SpecError((Fault("S003", f"scenario.{scenario.name}.event", message),))
        phases.append(Phase(len(phases) + 1, start, end, at.get(start, ()), tuple(off), spec))
    return tuple(phases)


def _with_load(nodes: dict[str, Any], name: str, coefficients: dict[str, Any]) -> dict[str, Any]:
    """The nodes, the first load of one of them with new coefficients, as they are written."""
    node = nodes[name]
    return {**nodes, name: {**node, "load": [{**node["load"][0], **coefficients}, *node["load"][1:]]}}


def _without(parts: dict[str, Any], off: dict[str, None]) -> dict[str, Any]:
    """The document without the DGUs and lines that are off; no name in `off` is one of both."""
    nodes = {
        name: {key: value for key, value in node.items() if key != "dgu" or name not in off}
        for name, node in parts["node"].items()
    }
    lines = [line for line in parts.get("line", []) if line["name"] not in off]
    return {**parts, "node": nodes, **({"line": lines} if "line" in parts else {})}


def require_microgrids(phases: tuple[Phase, ...], name: str) -> None:
    """Refuse phases that are no microgrids. Raises: SpecError with every fault, told once with all its phases."""
    found: dict[Fault, list[Phase]] = {}
    for phase in phases:
        for fault in _faults(phase.spec):
            found.setdefault(fault, []).append(phase)
    if found:
        raise SpecError(tuple(_in_phases(fault, name, where) for fault, where in found.items()))


def _faults(spec: bytes) -> Iterator[Fault]:
    try:
        decode_all(spec)
    except SpecError as error:
        yield from error.faults


def _in_phases(fault: Fault, name: str, phases: list[Phase]) -> Fault:
    """The fault with where it is found: in the first of these phases, and in how many more."""
    first = phases[0]
    more = f" and in {len(phases) - 1} more" if len(phases) > 1 else ""
    place = f"in phase {first.number} of scenario {name}, {first.span}{more}"
    return Fault(fault.code, fault.path, f"{fault.message} ({place})")
