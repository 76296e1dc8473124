"""Elements of a circuit as the engine tells them: exact numbers, how they are wired, and whether they are balanced."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.kernel.errors import Fault, SpecError

PHASES = (1, 2, 3)
_TURN = cmath.exp(2j * math.pi / 3)


class Unreadable(Exception):
    """A property that is no finite number; told as a fault of the element."""


@dataclass(frozen=True)
class Element:
    """One element. `nodes` are the nodes of its conductors, terminal after terminal; 0 is the ground.

    `admittance`: the primitive matrix at the frequency of the circuit, one complex list for each conductor, in siemens.
    """

    name: str
    kind: str
    enabled: bool
    buses: tuple[str, ...]
    nodes: tuple[int, ...]
    phases: int
    conductors: int
    open: tuple[tuple[bool, ...], ...]
    properties: dict[str, Any]
    admittance: tuple[tuple[complex, ...], ...]

    def number(self, key: str, index: int | None = None) -> Fraction:
        """A property as the decimal with at most 15 digits that the engine itself prints for it, exactly.

        Raises: Unreadable.
        """
        value = self.properties[key] if index is None else self.properties[key][index]
        return exact(value, key)

    def numbers(self, key: str) -> tuple[Fraction, ...]:
        """All numbers of a list."""
        return tuple(exact(value, key) for value in self.properties[key])

    def text(self, key: str) -> str:
        """A property that is a name; empty if there is none."""
        return str(self.properties.get(key) or "")

    def terminal(self, k: int) -> tuple[int, ...]:
        """The nodes of the phases of terminal k, in the order of the conductors."""
        return self.nodes[k * self.conductors : k * self.conductors + self.phases]

    @property
    def is_three_phase(self) -> bool:
        """Three phases, each terminal on the nodes 1, 2 and 3 of its bus, all in one order, or else on ground."""
        orders = {self.terminal(k) for k in range(len(self.buses))} - {(0, 0, 0)}
        return self.phases == 3 and len(orders) == 1 and sorted(next(iter(orders))) == list(PHASES)


def exact(value: Any, what: str) -> Fraction:
    """A double as the shortest decimal that is it to 15 significant digits: what a person wrote, or what the engine
    prints.

    >>> exact(3.3999999999999995, "C1")
    Fraction(17, 5)
    """
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise Unreadable(f"{what} is no finite number")
    if value and not 1e-30 < abs(value) < 1e30:
        raise Unreadable(f"{what} is {value!r}, which is absurd")
    return Fraction(f"{value:.15g}")


def to_element(raw: dict[str, Any]) -> Element:
    """An element from what the engine's process has written."""
    flat = raw["admittance"]
    size = math.isqrt(len(flat) // 2)
    entries = [complex(*flat[2 * k : 2 * k + 2]) for k in range(size * size)]  # symmetric: rows are columns
    rows = tuple(tuple(entries[k * size : (k + 1) * size]) for k in range(size))
    return Element(
        raw["name"],
        raw["kind"],
        raw["enabled"],
        tuple(raw["buses"]),
        tuple(raw["nodes"]),
        raw["phases"],
        raw["conductors"],
        tuple(tuple(states) for states in raw["open"]),
        raw["properties"],
        rows,
    )


def positive_sequence(element: Element) -> tuple[list[list[complex]], float]:
    """The admittances between the terminals for the positive sequence, and how far they depend on other sequences.

    Shapes: one row and one column for each terminal. The second result is the largest part of a current that is of
    another sequence than the voltage that drives it, as a share of the largest admittance: zero for a balanced
    element.
    """
    terminals = len(element.buses)
    vectors = [_phasors(element.terminal(k)) for k in range(terminals)]
    result = [[0j] * terminals for _ in range(terminals)]
    size = max((abs(y) for row in element.admittance for y in row), default=0.0) or 1.0
    other = 0.0
    for j, drive in enumerate(vectors):
        for i, sense in enumerate(vectors):
            block = [
                [element.admittance[i * element.conductors + a][j * element.conductors + b] for b in range(3)]
                for a in range(3)
            ]
            current = [sum(y * v for y, v in zip(row, drive, strict=True)) for row in block]
            own = sum(c * s.conjugate() for c, s in zip(current, sense, strict=True)) / 3
            result[i][j] = own
            other = max(other, *(abs(c - own * s) for c, s in zip(current, sense, strict=True)))
    return result, other / size


def _phasors(nodes: Sequence[int]) -> list[complex]:
    """Positive sequence at these nodes; a grounded terminal has it by position, as its partner does."""
    order = nodes if sorted(nodes) == list(PHASES) else PHASES
    return [_TURN ** -(node - 1) for node in order]


def refuse(faults: Sequence[Fault]) -> None:
    """Raises: SpecError if there is any fault."""
    if faults:
        raise SpecError(tuple(faults))
