"""The numbers of a proof, read strictly: rationals in lowest terms, as text."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any

from certify.kernel.errors import require
from certify.kernel.linalg import Matrix, Vector
from certify.kernel.quantity import shorten

_RATIONAL = re.compile(r"-?(?:0|[1-9]\d*)(?:/[1-9]\d*)?", re.ASCII)
MAX_DIGITS = 1_000  # of one number of a proof


class Data:
    """The numbers of one proof, read strictly: canonical rationals only."""

    def __init__(self, raw: object) -> None:
        self.raw = raw

    def fields(self, *names: str) -> list[Data]:
        require(isinstance(self.raw, dict) and set(self.raw) == set(names), f"the proof needs {names or 'no data'}")
        return [Data(self.raw[name]) for name in names]  # type: ignore[index]

    def optional(self, name: str) -> tuple[Data | None, Data]:
        """A field that a proof may have, or None, and the proof without it."""
        require(isinstance(self.raw, dict), "a proof is a table")
        rest: dict[str, Any] = dict(self.raw)  # type: ignore[call-overload]
        return (Data(rest.pop(name)) if name in rest else None), Data(rest)

    def corner(self) -> tuple[str, Data]:
        """The corner of the box that a refutation is about ("" for the values themselves), and the other fields."""
        signs, rest = self.optional("corner")
        text = signs.text() if signs else ""
        require(set(text) <= set("-0+") and (signs is None or text != ""), "a corner is named by signs")
        return text, rest

    def items(self) -> list[Data]:
        require(isinstance(self.raw, list), "expected a list in the proof")
        return [Data(entry) for entry in self.raw]  # type: ignore[attr-defined]

    def text(self) -> str:
        require(isinstance(self.raw, str), "expected text in the proof")
        return str(self.raw)

    def vector(self) -> Vector:
        """Rationals in one string, separated by single spaces."""
        return tuple(_rational(part) for part in self.text().split(" "))

    def scalar(self) -> Fraction:
        return _rational(self.text())

    def size(self) -> int:
        """How many characters the data have as text."""
        return len(str(self.raw))

    def matrix(self) -> Matrix:
        require(sum(len(row.text()) for row in self.items()) <= 100 * MAX_DIGITS, "a matrix has too many digits")
        rows = tuple(row.vector() for row in self.items())
        require(len({len(row) for row in rows}) <= 1, "the rows of a matrix differ in length")
        return rows


def _rational(text: str) -> Fraction:
    require(len(text) <= MAX_DIGITS, "a number has too many digits")
    require(bool(_RATIONAL.fullmatch(text)), f"not a rational number: {shorten(text)}")
    value = Fraction(text)
    require(str(value) == text, f"not in lowest terms: {shorten(text)}")
    return value
