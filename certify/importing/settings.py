"""What a foreign network does not say, and an import has to be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from certify.importing.network import Pair


@dataclass(frozen=True)
class Placement:
    """Where DGUs are: at buses by name, and at all elements of some KINDS. `leave_out`: tables to do without."""

    buses: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()


KINDS = ("generators", "storage", "static-generators", "ext-grid")


@dataclass(frozen=True)
class Settings:
    """Choices of one import. None and empty mean that nothing was stated, and nothing is assumed silently.

    `line_capacitance`: farad per metre, for lines that have none. `bus_capacitance`: farad, for buses that have none
    otherwise, and no DGU.
    `filters`, `controllers`: raw tables of a spec to take those of all DGUs from; `filter`, `controller` name the one
    that is meant. Without `filters`, placeholders are designed; `controller` is then "ida-pbc" or "pi".
    `references`: per unit, by the name of a bus; the one under "" is for all others.
    `frequency`: of the spec, in hertz, if it is to be another than that of the network.
    """

    band_pu: Pair = (Fraction(9, 10), Fraction(11, 10))
    line_capacitance: Fraction | None = None
    bus_capacitance: Fraction | None = None
    filters: Mapping[str, Any] = field(default_factory=dict)
    controllers: Mapping[str, Any] = field(default_factory=dict)
    filter: str | None = None
    controller: str | None = None
    taken_from: str = ""
    references: Mapping[str, Fraction] = field(default_factory=dict)
    frequency: Fraction | None = None
