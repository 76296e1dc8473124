"""Scenarios of a spec: what happens when. They are checked here; no proof of the spec itself depends on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.kernel.claims import to_text
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import REQUIRED, Reader
from certify.kernel.spec import Decoder

STARTS = ("flat", "zero", "equilibrium")
COEFFICIENTS = {"zip": ("Y", "I", "P"), "exp": ("P0", "np", "Q0", "nq")}


@dataclass(frozen=True)
class Event:
    """At a time, one DGU or line is connected or disconnected, or the first load of a node gets new coefficients.

    `position` is that in the list of the spec, which need not be in order of time. Coefficients are in SI; those that
    an event does not name stay as they are.
    """

    at_second: Fraction
    action: str  # "connect", "disconnect" or "load"
    part: str  # what `target` names: a "DGU" by its node, a "line", or a "load" by its node
    target: str
    coefficients: tuple[tuple[str, Any], ...] = ()
    position: int = 0


@dataclass(frozen=True)
class Scenario:
    """A course of events: its end, its start, the DGUs and lines that are off at first, its events in order of time.

    Events at the same time happen in the order of the spec.
    """

    name: str
    end_second: Fraction
    start: str
    disconnected: tuple[str, ...]
    events: tuple[Event, ...]


def find_faults(document: dict[str, Any]) -> tuple[Fault, ...]:
    """Everything wrong with the scenarios of a document."""
    try:
        decode_scenarios(document)
    except SpecError as error:
        return error.faults
    return ()


def decode_scenarios(document: dict[str, Any]) -> dict[str, Scenario]:
    """The scenarios of a document by name. Raises: SpecError with every fault found in them."""
    reader = _ScenarioDecoder(document)
    scenarios = reader.named(document.get("scenario", {}), "scenario", reader.scenario)
    if reader.faults:
        raise SpecError(tuple(reader.faults))
    return scenarios


class _ScenarioDecoder(Decoder):
    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(document)
        self.w0 = self.frequency(document.get("frequency"), "") or Fraction(1)
        bases = {"base_voltage": "V", "base_power": "VA"}
        self.bases(
            *(self.unit(unit, "> 0")(document[key], "") if key in document else None for key, unit in bases.items())
        )
        self.faults.clear()  # of these keys the decoder of the microgrid tells
        nodes = document.get("node")
        self.nodes: dict[str, Any] = nodes if isinstance(nodes, dict) else {}
        tables = {name: node for name, node in self.nodes.items() if isinstance(node, dict)}
        self.dgus = {name: node for name, node in tables.items() if "dgu" in node}
        loads = {name: node["load"] for name, node in tables.items() if isinstance(node.get("load"), list)}
        firsts = {name: listed[0] for name, listed in loads.items() if listed}
        self.first_loads = {name: load for name, load in firsts.items() if isinstance(load, dict)}
        lines = document.get("line")
        names = [line.get("name") for line in lines if isinstance(line, dict)] if isinstance(lines, list) else []
        self.lines = {name: None for name in names if isinstance(name, str)}

    def scenario(self, raw: object, path: str) -> Scenario | None:
        time, before = self.unit("s", "> 0"), len(self.faults)
        table = self.table(
            raw,
            path,
            {
                "end": (time, REQUIRED),
                "start": (self.one_of(STARTS), "flat"),
                "disconnected": (self.list_of(self.switched), []),
                "event": (self.list_of(self.event), []),
            },
        )
        whole = len(self.faults) == before
        listed, off = table["event"] or [], table["disconnected"] or []
        events = [replace(event, position=k) for k, event in enumerate(listed) if event]
        events.sort(key=lambda event: event.at_second)
        for event in events:
            if table["end"] and event.at_second >= table["end"]:
                place = f"{path}.event[{event.position}].at"
                self.fault("S309", place, f"an event at {to_text(event.at_second)} s is not before the end")
        if whole:  # else what cannot be read would make faults of what can
            self.follow(off, events, path)
        name = path.split(".", 1)[1]
        if table["end"] is None or table["start"] is None:
            return None
        return Scenario(name, table["end"], table["start"], tuple(filter(None, off)), tuple(events))

    def follow(self, disconnected: list[str], events: list[Event], path: str) -> None:
        """Note every event that switches what is switched so already."""
        off: set[str] = set()
        for k, name in enumerate(disconnected):
            if name in off:
                self.fault("S311", f"{path}.disconnected[{k}]", f"{shorten(name)} is named twice")
            off.add(name)
        for event in events:
            connects = event.action == "connect"
            if event.action != "load" and connects != (event.target in off):
                place = f"{path}.event[{event.position}].{event.action}"
                state = f"is {'on' if connects else 'off'} already at {to_text(event.at_second)} s"
                self.fault("S311", place, f"{event.part} {shorten(event.target)} {state}")
            if event.action != "load":
                (off.discard if connects else off.add)(event.target)

    def switched(self, raw: object, path: str) -> str | None:
        """The name of a DGU or a line, not of both."""
        name: str | None = self.one_of({**self.dgus, **self.lines}, "S306", "a DGU or line")(raw, path)
        if name in self.dgus and name in self.lines:
            self.fault("S312", path, f"both a DGU and a line are called {shorten(name)}")
            return None
        return name

    def event(self, raw: object, path: str) -> Event | None:
        actions = [key for key in ("connect", "disconnect", "load") if isinstance(raw, dict) and key in raw]
        if isinstance(raw, dict) and len(actions) != 1:
            given = f"{' and '.join(actions)} are" if actions else "none is"
            self.fault("S107", path, f"{given} given; expected exactly one of connect, disconnect, load")
            return None
        action = actions[0] if actions else "connect"
        schema: dict[str, tuple[Reader, Any]] = {"at": (self.unit("s", ">= 0"), REQUIRED)}
        if action == "load":
            schema |= {"load": (self.one_of(self.first_loads, "S306", "a node with a load"), REQUIRED)}
            schema["set"] = (self.coefficients, REQUIRED)
        else:
            schema[action] = (self.switched, REQUIRED)
        table = self.table(raw, path, schema)
        if None in table.values():
            return None
        target = table[action]
        if action != "load":
            return Event(table["at"], action, "DGU" if target in self.dgus else "line", target)
        kind = str(self.first_loads[target].get("kind"))
        if kind not in COEFFICIENTS:
            known = " and ".join(COEFFICIENTS)
            message = f"the first load of node {target} is of kind {shorten(kind)}; events change {known} loads"
            self.fault("S313", f"{path}.load", message)
            return None
        for key in table["set"]:
            if key not in COEFFICIENTS[kind]:
                self.fault("S101", f"{path}.set.{key}", f"the first load of node {target} has no such coefficient")
        return Event(table["at"], action, "load", target, tuple(sorted(table["set"].items())))

    def coefficients(self, raw: object, path: str) -> dict[str, Any] | None:
        pairs = {"Y": ("S", "S"), "I": ("A", "A"), "P": ("W", "var")}
        schema: dict[str, tuple[Reader, Any]] = {
            key: (self.pair(self.unit(a), self.unit(b)), None) for key, (a, b) in pairs.items()
        }
        schema |= {"P0": (self.unit("W"), None), "Q0": (self.unit("var"), None)}
        schema |= {"np": (self.exponent, None), "nq": (self.exponent, None)}
        before = len(self.faults)
        if raw == {}:
            self.fault("S102", path, "no coefficient is set")
        values = {key: value for key, value in self.table(raw, path, schema).items() if value is not None}
        return values if len(self.faults) == before else None
