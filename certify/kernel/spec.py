"""The spec: TOML or JSON text to frozen dataclasses in SI, strictly, with every fault reported at once.

Grammar: FORMAT.md. What the parts mean as equations is in `model`. Nothing here looks at a clock, a network or
an environment; the only input is the bytes of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

from certify.kernel.currents import CurrentLaw, current_law
from certify.kernel.errors import Fault, SpecError
from certify.kernel.linalg import Matrix, rank
from certify.kernel.quantity import Formula, QuantityError, parse_formula, parse_quantity, shorten
from certify.kernel.reader import REQUIRED, Pair, Reader, Schema, TableReader, keep, read_document, shown

FORMAT = "certify/microgrid@1"
MAX_STATES = 20

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


NO_TOLERANCE = (Fraction(0),) * 3


@dataclass(frozen=True)
class Filter:
    """`tolerance`: how far R, L and C may be off, as shares of their values."""

    resistance_ohm: Fraction
    inductance_henry: Fraction
    capacitance_farad: Fraction
    tolerance: tuple[Fraction, ...] = NO_TOLERANCE


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
class ConstantVoltage:
    """The terminal voltage is the reference, without feedback: an inverter in open loop, or one held at its limits."""


@dataclass(frozen=True)
class Dgu:
    """`anti_windup_second`: the time constant with which integrators follow what an axis at its limit applies."""

    filter: Filter | None
    controller: IdaPbc | StateFeedback | LinearLoop | ConstantVoltage
    reference_volt: Pair
    limits_volt: Pair | None
    anti_windup_second: Fraction | None = None


@dataclass(frozen=True)
class ZipLoad:
    """P = Y[0] v^2 + I[0] v + P[0] in watt; index 1 is the reactive part, in var. `tolerance`: of Y, I, P.

    Below `cutoff_volt`, if there is one, a load is the constant impedance that it is there.
    """

    Y: Pair
    I: Pair  # noqa: E741
    P: Pair
    tolerance: tuple[Fraction, ...] = NO_TOLERANCE
    cutoff_volt: Fraction | None = None


@dataclass(frozen=True)
class ExpLoad:
    """P = P0 (v/V0)^np, Q = Q0 (v/V0)^nq. `tolerance`: of P0, Q0; `cutoff_volt` as for a ZIP load."""

    P0_watt: Fraction
    np: Fraction
    Q0_var: Fraction
    nq: Fraction
    V0_volt: Fraction
    tolerance: tuple[Fraction, ...] = NO_TOLERANCE
    cutoff_volt: Fraction | None = None


@dataclass(frozen=True)
class CurrentLoad:
    """A load given by its current as a rational function of (Vd, Vq), for voltages in a disk."""

    law: CurrentLaw
    centre_volt: Pair
    radius_volt: Fraction


@dataclass(frozen=True)
class SeriesBranch:
    """A resistance and an inductance in series: a line, or a dynamic load to ground. `tolerance`: of R, L."""

    resistance_ohm: Fraction
    inductance_henry: Fraction
    tolerance: tuple[Fraction, ...] = NO_TOLERANCE[:2]


@dataclass(frozen=True)
class Node:
    """A bus; `band_volt` is where the claim on its static loads must hold, None without such loads.

    With a load given by its `current` the claim is about the disk of that one, and `band_volt` is None.
    """

    name: str
    dgu: Dgu | None
    loads: tuple[ZipLoad | ExpLoad, ...]
    branches: tuple[SeriesBranch, ...]
    band_volt: Pair | None
    capacitance_farad: Fraction
    current: CurrentLoad | None = None

    @property
    def has_static_load(self) -> bool:
        return self.band_volt is not None or self.current is not None


@dataclass(frozen=True)
class Line:
    name: str
    start: str
    end: str
    branch: SeriesBranch
    capacitance_farad: Fraction
    capacitance_tolerance: Fraction = Fraction(0)


@dataclass(frozen=True)
class Microgrid:
    name: str
    w0: Fraction
    line_legs_at_dgus: bool
    nodes: tuple[Node, ...]
    lines: tuple[Line, ...]


def decode(data: bytes) -> Microgrid:
    """The microgrid that a spec file describes. Raises: SpecError with every fault found."""
    return decode_document(read_document(data))


def decode_document(document: Any) -> Microgrid:
    """As `decode`, for a document that has been parsed already."""
    try:
        return Decoder(document).microgrid()
    except RecursionError:
        raise SpecError((Fault("S003", "", "nested too deeply; a spec needs no more than six levels"),)) from None


class Decoder(TableReader):
    """Reads the parts of a spec; a part with a fault becomes None, and reading goes on."""

    def __init__(self, document: Any) -> None:
        super().__init__()
        self.document = document
        self.gains: dict[tuple[str, Filter | None], IdaPbc | StateFeedback | LinearLoop | ConstantVoltage | None] = {}

    def frequency(self, raw: object, path: str) -> Fraction | None:
        """w0 in rad/s from a frequency in hertz."""
        value = self.unit("Hz", "> 0")(raw, path)
        if value is not None and not Fraction(1, 1000) <= value <= 10**6:
            self.fault("S202", path, "outside 0.001 Hz to 1 MHz")
            return None
        return angular_frequency(value) if value else None

    def band(self, raw: object, path: str) -> Pair | None:
        band: Pair | None = self.pair(self.unit("V", "> 0"), self.unit("V", "> 0"))(raw, path)
        if band and band[0] >= band[1]:
            self.fault("S307", path, "the lower end is not below the upper end")
            return None
        return band

    def share(self, raw: object, path: str) -> Fraction | None:
        """A tolerance: at least zero, and below one, so that no value of the box is zero."""
        try:
            value = parse_quantity(raw, "", {})
        except QuantityError as error:
            if error.code == "S202":
                self.fault("S202", path, error.message)
                return None
            value = Fraction(-1)
        if 0 <= value < 1:
            return value
        reason = "a tolerance of 100 % or more lets the value be zero" if value >= 1 else "not a share of the value"
        self.fault("S209", path, f'{reason}: {shorten(raw)}; write for example "10 %"')
        return None

    def tolerance(self, keys: str, default: Sequence[Fraction]) -> tuple[Reader, Any]:
        """A share for all of these keys, or a table with a share for some; the others have the default."""
        names = keys.split()

        def read(raw: object, path: str) -> tuple[Fraction, ...] | None:
            if isinstance(raw, dict):
                schema = {key: (self.share, share) for key, share in zip(names, default, strict=True)}
                shares = list(self.table(raw, path, schema).values())
            else:
                shares = [self.share(raw, path)] * len(names)
            return None if None in shares else tuple(shares)

        return read, tuple(default)

    def common_share(self, kind: str, count: int) -> list[Fraction]:
        return [self.common_tolerance.get(kind) or Fraction(0)] * count

    def common(self, raw: object, path: str) -> dict[str, Any]:
        """The tolerances of all filters, lines and loads that have none of their own."""
        kinds = ("filter", "line", "load")
        if isinstance(raw, dict):
            return self.table(raw, path, {kind: (self.share, Fraction(0)) for kind in kinds})
        return dict.fromkeys(kinds, self.share(raw, path))

    def impedances(self, resistance: str, capacitance: str, per: str = "", default: Any = REQUIRED) -> Schema:
        signs = {"R": ("ohm", resistance), "L": ("H", "> 0"), "C": ("F", capacitance)}
        return {key: (self.unit(unit + per, sign), default) for key, (unit, sign) in signs.items()}

    def microgrid(self) -> Microgrid:
        # Parts that refer to others are kept raw until those have been read.
        schema: dict[str, tuple[Reader, Any]] = {
            "format": (self.one_of([FORMAT]), REQUIRED),
            "name": (self.text, ""),
            "frequency": (self.frequency, REQUIRED),
            "base_voltage": (self.unit("V", "> 0"), None),
            "base_power": (self.unit("VA", "> 0"), None),
            "tolerance": (self.common, dict.fromkeys(("filter", "line", "load"), Fraction(0))),
            "line_legs": (self.one_of(["included", "neglected at DGUs"]), "included"),
            **{key: (keep, {}) for key in ("filter", "controller", "line_type", "scenario")},
            **{key: (keep, default) for key, default in (("voltage_band", None), ("node", REQUIRED), ("line", []))},
        }
        top = self.table(self.document, "", schema)
        self.w0 = top["frequency"] or Fraction(1)
        faulty = Fraction(1) if "base_voltage" in self.document and not top["base_voltage"] else None
        self.bases(top["base_voltage"] or faulty, top["base_power"])
        self.base_voltage, self.common_tolerance = top["base_voltage"], top["tolerance"] or {}
        self.common_band = REQUIRED if top["voltage_band"] is None else self.band(top["voltage_band"], "voltage_band")
        self.filters = self.named(top["filter"], "filter", self.filter)
        self.controllers = self.named(top["controller"], "controller", self.controller)
        self.types = self.named(top["line_type"], "line_type", self.line_type)
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
        tolerance = self.tolerance("R L C", self.common_share("filter", 3))
        values = self.table(raw, path, {**self.impedances(">= 0", "> 0"), "tolerance": tolerance})
        return None if None in values.values() else Filter(*values.values())

    def line_type(self, raw: object, path: str) -> dict[str, Any]:
        tolerance = self.tolerance("R L C", self.common_share("line", 3))
        return self.table(raw, path, {**self.impedances("> 0", ">= 0", "/m"), "tolerance": tolerance})

    def controller(self, raw: object, path: str) -> Any:
        """Checked here as far as it can be without a filter; `evaluate` does the rest for each filter."""
        before = len(self.faults)
        kind = self.one_of(_GAINS)(raw.get("kind") if isinstance(raw, dict) else None, f"{path}.kind")
        if kind is None:
            return None
        scope = {"R", "L", "C", "w0"}
        formulas: dict[str, Formula] = {}

        def formula(raw: object, path: str) -> Any:
            parsed = self.formula(raw, path)
            for name in sorted(parsed.names - scope) if parsed else ():
                self.fault("S206", path, f"unknown name {shorten(name)}; in scope: {', '.join(sorted(scope))}")
            return parsed

        def let(raw: object, path: str) -> None:
            for name, value in raw.items() if isinstance(raw, dict) else [("", raw)]:
                where = f"{path}.{shown(name)}"
                if name in scope or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
                    self.fault("S105", where, "not a usable name: letters, digits and _; not R, L, C, w0")
                formulas[name] = formula(value, where)
                scope.add(name)

        def gain(raw: object, path: str) -> Any:
            rows = _GAINS[kind][1](raw)
            if rows is None:
                self.fault("S103", path, f"expected {_SHAPES[kind]}, got {_size(raw)}")
                return None
            return [[formula(x, at(path, i, j)) for j, x in enumerate(row)] for i, row in enumerate(rows)]

        def at(path: str, i: int, j: int) -> str:
            return f"{path}[{i}][{j}]" if kind == "linear" else path

        def design(raw: object, path: str) -> dict[str, Any]:
            own = {**self.impedances(">= 0", "> 0", default=None), "frequency": (self.frequency, None)}
            values = self.table(raw, path, own)
            return {"w0" if key == "frequency" else key: x for key, x in values.items() if x is not None}

        keys = _GAINS[kind][0]  # read after `let`, with its names in scope
        schema: dict[str, tuple[Reader, Any]] = {"kind": (keep, None)}
        schema |= {"let": (let, None), "design": (design, {})} if keys else {}
        schema |= {key: (gain, None if key == "K13" else REQUIRED) for key in keys}
        values = self.table(raw, path, schema)
        gains = {key: values[key] for key in keys if values[key] is not None}
        if kind == "linear" and len(gains) == 3:
            shapes = [(len(gains[key]), len(gains[key][0])) for key in "FBC"]
            n = shapes[0][0]
            if shapes != [(n, n), (n, 2), (2, n)]:
                listed = ", ".join(f"{key} is {m} x {k}" for key, (m, k) in zip("FBC", shapes, strict=True))
                self.fault("S103", path, f"F must be n x n, B n x 2 and C 2 x n, but {listed}")
        return None if len(self.faults) > before else (kind, values.get("design", {}), formulas, gains)

    def evaluate(self, name: str, filter_: Filter | None) -> Any:
        """The controller called `name` with its formulas evaluated for one filter; faults are reported once."""
        if (name, filter_) not in self.gains:
            path = f"controller.{shown(name)}"
            self.gains[name, filter_] = self._evaluate(path, self.controllers[name], filter_)
        return self.gains[name, filter_]

    def _evaluate(self, path: str, controller: Any, filter_: Filter | None) -> Any:
        kind, design, formulas, gains = controller
        scope, before = {"w0": self.w0}, len(self.faults)
        if filter_:
            scope |= {"R": filter_.resistance_ohm, "L": filter_.inductance_henry, "C": filter_.capacitance_farad}
        scope |= design
        for name, formula in formulas.items():
            scope[name] = self.attempt(f"{path}.let.{name}", partial(formula.evaluate, scope))
            if scope[name] is None:
                return None

        def value(formula: Formula, key: str, i: int, j: int) -> Any:
            where = f"{path}.{key}[{i}][{j}]" if kind == "linear" else f"{path}.{key}"
            return self.attempt(where, partial(formula.evaluate, scope))

        matrix = {
            key: tuple(tuple(value(f, key, i, j) for j, f in enumerate(row)) for i, row in enumerate(rows))
            for key, rows in gains.items()
        }
        if kind == "ida-pbc" and 0 in matrix["nu"][0]:
            self.fault("S207", f"{path}.nu", "nu is zero, and the control law divides by it")
        if len(self.faults) > before:
            return None
        if kind == "constant":
            return ConstantVoltage()
        if kind == "linear":
            return LinearLoop(matrix["F"], matrix["B"], matrix["C"])
        if kind == "state-feedback":
            return StateFeedback(matrix["K11"], matrix["K12"], matrix.get("K13"))
        own = Filter(scope["R"], scope["L"], scope["C"])
        return IdaPbc(matrix["alpha"][0], matrix["nu"][0], matrix["ki"][0], own, scope["w0"])

    def node(self, raw: object, path: str) -> Node | None:
        before = len(self.faults)
        schema: Schema = {
            "dgu": (self.dgu, None),
            "load": (self.list_of(self.load), []),
            "capacitance": (self.unit("F", ">= 0"), Fraction(0)),
        }
        table = self.table(raw, path, schema)
        loads = [(x, band) for x, band in table["load"] or () if not isinstance(x, SeriesBranch | CurrentLoad)]
        if len(self.faults) > before or None in (band for _, band in loads):
            return None
        currents = [load for load, _ in table["load"] if isinstance(load, CurrentLoad)]
        branches = tuple(load for load, _ in table["load"] if isinstance(load, SeriesBranch))
        # A load with a cut-off has a law below its band too.
        lows = [Fraction(0) if load.cutoff_volt is not None else band[0] for load, band in loads]
        span = (max(lows), min(b[1] for _, b in loads)) if loads else None
        if span and span[0] >= span[1]:
            self.fault("S307", f"{path}.load", "the voltage bands of these loads have no common part")
        name, static = path.split(".", 1)[1], tuple(x for x, _ in loads)
        if currents:
            self.disk(currents, static, span, f"{path}.load")
        band = None if currents else span
        return Node(name, table["dgu"], static, branches, band, table["capacitance"], *currents[:1])

    def disk(
        self, currents: list[CurrentLoad], others: Sequence[ZipLoad | ExpLoad], span: Pair | None, path: str
    ) -> None:
        """Beside a load given by its current: constant admittances and powers only, its disk in their band."""
        if len(currents) > 1:
            self.fault("S310", path, "two loads given by their currents; add their formulas up")
        for load in others:
            plain = not any(load.I) if isinstance(load, ZipLoad) else {load.np, load.nq} <= {0, 2}
            if not plain or any(load.tolerance) or load.cutoff_volt is not None:
                allowed = "only constant admittances and powers may stand"
                self.fault("S310", path, f"beside a load given by its current {allowed}")
        size, radius = sum(x * x for x in currents[0].centre_volt), currents[0].radius_volt
        if span and not ((span[0] + radius) ** 2 <= size and radius < span[1] and size <= (span[1] - radius) ** 2):
            self.fault("S310", path, "the disk reaches out of the voltage band of another load")

    def dgu(self, raw: object, path: str) -> Dgu | None:
        schema: Schema = {
            "filter": (self.one_of(self.filters, "S306", "a filter"), None),
            "controller": (self.one_of(self.controllers, "S306", "a controller"), REQUIRED),
            "reference": (self.pair(self.unit("V"), self.unit("V")), REQUIRED),
            "limits": (self.pair(self.unit("V", "> 0"), self.unit("V", "> 0")), None),
            "anti_windup": (self.unit("s", "> 0"), None),
        }
        table = self.table(raw, path, schema)
        if table["reference"] and not any(table["reference"]):
            self.fault("S208", f"{path}.reference", "the reference voltage must not be zero")
        controller, filter_ = self.controllers.get(table["controller"]), self.filters.get(table["filter"])
        if controller is None or (filter_ is None and isinstance(raw, dict) and "filter" in raw):
            return None  # the fault was reported where that part is defined
        if controller[0] != "linear" and filter_ is None:
            self.fault("S102", f"{path}.filter", "this key is missing")
            return None
        if controller[0] == "linear" and filter_ and any(filter_.tolerance):
            self.fault("S210", f"{path}.filter", "a tolerance has no meaning for a linear loop: its F holds the plant")
            return None
        evaluated = self.evaluate(table["controller"], filter_)
        if isinstance(raw, dict) and "anti_windup" in raw:
            if "limits" not in raw:
                self.fault("S212", f"{path}.anti_windup", "this DGU has no limits, so it never winds up")
            if evaluated and not integrates(evaluated):
                self.fault("S212", f"{path}.anti_windup", "the integral gain of its controller cannot be inverted")
        return Dgu(filter_, evaluated, *list(table.values())[2:]) if evaluated else None

    def load(self, raw: Any, path: str) -> tuple[ZipLoad | ExpLoad | CurrentLoad | SeriesBranch | None, Any]:
        """A load, and for a static one the band in which its claim must hold."""
        kinds = ("zip", "exp", "rl", "current")
        kind = self.one_of(kinds)(raw.get("kind") if isinstance(raw, dict) else None, f"{path}.kind")
        if kind is None:
            return None, None
        schema: dict[str, tuple[Reader, Any]] = {"kind": (keep, None)}
        if kind == "rl":
            schema |= {key: value for key, value in self.impedances("> 0", "").items() if key != "C"}
            table = self.table(raw, path, {**schema, "tolerance": self.tolerance("R L", self.common_share("load", 2))})
            return SeriesBranch(table["R"], table["L"], table["tolerance"]), None
        if kind == "current":
            volts = self.pair(self.unit("V"), self.unit("V"))
            schema |= {"I": (self.pair(self.formula, self.formula), REQUIRED), "centre": (volts, REQUIRED)}
            table = self.table(raw, path, {**schema, "radius": (self.unit("V", "> 0"), REQUIRED)})
            if None in table.values():
                return None, None
            law = self.attempt(f"{path}.I", lambda: current_law(*table["I"]))
            return CurrentLoad(law, table["centre"], table["radius"]) if law else None, None
        schema["band"] = (self.band, None if self.common_band is REQUIRED else self.common_band)
        if self.common_band is REQUIRED and "band" not in raw:
            what_to_do = "give this load a band, or the microgrid a voltage_band"
            self.fault("S102", f"{path}.band", f"no voltage band: {what_to_do}")
        schema["below"] = (self.one_of(["constant-impedance"]), None)
        zero = Fraction(0)
        if kind == "zip":
            units = {"Y": ("S", "S"), "I": ("A", "A"), "P": ("W", "var")}
            schema |= {key: (self.pair(self.unit(a), self.unit(b)), (zero, zero)) for key, (a, b) in units.items()}
            schema["tolerance"] = self.tolerance("Y I P", self.common_share("load", 3))
            table = self.table(raw, path, schema)
            if not units.keys() & raw.keys():
                self.fault("S102", path, "a zip load needs at least one of Y, I, P")
            return self.with_band(ZipLoad(table["Y"], table["I"], table["P"], table["tolerance"]), table)
        schema |= {"P0": (self.unit("W"), REQUIRED), "np": (self.exponent, REQUIRED)}
        schema |= {"Q0": (self.unit("var"), zero), "nq": (self.exponent, zero)}
        schema["V0"] = (self.unit("V", "> 0"), self.base_voltage or REQUIRED)
        schema["tolerance"] = self.tolerance("P0 Q0", self.common_share("load", 2))
        table = self.table(raw, path, schema)
        if ("Q0" in raw) != ("nq" in raw):
            self.fault("S102", path, "Q0 and nq go together")
        values = [table[key] for key in ("P0", "np", "Q0", "nq", "V0", "tolerance")]
        return self.with_band(ExpLoad(*values), table)

    def with_band(self, load: ZipLoad | ExpLoad, table: dict[str, Any]) -> tuple[ZipLoad | ExpLoad, Any]:
        """A load and its band, the lower end of which is its cut-off if it is to be an impedance below."""
        band = table["band"]
        return (replace(load, cutoff_volt=band[0]) if table["below"] and band not in (None, REQUIRED) else load), band

    def formula(self, raw: object, path: str) -> Formula | None:
        return self.attempt(path, lambda: parse_formula(raw))  # type: ignore[no-any-return]

    def exponent(self, raw: object, path: str) -> Fraction | None:
        value: Fraction | None = self.unit("")(raw, path)
        if value is not None and abs(value) > 100:
            self.fault("S202", path, f"exponent {shorten(raw)} is absurd; at most 100 in size")
        return value

    def line(self, raw: object, path: str) -> Line | None:
        before, table = len(self.faults), raw if isinstance(raw, dict) else {}
        if isinstance(table.get("name"), str):
            path = self.path_of("line", table["name"])
            if table["name"] in self.line_names:
                self.fault("S303", path, "there is another line of this name")
            self.line_names.add(table["name"])
        node = self.one_of(self.known_nodes, "S301", "a node")
        schema: dict[str, tuple[Reader, Any]] = {"name": (self.text, REQUIRED), "from": (node, REQUIRED)}
        schema["to"] = (node, REQUIRED)
        by_type = "type" in table or "length" in table
        if by_type:
            schema["type"] = (self.one_of(self.types, "S306", "a line_type"), REQUIRED)
            schema["length"] = (self.unit("m", "> 0"), REQUIRED)
        else:
            schema |= self.impedances("> 0", ">= 0")
        of_type = (self.types.get(table["type"]) or {}).get("tolerance") if isinstance(table.get("type"), str) else None
        schema["tolerance"] = self.tolerance("R L C", of_type or self.common_share("line", 3))
        table = self.table(raw, path, schema)
        if table["from"] is not None and table["from"] == table["to"]:
            self.fault("S302", path, "the line starts and ends at the same node")
        per_metre = self.types.get(table["type"], {}) if by_type else table
        if len(self.faults) > before or None in per_metre.values():
            return None
        R, L, C = (per_metre[key] * (table["length"] if by_type else 1) for key in "RLC")
        off = table["tolerance"]
        return Line(table["name"], table["from"], table["to"], SeriesBranch(R, L, off[:2]), C, off[2])

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
                listed = ", ".join(island[:6]) + (", ..." if len(island) > 6 else "")
                self.fault("S304", f"node.{island[0]}", f"no DGU among the connected nodes {listed}")


def integrates(law: IdaPbc | StateFeedback | LinearLoop | ConstantVoltage) -> bool:
    """Whether the integral gain K13 of a law is there and can be inverted."""
    energy_shaping = isinstance(law, IdaPbc) and all((*law.alpha, *law.ki))  # then K13 = -(alpha/nu) ki
    return energy_shaping or (isinstance(law, StateFeedback) and law.K13 is not None and rank(law.K13, 2) == 2)


def components(names: Iterable[str], lines: Iterable[Line]) -> tuple[tuple[str, ...], ...]:
    """The connected components of the network: node names in the order of the spec."""
    parent = {name: name for name in names}

    def root(name: str) -> str:
        while parent[name] != name:
            parent[name] = parent[parent[name]]
            name = parent[name]
        return name

    for line in lines:
        parent[root(line.end)] = root(line.start)
    groups: dict[str, list[str]] = {}
    for name in parent:
        groups.setdefault(root(name), []).append(name)
    return tuple(tuple(group) for group in groups.values())


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


def _size(raw: object) -> str:
    """What stands in place of a matrix, in short."""
    if not isinstance(raw, list):
        return shorten(raw)
    widths = sorted({len(row) if isinstance(row, list) else 0 for row in raw})
    return f"{len(raw)} rows of {' and '.join(map(str, widths[:4])) or 'nothing'}"


_SHAPES = {
    "ida-pbc": "a number or a list [d, q]",
    "state-feedback": "a number or [[dd, dq], [qd, qq]]",
    "linear": f"rows of equal length, at most {MAX_STATES} of either",
}
_GAINS = {
    "ida-pbc": (("alpha", "nu", "ki"), _pair_rows),
    "state-feedback": (("K11", "K12", "K13"), _square_rows),
    "linear": (("F", "B", "C"), _rectangle_rows),
    "constant": ((), _rectangle_rows),
}
