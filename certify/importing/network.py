"""A balanced three-phase network between a foreign format and a spec: buses, branches, rows of loads, sources.

Conventions, the same as those of a spec: `nominal_volt` and all voltages are from line to line (RMS), powers those of
all three phases, impedances and capacitances those of one phase of the equivalent star. A spec says
`P + jQ = V conj(I)` and `V_a - V_b = Z I`. With `|V| = V_LL` and `|I| = sqrt(3) I_conductor`, the power-invariant dq
transformation, both are true of the power of all three phases and of the impedance of one: no factor 3 or sqrt(3)
remains anywhere.

All numbers are exact. `origins` name the elements of the foreign file that a part comes from, such as `("line 3",)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

Pair = tuple[Fraction, Fraction]  # active, reactive
ZERO = Fraction(0)
NONE: Pair = (ZERO, ZERO)


@dataclass(frozen=True)
class Bus:
    """`capacitance_farad`: a shunt of its own, beside what its branches bring."""

    name: str
    nominal_volt: Fraction
    origins: tuple[str, ...] = ()
    capacitance_farad: Fraction = ZERO


@dataclass(frozen=True)
class Branch:
    """A line, or a transformer: a pi section behind an ideal ratio at its start.

    `V_start = ratio e^(j shift) V'`, and between V' and V_end stand `resistance_ohm` and `inductance_henry`, with half
    of `capacitance_farad` and half of `shunt_siemens` at each end (P = G v^2, Q = B v^2, so a magnetising branch has
    B > 0), all as seen from the end's side. A branch with `length_metre` is a line, and `kind` names its type.
    """

    name: str
    start: str
    end: str
    resistance_ohm: Fraction
    inductance_henry: Fraction
    capacitance_farad: Fraction = ZERO
    shunt_siemens: Pair = NONE
    length_metre: Fraction | None = None
    kind: str = ""
    ratio: Fraction = Fraction(1)
    shift_degree: Fraction = ZERO
    origins: tuple[str, ...] = ()


@dataclass(frozen=True)
class ZipRow:
    """One row of a load table: watt and var that its parts draw at `nominal_volt`.

    P(v) = impedance (v/nominal)^2 + current (v/nominal) + power. `band_pu`, of nominal_volt, stands in for that of the
    settings; with `impedance_below` the load is a constant impedance below it.
    """

    bus: str
    nominal_volt: Fraction
    impedance: Pair = NONE
    current: Pair = NONE
    power: Pair = NONE
    origins: tuple[str, ...] = ()
    band_pu: Pair | None = None
    impedance_below: bool = False

    @property
    def apparent(self) -> Pair:
        """Watt and var at nominal voltage."""
        p, q = (z + i + c for z, i, c in zip(self.impedance, self.current, self.power, strict=True))
        return p, q


@dataclass(frozen=True)
class ExpRow:
    """One row of a load table: P(v) = P0 (v/nominal)^np, Q(v) = Q0 (v/nominal)^nq; the rest as for a ZipRow."""

    bus: str
    nominal_volt: Fraction
    P0_watt: Fraction
    np: Fraction
    Q0_var: Fraction = ZERO
    nq: Fraction = ZERO
    origins: tuple[str, ...] = ()
    band_pu: Pair | None = None
    impedance_below: bool = False

    @property
    def apparent(self) -> Pair:
        """Watt and var at nominal voltage."""
        return self.P0_watt, self.Q0_var


@dataclass(frozen=True)
class Source:
    """A place for a DGU. `reference_pu` is of the bus's nominal voltage.

    `angle_degree` is as in the foreign network, shifts of transformers included; None is zero once these are taken out.
    """

    bus: str
    rating_va: Fraction | None = None
    reference_pu: Fraction = Fraction(1)
    angle_degree: Fraction | None = None
    origins: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unmapped:
    """An element of the foreign network that the spec has not, and why."""

    element: str
    reason: str


@dataclass(frozen=True)
class Note:
    """Something that a reader of the spec should know about a part, or about all of it (`element` empty)."""

    element: str
    text: str


@dataclass(frozen=True)
class Network:
    """What a format has been read into. `origin` says in a few words where it comes from, for the head of the spec.

    `aliases`: what a bus may be called in options, to its name; names need not be in it.
    """

    name: str
    origin: str
    frequency_hertz: Fraction
    buses: tuple[Bus, ...]
    branches: tuple[Branch, ...]
    loads: tuple[ZipRow | ExpRow, ...]
    sources: tuple[Source, ...]
    unmapped: tuple[Unmapped, ...] = ()
    notes: tuple[Note, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)
