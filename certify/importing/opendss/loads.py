"""Loads of OpenDSS: which law each row has, where it holds, and three single-phase ones that make a balanced load.

Within `(max(vminpu, vlowpu), vmaxpu]` a load has the law of its model; outside, the engine puts impedances in its
place that depend on the model. A spec says on which band a law holds, so each load gets the part of the band where it
does. Below it the engine's law is that of a spec's `below = "constant-impedance"` in some cases only, of which the
usual one is a `vminpu` of exactly 1 (it draws a straight line in the current from the rated impedance at `vlowpu` to
the rated power at `vminpu`, which otherwise is no impedance).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from certify.importing.network import NONE, ZERO, ExpRow, Note, Pair, ZipRow
from certify.importing.numbers import decimal, root
from certify.importing.opendss.elements import PHASES, Element, Unreadable
from certify.kernel.errors import Fault

ONE = Fraction(1)
# The engine lets a ZIPV load fade as (1 + tanh(500 (v - cut-off))) / 2; 0.04 pu above, that is one in doubles.
FADED = Fraction(1, 25)
# Properties of a single-phase load that its two partners have to share.
_SHARED = ("kV", "kW", "kvar", "Model", "Status", "VMinpu", "VMaxpu", "VLowpu", "CVRWatts", "CVRVars", "ZIPV")


@dataclass(frozen=True)
class Holds:
    """Where a law holds, per unit of the load's nominal voltage; `high` None: everywhere above.

    `impedance_below`: below `low` the load is the constant impedance that it is there.
    """

    low: Fraction
    high: Fraction | None
    impedance_below: bool = False


def row_of(
    load: Element, multiplier: Fraction, nominal_volt: Fraction, count: int = 1
) -> tuple[ZipRow | ExpRow, Holds]:
    """The law of `count` equal loads, and where it holds; `multiplier` scales all loads whose status is variable.

    Raises: Unreadable.
    """
    model = load.properties["Model"]
    factor = multiplier if load.text("Status").lower() == "variable" else ONE
    p, q = (count * 1000 * load.number(key) for key in ("kW", "kvar"))
    watt, var = p * factor, q * factor
    row = ZipRow(load.buses[0], nominal_volt)
    match model:
        case 1:
            return replace(row, power=(watt, var)), _holds(load)
        case 2:
            return replace(row, impedance=(watt, var)), Holds(ZERO, None)
        case 3:
            return replace(row, power=(watt, ZERO), impedance=(ZERO, var)), _holds(load)
        case 4:
            exponents = load.number("CVRWatts"), load.number("CVRVars")
            return ExpRow(load.buses[0], nominal_volt, watt, exponents[0], var, exponents[1]), _holds(load)
        case 5:
            return replace(row, current=(watt, var)), _holds(load)
        case 6:
            return replace(row, power=(watt, q)), _holds(load, fixed=factor != 1)
        case 7:
            return replace(row, power=(watt, ZERO), impedance=(ZERO, q)), _holds(load, fixed=factor != 1)
        case 8:
            return _zipv(row, load, watt, var)
    raise Unreadable(f"model {model!r} is none of 1 to 8")


def _holds(load: Element, fixed: bool = False) -> Holds:
    """The range of every model but 2 and 8. `fixed`: the reactive power of model 6 or 7 is not scaled, the active one
    is."""
    least, lowest, most = (load.number(key) for key in ("VMinpu", "VLowpu", "VMaxpu"))
    low = max(least, lowest)
    below = low == 1 and (not fixed or not lowest)
    if load.properties["Model"] == 7 and least > 0 and not lowest:
        below = True  # the engine keeps the impedance that there is at vminpu, down to zero
    return Holds(low, most, below)


def _zipv(row: ZipRow, load: Element, watt: Fraction, var: Fraction) -> tuple[ZipRow, Holds]:
    """Seven coefficients: parts of the active power, then of the reactive one, as they are; then the cut-off."""
    coefficients = load.numbers("ZIPV")
    if len(coefficients) != 7 or not any(coefficients):
        raise Unreadable("a load of model 8 needs zipv with seven coefficients")
    active, reactive, cut = coefficients[:3], coefficients[3:6], coefficients[6]
    pairs: list[Pair] = [(watt * a, var * r) for a, r in zip(active, reactive, strict=True)]
    row = replace(row, impedance=pairs[0], current=pairs[1], power=pairs[2])
    least, lowest, most = (load.number(key) for key in ("VMinpu", "VLowpu", "VMaxpu"))
    # Below vlowpu the engine has the rated impedance, whatever the coefficients add up to.
    whole = not lowest or ((sum(active) == 1 or not watt) and (sum(reactive) == 1 or not var))
    if cut > 0:
        return row, Holds(max(least, lowest, cut + FADED), most)
    if row.current == row.power == NONE:
        return row, Holds(ZERO if whole else lowest, None)
    low = max(least, lowest)
    return row, Holds(low, most, low == 1 and whole)


def on_band(
    row: ZipRow | ExpRow, holds: Holds, load: Element, band_pu: Pair
) -> tuple[ZipRow | ExpRow, list[Note], list[Fault]]:
    """The row with the part of the wished band on which its law holds."""
    cut = load.numbers("ZIPV")[6] if load.properties["Model"] == 8 else ZERO
    low = max(band_pu[0], load.number("VMinpu"), load.number("VLowpu"))
    if cut > 0 and low < cut + FADED:
        text = (
            f"its cut-off of {decimal(cut)} pu (the seventh number of zipv) reaches into the band from {decimal(low)} "
            "pu on, and a load that fades away cannot be expressed; the band has to begin at "
            f"{decimal(cut + FADED)} pu or above"
        )
        return row, [], [Fault("I049", load.name, text)]
    return within(row, holds, load.name, band_pu)


def within(
    row: ZipRow | ExpRow, holds: Holds, name: str, band_pu: Pair
) -> tuple[ZipRow | ExpRow, list[Note], list[Fault]]:
    """The row on the part of the band on which its law holds, with a note if that is not all of it."""
    low = max(band_pu[0], holds.low)
    high = band_pu[1] if holds.high is None else min(band_pu[1], holds.high)
    if low >= high:
        text = (
            f"no voltage of the band from {decimal(band_pu[0])} to {decimal(band_pu[1])} pu lies where its model "
            f"holds, from {decimal(holds.low)} to {decimal(holds.high or band_pu[1])} pu"
        )
        return row, [], [Fault("I049", name, text)]
    below = holds.impedance_below and holds.low >= band_pu[0]
    if (low, high) == band_pu and not below:
        return row, [], []
    row = replace(row, band_pu=(low, high), impedance_below=below)
    text = (
        f"its model holds from {decimal(low)} to {decimal(high)} pu only (vminpu, vlowpu, vmaxpu), so that is its band"
    )
    if below:
        text += "; below, it is a constant impedance"
    return row, [Note(name, text)], []


def to_rows(
    loads: Sequence[Element], multiplier: Fraction, band_pu: Pair
) -> tuple[list[ZipRow | ExpRow], list[Note], list[Fault]]:
    """The rows of all loads that are on. A load that is not balanced is a fault, and so is one that is no load."""
    rows: list[ZipRow | ExpRow] = []
    notes: list[Note] = []
    faults: list[Fault] = []
    singles = [load for load in loads if load.phases == 1]
    groups, alone = balanced_groups(singles)
    whole = [(load,) for load in loads if load.phases != 1]
    position = {load.name: k for k, load in enumerate(loads)}
    for group in sorted((*groups, *whole), key=lambda group: position[group[0].name]):
        load = group[0]
        if len(group) == 1 and not load.is_three_phase:
            faults.append(Fault("I047", load.name, _unbalanced(load)))
            continue
        try:
            nominal = 1000 * load.number("kV")
            if len(group) == 3 and 0 in _ends(load):  # from line to neutral, where all others are from line to line
                nominal *= root(Fraction(3))
            if nominal <= 0:
                raise Unreadable(f"kV is {load.properties['kV']}")
            row, holds = row_of(load, multiplier, nominal, len(group))
            row, more_notes, more_faults = on_band(row, holds, load, band_pu)
        except Unreadable as error:
            faults.append(Fault("I051", load.name, str(error)))
            continue
        rows.append(replace(row, origins=tuple(member.name for member in group)))
        notes += more_notes
        faults += more_faults
        if len(group) == 3:
            notes.append(Note(load.name, f"with {group[1].name} and {group[2].name} one balanced load"))
    faults += [Fault("I047", load.name, _unbalanced(load)) for load in alone]
    return rows, notes, faults


def _ends(load: Element) -> tuple[int, int]:
    """The two nodes of a single-phase load, the neutral as 0 wherever it is brought out."""
    first, second = (node if node in PHASES else 0 for node in (*load.nodes, 0)[:2])
    return first, second


def _unbalanced(load: Element) -> str:
    conductors = load.nodes[:2] if load.phases == 1 and _ends(load)[1] else load.terminal(0)
    place = f"{load.buses[0]}.{'.'.join(map(str, conductors))}"
    if load.phases == 1:
        return f"one phase, at {place}, without equal loads on the other two"
    if load.phases == 3:
        return f"{place}: its phases are not the nodes 1, 2 and 3"
    return f"{load.phases} phases, at {place}, where a balanced load has three"


def balanced_groups(loads: Iterable[Element]) -> tuple[list[tuple[Element, ...]], list[Element]]:
    """Threes of single-phase loads that are equal but for their phases, and those that are left over."""
    places: dict[tuple[object, ...], dict[frozenset[int], list[Element]]] = defaultdict(lambda: defaultdict(list))
    alone: list[Element] = []
    for load in loads:
        ends = _ends(load)
        phases = frozenset(ends)
        if len(phases) != 2:
            alone.append(load)
            continue
        neutral = (*load.nodes, 0)[:2][ends.index(0)] if 0 in ends else -1
        shared = tuple(repr(load.properties.get(key)) for key in _SHARED)
        places[(load.buses[0], neutral, *shared)][phases].append(load)
    groups: list[tuple[Element, ...]] = []
    for key, by_phases in places.items():
        wanted = [{1, 2}, {2, 3}, {1, 3}] if key[1] == -1 else [{0, 1}, {0, 2}, {0, 3}]
        columns = [by_phases.get(frozenset(phases), []) for phases in wanted]
        full = min(map(len, columns))
        groups += list(zip(*(column[:full] for column in columns), strict=True))
        alone += [load for column in columns for load in column[full:]]
    return groups, alone
