"""The spec: TOML or JSON text to frozen dataclasses in SI, strictly, with every fault reported at once.

Grammar: FORMAT.md. What the parts mean as equations is in `model`. Nothing here looks at a clock, a network or
an environment; the only input is the bytes of the file.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.linalg import Matrix
from certify.kernel.quantity import (
    Formula,
    NumberText,
    QuantityError,
    parse_formula,
    parse_quantity,
    shorten,
)

FORMAT = "certify/microgrid@1"
MAX_BYTES = 1 << 28
MAX_TOML_LINE = 20_000
MAX_STATES = 20
MAX_FAULTS = 500
Pair = tuple[Fraction, Fraction]

# 2 pi, to 100 decimals.
TWO_PI = Fraction(
    "6.2831853071795864769252867665590057683943387987502116419498891846156328125724179972560696506842341360"
)


def angular_frequency(frequency_hertz: Fraction) -> Fraction:
    """w0 = 2 pi f in rad/s, rounded to 40 significant digits: the design constant of the dq frame (THEORY 0).

    >>> float(angular_frequency(Fraction(50)))
    314.1592653589793
    """
    exact = TWO_PI * frequency_hertz
    exponent = 0
    while exact >= Fraction(10) ** (exponent + 40):
        exponent += 1
    while exact < Fraction(10) ** (exponent + 39):
        exponent -= 1
    unit = Fraction(10) ** exponent
    return round(exact / unit) * unit


@dataclass(frozen=True)
class Filter:
    resistance_ohm: Fraction
    inductance_henry: Fraction
    capacitance_farad: Fraction


@dataclass(frozen=True)
class IdaPbc:
    """Port-Hamiltonian controller with integral action; every gain is a (d, q) pair. `design` is its own plant."""

    alpha: Pair
    nu: Pair
    ki: Pair
    design: Filter
    design_w0: Fraction


@dataclass(frozen=True)
class StateFeedback:
    """u = K11 V + K12 I + K13 v with v' = V* - V; no integrator if K13 is None. 2x2 matrices."""

    K11: Matrix
    K12: Matrix
    K13: Matrix | None


@dataclass(frozen=True)
class LinearLoop:
    """Any other shifted closed loop x' = F x + B d, z = C x of a DGU, without the legs of its lines."""

    F: Matrix
    B: Matrix
    C: Matrix


@dataclass(frozen=True)
class Dgu:
    filter: Filter | None
    controller: IdaPbc | StateFeedback | LinearLoop
    reference_volt: Pair
    limits_volt: Pair | None


@dataclass(frozen=True)
class ZipLoad:
    """P = Y[0] v^2 + I[0] v + P[0] in watt; index 1 is the reactive part, in var."""

    Y: Pair
    I: Pair  # noqa: E741
    P: Pair


@dataclass(frozen=True)
class ExpLoad:
    """P = P0 (v/V0)^np, Q = Q0 (v/V0)^nq."""

    P0_watt: Fraction
    np: Fraction
    Q0_var: Fraction
    nq: Fraction
    V0_volt: Fraction


@dataclass(frozen=True)
class SeriesBranch:
    """A resistance and an inductance in series: a line, or a dynamic load to ground."""

    resistance_ohm: Fraction
    inductance_henry: Fraction


@dataclass(frozen=True)
class Node:
    """A bus; `band_volt` is where the claim on its static loads must hold, None without such loads."""

    name: str
    dgu: Dgu | None
    loads: tuple[ZipLoad | ExpLoad, ...]
    branches: tuple[SeriesBranch, ...]
    band_volt: Pair | None
    capacitance_farad: Fraction


@dataclass(frozen=True)
class Line:
    name: str
    start: str
    end: str
    branch: SeriesBranch
    capacitance_farad: Fraction


@dataclass(frozen=True)
class Microgrid:
    name: str
    w0: Fraction
    line_legs_at_dgus: bool
    nodes: tuple[Node, ...]
    lines: tuple[Line, ...]


class _Table(dict[str, Any]):
    duplicates: tuple[str, ...] = ()


def _json_object(pairs: list[tuple[str, Any]]) -> _Table:
    table = _Table(pairs)
    if len(table) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        table.duplicates = tuple(key for key, count in counts.items() if count > 1)
    return table


def read_document(data: bytes) -> dict[str, Any]:
    """The parsed TOML or JSON document, its decimals kept as text. Raises: SpecError if it cannot be parsed."""

    def refuse(code: str, message: str) -> SpecError:
        return SpecError((Fault(code, "", message),))

    if len(data) > MAX_BYTES:
        raise refuse("S003", f"file of {len(data)} bytes; at most {MAX_BYTES} are read")
    try:
        text = data.decode("utf-8-sig")
        if not text.strip():
            raise refuse("S002", "the file is empty")
        if text.lstrip().startswith("{"):
            number: Any = NumberText
            numbers = {"parse_float": number, "parse_int": number, "parse_constant": number}
            return json.loads(text, object_pairs_hook=_json_object, **numbers)  # type: ignore[no-any-return]
        for row, line in enumerate(text.split("\n"), 1):
            if len(line) > MAX_TOML_LINE or line.count(".") > MAX_TOML_LINE // 10:
                raise refuse("S003", f"line {row} is absurdly long; break it, or use JSON of the same shape")
        return tomllib.loads(text, parse_float=NumberText)
    except UnicodeDecodeError as error:
        raise refuse("S001", f"not UTF-8 text: byte {error.start} cannot be decoded") from None
    except RecursionError:
        raise refuse("S003", "nested too deeply; a spec needs no more than six levels") from None
    except ValueError as error:
        raise refuse("S002", f"not valid TOML or JSON: {error}") from None


def decode(data: bytes) -> Microgrid:
    """The microgrid that a spec file describes. Raises: SpecError with every fault found."""
    return Decoder(read_document(data)).microgrid()


Reader = Callable[[Any, str], Any]
REQUIRED = object()


def _keep(raw: Any, _: str) -> Any:
    return raw


class Decoder:
    """Reads tables by a schema {key: (reader, default)}; a bad value becomes a fault and None, and reading goes on."""

    def __init__(self, document: Any) -> None:
        self.document = document
        self.faults: list[Fault] = []
        self.per_unit: dict[str, Fraction] = {}
        self.gains: dict[tuple[str, Filter | None], IdaPbc | StateFeedback | LinearLoop | None] = {}

    # --- readers: (raw value, path) -> value or None ------------------------------------------------------

    def fault(self, code: str, path: str, message: str) -> None:
        self.faults.append(Fault(code, path, message))
        if len(self.faults) >= MAX_FAULTS:
            raise SpecError((*self.faults, Fault("S108", "", f"more than {MAX_FAULTS} faults; the rest is not listed")))

    def table(self, raw: object, path: str, schema: Mapping[str, tuple[Reader, Any]]) -> dict[str, Any]:
        """Every key of the schema, read; a fault for each key that is unknown, missing or given twice."""
        if not isinstance(raw, dict):
            self.fault("S103", path, f"expected a table, got {shorten(raw)}")
            return dict.fromkeys(schema)
        dot = f"{path}." if path else ""
        for key in getattr(raw, "duplicates", ()):
            self.fault("S104", f"{dot}{_shown(key)}", "the key is given twice")
        for key in raw:
            if key not in schema:
                self.fault("S101", f"{dot}{_shown(key)}", f"unknown key; {_near(key, schema)}")
        values = {}
        for key, (read, default) in schema.items():
            if key not in raw and default is REQUIRED:
                self.fault("S102", f"{dot}{key}", "this key is missing")
            values[key] = read(raw[key], f"{dot}{key}") if key in raw else None if default is REQUIRED else default
        return values

    def named(self, raw: object, path: str, read: Reader) -> dict[str, Any]:
        """A table whose keys are names: each entry, read."""
        if not isinstance(raw, dict):
            self.fault("S103", path, f"expected a table of tables, got {shorten(raw)}")
            return {}
        for name in getattr(raw, "duplicates", ()):
            self.fault("S104", f"{path}.{_shown(name)}", "the name is given twice")
        return {name: read(entry, self.path_of(path, name)) for name, entry in raw.items()}

    def path_of(self, key: str, name: str) -> str:
        path = f"{key}.{_shown(name)}"
        if not _NAME.fullmatch(name):
            self.fault("S105", path, "not a usable name: letters, digits, _ . : + - and inner spaces, at most 64")
        return path

    def text(self, raw: object, path: str) -> str | None:
        if isinstance(raw, str) and not isinstance(raw, NumberText) and len(raw) <= 200 and raw.isprintable():
            return raw
        self.fault("S103", path, f"expected a line of text in quotes, got {shorten(raw)}")
        return None

    def one_of(self, *words: str) -> Reader:
        def read(raw: object, path: str) -> str | None:
            if isinstance(raw, str) and raw in words:
                return raw
            self.fault("S107", path, f"got {shorten(raw)}; expected one of {', '.join(words)}")
            return None

        return read

    def attempt(self, path: str, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except QuantityError as error:
            self.fault(error.code, path, error.message)
            return None

    def unit(self, unit: str, sign: str = "") -> Reader:
        """A quantity in SI; `sign` is "> 0", ">= 0" or "" for any."""

        def read(raw: object, path: str) -> Any:
            value = self.attempt(path, lambda: parse_quantity(raw, unit, self.per_unit))
            if value is not None and sign and (value < 0 or (value == 0 and sign == "> 0")):
                self.fault(
                    "S208", path, f"must be {'positive' if sign == '> 0' else 'zero or more'}, got {shorten(raw)}"
                )
                return None
            return value

        return read

    def frequency(self, raw: object, path: str) -> Fraction | None:
        """w0 in rad/s from a frequency in hertz."""
        value = self.unit("Hz", "> 0")(raw, path)
        if value is not None and not Fraction(1, 1000) <= value <= 10**6:
            self.fault("S202", path, "outside 0.001 Hz to 1 MHz")
            return None
        return angular_frequency(value) if value else None

    def pair(self, first: Reader, second: Reader) -> Reader:
        def read(raw: object, path: str) -> Pair | None:
            if not isinstance(raw, list) or len(raw) != 2:
                self.fault("S103", path, f"expected a list of two values, got {shorten(raw)}")
                return None
            a, b = first(raw[0], f"{path}[0]"), second(raw[1], f"{path}[1]")
            return None if a is None or b is None else (a, b)

        return read

    def band(self, raw: object, path: str) -> Pair | None:
        band: Pair | None = self.pair(self.unit("V", "> 0"), self.unit("V", "> 0"))(raw, path)
        if band and band[0] >= band[1]:
            self.fault("S307", path, "the lower end is not below the upper end")
            return None
        return band

    def list_of(self, read: Reader) -> Reader:
        def read_all(raw: object, path: str) -> list[Any]:
            if not isinstance(raw, list):
                self.fault("S103", path, f"expected a list of tables, got {shorten(raw)}")
                return []
            return [read(entry, f"{path}[{k}]") for k, entry in enumerate(raw)]

        return read_all

    def reference_to(self, kind: str, known: Mapping[str, Any]) -> Reader:
        """The name of something defined elsewhere in the spec."""

        def read(raw: object, path: str) -> str | None:
            if isinstance(raw, str) and raw in known:
                return raw
            self.fault("S301" if kind == "node" else "S306", path, f"no {kind} {shorten(raw)}; {_near(raw, known)}")
            return None

        return read

    # --- the parts ----------------------------------------------------------------------------------------

    def microgrid(self) -> Microgrid:
        # Parts that refer to others are kept raw until those have been read.
        top = self.table(
            self.document,
            "",
            {
                "format": (self.one_of(FORMAT), REQUIRED),
                "name": (self.text, ""),
                "frequency": (self.frequency, REQUIRED),
                "base_voltage": (self.unit("V", "> 0"), None),
                "base_power": (self.unit("VA", "> 0"), None),
                "line_legs": (self.one_of("included", "neglected at DGUs"), "included"),
                **{key: (_keep, {}) for key in ("voltage_band", "filter", "controller", "line_type", "scenario")},
                "node": (_keep, REQUIRED),
                "line": (_keep, []),
            },
        )
        self.w0 = top["frequency"] or Fraction(1)
        self.bases(top["base_voltage"], top["base_power"])
        self.base_voltage, raw_band = top["base_voltage"], top["voltage_band"]
        self.band_volt = None if raw_band == {} else self.band(raw_band, "voltage_band")
        self.has_band = raw_band != {}
        self.filters = self.named(top["filter"], "filter", self.filter)
        self.controllers = self.named(top["controller"], "controller", self.controller)
        self.types = self.named(top["line_type"], "line_type", lambda raw, path: self.series(raw, path, "/m"))
        nodes = self.named({} if top["node"] is None else top["node"], "node", self.node)
        if not nodes and top["node"] is not None:
            self.fault("S308", "node", "the microgrid has no node")
        self.known_nodes, self.line_names = nodes, set[str]()
        lines = self.list_of(self.line)(top["line"], "line")
        if not self.faults:
            self.network(nodes, lines)
        if self.faults:
            raise SpecError(tuple(self.faults))
        return Microgrid(top["name"], self.w0, top["line_legs"] == "included", tuple(nodes.values()), tuple(lines))

    def bases(self, voltage: Fraction | None, power: Fraction | None) -> None:
        self.per_unit = {"V": voltage} if voltage else {}
        if voltage and power:
            impedance = voltage**2 / power
            self.per_unit |= {"W": power, "var": power, "VA": power, "A": power / voltage, "ohm": impedance}
            self.per_unit |= {"S": 1 / impedance, "H": impedance / self.w0, "F": 1 / (impedance * self.w0)}

    def filter(self, raw: object, path: str) -> Filter | None:
        signs = {"R": ("ohm", ">= 0"), "L": ("H", "> 0"), "C": ("F", "> 0")}
        values = self.table(raw, path, {key: (self.unit(*sign), REQUIRED) for key, sign in signs.items()})
        return None if None in values.values() else Filter(*values.values())

    def series(self, raw: object, path: str, per: str = "") -> tuple[Fraction, ...] | None:
        """R, L and C of a line, or of one metre of it."""
        signs = {"R": ("ohm", "> 0"), "L": ("H", "> 0"), "C": ("F", ">= 0")}
        values = self.table(raw, path, {key: (self.unit(u + per, sign), REQUIRED) for key, (u, sign) in signs.items()})
        return None if None in values.values() else tuple(values.values())

    def controller(self, raw: object, path: str) -> Any:
        """Checked here as far as it can be without a filter; `evaluate` does the rest for each filter."""
        before = len(self.faults)
        kind = self.one_of(*_GAINS)(raw.get("kind") if isinstance(raw, dict) else None, f"{path}.kind")
        if kind is None:
            return None
        scope = {"R", "L", "C", "w0"}
        formulas: dict[str, Formula] = {}

        def formula(raw: object, path: str) -> Any:
            parsed: Formula | None = self.attempt(path, lambda: parse_formula(raw))
            for name in sorted(parsed.names - scope) if parsed else ():
                self.fault("S206", path, f"unknown name {shorten(name)}; in scope: {', '.join(sorted(scope))}")
            return parsed

        def let(raw: object, path: str) -> None:
            for name, value in raw.items() if isinstance(raw, dict) else [("", raw)]:
                where = f"{path}.{_shown(name)}"
                if name in scope or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
                    self.fault("S105", where, "not a usable name: letters, digits and _; not R, L, C, w0")
                formulas[name] = formula(value, where)
                scope.add(name)

        def gain(raw: object, path: str) -> Any:
            rows = _GAIN_SHAPES[kind](raw)
            if rows is None:
                self.fault("S103", path, f"wrong shape: {shorten(raw)}")
                return None
            return [[formula(x, path) for x in row] for row in rows]

        design_schema = {key: (self.unit(*sign), None) for key, sign in _DESIGN.items()}

        def design(raw: object, path: str) -> dict[str, Any]:
            return self.table(raw, path, {**design_schema, "frequency": (self.frequency, None)})

        # `let` comes first in the schema, because the gains are read with its names in scope
        schema: dict[str, tuple[Reader, Any]] = {"kind": (_keep, None), "let": (let, None)}
        schema["design"] = (design, dict.fromkeys((*_DESIGN, "frequency")))
        schema |= {key: (gain, None if key == "K13" else REQUIRED) for key in _GAINS[kind]}
        values = self.table(raw, path, schema)
        gains = {key: values[key] for key in _GAINS[kind] if values[key] is not None}
        if kind == "linear" and len(gains) == 3:
            shapes = [(len(gains[key]), len(gains[key][0])) for key in "FBC"]
            n = shapes[0][0]
            if shapes != [(n, n), (n, 2), (2, n)]:
                self.fault("S103", path, f"the shapes of F, B and C do not fit together: {shapes}")
        return None if len(self.faults) > before else (kind, values["design"], formulas, gains)

    def evaluate(self, name: str, filter_: Filter | None) -> Any:
        """The controller called `name` with its formulas evaluated for one filter; faults are reported once."""
        if (name, filter_) not in self.gains:
            path = f"controller.{_shown(name)}"
            self.gains[name, filter_] = self._evaluate(path, self.controllers[name], filter_)
        return self.gains[name, filter_]

    def _evaluate(self, path: str, controller: Any, filter_: Filter | None) -> Any:
        kind, design, formulas, gains = controller
        scope = {"w0": self.w0}
        if filter_:
            scope |= {"R": filter_.resistance_ohm, "L": filter_.inductance_henry, "C": filter_.capacitance_farad}
        scope |= {"w0" if key == "frequency" else key: value for key, value in design.items() if value is not None}
        before = len(self.faults)
        for name, formula in formulas.items():
            scope[name] = self.attempt(f"{path}.let.{name}", partial(formula.evaluate, scope))
            if scope[name] is None:
                return None
        matrix = {
            key: tuple(tuple(self.attempt(f"{path}.{key}", partial(f.evaluate, scope)) for f in row) for row in rows)
            for key, rows in gains.items()
        }
        if len(self.faults) > before:
            return None
        if kind == "linear":
            return LinearLoop(matrix["F"], matrix["B"], matrix["C"])
        if kind == "state-feedback":
            return StateFeedback(matrix["K11"], matrix["K12"], matrix.get("K13"))
        if not all(matrix["nu"][0]):
            self.fault("S207", f"{path}.nu", "nu is zero, and the control law divides by it")
            return None
        own = Filter(scope["R"], scope["L"], scope["C"])
        return IdaPbc(matrix["alpha"][0], matrix["nu"][0], matrix["ki"][0], own, scope["w0"])

    def node(self, raw: object, path: str) -> Node | None:
        before = len(self.faults)
        table = self.table(
            raw,
            path,
            {
                "dgu": (self.dgu, None),
                "load": (self.list_of(self.load), []),
                "capacitance": (self.unit("F", ">= 0"), Fraction(0)),
            },
        )
        loads = [(load, band) for load, band in table["load"] or () if not isinstance(load, SeriesBranch)]
        if len(self.faults) > before or None in (band for _, band in loads):
            return None
        branches = [load for load, _ in table["load"] if isinstance(load, SeriesBranch)]
        span = (max(b[0] for _, b in loads), min(b[1] for _, b in loads)) if loads else None
        if span and span[0] >= span[1]:
            self.fault("S307", f"{path}.load", "the voltage bands of these loads have no common part")
        name = path.split(".", 1)[1]
        return Node(name, table["dgu"], tuple(x for x, _ in loads), tuple(branches), span, table["capacitance"])

    def dgu(self, raw: object, path: str) -> Dgu | None:
        volt = self.unit("V", "> 0")
        table = self.table(
            raw,
            path,
            {
                "filter": (self.reference_to("filter", self.filters), None),
                "controller": (self.reference_to("controller", self.controllers), REQUIRED),
                "reference": (self.pair(self.unit("V"), self.unit("V")), REQUIRED),
                "limits": (self.pair(volt, volt), None),
            },
        )
        if table["reference"] and not any(table["reference"]):
            self.fault("S208", f"{path}.reference", "the reference voltage must not be zero")
        name, controller = table["controller"], self.controllers.get(table["controller"])
        filter_ = self.filters.get(table["filter"])
        if controller is None or (filter_ is None and isinstance(raw, dict) and "filter" in raw):
            return None  # the fault was reported where that part is defined
        if controller[0] != "linear" and filter_ is None:
            self.fault("S102", f"{path}.filter", "this key is missing")
            return None
        evaluated = self.evaluate(name, filter_)
        return Dgu(filter_, evaluated, table["reference"], table["limits"]) if evaluated else None

    def load(self, raw: object, path: str) -> tuple[Any, Any]:
        kind = self.one_of("zip", "exp", "rl")(raw.get("kind") if isinstance(raw, dict) else None, f"{path}.kind")
        if kind is None:
            return None, None
        schema: dict[str, tuple[Reader, Any]] = {"kind": (_keep, None)}
        if kind == "rl":
            table = self.table(
                raw, path, {**schema, "R": (self.unit("ohm", "> 0"), REQUIRED), "L": (self.unit("H", "> 0"), REQUIRED)}
            )
            return SeriesBranch(table["R"], table["L"]), None
        schema["band"] = (self.band, self.band_volt)
        zero = Fraction(0)
        if kind == "zip":
            units = {"Y": ("S", "S"), "I": ("A", "A"), "P": ("W", "var")}
            schema |= {k: (self.pair(self.unit(a), self.unit(b)), (zero, zero)) for k, (a, b) in units.items()}
            table = self.table(raw, path, schema)
            load: ZipLoad | ExpLoad = ZipLoad(table["Y"], table["I"], table["P"])
            if not set(units) & set(raw):  # type: ignore[call-overload]
                self.fault("S102", path, "a zip load needs at least one of Y, I, P")
        else:
            schema |= {"P0": (self.unit("W"), REQUIRED), "np": (self.exponent, REQUIRED)}
            schema |= {"Q0": (self.unit("var"), zero), "nq": (self.exponent, zero)}
            schema["V0"] = (self.unit("V", "> 0"), self.base_voltage or REQUIRED)
            table = self.table(raw, path, schema)
            load = ExpLoad(table["P0"], table["np"], table["Q0"], table["nq"], table["V0"])
            if ("Q0" in raw) != ("nq" in raw):  # type: ignore[operator]
                self.fault("S102", path, "Q0 and nq go together")
        if table["band"] is None and not self.has_band:
            self.fault("S102", "voltage_band", f"{path} needs a band of voltages in which its claim must hold")
        return load, table["band"]

    def exponent(self, raw: object, path: str) -> Fraction | None:
        value: Fraction | None = self.unit("")(raw, path)
        if value is not None and abs(value) > 100:
            self.fault("S202", path, f"exponent {shorten(raw)} is absurd; at most 100 in size")
        return value

    def line(self, raw: object, path: str) -> Line | None:
        before = len(self.faults)
        if isinstance(raw, dict) and isinstance(raw.get("name"), str):
            path = self.path_of("line", raw["name"])
            if raw["name"] in self.line_names:
                self.fault("S303", path, "there is another line of this name")
            self.line_names.add(raw["name"])
        node = self.reference_to("node", self.known_nodes)
        ends = {"name": (self.text, REQUIRED), "from": (node, REQUIRED), "to": (node, REQUIRED)}
        if isinstance(raw, dict) and ("type" in raw or "length" in raw):
            kind, metre = (self.reference_to("line_type", self.types), REQUIRED), (self.unit("m", "> 0"), REQUIRED)
            table = self.table(raw, path, {**ends, "type": kind, "length": metre})
            per_metre, length = self.types.get(table["type"]), table["length"]
            values = [x * length for x in per_metre] if per_metre and length else None
        else:
            keys = {"R": (self.unit("ohm", "> 0"), REQUIRED), "L": (self.unit("H", "> 0"), REQUIRED)}
            keys["C"] = (self.unit("F", ">= 0"), REQUIRED)
            table = self.table(raw, path, {**ends, **keys})
            values = [table["R"], table["L"], table["C"]]
        if table["from"] is not None and table["from"] == table["to"]:
            self.fault("S302", path, "the line starts and ends at the same node")
        if len(self.faults) > before or not values:
            return None
        return Line(table["name"], table["from"], table["to"], SeriesBranch(values[0], values[1]), values[2])

    # --- the network as a whole ---------------------------------------------------------------------------

    def network(self, nodes: Mapping[str, Node], lines: list[Line]) -> None:
        legs = {name: node.capacitance_farad for name, node in nodes.items()}
        for line in lines:
            for end in (line.start, line.end):
                legs[end] += line.capacitance_farad / 2
        for name, node in nodes.items():
            if not node.dgu and not legs[name]:
                self.fault("S305", f"node.{name}", "no capacitance at this node, so its voltage is no state")
        for island in components(nodes, lines):
            if not any(nodes[name].dgu for name in island):
                shown = ", ".join(island[:6]) + (", ..." if len(island) > 6 else "")
                self.fault("S304", f"node.{island[0]}", f"no DGU among the connected nodes {shown}")


def components(names: Iterable[str], lines: Iterable[Line]) -> tuple[tuple[str, ...], ...]:
    """The connected components of the network: node names in the order of the spec."""
    neighbours: dict[str, list[str]] = {name: [] for name in names}
    for line in lines:
        neighbours[line.start].append(line.end)
        neighbours[line.end].append(line.start)
    label: dict[str, int] = {}
    groups: list[list[str]] = []
    for first in neighbours:
        stack = [] if first in label else [first]
        if stack:
            label[first] = len(groups)
            groups.append([])
        while stack:
            for other in neighbours[stack.pop()]:
                if other not in label:
                    label[other] = label[first]
                    stack.append(other)
    for name in neighbours:
        groups[label[name]].append(name)
    return tuple(tuple(group) for group in groups)


def _shown(name: str) -> str:
    """A name or key as it may stand in a path."""
    return name if _NAME.fullmatch(name) else shorten(name)


def _near(name: object, known: Iterable[str]) -> str:
    names = list(known)[:300]
    near = difflib.get_close_matches(str(name)[:60], names, 1)
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"did you mean {near[0]!r}?" if near else f"known here: {shown}" if names else "none is defined"


_NAME = re.compile(r"\w(?:[\w .:+-]{0,62}\w)?")
_DESIGN = {"R": ("ohm", ">= 0"), "L": ("H", "> 0"), "C": ("F", "> 0")}
_GAINS = {"ida-pbc": ("alpha", "nu", "ki"), "state-feedback": ("K11", "K12", "K13"), "linear": ("F", "B", "C")}


def _pair_rows(raw: object) -> list[list[Any]] | None:
    """A number, or [d, q]."""
    if isinstance(raw, list):
        return [raw] if len(raw) == 2 else None
    return [[raw, raw]]


def _square_rows(raw: object) -> list[list[Any]] | None:
    """A multiple of the identity, or [[dd, dq], [qd, qq]]."""
    if isinstance(raw, list):
        return raw if len(raw) == 2 and all(isinstance(row, list) and len(row) == 2 for row in raw) else None
    return [[raw, 0], [0, raw]]


def _rectangle_rows(raw: object) -> list[list[Any]] | None:
    """Rows of equal length, not more than MAX_STATES of either."""
    if not isinstance(raw, list) or not 0 < len(raw) <= MAX_STATES or not all(isinstance(row, list) for row in raw):
        return None
    return raw if {len(row) for row in raw} <= {len(raw[0])} & set(range(1, MAX_STATES + 1)) else None


_GAIN_SHAPES = {"ida-pbc": _pair_rows, "state-feedback": _square_rows, "linear": _rectangle_rows}
