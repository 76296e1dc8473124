"""From where the motion returns to an equilibrium: a level of the sum of all storage functions (THEORY 9).

What is below the level keeps every load in the band of its claim, and every inverter with limits inside them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from math import isqrt

from certify.kernel import loads
from certify.kernel.balls import Ball, lower, value
from certify.kernel.claims import Context, Fact, Mode
from certify.kernel.data import Data
from certify.kernel.equilibrium import margin
from certify.kernel.errors import require
from certify.kernel.linalg import ZERO, Matrix, multiply, solve, transpose
from certify.kernel.model import feedback, law_at, law_corners
from certify.kernel.rules import lowered
from certify.kernel.spec import ConstantVoltage, LinearLoop

MAX_PAIRS = 20_000  # of terms of a load law times corners: beyond, the end of its band is taken as a bound


def reach(context: Context, mode: Mode, rows: Matrix = ()) -> Fraction:
    """An upper bound of |K x~|^2 / (x~' P x~) over all corners of the tolerances, K being these rows or that of z.

    It is the largest eigenvalue of K P^-1 K'. In the charges q = c V of a box K and P are affine in 1/c, and
    K P^-1 K' is convex in both together, so its largest value is at a corner (FORMAT.md).
    """
    largest = ZERO
    for port, P in context.storages[mode].forms:
        c, K = port.capacitance_farad, rows or port.C
        if not rows and c is not None and all(P[i] == tuple(c if i == j else 0 for j in range(len(P))) for i in (0, 1)):
            largest = max(largest, 1 / c)  # P B = C': V stands alone in the storage
            continue
        W = multiply(K, solve(P, transpose(K)))
        a, d, b = W[0][0], W[-1][-1], W[0][-1] if len(W) > 1 else ZERO
        largest = max(largest, -lowered(-(a + d) / 2 - _root(((a - d) / 2) ** 2 + b * b, up=True)))
    return largest


def _root(x: Fraction, up: bool = False) -> Fraction:
    """The square root of x >= 0, rounded down (or up) in the 24th digit or so."""
    shift = max(0, 80 - (x.numerator.bit_length() - x.denominator.bit_length()) // 2)
    return Fraction(isqrt((x.numerator << 2 * shift) // x.denominator) + up, 1 << shift)


# A level in joule, what sets it, the margin in volt that it stands for, and whether it is a bound at all.
Bound = tuple[Fraction, str, Fraction, Callable[[], bool]]


def _load_bounds(context: Context, name: str, V: Ball, per_joule: Fraction) -> Iterator[Bound]:
    """Up to where the voltage stays in the band of the load there; an end beyond which the claim goes on is none."""
    for upward, units in enumerate(margin(context, name, V) or ()):
        if units is not None:
            require(units > 0, f"the load at node {name} is at the end of its band")
            ends = partial(_ends, context, name, bool(upward))
            yield value(units) ** 2 / (2 * per_joule), f"node {name}", value(units), ends


def _ends(context: Context, name: str, upward: bool) -> bool:
    """Whether a load is not shown to be monotone beyond that end of its band, at every corner of its tolerances."""
    if context.nodes[name].current is not None:
        return True
    band, law = context.pieces(name)[-1 if upward else 0]
    cuts = [load.cutoff_volt for load in context.nodes[name].loads if load.cutoff_volt is not None]
    if any(cut >= band[1] if upward else cut <= band[0] for cut in cuts):
        return True  # another law holds there
    if name in context.shortages:
        return True  # the load makes up for a shortage by its modulus, which is that on the band

    def holds() -> bool:
        corners = law_corners(law)
        if len(corners) * (len(law.active) ** 2 + len(law.reactive) ** 2) > MAX_PAIRS:
            return False
        return all(loads.is_monotone_beyond(law_at(law, signs), band[upward], upward) for signs in corners)

    return not context.once(("beyond", band, law, upward), holds)


def _limit_bounds(context: Context, name: str, u: Ball) -> Iterator[Bound]:
    """Up to where an inverter stays inside its limits."""
    dgu = context.nodes[name].dgu
    if dgu is None or dgu.limits_volt is None or isinstance(dgu.controller, LinearLoop | ConstantVoltage):
        return
    K, _ = feedback(dgu.controller)
    for axis, row, limit, x in zip("dq", K, dgu.limits_volt, u[:2], strict=True):
        units = lower(limit) - abs(x) - u.r
        require(units > 0, f"the inverter at node {name} is at its limit")
        key = ("reach", context.storages[name].key, row)
        per_joule = context.once(key, partial(reach, context, name, (row,)))
        if per_joule:
            what = f"the terminal voltage of the DGU at node {name}, {axis}"
            yield value(units) ** 2 / (2 * per_joule), what, value(units), lambda: True


def sublevel_set(status: str, context: Context, names: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `sublevel-set`: {H <= c} is invariant, and all motion in it tends to the equilibrium.

    Nothing is read from the certificate: c is the largest level at which no bound is passed, rounded down.
    """
    data.fields()
    first = names[0]
    require(first in context.equilibria, "the equilibrium is not proved")
    require(context.status[f"invariant-set/{first}"] == status, "the invariant set is not proved, or conditional")
    rest = context.equilibria[first]
    bounds: list[Bound] = []
    per_joule: dict[str, Fraction] = {}  # |V~|^2 / (2 S) at most
    for name in names:
        if context.nodes[name].dgu:
            per_joule[name] = context.once(("reach", context.storages[name].key), partial(reach, context, name))
        else:
            per_joule[name] = 1 / context.capacitances["-"][name]
        bounds += _load_bounds(context, name, rest.voltages[name], per_joule[name])
        if name in rest.terminals:
            bounds += _limit_bounds(context, name, rest.terminals[name])
    bounds.sort(key=lambda bound: bound[:2])
    least = next((bound for bound in bounds if bound[3]()), None)
    if least is None:
        return (("global", Fraction(1), ""),)
    level, what, volts, _ = least
    facts: list[Fact] = [("level c of the storage", level, "J"), (f"limited by {what}", volts, "V")]
    facts += ((f"reach at node {name}", _root(2 * level * per_joule[name], up=True), "V") for name in names)
    for name in names:
        for line in context.lines_at[name]:
            if line.start == name:
                henry = line.branch.inductance_henry * (1 - line.branch.tolerance[1])
                facts.append((f"reach in line {line.name}", _root(2 * level / henry, up=True), "A"))
    return tuple(facts)
