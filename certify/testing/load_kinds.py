"""Strategies for loads that are monotone on a band of voltages, or not, by construction.

With the power of a load at |V| = v as Y v^2 + I v + P, active parts (p) and reactive parts (q) alike, its current is
monotone on a band iff (Yp v^2 - Pp) (Yp v^2 + Ip v + Pp) >= (Iq v / 2 + Pq)^2 there and its conductance is positive.
With no parts below zero, and Iq <= Ip, Pq <= Pp, that holds from v1 on if Ip <= Yp v1 and Pp <= Yp v1^2 / 4: with
y = Yp v1^2, i = Ip v1, p = Pp the difference of both sides is at least 7/8 y^2 + y i / 4 at v1, and grows with v.

An exponential load P0 (v/V0)^np, Q0 (v/V0)^nq needs 4 (np - 1) P0^2 (v/V0)^(2 np) >= (nq - 2)^2 Q0^2 (v/V0)^(2 nq).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from hypothesis import strategies as st

from certify.kernel.quantity import QuantityError, parse_quantity
from certify.testing.assembly import BAND, BASE_VOLTAGE
from certify.testing.parts import Load
from certify.testing.short_numbers import decimals, quantities, significands, write
from certify.values import to_plain

POWER = ("1 kW", "100 kW")  # at 1 pu, of each part
KINDS = ("zip", "exp", "rl")
Number = tuple[int, int]  # m, e: m 10^e
_TENTHS = st.sampled_from((0, 5, 10))


def loads(
    monotone: bool | None = None,
    kinds: Sequence[str] = KINDS,
    *,
    band: Sequence[Any] = BAND,
    base_voltage: Any = BASE_VOLTAGE,
    power: tuple[Any, Any] = POWER,
) -> st.SearchStrategy[Load]:
    """Loads at a node whose voltage is `base_voltage` about: one of `kinds`, monotone on the `band` or not (or both).

    Band and base voltage are those of the spec that they are for; the ones of `dgu_spec` and `network_spec` if left
    out. `power`: what a load draws at 1 pu, from and to. Shrinks to few round numbers: a series R-L load, or a
    constant power if it is not to be monotone. A series R-L load is always monotone, in the sense that it is passive.
    Raises: ValueError for other kinds, or for a band or powers that cannot be.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise ValueError(f"loads of kind {kind!r}; there are {', '.join(KINDS)}")
    volts, v1, v2 = _volts(base_voltage, band)
    low, high = (_exactly(end, "W", {}) for end in power)
    powers = significands(low, high, 2)
    admittances = significands(low / volts**2, high / volts**2, 2)
    makers = {
        "zip": ((_monotone_zip(admittances, v1),), (_constant_power(powers), _mostly_power(powers, v2))),
        "exp": ((_monotone_exp(powers),), (_stiff_exp(powers),)),
        "rl": ((_series(quantities("ohm", volts**2 / high, volts**2 / low)),), ()),
    }
    wanted = (0, 1) if monotone is None else (0,) if monotone else (1,)
    choices = [maker for side in wanted for kind in kinds for maker in makers[kind][side]]
    if not choices:
        raise ValueError("every series R-L load is monotone; name zip or exp")
    return st.one_of(*choices)


def _volts(base_voltage: Any, band: Sequence[Any]) -> tuple[Fraction, Fraction, Fraction]:
    """The base voltage and the ends of the band, in volt."""
    volts = _exactly(base_voltage, "V", {})
    low, high = (_exactly(end, "V", {"V": volts}) for end in band)
    if not 0 < low < high:
        raise ValueError(f"a band from {float(low):g} V to {float(high):g} V")
    return volts, low, high


def _exactly(value: Any, unit: str, per_unit: dict[str, Fraction]) -> Fraction:
    try:
        return parse_quantity(to_plain(value), unit, per_unit)
    except QuantityError as error:
        raise ValueError(f"{error.message}, in what loads are to be like") from None


@st.composite
def _pair(draw: st.DrawFn, value: Number, units: tuple[str, str]) -> list[str]:
    """[active, reactive]: the reactive part zero, half or all of the active one."""
    m, e = value
    tenths = draw(_TENTHS)
    return [write(m, e, units[0]), write(m * tenths, e - 1, units[1])]


@st.composite
def _at_most(draw: st.DrawFn, bound: Fraction) -> Number:
    """m 10^e of two digits at most, from a tenth of the bound to all of it."""
    e = len(str(bound.numerator)) - len(str(bound.denominator)) - 2
    unit = Fraction(10) ** e
    most = int(bound / unit)
    while most >= 100:
        most, e = most // 10, e + 1
    return draw(st.integers(max(1, most // 10), most)), e


@st.composite
def _monotone_zip(draw: st.DrawFn, admittances: st.SearchStrategy[Number], v1: Fraction) -> Load:
    Y = draw(admittances)
    yp = Fraction(Y[0]) * Fraction(10) ** Y[1]
    parts = {"Y": draw(_pair(Y, ("S", "S")))}
    if draw(st.booleans()):
        parts["I"] = draw(_pair(draw(_at_most(yp * v1)), ("A", "A")))
    if draw(st.booleans()):
        parts["P"] = draw(_pair(draw(_at_most(yp * v1**2 / 4)), ("W", "var")))
    return Load(kind="zip", **parts)


@st.composite
def _constant_power(draw: st.DrawFn, powers: st.SearchStrategy[Number]) -> Load:
    """(-P) (P) < 0 at every voltage; a source as well as a load."""
    value = write(*draw(powers), "W")
    return Load(kind="zip", P=[f"-{value}" if draw(st.booleans()) else value, "0 var"])


@st.composite
def _mostly_power(draw: st.DrawFn, powers: st.SearchStrategy[Number], v2: Fraction) -> Load:
    """P > Y v2^2, Y > 0: the first factor is negative all over the band, and the second positive."""
    m, e = draw(powers)
    Y = draw(_at_most(Fraction(m) * Fraction(10) ** e / v2**2 * Fraction(99, 100)))
    return Load(kind="zip", Y=[write(*Y, "S"), "0 S"], P=[write(m, e, "W"), "0 var"])


_ABOVE_ONE, _BELOW_ONE = decimals("1.2", 3), st.one_of(st.just(0), decimals("0.1", "0.95"))


@st.composite
def _monotone_exp(draw: st.DrawFn, powers: st.SearchStrategy[Number]) -> Load:
    """np > 1 with Q0 = 0, with nq = 2, or with nq = np from 1.2 on and Q0 <= P0, where 4 (np - 1) > (np - 2)^2."""
    power, np = draw(powers), draw(_ABOVE_ONE)
    reactive = draw(st.sampled_from(("none", "2", "np")))
    table = {"kind": "exp", "P0": write(*power, "W"), "np": np}
    return Load(
        table if reactive == "none" else table | {"Q0": write(*power, "var"), "nq": 2 if reactive == "2" else np}
    )


@st.composite
def _stiff_exp(draw: st.DrawFn, powers: st.SearchStrategy[Number]) -> Load:
    """np < 1: the left side is negative at every voltage."""
    return Load(kind="exp", P0=write(*draw(powers), "W"), np=draw(_BELOW_ONE))


_COILS = quantities("H", "10 mH", "1 H")


@st.composite
def _series(draw: st.DrawFn, resistances: st.SearchStrategy[str]) -> Load:
    return Load(kind="rl", R=draw(resistances), L=draw(_COILS))
