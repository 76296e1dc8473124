"""Reading TOML and JSON strictly: decimals as text, tables by schema, every fault with its path.

A reader is a function of a raw value and its path that returns the value, or None after noting a fault.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import NumberText, QuantityError, parse_quantity, shorten

MAX_BYTES = 1 << 25
MAX_TOML_BYTES = 1 << 22
MAX_TOML_LINE = 20_000
MAX_DOTS = 50  # in a key or a line of an array: deeper keys cost the parser quadratic time
MAX_FAULTS = 500
NAME = re.compile(r"\w(?:[\w .:+-]{0,62}\w)?")
REQUIRED = object()  # in place of a default
Reader = Callable[[Any, str], Any]
Schema = Mapping[str, tuple[Reader, Any]]
Pair = tuple[Fraction, Fraction]


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object without duplicate keys. Raises: ValueError otherwise."""
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {shorten(twice)} is given twice")
    return table


def read_document(data: bytes) -> Any:
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
            hooks = {"parse_float": number, "parse_int": number, "parse_constant": number, "object_pairs_hook": unique}
            return json.loads(text, **hooks)
        if len(data) > MAX_TOML_BYTES:
            raise refuse("S003", f"{len(data)} bytes of TOML; use JSON of the same shape")
        for row, line in enumerate(text.split("\n"), 1):
            keys = line.split("=") if "{" in line else line.split("=")[:1]
            if len(line) > MAX_TOML_LINE or max(key.count(".") for key in keys) > MAX_DOTS:
                raise refuse("S003", f"line {row} is absurdly long; break it, or use JSON of the same shape")
        return tomllib.loads(text, parse_float=NumberText)
    except UnicodeDecodeError as error:
        raise refuse("S001", f"not UTF-8 text: byte {error.start} cannot be decoded") from None
    except RecursionError:
        raise refuse("S003", "nested too deeply; a spec needs no more than six levels") from None
    except ValueError as error:
        raise refuse("S002", f"not valid TOML or JSON: {error}") from None


def shown(name: str) -> str:
    """A name or key as it may stand in a path."""
    return name if NAME.fullmatch(name) else shorten(name)


def keep(raw: Any, _: str) -> Any:
    """The reader that leaves a value as it is."""
    return raw


class TableReader:
    """Readers that note faults and go on; `per_unit` says what 1 pu of each unit is."""

    def __init__(self) -> None:
        self.faults: list[Fault] = []
        self.per_unit: dict[str, Fraction] = {}

    def fault(self, code: str, path: str, message: str) -> None:
        if Fault(code, path, message) not in self.faults:  # a scalar gain stands at two places of its matrix
            self.faults.append(Fault(code, path, message))
        if len(self.faults) >= MAX_FAULTS:
            raise SpecError((*self.faults, Fault("S108", "", f"more than {MAX_FAULTS} faults; the rest is not listed")))

    def near(self, name: object, known: Iterable[str]) -> str:
        """What was perhaps meant; only for the first faults, because comparing names costs time."""
        names = list(known)[:30]
        if isinstance(name, int) and name.bit_length() < 64 and str(name) in names:
            return f"did you mean '{name}', in quotes?"
        alike = isinstance(name, str) and len(self.faults) < 20
        near = difflib.get_close_matches(name[:60], names, 1) if alike else []  # type: ignore[index]
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        return f"did you mean {near[0]!r}?" if near else f"known here: {listed}" if names else "none is defined"

    def attempt(self, path: str, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except QuantityError as error:
            self.fault(error.code, path, error.message)
            return None

    def table(self, raw: object, path: str, schema: Schema) -> dict[str, Any]:
        """Every key of the schema, read; a fault for each key that is unknown or missing."""
        if not isinstance(raw, dict):
            self.fault("S103", path, f"expected a table, got {shorten(raw)}")
            return dict.fromkeys(schema)
        dot, values = f"{path}." if path else "", {}
        for key in raw:
            if key not in schema:
                self.fault("S101", f"{dot}{shown(key)}", f"unknown key; {self.near(key, schema)}")
        for key, (read, default) in schema.items():
            if key not in raw and default is REQUIRED:
                self.fault("S102", f"{dot}{key}", "this key is missing")
            elif key in raw and raw[key] is None:
                self.fault("S103", f"{dot}{key}", "null is no value; leave the key out")
            elif key in raw:
                values[key] = read(raw[key], f"{dot}{key}")
            else:
                values[key] = default
        return {key: values.get(key) for key in schema}

    def named(self, raw: object, path: str, read: Reader) -> dict[str, Any]:
        """A table whose keys are names: each entry, read."""
        if not isinstance(raw, dict):
            self.fault("S103", path, f"expected a table of tables, got {shorten(raw)}")
            return {}
        return {name: read(entry, self.path_of(path, name)) for name, entry in raw.items()}

    def path_of(self, key: str, name: str) -> str:
        path = f"{key}.{shown(name)}"
        if not NAME.fullmatch(name):
            self.fault("S105", path, "not a usable name: letters, digits, _ . : + - and inner spaces, at most 64")
        return path

    def text(self, raw: object, path: str) -> str | None:
        if isinstance(raw, str) and not isinstance(raw, NumberText) and len(raw) <= 200 and raw.isprintable():
            return raw
        self.fault("S103", path, f"expected a line of text in quotes, got {shorten(raw)}")
        return None

    def one_of(self, known: Iterable[str], code: str = "S107", kind: str = "a choice here") -> Reader:
        """One of some words, or the name of something that the spec defines elsewhere."""

        def read(raw: object, path: str) -> str | None:
            if isinstance(raw, str) and raw in known:
                return raw
            self.fault(code, path, f"{shorten(raw)} is not {kind}; {self.near(raw, known)}")
            return None

        return read

    def unit(self, unit: str, sign: str = "") -> Reader:
        """A quantity in SI; `sign` is "> 0", ">= 0" or "" for any."""

        def read(raw: object, path: str) -> Any:
            value = self.attempt(path, lambda: parse_quantity(raw, unit, self.per_unit))
            if value is None or not sign or value > 0 or (value == 0 and sign == ">= 0"):
                return value
            self.fault("S208", path, f"must be {'positive' if sign == '> 0' else 'zero or more'}, got {shorten(raw)}")
            return None

        return read

    def pair(self, first: Reader, second: Reader) -> Reader:
        def read(raw: object, path: str) -> Pair | None:
            if not isinstance(raw, list) or len(raw) != 2:
                got = f"a list of {len(raw)}" if isinstance(raw, list) else shorten(raw)
                self.fault("S103", path, f"expected a list of two values, got {got}")
                return None
            a, b = first(raw[0], f"{path}[0]"), second(raw[1], f"{path}[1]")
            return None if a is None or b is None else (a, b)

        return read

    def list_of(self, read: Reader) -> Reader:
        def read_all(raw: object, path: str) -> list[Any]:
            if not isinstance(raw, list):
                self.fault("S103", path, f"expected a list of tables, got {shorten(raw)}")
                return []
            return [read(entry, f"{path}[{k}]") for k, entry in enumerate(raw)]

        return read_all
