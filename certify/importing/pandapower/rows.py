"""Rows of foreign tables: numbers, buses and flags, with a fault for each that is not usable."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from certify.importing.names import comment
from certify.importing.network import Note, Unmapped
from certify.importing.numbers import from_float
from certify.kernel.errors import Fault
from certify.kernel.quantity import shorten

# Beyond these sizes no value of a power system lies; a spec would refuse them later, and less clearly.
SMALLEST, LARGEST = Fraction(1, 10**18), Fraction(10**18)


def missing(value: Any) -> bool:
    """None, NaN and what pandas has for them."""
    return (
        value is None or type(value).__name__ in ("NAType", "NaTType") or (isinstance(value, float) and value != value)
    )


MOST_FAULTS = 50  # told at once


def first_of(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Each fault once, and of very many the first, the last of which says how many more there are."""
    once = tuple(dict.fromkeys(faults))
    if len(once) <= MOST_FAULTS:
        return once
    last = once[MOST_FAULTS - 1]
    more = f"{last.message}; and {len(once) - MOST_FAULTS} more faults of this network"
    return (*once[: MOST_FAULTS - 1], replace(last, message=more))


@dataclass(frozen=True)
class Row:
    """One row of a table. `label` names it in messages and comments."""

    table: str
    index: Any
    values: Mapping[str, Any]

    @property
    def key(self) -> str:
        return f"{self.table} {self.index}"

    @property
    def label(self) -> str:
        name = self.values.get("name")
        return f"{self.key} ({comment(str(name), 60)})" if isinstance(name, str) and name else self.key


class Reading:
    """What has been read so far. Reading goes on after a fault: the value is then a harmless one."""

    def __init__(self) -> None:
        self.faults: list[Fault] = []
        self.unmapped: list[Unmapped] = []
        self.notes: list[Note] = []

    def fault(self, code: str, row: Row, column: str, message: str) -> None:
        name = row.values.get("name")
        named = f" ({comment(str(name), 60)})" if isinstance(name, str) and name else ""
        where = f"{row.table}[{row.index}]" + (f".{column}" if column else "")
        self.faults.append(Fault(code, where, message + named))

    def leave_out(self, row: Row, reason: str) -> None:
        self.unmapped.append(Unmapped(row.label, reason))

    def number(
        self, row: Row, column: str, sign: str = "", default: Fraction | None = None, blank: bool = False
    ) -> Fraction:
        """The shortest decimal of a cell; `sign` is "> 0", ">= 0" or "".

        The default is that of a column that older files have not. A cell that is empty in a column that is there has
        it with `blank` only, where pandapower takes it so; elsewhere it computes nothing with such a row.
        """
        value: Any = row.values.get(column)
        harmless = Fraction(1) if default is None else default
        if missing(value):
            if default is None or (column in row.values and not blank):
                self.fault("I003", row, column, "the number is missing")
            return harmless
        try:
            number = Fraction(value) if type(value) is int else from_float(float(value))
            if isinstance(value, bool | str):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            self.fault("I003", row, column, f"not a finite number: {shorten(str(value))}")
            return harmless
        if number and not SMALLEST <= abs(number) <= LARGEST:
            self.fault("I003", row, column, f"an absurd number: {shorten(str(value))}")
            return harmless
        if (sign == "> 0" and number <= 0) or (sign == ">= 0" and number < 0):
            self.fault("I003", row, column, f"must be {'positive' if sign == '> 0' else 'zero or more'}, got {value}")
            return harmless
        return number

    def flag(self, row: Row, column: str, default: bool | None = None) -> bool:
        """A truth value, of pandas too. Without a default a cell may not be empty."""
        value: Any = row.values.get(column)
        if missing(value):
            if default is None:
                self.fault("I003", row, column, "neither true nor false: the cell is empty")
            return bool(default)
        if type(value).__name__ in ("bool", "bool_", "int", "int64", "float", "float64") and value in (0, 1):
            return bool(value)
        self.fault("I003", row, column, f"neither true nor false: {shorten(str(value))}")
        return bool(default)

    def text(self, row: Row, column: str) -> str:
        """Text, empty if there is none."""
        value: Any = row.values.get(column)
        return value if isinstance(value, str) else ""

    def whole(self, row: Row, column: str) -> int | None:
        """A whole number, or None if the cell is something else."""
        value: Any = row.values.get(column)
        if missing(value) or isinstance(value, str | bool):
            return None
        try:
            number = float(value)
        except (TypeError, ValueError):
            return None
        return int(number) if math.isfinite(number) and number == int(number) else None
