"""Scenarios of a spec: what happens when. They are checked here; no proof of the spec itself depends on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.kernel.claims import to_text
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import NumberText, shorten
from certify.kernel.reader import REQUIRED, Pair, Reader
from certify.kernel.spec import Decoder, Filter

STARTS = ("flat", "zero", "equilibrium")
ACTIONS = ("connect", "disconnect", "load", "reference", "controller")
FILTERS = ("synchronised", "discharged")
COEFFICIENTS = {"zip": ("Y", "I", "P"), "exp": ("P0", "np", "Q0", "nq"), "rl": ("R", "L")}
MAX_INDEX_DIGITS = 9


@dataclass(frozen=True)
class Target:
    """What can be switched: a "DGU" by its node, a "line" by its name, or a "load" by its node and its `index`.

    The index counts the node's list of loads as it stands in the spec, from 0, whatever is off; else it is None.
    """

    part: str
    name: str
    index: int | None = None

    def __str__(self) -> str:
        return self.name if self.index is None else f"load {self.index} at node {self.name}"


@dataclass(frozen=True)
class Event:
    """At a time, something is switched on or off, or a load, a reference or a controller is changed.

    `position` is that in the list of the spec, which need not be in order of time. What an event sets is in SI, in the
    field of its action; the others are empty. Coefficients that it does not name stay as they are.
    """

    at_second: Fraction
    action: str  # one of ACTIONS
    part: str  # what `target` and `index` name: a "DGU" by its node, a "line", or a "load" by its node and index
    target: str
    coefficients: tuple[tuple[str, Any], ...] = ()  # of "load"
    position: int = 0
    index: int | None = None  # of a load: as in `Target`
    discharged: bool = False  # of "connect": whether the filter of the DGU connects discharged, else synchronised
    reference_volt: Pair | None = None  # of "reference"
    controller: str | None = None  # of "controller": its name in the spec

    @property
    def switched(self) -> Target:
        return Target(self.part, self.target, self.index)


@dataclass(frozen=True)
class Scenario:
    """A course of events: its end, its start, what is off at first, its events in order of time.

    Events at the same time happen in the order of the spec.
    """

    name: str
    end_second: Fraction
    start: str
    disconnected: tuple[Target, ...]
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


def law_reader(document: dict[str, Any]) -> Callable[[str, Filter | None], Any]:
    """Reads the controller of that name as a DGU with that filter has it; None if its formulas have no value there.

    `document` is what `read_document` returns for a spec without faults.
    """
    decoder = _ScenarioDecoder(document)
    decoder.controllers = {}

    def read(name: str, filter_: Filter | None) -> Any:
        if name not in decoder.controllers:
            decoder.controllers[name] = decoder.controller(document["controller"][name], "controller")
        law = decoder.evaluate(name, filter_)
        decoder.faults.clear()
        return law

    return read


class _ScenarioDecoder(Decoder):
    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(document)
        self.w0 = self.frequency(document.get("frequency"), "") or Fraction(1)
        bases = {"base_voltage": "V", "base_power": "VA"}
        self.bases(
            *(self.unit(unit, "> 0")(document[key], "") if key in document else None for key, unit in bases.items())
        )
        self.faults.clear()  # of these keys the decoder of the microgrid tells
        tables = {name: node for name, node in _table(document.get("node")).items() if isinstance(node, dict)}
        self.dgus = {name: _table(node["dgu"]) for name, node in tables.items() if "dgu" in node}
        loads = {name: node.get("load") for name, node in tables.items()}
        self.loads: dict[str, list[Any]] = {name: x for name, x in loads.items() if isinstance(x, list) and x}
        lines = document.get("line")
        names = [line.get("name") for line in lines if isinstance(line, dict)] if isinstance(lines, list) else []
        self.lines = {name: None for name in names if isinstance(name, str)}
        self.known = {**self.dgus, **self.lines}
        laws = {name: _table(law) for name, law in _table(document.get("controller")).items()}
        # The number of states of a linear loop; None if it cannot be told, then another decoder does.
        self.states = {name: len(law["F"]) if isinstance(law.get("F"), list) else None for name, law in laws.items()}
        self.kinds = {name: law.get("kind") for name, law in laws.items()}

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

    def follow(self, disconnected: list[Target], events: list[Event], path: str) -> None:
        """Note every event that switches what is switched so already."""
        off: set[Target] = set()
        for k, target in enumerate(disconnected):
            if target in off:
                self.fault("S311", f"{path}.disconnected[{k}]", f"{_told(target)} is named twice")
            off.add(target)
        for event in events:
            if event.action not in ("connect", "disconnect"):
                continue
            connects, target = event.action == "connect", event.switched
            if connects != (target in off):
                place = f"{path}.event[{event.position}].{event.action}"
                state = f"is {'on' if connects else 'off'} already at {to_text(event.at_second)} s"
                self.fault("S311", place, f"{_told(target)} {state}")
            (off.discard if connects else off.add)(target)

    def switched(self, raw: object, path: str) -> Target | None:
        """The name of a DGU or a line, not of both; or the node and the index of a load."""
        if isinstance(raw, dict):
            table = self.table(raw, path, self.one_load("load"))
            return None if None in table.values() else self.load_at(table["load"], table["index"], path)
        name: str | None = self.one_of(self.known, "S306", "a DGU or line")(raw, path)
        if name in self.dgus and name in self.lines:
            self.fault("S312", path, f"both a DGU and a line are called {shorten(name)}")
            return None
        return name and Target("DGU" if name in self.dgus else "line", name)  # type: ignore[return-value]

    def one_load(self, key: str) -> dict[str, tuple[Reader, Any]]:
        return {key: (self.one_of(self.loads, "S306", "a node with a load"), REQUIRED), "index": (self.index, 0)}

    def index(self, raw: object, path: str) -> int | None:
        whole = (isinstance(raw, int) and not isinstance(raw, bool) and 0 <= raw < 10**MAX_INDEX_DIGITS) or (
            isinstance(raw, NumberText) and raw.isascii() and raw.isdigit() and len(raw) <= MAX_INDEX_DIGITS
        )
        if not whole:
            self.fault("S314", path, f"expected a whole number from 0 up, got {shorten(raw)}")
        return int(raw) if whole else None  # type: ignore[call-overload]

    def load_at(self, name: str, index: int, path: str) -> Target | None:
        count = len(self.loads[name])
        if index < count:
            return Target("load", name, index)
        listed = f"{count} loads, 0 to {count - 1}" if count > 1 else "one load, 0"
        self.fault("S314", f"{path}.index", f"there is no load {index}: node {shorten(name)} has {listed}")
        return None

    def event(self, raw: object, path: str) -> Event | None:
        actions = [key for key in ACTIONS if isinstance(raw, dict) and key in raw]
        if isinstance(raw, dict) and len(actions) != 1:
            given = f"{' and '.join(actions)} are" if actions else "none is"
            self.fault("S107", path, f"{given} given; expected exactly one of {', '.join(ACTIONS)}")
            return None
        action = actions[0] if actions else "connect"
        schema: dict[str, tuple[Reader, Any]] = {"at": (self.unit("s", ">= 0"), REQUIRED)}
        if action == "load":
            schema |= {**self.one_load("load"), "set": (self.coefficients, REQUIRED)}
        elif action in ("connect", "disconnect"):
            schema[action] = (self.switched, REQUIRED)
            schema |= {"filter": (self.one_of(FILTERS), FILTERS[0])} if action == "connect" else {}
        else:
            schema[action] = (self.one_of(self.dgus, "S306", "a node with a DGU"), REQUIRED)
            new = self.reference if action == "reference" else self.one_of(self.kinds, "S306", "a controller")
            schema["set"] = (new, REQUIRED)
        table = self.table(raw, path, schema)
        if None in table.values():
            return None
        at, target = table["at"], table[action]
        if action == "load":
            return self.load_event(at, target, table["index"], table["set"], path)
        if action == "reference":
            return Event(at, action, "DGU", target, reference_volt=table["set"])
        if action == "controller":
            fits = self.may_replace(target, table["set"], f"{path}.set")
            return Event(at, action, "DGU", target, controller=table["set"]) if fits else None
        if "filter" in raw and target.part != "DGU":  # type: ignore[operator]
            self.fault("S101", f"{path}.filter", f"only a DGU connects with a filter, and this is a {target.part}")
            return None
        discharged = table.get("filter") == "discharged"
        return Event(at, action, target.part, target.name, index=target.index, discharged=discharged)

    def kind_at(self, name: str) -> object:
        """The kind of the controller of the DGU at a node, as the spec gives it; None if it cannot be told."""
        law = self.dgus[name].get("controller")
        return self.kinds.get(law) if isinstance(law, str) else None

    def may_replace(self, name: str, new: str, path: str) -> bool:
        """Whether a DGU may change to this controller: the states of a linear loop stay, and it has no others."""
        old = self.dgus[name].get("controller")
        kinds = (self.kind_at(name), self.kinds[new])
        if not all(isinstance(kind, str) for kind in kinds) or "linear" not in kinds:
            return True  # a kind that cannot be told is a fault of that controller
        if kinds[0] != kinds[1]:
            told = f"{shorten(new)} is {shorten(kinds[1])}, and {shorten(old)} is {shorten(kinds[0])}"
            self.fault("S315", path, f"{told}, which node {shorten(name)} has")
            return False
        counts = [self.states[str(law)] for law in (old, new)]
        if None in counts or counts[0] == counts[1]:
            return True
        told = f"{shorten(new)} has {counts[1]} states, and {shorten(old)} has {counts[0]}"
        self.fault("S315", path, f"{told}, which node {shorten(name)} has")
        return False

    def load_event(self, at: Fraction, name: str, index: int, given: dict[str, Any], path: str) -> Event | None:
        if self.load_at(name, index, path) is None or not isinstance(self.loads[name][index], dict):
            return None  # what is no load at all is a fault of its node
        kind, load = self.loads[name][index].get("kind"), _told(Target("load", name, index))
        if not isinstance(kind, str) or kind not in COEFFICIENTS:
            known = ", ".join(COEFFICIENTS)
            message = f"{load} is of kind {shorten(kind)}; events change loads of kind {known}"
            self.fault("S313", f"{path}.load", message)
            return None
        for key in given:
            if key not in COEFFICIENTS[kind]:
                self.fault("S101", f"{path}.set.{key}", f"{load} has no such coefficient")
        return Event(at, "load", "load", name, tuple(sorted(given.items())), index=index)

    def reference(self, raw: object, path: str) -> Pair | None:
        volts: Pair | None = self.pair(self.unit("V"), self.unit("V"))(raw, path)
        if volts and not any(volts):
            self.fault("S208", path, "the reference voltage must not be zero")
            return None
        return volts

    def coefficients(self, raw: object, path: str) -> dict[str, Any] | None:
        pairs = {"Y": ("S", "S"), "I": ("A", "A"), "P": ("W", "var")}
        schema: dict[str, tuple[Reader, Any]] = {
            key: (self.pair(self.unit(a), self.unit(b)), None) for key, (a, b) in pairs.items()
        }
        schema |= {"P0": (self.unit("W"), None), "Q0": (self.unit("var"), None)}
        schema |= {"R": (self.unit("ohm", "> 0"), None), "L": (self.unit("H", "> 0"), None)}
        schema |= {"np": (self.exponent, None), "nq": (self.exponent, None)}
        before = len(self.faults)
        if raw == {}:
            self.fault("S102", path, "no coefficient is set")
        values = {key: value for key, value in self.table(raw, path, schema).items() if value is not None}
        return values if len(self.faults) == before else None


def _table(raw: object) -> dict[str, Any]:
    """A table, or an empty one in place of what is none: of that the decoder of the microgrid tells."""
    return raw if isinstance(raw, dict) else {}


def _told(target: Target) -> str:
    name = shorten(target.name)
    return f"{target.part} {name}" if target.index is None else f"load {target.index} at node {name}"
