"""Complex numbers known to within a radius: a centre of two integers in units of 2^-BITS, and a bound of the error.

Every operation rounds its centre and enlarges the radius by more than that, so the true value stays in the ball. Real
quantities that are only bounded (a voltage, a tolerance) are balls too. Integers make this quick and hold its length.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import isqrt
from typing import NamedTuple

from certify.kernel.errors import require
from certify.kernel.powers import Interval
from certify.kernel.reader import Pair

BITS = 160


class Ball(NamedTuple):
    """All z with |z - (x + j y)| <= r, in units of 2^-BITS."""

    x: int
    y: int
    r: int

    def __add__(self, other: Ball) -> Ball:  # type: ignore[override]
        return Ball(self.x + other.x, self.y + other.y, self.r + other.r)

    def __sub__(self, other: Ball) -> Ball:
        return Ball(self.x - other.x, self.y - other.y, self.r + other.r)

    def __mul__(self, other: Ball) -> Ball:  # type: ignore[override]
        (a, b, r), (c, d, s) = self, other
        error = (
            isqrt(a * a + b * b) * s + isqrt(c * c + d * d) * r + r * s + r + s
        )  # the roots are below by less than 1
        return Ball((a * c - b * d) >> BITS, (a * d + b * c) >> BITS, (error >> BITS) + 3)

    def inverse(self) -> Ball:
        """1/z: the ball around conj(c) / (|c|^2 - r^2) with radius r / (|c|^2 - r^2)."""
        power = self.x * self.x + self.y * self.y - self.r * self.r
        require(power > 0, "a quantity to divide by may be zero")
        x, y, r = (part << 2 * BITS for part in self)
        return Ball(x // power, -y // power, r // power + 3)

    def largest(self) -> int:
        """An upper bound of |z|."""
        return isqrt(self.x * self.x + self.y * self.y) + 1 + self.r

    def widened(self, radius: int) -> Ball:
        return Ball(self.x, self.y, self.r + radius)


NOTHING = Ball(0, 0, 0)


def upper(x: Fraction) -> int:
    """x in units, rounded up."""
    return -((-x.numerator << BITS) // x.denominator)


def lower(x: Fraction) -> int:
    """x in units, rounded down."""
    return (x.numerator << BITS) // x.denominator


def value(units: int) -> Fraction:
    return Fraction(units, 1 << BITS)


def ball(z: Pair, radius: Fraction | int = 0) -> Ball:
    """The ball around an exact complex number.

    >>> third = ball((Fraction(1, 3), Fraction(0)))
    >>> (third * ball((Fraction(3), Fraction(0)))).largest() >= 1 << BITS
    True
    """
    return Ball(lower(z[0]), lower(z[1]), upper(Fraction(radius)) + 2)


def box(real: Interval, imaginary: Interval) -> Ball:
    """The ball around all complex numbers with these parts."""
    (a, b), (c, d) = real, imaginary
    inner = ball(((a + b) / 2, (c + d) / 2))
    return inner.widened(isqrt(upper((b - a) / 2) ** 2 + upper((d - c) / 2) ** 2) + 1)


def total(balls: Iterable[Ball]) -> Ball:
    x = y = r = 0
    for a, b, s in balls:
        x, y, r = x + a, y + b, r + s
    return Ball(x, y, r)


def centre(z: Ball) -> Pair:
    return value(z.x), value(z.y)
