"""Specs built in Python, part by part, or read from a file to be changed; each step gives a new one."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property
from numbers import Real
from typing import Any

from certify.building.changes import Change, add_entry, add_part, remove, set_value
from certify.building.checks import check_name, check_part, check_top, given, require_kind
from certify.building.paths import find
from certify.building.toml import to_toml
from certify.certificate import save
from certify.editing import edit_spec, to_json
from certify.inputs import SpecSource, to_bytes
from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import MAX_TOML_BYTES, read_document
from certify.kernel.spec import FORMAT
from certify.values import to_plain

Value = Any  # a number, text with a unit, a phasor, an array: see `certify.values`


@dataclass(frozen=True, init=False, repr=False)
class Spec:
    """A spec under construction. It never changes: each method returns a new one with one part more, or another value.

    Numbers are int, float (the shortest decimal that names it: 0.1 is 1/10), Fraction, Decimal, or of numpy; without a
    unit they are SI. Text may have a unit ("1.8 mH") or, for gains, be a formula ("1 - kp*L"). Voltages d + jq may be
    complex; matrices may be arrays. Proofs are about exactly these numbers: gains that have to cancel something of the
    plant do so as formulas or Fractions, and as floats only to sixteen digits, which a proof tells from zero.

    What can be checked of a part alone is checked at once, and the whole by whatever takes it, such as `certify.prove`.
    Raises: SpecError with every fault, each with its place.

    >>> import certify
    >>> grid = (
    ...     certify.Spec(frequency=50, base_voltage="400 V", voltage_band=("0.8 pu", "1.2 pu"))
    ...     .filter("lc", R=0.1, L=1.8e-3, C="25 uF")
    ...     .controller("phs", alpha=(-5, -4), nu=1, ki=100)
    ...     .node("a", filter="lc", controller="phs", reference=400 + 0j)
    ...     .node("b", capacitance="1 uF")
    ...     .load("b", Y=(20e-3, 5e-3), P=300 + 50j)
    ...     .line("a-b", "a", "b", R=0.2, L="0.4 mH", C=0)
    ... )
    >>> grid
    <Spec: 2 nodes, 1 line, 1 DGU>
    >>> certify.prove(grid).outcome
    'certified'
    >>> print(grid.to_toml().split("[node.b]")[1], end="")  # doctest: +NORMALIZE_WHITESPACE
    capacitance = "1 uF"
    load = [{ kind = "zip", Y = [0.02, 0.005], P = [300, 50] }]
    [[line]]
    name = "a-b"
    from = "a"
    to = "b"
    R = 0.2
    L = "0.4 mH"
    C = 0
    """

    _document: dict[str, Any] = field(hash=False)
    _source: bytes | None = field(compare=False)

    def __init__(
        self,
        name: str | None = None,
        *,
        frequency: Value,
        base_voltage: Value = None,
        base_power: Value = None,
        voltage_band: Sequence[Value] | None = None,
        tolerance: Value = None,
        line_legs: str | None = None,
    ) -> None:
        """What stands before all parts. Units: Hz, V, VA, V; `tolerance`: a share or "5 %", or a mapping by kind.

        `line_legs`: "included", or "neglected at DGUs".
        """
        values = {"name": name, "frequency": frequency, "base_voltage": base_voltage, "base_power": base_power}
        values |= {"voltage_band": voltage_band, "tolerance": tolerance, "line_legs": line_legs}
        document = {"format": FORMAT, **given("", **values)}
        check_top(document)
        object.__setattr__(self, "_document", document)
        object.__setattr__(self, "_source", None)

    @classmethod
    def read(cls, spec: SpecSource) -> Spec:
        """One that is there already, to be changed; the text keeps its comments and its order.

        For `spec` see `certify.inputs.to_bytes`. Only what cannot be parsed at all is refused here.

        >>> import certify
        >>> grid = certify.Spec.read("specs/two-inverters.toml").replace({"line.a-b.R": "0.3 ohm"})
        >>> certify.prove(grid).outcome, b"# a roof feeding constant power in" in grid.to_bytes()
        ('certified', True)
        """
        source = to_bytes(spec)
        return cls._of(read_document(source), source)

    @classmethod
    def _of(cls, document: dict[str, Any], source: bytes | None) -> Spec:
        new = object.__new__(cls)
        object.__setattr__(new, "_document", document)
        object.__setattr__(new, "_source", source)
        return new

    # --- parts ----------------------------------------------------------------------------------------------------

    def filter(self, name: str | int, *, R: Value, L: Value, C: Value, tolerance: Value = None) -> Spec:
        """The LC filter of inverters: series R in ohm and L in henry, C in farad."""
        return self._part("filter", name, {"R": R, "L": L, "C": C, "tolerance": tolerance}, check=True)

    def controller(
        self,
        name: str | int,
        kind: str | None = None,
        *,
        let: Mapping[str, Value] | None = None,
        design: Mapping[str, Value] | None = None,
        **gains: Value,
    ) -> Spec:
        """A control law; its kind follows from its gains, and is "constant" without any.

        K11, K12, K13: "state-feedback" u = K11 V + K12 I + K13 v, v' = V* - V, each a (2, 2) array or a number for a
        multiple of the identity. alpha, nu, ki: "ida-pbc", each a number or (d, q). F, B, C: "linear", any other
        shifted closed loop. Formulas may use R, L, C, w0 and the names of `let`; `design`: the values of R, L and C
        that the law was designed with.
        """
        kinds = {"K11": "state-feedback", "K12": "state-feedback", "alpha": "ida-pbc", "F": "linear"}
        if kind is None:
            kind = next((own for key, own in kinds.items() if key in gains), "constant" if not gains else None)
        require_kind(kind, gains, f"controller.{name}", "K11 and K12, alpha, or F")
        return self._part("controller", name, {"kind": kind, "let": let, "design": design, **gains}, check=True)

    def line_type(self, name: str | int, *, R: Value, L: Value, C: Value, tolerance: Value = None) -> Spec:
        """What lines have per length: R in ohm/m, L in H/m, C in F/m, or text such as "0.343 ohm/km"."""
        return self._part("line_type", name, {"R": R, "L": L, "C": C, "tolerance": tolerance}, check=True)

    def node(
        self,
        name: str | int,
        *,
        controller: str | int | None = None,
        filter: str | int | None = None,
        reference: Value = None,
        limits: Sequence[Value] | None = None,
        anti_windup: Value = None,
        capacitance: Value = None,
        load: Sequence[Mapping[str, Value]] | None = None,
    ) -> Spec:
        """A bus, with a DGU if it is given a controller.

        `reference`: V* = d + jq in volt, a number or a pair; `limits`: of |u_d| and |u_q| in volt; `anti_windup` in s;
        `capacitance` at the node beside those of filter and lines, in farad; `load`: tables as a spec has them, or see
        `Spec.load`. Names of filter and controller are looked up when the whole is checked.
        """
        dgu = {
            "filter": None if filter is None else str(filter),
            "controller": None if controller is None else str(controller),
            "reference": (reference, 0) if isinstance(reference, Real | Decimal) else reference,
            "limits": limits,
            "anti_windup": anti_windup,
        }
        own = given(f"node.{name}.dgu", **dgu) or None
        return self._part("node", name, {"dgu": own, "load": load, "capacitance": capacitance})

    def load(self, node: str | int, kind: str | None = None, **fields: Value) -> Spec:
        """A load at a node that is there; its kind follows from its fields.

        Y, I, P: "zip", pairs [active, reactive] in S, A and W, so that P + jQ = Y v^2 + I v + P; P may be complex.
        P0, np, Q0, nq, V0: "exp". R, L: "rl", in series. I, centre, radius: "current", two formulas in Vd and Vq.
        `band`, `below` and `tolerance` as in a spec.
        """
        kinds = {"P0": "exp", "centre": "current", "R": "rl", "Y": "zip", "P": "zip", "I": "zip"}
        if kind is None:
            kind = next((own for key, own in kinds.items() if key in fields), None)
        path = f"node.{node}.load[{self._count(str(node))}]"
        require_kind(kind, fields, path, "Y, I or P, P0, R and L, or centre")
        entry = given(path, kind=kind, **fields)
        check_part(self._document, "load", entry, path)
        return self._changed(add_entry(f"node.{node}", "load", entry), "node", str(node), "load")

    def line(
        self,
        name: str | int,
        start: str | int,
        end: str | int,
        *,
        R: Value = None,
        L: Value = None,
        C: Value = None,
        type: str | int | None = None,
        length: Value = None,
        tolerance: Value = None,
    ) -> Spec:
        """A line from node to node: R in ohm, L in henry, C in farad as a whole; or its `type`, and `length` in m."""
        lines = self._document.get("line", [])
        taken = {entry.get("name") for entry in lines if isinstance(entry, dict)} if isinstance(lines, list) else set()
        check_name(str(name), "line", taken)
        of = None if type is None else str(type)
        values = {"R": R, "L": L, "C": C, "type": of, "length": length, "tolerance": tolerance}
        ends = {"name": str(name), "from": str(start), "to": str(end)}
        return self._changed(add_entry("", "line", {**ends, **given(f"line.{name}", **values)}), "line")

    def scenario(
        self,
        name: str | int,
        *,
        end: Value,
        start: str | None = None,
        disconnected: Sequence[Value] | None = None,
        event: Sequence[Mapping[str, Value]] | None = None,
    ) -> Spec:
        """What happens when, for simulations: see `certify.simulate`. Times in s; events are tables as in a spec."""
        return self._part("scenario", name, {"end": end, "start": start, "disconnected": disconnected, "event": event})

    # --- changes --------------------------------------------------------------------------------------------------

    def replace(self, values: Mapping[str, Value]) -> Spec:
        """Other values at places named as messages name them, such as "filter.lc.L"; the last key may be a new one.

        Raises: SpecError U035 if nothing stands there.
        """
        new = self
        for path, value in values.items():
            if value is None:
                raise SpecError((Fault("U030", path, "None is no value; `without` takes a key out"),))
            new = new._changed(set_value(path, to_plain(value, path)))
        return new

    def without(self, *paths: str) -> Spec:
        """Parts or values taken out. Raises: SpecError U035 if nothing stands at a path."""
        new = self
        for path in paths:
            new = new._changed(remove(path))
        return new

    def __getitem__(self, path: str) -> Any:
        """What the document has at a place, numbers as they are written. Raises: SpecError U035."""
        at, key = find(self._document, path)
        return copy.deepcopy(at[key])

    # --- text -----------------------------------------------------------------------------------------------------

    def to_document(self) -> dict[str, Any]:
        """A copy of the document, as JSON has it; decimals are text that knows to be a number (`NumberText`)."""
        return copy.deepcopy(self._document)

    def to_toml(self) -> str:
        """The spec as TOML for people; that which was read from TOML as it stands, with its comments."""
        if self._source is not None and not self._source.decode("utf-8-sig").lstrip().startswith("{"):
            return self._source.decode("utf-8-sig")
        return to_toml(self._document)

    def to_json(self) -> str:
        """The spec as JSON; every number as it was written."""
        return to_json(self._document, "{\n ")

    def to_bytes(self) -> bytes:
        """The text that certificates are about: what was read, or TOML, or JSON if that would be too much of TOML."""
        return self._text

    @cached_property
    def _text(self) -> bytes:
        if self._source is not None:
            return self._source
        text = self.to_toml().encode()
        return text if len(text) <= MAX_TOML_BYTES else self.to_json().encode()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_bytes()`, or JSON if the path ends in .json: whole, or not at all.

        A certificate is about one of these texts: prove what was saved. Raises: SpecError U032.
        """
        json = os.fsdecode(path).endswith(".json")
        save(path, self.to_json().encode() if json and not self._text.lstrip().startswith(b"{") else self._text)

    def __hash__(self) -> int:
        return hash(self._text)

    def __repr__(self) -> str:
        def count(key: str, word: str) -> str:
            parts = self._document.get(key, ())
            number = len(parts) if isinstance(parts, dict | list | tuple) else 0
            return f"{number:,} {word}{'' if number == 1 else 's'}"

        nodes = self._document.get("node", {})
        dgus = (
            sum(isinstance(node, dict) and "dgu" in node for node in nodes.values()) if isinstance(nodes, dict) else 0
        )
        name = f" {self._document['name']!r}" if "name" in self._document else ""
        return f"<Spec{name}: {count('node', 'node')}, {count('line', 'line')}, {dgus:,} DGU{'' if dgus == 1 else 's'}>"

    def _part(self, kind: str, name: str | int, values: dict[str, Value], check: bool = False) -> Spec:
        path = f"{kind}.{name}"
        check_name(str(name), kind, self._document.get(kind, ()))
        part = given(path, **values)
        if check:
            check_part(self._document, kind, part, path)
        return self._changed(add_part(kind, str(name), part), kind)

    def _changed(self, change: Change, *along: str) -> Spec:
        """After a change that touches no more than what stands on the way `along` these keys; without any, whatever."""
        if self._source is None:
            return Spec._of(change(_copy_along(self._document, along) if along else _copy(self._document)), None)
        source = edit_spec(self._source, change)
        return Spec._of(read_document(source), source)

    def _count(self, node: str) -> int:
        at, key = find(self._document, f"node.{node}")
        loads = at[key].get("load", ()) if isinstance(at[key], dict) else ()
        return len(loads) if isinstance(loads, list) else 0


def _copy(document: Any) -> Any:
    """A copy of all tables and lists; what they hold never changes in place."""
    if isinstance(document, dict):
        return {key: _copy(part) for key, part in document.items()}
    return [_copy(part) for part in document] if isinstance(document, list) else document


def _copy_along(document: Any, keys: Sequence[str]) -> Any:
    """A copy of the tables and lists that lie on the way; all others are shared."""
    if not isinstance(document, dict | list):
        return document
    copied = document.copy()
    if keys and isinstance(copied, dict) and keys[0] in copied:
        copied[keys[0]] = _copy_along(copied[keys[0]], keys[1:])
    return copied
