"""Whether a load of given exponents or fractions is monotone, exactly, for the square of Q0/P0.

The square is rational for every power factor, where Q0/P0 mostly is not; and monotonicity depends on nothing else.
"""

from __future__ import annotations

from fractions import Fraction

from certify.kernel import poly
from certify.kernel.poly import to_polynomial
from certify.kernel.powers import compare_power
from certify.kernel.reader import Pair


def exponents_hold(np: Fraction, nq: Fraction, square: Fraction, band: Pair) -> bool | None:
    """An exponential load with P0 > 0: 4 (np - 1) v^(2 np - 2 nq) >= (nq - 2)^2 square at both ends, np > 1.

    `band` in units of V0. None if a power is too close to be told apart (THEORY 5).

    >>> exponents_hold(Fraction(3, 2), Fraction(1), Fraction(1), (Fraction(9, 10), Fraction(11, 10)))
    True
    """
    reactive = (nq - 2) ** 2 * square
    if np <= 1:
        return np == 1 and not reactive
    signs = [compare_power(v, 2 * (np - nq), reactive / (4 * (np - 1))) for v in band]
    return None if None in signs else min(sign or 0 for sign in signs) >= 0


def fractions_hold(Zp: Fraction, Pp: Fraction, square: Fraction, band: Pair) -> bool:
    """A ZIP load with P0 > 0 and the same fractions for P and Q, which add up to one; `band` in units of V0.

    >>> fractions_hold(Fraction(1), Fraction(0), Fraction(1), (Fraction(9, 10), Fraction(11, 10)))
    True
    """
    P = to_polynomial([Pp, 1 - Zp - Pp, Zp])
    v_slope = poly.multiply(to_polynomial([0, 1]), poly.derivative(P))
    radial, cross = (poly.add(v_slope, poly.scale(-k, P)) for k in (1, 2))
    D = poly.add(poly.multiply(P, radial), poly.scale(-square / 4, poly.multiply(cross, cross)))
    return all(_is_nonnegative(p, band) for p in (P, D))


def _is_nonnegative(p: poly.Polynomial, band: Pair) -> bool:
    """By Bernstein coefficients where they tell, which is quick; else by Sturm sequences."""
    signs = poly.bernstein_signs(tuple(int(c) for c in poly.primitive(p)), *band)
    if min(signs, default=0) >= 0:
        return True
    return min(signs[0], signs[-1]) >= 0 and poly.is_nonnegative_on(p, *band)
