"""Strategies for inverters: filters, and control laws that are passive, on the boundary, or not, by construction.

With the filter (R, L, C) and the law u = K11 V + K12 I + K13 v put K11 = 1 - Bm - L X, K12 = H + R + w0 L J and
K13 = -H X, J the rotation by a right angle. The controlled inverter is passive iff X = X' > 0, Bm = Bm' > 0 and
H Bm + Bm H' <= 0; then S = (C |V~|^2 + L w' Bm^-1 w + v~' X v~) / 2 with w = I~ - X v~ is a storage function, and
S' = <V~, d~> + w' Bm^-1 H w. Without integrator the same holds with X = 0, and K13 left out. The gains are formulas in
R, L and w0, so that what is said of a law holds with every filter and frequency.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import Any

from hypothesis import strategies as st

from certify.kernel.quantity import NumberText
from certify.testing.parts import Controller, Filter
from certify.testing.short_numbers import decimals, in_range, plain

CROSS = "w0*L"
STIFFNESS = decimals(1, 10_000)  # X, in V/(A s)
WEIGHT = decimals("0.01", 100)  # Bm, without unit
DAMPING = decimals("0.01", 20)  # of H, in ohm
ALPHA = decimals("0.1", 100)  # of an IDA-PBC law, in ohm
_OFF = st.sampled_from(sorted(range(-5, 6), key=lambda k: (abs(k), -k)))  # hundredths: 0, 1, -1, ...


def _negative(value: Any) -> Any:
    return -value if isinstance(value, int) else NumberText(f"-{value}".replace("--", ""))


def _either_sign(values: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.tuples(st.booleans(), values).map(lambda drawn: _negative(drawn[1]) if drawn[0] else drawn[1])


_TURN = _either_sign(DAMPING)  # g of H, in ohm
_ERROR = _either_sign(decimals("0.001", "0.5"))  # as a share


def filters(
    R: Any = ("10 mohm", "1 ohm"),
    L: Any = ("0.1 mH", "10 mH"),
    C: Any = ("1 uF", "100 uF"),
    tolerance: Any = None,
) -> st.SearchStrategy[Filter]:
    """Filters of inverters. Each value is a range (low, high), one value, or a strategy of one's own.

    Shrinks to 0.1 ohm, 1 mH, 10 uF. `tolerance`, such as "5 %", is that of all three.
    Raises: ValueError for a range that has no number of two digits.
    """
    values = {"R": in_range("ohm", R), "L": in_range("H", L), "C": in_range("F", C)}
    return _parts(Filter, values | ({} if tolerance is None else {"tolerance": in_range("%", tolerance)}))


@st.composite
def _parts(draw: st.DrawFn, kind: type[Filter], values: dict[str, st.SearchStrategy[Any]]) -> Filter:
    return kind({key: draw(value) for key, value in values.items()})


@st.composite
def references(draw: st.DrawFn) -> list[str]:
    """Reference voltages [d, q] in per unit: d from 0.95 to 1.05, q up to 0.05 to either side. Shrinks to 1 and 0."""
    return [f"{plain(100 + draw(_OFF), -2)} pu", f"{plain(draw(_OFF), -2)} pu"]


def controllers(passive: bool | str = True, integral: bool | None = None) -> st.SearchStrategy[Controller]:
    """Control laws that are passive with every filter (True), on the boundary of that ("boundary"), or not (False)."""
    if passive == "boundary":
        return boundary_controllers(integral)
    if not isinstance(passive, bool):
        raise ValueError(f'passive is True, False or "boundary", not {passive!r}')
    return passive_controllers(integral) if passive else non_passive_controllers(integral)


@cache
def passive_controllers(integral: bool | None = None) -> st.SearchStrategy[Controller]:
    """Laws with which the inverter is passive, whatever its filter and the frequency, with damping to spare.

    `integral`: only laws with integral action (True), only such without (False), or both. With it the network's
    equilibrium has the reference as its voltage. Kinds, simplest first: IDA-PBC (alpha < 0 < nu, ki); state feedback
    by one number for each of X, Bm, H; with H turned by g; by two for each, one an axis; with a coupled X > 0. A
    constant voltage has the damping of the filter's resistance, and none without one.
    """
    with_integral = (_energy_shaping(), _plain_feedback(), _turned_feedback(), _by_axis(), _coupled())
    without = (_proportional(), _constant())
    return st.one_of(*_chosen(integral, with_integral, without))


@cache
def boundary_controllers(integral: bool | None = None) -> st.SearchStrategy[Controller]:
    """Laws that are passive, and lossless in one direction at least: the damping h, hd or hq of their `let` is 0.

    With any negative number in its place (`law.with_let(h=...)`) no storage function exists; with a positive one
    there is dissipation to spare. H is nonsingular by its rotation g, so S is positive definite all the same. Moreover,
    as with every law with integral action, anything at all in one corner of K11 (`law.perturbed("K11", by, at=(0, 1))`)
    makes X or Bm lose its symmetry, and no storage function exists.
    """
    with_integral = (_turned_feedback(lossless=True), _lossless_axis())
    return st.one_of(*_chosen(integral, with_integral, (_proportional(lossless=True),)))


@cache
def non_passive_controllers(integral: bool | None = None, unstable: bool = False) -> st.SearchStrategy[Controller]:
    """Laws with which the inverter is not passive, whatever its filter: for each there is a witness of that.

    They are passive laws with one mistake, such as designs have: damping, weight or integral of the wrong sign,
    decoupling of the wrong sign, twice over, or by another inductance, a published sign, one corner of K11 too many.
    A network with one of them may still be stable; with `unstable` there are only such that are unstable by
    themselves: the trace of F, that is of 2 H / L, is positive, so that nothing else could be claimed of them.
    """
    growing = (_plain_feedback(damping=-1), _energy_shaping(signs=(1, 1, 1)))
    with_integral = growing if unstable else (*growing, _mistaken(), _energy_shaping(signs=(-1, 1, -1)))
    return st.one_of(*_chosen(integral, with_integral, (_proportional(damping=-1),)))


def _chosen(integral: bool | None, with_integral: tuple[Any, ...], without: tuple[Any, ...]) -> tuple[Any, ...]:
    if integral is None:
        return (*with_integral, *without)
    return with_integral if integral else without


def _law(let: dict[str, Any], K11: Any, K12: Any, K13: Any = None) -> Controller:
    gains = {"K11": K11, "K12": K12, **({} if K13 is None else {"K13": K13})}
    return Controller(kind="state-feedback", let=let, **gains)


def _decoupled(h: str = "h", cross: str = CROSS, other: str = "") -> list[list[str]]:
    """R + w0 L J, less the damping."""
    return [[f"R - {h}", f"-{cross}"], [cross, f"R - {other or h}"]]


def _turned(h: str = "h", other: str = "") -> list[list[str]]:
    return [[f"R - {h}", f"-({CROSS} + g)"], [f"{CROSS} + g", f"R - {other or h}"]]


def _number(sign: int, value: Any) -> Any:
    return value if sign > 0 else _negative(value)


@st.composite
def _energy_shaping(draw: st.DrawFn, signs: tuple[int, int, int] = (-1, 1, 1)) -> Controller:
    """alpha, nu, ki with these signs, as numbers or by axis."""
    values = []
    by_axis = draw(st.booleans())
    for sign, numbers in zip(signs, (ALPHA, WEIGHT, STIFFNESS), strict=True):
        pair = [_number(sign, draw(numbers)) for _ in range(2 if by_axis else 1)]
        values.append(pair if by_axis else pair[0])
    return Controller(kind="ida-pbc", alpha=values[0], nu=values[1], ki=values[2])


@st.composite
def _plain_feedback(draw: st.DrawFn, damping: int = 1) -> Controller:
    let = {"x": draw(STIFFNESS), "b": draw(WEIGHT), "h": _number(damping, draw(DAMPING))}
    return _law(let, "1 - b - L*x", _decoupled(), "h*x")


@st.composite
def _turned_feedback(draw: st.DrawFn, lossless: bool = False) -> Controller:
    let = {"x": draw(STIFFNESS), "b": draw(WEIGHT)}
    let |= {"h": 0 if lossless else draw(DAMPING), "g": draw(_TURN)}
    return _law(let, "1 - b - L*x", _turned(), [["h*x", "g*x"], ["-g*x", "h*x"]])


@st.composite
def _lossless_axis(draw: st.DrawFn) -> Controller:
    """No damping on one axis; H = [[-hd, -g], [g, -hq]], Bm and X multiples of the identity."""
    let = {"x": draw(STIFFNESS), "b": draw(WEIGHT)}
    h = draw(DAMPING)
    let |= {"hd": h, "hq": 0} if draw(st.booleans()) else {"hd": 0, "hq": h}
    let["g"] = draw(_TURN)
    return _law(let, "1 - b - L*x", _turned("hd", "hq"), [["hd*x", "g*x"], ["-g*x", "hq*x"]])


@st.composite
def _by_axis(draw: st.DrawFn) -> Controller:
    ranges = {"x": STIFFNESS, "b": WEIGHT, "h": DAMPING}
    let = {f"{name}{axis}": draw(numbers) for name, numbers in ranges.items() for axis in "dq"}
    K11 = [["1 - bd - L*xd", 0], [0, "1 - bq - L*xq"]]
    return _law(let, K11, _decoupled("hd", other="hq"), [["hd*xd", 0], [0, "hq*xq"]])


@st.composite
def _coupled(draw: st.DrawFn) -> Controller:
    """X = [[xd, c], [c, xq]] with |c| < the smaller of the two; H = -h + g J; K13 = -H X."""
    xd, xq = draw(STIFFNESS), draw(STIFFNESS)
    share = draw(st.sampled_from((1, -1, 5, -5, 9, -9)))
    c = plain(int(min(Fraction(xd), Fraction(xq)) * 10) * share, -2)
    let = {"xd": xd, "xq": xq, "c": c, "b": draw(WEIGHT), "h": draw(DAMPING)}
    let["g"] = draw(st.one_of(st.just(0), _TURN))
    K11 = [["1 - b - L*xd", "-L*c"], ["-L*c", "1 - b - L*xq"]]
    return _law(let, K11, _turned(), [["h*xd + g*c", "h*c + g*xq"], ["h*c - g*xd", "h*xq - g*c"]])


@st.composite
def _proportional(draw: st.DrawFn, damping: int = 1, lossless: bool = False) -> Controller:
    """No integrator: X = 0."""
    h = 0 if lossless else _number(damping, draw(DAMPING))
    return _law({"b": draw(WEIGHT), "h": h}, "1 - b", _decoupled())


def _constant() -> st.SearchStrategy[Controller]:
    """A constant terminal voltage: the filter alone, Bm = 1 and H = -R - w0 L J."""
    return st.builds(Controller, st.just({"kind": "constant"}))


_MISTAKES = (
    "decoupling of the wrong sign",
    "decoupling twice over",
    "decoupling by another inductance",
    "weight of the wrong sign",
    "integral of the wrong sign",
    "published sign of K11",
    "one corner of K11",
)


@st.composite
def _mistaken(draw: st.DrawFn) -> Controller:
    """A plain law with one mistake.

    A factor k != 1 at w0 L leaves H = -h + (k - 1) w0 L J, and X = -H^-1 K13 is not symmetric; nor is it with one more
    corner of K11 the case that Bm is. Otherwise X = -x, Bm = -b or Bm = -2 L x is negative.
    """
    let = {"x": draw(STIFFNESS), "b": draw(WEIGHT), "h": draw(DAMPING)}
    K11: Any = "1 - b - L*x"
    K12, K13 = _decoupled(), "h*x"
    mistake = draw(st.sampled_from(_MISTAKES))
    if mistake == "decoupling of the wrong sign":
        K12 = [["R - h", CROSS], [f"-{CROSS}", "R - h"]]
    elif mistake == "decoupling twice over":
        K12 = _decoupled(cross=f"2*{CROSS}")
    elif mistake == "decoupling by another inductance":
        factor = plain(10_000 + int(Fraction(draw(_ERROR)) * 10_000), -4)
        K12 = _decoupled(cross=f"{factor}*{CROSS}")
    elif mistake == "weight of the wrong sign":
        let["b"] = _number(-1, let["b"])
    elif mistake == "integral of the wrong sign":
        K13 = "-h*x"
    elif mistake == "published sign of K11":
        del let["b"]
        K11 = "1 + L*x"
    else:
        let["a"] = draw(_ERROR)
        K11 = [[K11, "a"], [0, K11]]
    return _law(let, K11, K12, K13)
