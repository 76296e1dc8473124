"""Scenarios of a spec: what happens when, for simulations. They are checked here; proofs do not depend on them."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import REQUIRED, Reader
from certify.kernel.spec import Decoder

STARTS = ("flat", "zero", "equilibrium")
COEFFICIENTS = {"zip": ("Y", "I", "P"), "exp": ("P0", "np", "Q0", "nq")}


@dataclass(frozen=True)
class Event:
    """At a time, one DGU or line is connected or disconnected, or the first load of a node gets new coefficients."""

    at_second: Fraction
    action: str  # "connect", "disconnect" or "load"
    target: str
    coefficients: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True)
class Scenario:
    """A course of events: its end, its start, the DGUs that are off at first, and its events in order of time."""

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
        self.dgus = {name: node for name, node in self.nodes.items() if isinstance(node, dict) and "dgu" in node}
        lines = document.get("line")
        names = [line.get("name") for line in lines if isinstance(line, dict)] if isinstance(lines, list) else []
        self.lines = {name: None for name in names if isinstance(name, str)}

    def scenario(self, raw: object, path: str) -> Scenario | None:
        time = self.unit("s", "> 0")
        table = self.table(
            raw,
            path,
            {
                "end": (time, REQUIRED),
                "start": (self.one_of(STARTS), "flat"),
                "disconnected": (self.list_of(self.one_of(self.dgus, "S306", "a node with a DGU")), []),
                "event": (self.list_of(self.event), []),
            },
        )
        events = [event for event in table["event"] or [] if event]
        for event in events:
            if table["end"] and event.at_second >= table["end"]:
                self.fault("S309", f"{path}.event", f"an event at {event.at_second} s is not before the end")
        name = path.split(".", 1)[1]
        off = tuple(name for name in table["disconnected"] or [] if name)
        if table["end"] is None or table["start"] is None:
            return None
        return Scenario(name, table["end"], table["start"], off, tuple(sorted(events, key=lambda e: e.at_second)))

    def event(self, raw: object, path: str) -> Event | None:
        actions = [key for key in ("connect", "disconnect", "load") if isinstance(raw, dict) and key in raw]
        if isinstance(raw, dict) and len(actions) != 1:
            self.fault("S107", path, f"got {shorten(actions)}; expected one of connect, disconnect, load")
            return None
        action = actions[0] if actions else "connect"
        schema: dict[str, tuple[Reader, Any]] = {"at": (self.unit("s", ">= 0"), REQUIRED)}
        if action == "load":
            loaded = {name: node for name, node in self.nodes.items() if isinstance(node, dict) and node.get("load")}
            schema |= {"load": (self.one_of(loaded, "S306", "a node with a load"), REQUIRED)}
            schema["set"] = (self.coefficients, REQUIRED)
        else:
            schema[action] = (self.one_of({**self.dgus, **self.lines}, "S306", "a DGU or line"), REQUIRED)
        table = self.table(raw, path, schema)
        if None in table.values():
            return None
        loads = self.nodes[table["load"]]["load"] if action == "load" else []
        first = next((load for load in loads if isinstance(load, dict)), {})
        for key in table.get("set", {}):
            if key not in COEFFICIENTS.get(str(first.get("kind")), ()):
                self.fault(
                    "S101", f"{path}.set.{key}", f"the first load of node {table['load']} has no such coefficient"
                )
        return Event(table["at"], action, table[action], tuple(sorted(table.get("set", {}).items())))

    def coefficients(self, raw: object, path: str) -> dict[str, Any] | None:
        pairs = {"Y": ("S", "S"), "I": ("A", "A"), "P": ("W", "var")}
        schema: dict[str, tuple[Reader, Any]] = {
            key: (self.pair(self.unit(a), self.unit(b)), None) for key, (a, b) in pairs.items()
        }
        schema |= {"P0": (self.unit("W"), None), "Q0": (self.unit("var"), None)}
        schema |= {"np": (self.exponent, None), "nq": (self.exponent, None)}
        before = len(self.faults)
        values = {key: value for key, value in self.table(raw, path, schema).items() if value is not None}
        return values if len(self.faults) == before else None
