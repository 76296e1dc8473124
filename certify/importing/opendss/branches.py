"""Lines, transformers, reactors and capacitors of OpenDSS as branches, shunts and capacitances, compared with the
engine.

Whatever the properties of an element say, what counts is the admittance that the engine itself makes of them. So each
part that is read here is compared with it, and a difference (a long line, a unit that was read otherwise) is a fault,
never a wrong spec.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache

from certify.importing.network import ZERO, Branch, Note, Pair, Unmapped
from certify.importing.numbers import inductance
from certify.importing.opendss.elements import Element, Unreadable, exact, positive_sequence
from certify.kernel.errors import Fault
from certify.kernel.spec import angular_frequency

# The engine's own names; "none" says that a length is in the unit of its line code, whatever that is.
METRES = {
    "mi": Fraction("1609.344"),
    "kft": Fraction("304.8"),
    "km": Fraction(1000),
    "m": Fraction(1),
    "ft": Fraction("0.3048"),
    "in": Fraction("0.0254"),
    "cm": Fraction("0.01"),
    "mm": Fraction("0.001"),
}
SAME = Fraction(1, 10**12)  # entries of a matrix that differ by less are equal: the last of 15 digits
BALANCED = 1e-9  # currents of other sequences, as a share
AGREES = 1e-9
AGREES_HANGING = 1e-5  # the engine has 1e-12 S at an open end
AGREES_TRANSFORMER = 1e-5  # the engine keeps windings from floating with reactances of 1 ppm


@dataclass(frozen=True)
class Shunt:
    """A constant admittance to ground: P = siemens[0] v^2, Q = siemens[1] v^2."""

    bus: str
    siemens: Pair
    origin: str


@dataclass
class Parts:
    """What the elements of a circuit come to."""

    branches: list[Branch] = field(default_factory=list)
    shunts: list[Shunt] = field(default_factory=list)
    capacitances: dict[str, tuple[Fraction, tuple[str, ...]]] = field(default_factory=dict)
    unmapped: list[Unmapped] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def fault(self, code: str, element: Element, message: str) -> None:
        self.faults.append(Fault(code, element.name, message))


def add_element(element: Element, frequency: Fraction, parts: Parts) -> None:
    """Add what an element of a kind in READERS comes to, or why it cannot be."""
    opened = [all(states) for states in element.open]
    if any(opened) and not _hangs(element):
        which = " and ".join(bus for bus, is_open in zip(element.buses, opened, strict=True) if is_open)
        parts.unmapped.append(Unmapped(element.name, f"open at {which}"))
        return
    if any(any(states) and not all(states) for states in element.open):
        parts.fault("I047", element, "open in some of its phases only")
        return
    if element.kind == "transformer" and len(element.buses) != 2:
        parts.fault("I050", element, f"{len(element.buses)} windings; two can be referred to one side")
        return
    if not element.is_three_phase:
        parts.fault("I047", element, unbalanced(element))
        return
    try:
        READERS[element.kind](element, frequency, parts)
    except Unreadable as error:
        parts.fault("I051", element, str(error))


def unbalanced(element: Element) -> str:
    """Why an element is none with three equal phases."""
    places = " to ".join(
        f"{bus}.{'.'.join(map(str, element.terminal(k)))}"
        for k, bus in enumerate(element.buses)
        if any(element.terminal(k))
    )
    if element.phases != 3:
        return f"{element.phases} phase{'s' if element.phases != 1 else ''}, {places}, where a balanced one has three"
    return f"{places}: its phases are not the nodes 1, 2 and 3 in one order"


def _line(line: Element, frequency: Fraction, parts: Parts) -> None:
    if line.properties["R1"] is None:
        try:
            r, x, c = (_from_matrix(line, key) for key in ("RMatrix", "XMatrix", "CMatrix"))
        except ValueError as error:
            parts.fault("I048", line, str(error))
            return
    else:
        r, x, c = (line.number(key) for key in ("R1", "X1", "C1"))
        if (c, line.number("C0")) == (Fraction("3.4"), Fraction("1.6")):
            parts.notes.append(Note(line.name, "its capacitance is the default of OpenDSS, 3.4 nF per unit of length"))
        if (r, x) == (Fraction("0.058"), Fraction("0.1206")):
            parts.notes.append(Note(line.name, "its impedance is the default of OpenDSS, 0.058 + 0.1206j ohm per unit"))
    length, unit = line.number("Length"), line.text("Units").lower()
    metres = METRES.get(unit)
    if line.properties["Switch"]:
        parts.notes.append(Note(line.name, "a switch, which OpenDSS takes for a short line"))
        metres = None
    branch = Branch(
        line.name.partition(".")[2],
        line.buses[0],
        line.buses[1],
        r * length,
        inductance(x, _w0(line.number("BaseFreq"))) * length,  # lines of one code have one type
        c * length / 10**9,
        length_metre=metres * length if metres else None,
        kind=(line.text("LineCode") or line.text("Geometry")) if metres else "",
        origins=(line.name,),
    )
    model, tolerance = _pi(branch, frequency), AGREES
    ends: tuple[int, ...] = (0, 1)
    if _hangs(line):
        branch, model, ends = _hanging(line, branch, model)
        tolerance = AGREES_HANGING
        parts.notes.append(Note(line.name, "open at one end, where it now has a bus of its own: its charging stays"))
    if _agrees(line, model, tolerance, parts, ends):
        parts.branches.append(branch)


def _hangs(element: Element) -> bool:
    """Whether an element is a line that is open at one end, and has a capacitance that is charged from the other."""
    opened = [all(states) for states in element.open]
    if element.kind != "line" or element.properties["Switch"] or sum(opened) != 1:
        return False
    return any(c for row in element.properties["CMatrix"] for c in row)


def _hanging(
    line: Element, branch: Branch, model: list[list[complex]]
) -> tuple[Branch, list[list[complex]], tuple[int, ...]]:
    """The line with a bus of its own at its open end, what its closed end sees, and which end that is."""
    far = 1 if all(line.open[1]) else 0
    near = 1 - far
    own = f"{line.buses[far]} open {branch.name}"
    seen = model[near][near] - model[near][far] * model[far][near] / model[far][far]
    return replace(branch, end=own) if far else replace(branch, start=own), [[seen]], (near,)


def _from_matrix(line: Element, key: str) -> Fraction:
    """Positive sequence of a matrix with three equal phases. Raises: ValueError if they are not equal, Unreadable."""
    entries = [[exact(value, key) for value in row] for row in line.properties[key]]
    own = [entries[k][k] for k in range(3)]
    mutual = [entries[i][j] for i in range(3) for j in range(3) if i != j]
    size = max(map(abs, (*own, *mutual)))
    for what, values in (("on", own), ("beside", mutual)):
        if max(values) - min(values) > SAME * size:
            share = float(100 * (max(values) - min(values)) / size)
            raise ValueError(
                f"{key.lower()} is not that of three equal phases: entries {what} the diagonal differ by "
                f"{share:.3g} % of the largest"
            )
    return own[0] - mutual[0]


def _reactor(reactor: Element, frequency: Fraction, parts: Parts) -> None:
    stated = [key for key in ("Rp",) if reactor.number(key)] + [key for key in ("Parallel",) if reactor.properties[key]]
    if stated:
        parts.fault("I050", reactor, f"with {stated[0]}: only a resistance in series with an inductance is read")
        return
    r, x = reactor.number("R"), reactor.number("X")
    w0, w = _w0(reactor.number("BaseFreq")), _w0(frequency)
    if not _is_shunt(reactor):
        branch = Branch(
            reactor.name.partition(".")[2],
            reactor.buses[0],
            reactor.buses[1],
            r,
            inductance(x, w0),
            origins=(reactor.name,),
        )
        if _agrees(reactor, _pi(branch, frequency), AGREES, parts):
            parts.branches.append(branch)
        return
    if reactor.text("Conn").lower() == "delta":
        r, x = r / 3, x / 3
    x = x * w / w0
    size = r**2 + x**2
    if not size:
        parts.fault("I050", reactor, "a short circuit: neither resistance nor reactance")
        return
    y = (r / size, x / size)
    if _agrees(reactor, [[complex(y[0], -y[1])]], AGREES, parts):
        parts.shunts.append(Shunt(reactor.buses[0], y, reactor.name))
        parts.notes.append(Note(reactor.name, "a shunt, taken for a constant admittance: that of its frequency"))


def _capacitor(capacitor: Element, frequency: Fraction, parts: Parts) -> None:
    if not _is_shunt(capacitor):
        parts.fault("I050", capacitor, "in series; only a capacitor to ground is read")
        return
    if any(capacitor.numbers("R")) or any(capacitor.numbers("XL")):
        parts.fault("I050", capacitor, "with a resistance or an inductance in series")
        return
    states = capacitor.properties["States"]
    farad = sum((c for c, on in zip(capacitor.numbers("Cuf"), states, strict=True) if on), ZERO) / 10**6
    if capacitor.text("Conn").lower() == "delta":
        farad *= 3
    y = 1j * float(_w0(frequency) * farad)
    if not farad:
        parts.unmapped.append(Unmapped(capacitor.name, "all its steps are off"))
    elif _agrees(capacitor, [[y]], AGREES, parts):
        have, origins = parts.capacitances.get(capacitor.buses[0], (ZERO, ()))
        parts.capacitances[capacitor.buses[0]] = (have + farad, (*origins, capacitor.name))


def _is_shunt(element: Element) -> bool:
    """Whether there is one terminal, or the other one is on the ground of the same bus."""
    return len(element.buses) == 1 or element.terminal(1) == (0, 0, 0)


def _transformer(transformer: Element, frequency: Fraction, parts: Parts) -> None:
    kv, tap = transformer.numbers("kVs"), transformer.numbers("Taps")
    va = 1000 * transformer.number("kVAs", 0)
    volts = [1000 * k * t for k, t in zip(kv, tap, strict=True)]
    if min(volts) <= 0 or va <= 0:
        parts.fault("I050", transformer, "a rating or a tap is not positive")
        return
    base = volts[1] ** 2 / va
    w0 = _w0(transformer.number("BaseFreq"))
    # The engine has the iron losses and the magnetising current at the terminals of the last winding.
    iron = [va * transformer.number(key) / 100 for key in ("pctNoLoadLoss", "pctIMag")]
    matrix, _ = positive_sequence(transformer)
    turn = cmath.phase(-matrix[1][1] / matrix[1][0]) if matrix and matrix[1][0] else 0.0
    branch = Branch(
        transformer.name.partition(".")[2],
        transformer.buses[0],
        transformer.buses[1],
        sum(transformer.numbers("pctRs"), ZERO) / 100 * base,
        inductance(transformer.number("XHL") / 100 * base, w0),
        ratio=volts[0] / volts[1],
        shift_degree=Fraction(30 * round(math.degrees(turn) / 30)),
        origins=(transformer.name,),
    )
    model = _pi(branch, frequency)
    model[1][1] += complex(iron[0], -iron[1]) / float(volts[1]) ** 2
    if not _agrees(transformer, model, AGREES_TRANSFORMER, parts):
        return
    parts.branches.append(branch)
    if any(iron):
        siemens = (iron[0] / volts[1] ** 2, iron[1] / volts[1] ** 2)
        parts.shunts.append(Shunt(transformer.buses[1], siemens, transformer.name))
    if transformer.number("ppm_Antifloat"):
        text = "the reactances to ground of 1 ppm that keep its windings from floating are left out"
        parts.notes.append(Note(transformer.name, text))


def _pi(branch: Branch, frequency: Fraction) -> list[list[complex]]:
    """The admittances between the ends of a branch, in floats, with its ideal ratio at the start."""
    w = float(_w0(frequency))
    y = 1 / complex(float(branch.resistance_ohm), w * float(branch.inductance_henry) or 1e-300)
    leg = 0.5j * w * float(branch.capacitance_farad)
    ratio = float(branch.ratio) * cmath.exp(1j * math.radians(float(branch.shift_degree)))
    size = abs(ratio) ** 2
    return [[(y + leg) / size, -y / ratio.conjugate()], [-y / ratio, y + leg]]


def _agrees(
    element: Element,
    model: Sequence[Sequence[complex]],
    tolerance: float,
    parts: Parts,
    ends: tuple[int, ...] | None = None,
) -> bool:
    """Whether the engine makes the same of an element, between these ends; a difference is a fault."""
    matrix, other = positive_sequence(element)
    if other > BALANCED:
        text = f"its phases are not equal: {other:.2g} of its current is not of the sequence of its voltage"
        parts.fault("I048" if element.kind == "line" else "I047", element, text)
        return False
    n = len(model)
    ends = ends or tuple(range(n))
    matrix = [[matrix[i][j] for j in ends] for i in ends]
    # Each entry by its own rows' sizes, so that a ratio of 100 does not hide the smaller side.
    scale = [max(abs(matrix[k][k]), abs(model[k][k]), 1e-300) for k in range(n)]
    off = max(abs(matrix[i][j] - model[i][j]) / math.sqrt(scale[i] * scale[j]) for i in range(n) for j in range(n))
    if off > tolerance:
        text = f"the admittance that OpenDSS gives it is not that of its properties, by {off:.2g} of its size"
        parts.fault("I052", element, text)
    return off <= tolerance


@lru_cache
def _w0(frequency_hertz: Fraction) -> Fraction:
    """As for a spec; most elements are of one frequency."""
    return angular_frequency(frequency_hertz)


READERS: dict[str, Callable[[Element, Fraction, Parts], None]] = {
    "line": _line,
    "reactor": _reactor,
    "capacitor": _capacitor,
    "transformer": _transformer,
}
