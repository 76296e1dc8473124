"""The phases of a scenario: what a microgrid is from one event to the next, each as a spec of its own.

A DGU that is off is left out of its node, which keeps its loads and the legs of its lines; a line that is off is left
out with its capacitance; a load that is off is left out of the list of its node. What events set goes to what is off
as well. Numbers are passed on as they are written, so nothing is rounded.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import groupby, pairwise
from typing import Any

from certify.editing import to_json
from certify.inputs import decode_all
from certify.kernel.claims import to_text
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import read_document, shown
from certify.simulator.scenario import Event, Scenario, Target, decode_scenarios

MAX_TOTAL_BYTES = 1 << 28  # of the specs of all phases together
SHOWN_NAMES = 12


@dataclass(frozen=True)
class Phase:
    """A stretch of time without events: `events` are those at its start, `spec` is what there is from then on.

    `number` counts from 1, `gone` is what is off, in the order in which it was switched off, and `spec` has the format
    of a spec, as JSON. `settings`: of all references and controllers that events have set so far, also those of DGUs
    that are off, the last ones.
    """

    number: int
    start_second: Fraction
    end_second: Fraction
    events: tuple[Event, ...]
    gone: tuple[Target, ...]
    spec: bytes
    settings: tuple[Event, ...] = ()

    @property
    def off(self) -> tuple[str, ...]:
        """What is off, as text: "5", "load 0 at node 8"."""
        return tuple(map(str, self.gone))

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
    parts["node"] = {name: _own(node) for name, node in parts["node"].items()}
    gone = dict.fromkeys(scenario.disconnected)
    settings: dict[tuple[str, str], Event] = {}
    at = {time: tuple(events) for time, events in groupby(scenario.events, key=lambda event: event.at_second)}
    phases: list[Phase] = []
    total = 0
    for start, end in pairwise((*sorted({Fraction(0), *at}), scenario.end_second)):
        for event in at.get(start, ()):
            if event.action == "connect":
                del gone[event.switched]
            elif event.action == "disconnect":
                gone[event.switched] = None
            elif event.index is not None:
                parts["node"][event.target]["load"][event.index] |= listed[event.position]["set"]
            else:
                parts["node"][event.target]["dgu"][event.action] = listed[event.position]["set"]
                settings[event.action, event.target] = event
        spec = to_json(_without(parts, gone), "{\n ").encode()
        total += len(spec)
        if total > MAX_TOTAL_BYTES:
            message = f"the specs of its phases are larger than {MAX_TOTAL_BYTES} bytes together"
            raise SpecError((Fault("S003", f"scenario.{scenario.name}.event", message),))
        phases.append(Phase(len(phases) + 1, start, end, at.get(start, ()), tuple(gone), spec, (*settings.values(),)))
    return tuple(phases)


def _own(node: dict[str, Any]) -> dict[str, Any]:
    """A copy of a node in which loads and the DGU may be changed."""
    own = dict(node)
    if "load" in own:
        own["load"] = [dict(load) for load in own["load"]]
    if "dgu" in own:
        own["dgu"] = dict(own["dgu"])
    return own


def _without(parts: dict[str, Any], gone: Iterable[Target]) -> dict[str, Any]:
    """The document without what is off."""
    dgus, lines = ({target.name for target in gone if target.part == part} for part in ("DGU", "line"))
    nodes = {
        name: {key: value for key, value in node.items() if key != "dgu" or name not in dgus}
        for name, node in parts["node"].items()
    }
    for name, off in indices_of_loads(gone).items():
        nodes[name]["load"] = [load for k, load in enumerate(nodes[name]["load"]) if k not in off]
    left = [line for line in parts.get("line", []) if line["name"] not in lines]
    return {**parts, "node": nodes, **({"line": left} if "line" in parts else {})}


def indices_of_loads(gone: Iterable[Target]) -> dict[str, set[int]]:
    """Of the loads among some targets the indices, by node."""
    found: dict[str, set[int]] = {}
    for target in gone:
        if target.index is not None:
            found.setdefault(target.name, set()).add(target.index)
    return found


def series_loads(document: dict[str, Any], gone: Iterable[Target]) -> dict[str, list[int]]:
    """For each node of the spec of a phase the indices of its series R-L loads, in the spec with everything on.

    In the phase they are counted among themselves, and what is `gone` is left out: `Node.branches` are in this order.
    """
    off_at = indices_of_loads(gone)
    found = {}
    for name, node in document["node"].items():
        loads, off = node.get("load", []), off_at.get(name, set())
        indices = [k for k in range(len(loads) + len(off)) if k not in off]
        found[name] = [k for k, load in zip(indices, loads, strict=True) if load["kind"] == "rl"]
    return found


def require_microgrids(phases: tuple[Phase, ...], name: str) -> None:
    """Refuse phases that are no microgrids. Raises: SpecError with every fault, told once with all its phases."""
    found: dict[Fault, list[Phase]] = {}
    for phase in phases:
        for fault in _faults(phase):
            found.setdefault(fault, []).append(phase)
    if found:
        raise SpecError(tuple(_in_phases(fault, name, where) for fault, where in found.items()))


def _faults(phase: Phase) -> Iterator[Fault]:
    try:
        decode_all(phase.spec)
    except SpecError as error:
        for fault in error.faults:
            yield replace(fault, path=_as_written(fault.path, phase.gone))


def _as_written(path: str, gone: Iterable[Target]) -> str:
    """A path of the spec of a phase as one of the spec with everything on: the same but for the indices of loads."""
    found = re.fullmatch(r"(node\.(.+)\.load)\[(\d+)\](.*)", path, re.DOTALL)
    if found is None:
        return path
    index = int(found[3])
    off = {k for name, indices in indices_of_loads(gone).items() if shown(name) == found[2] for k in indices}
    for k in sorted(off):
        index += k <= index
    return f"{found[1]}[{index}]{found[4]}"


def _in_phases(fault: Fault, name: str, phases: list[Phase]) -> Fault:
    """The fault with where it is found: in the first of these phases, and in how many more."""
    first = phases[0]
    more = f" and in {len(phases) - 1} more" if len(phases) > 1 else ""
    place = f"in phase {first.number} of scenario {name}, {first.span}{more}"
    return Fault(fault.code, fault.path, f"{fault.message} ({place})")
