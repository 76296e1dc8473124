"""Where an exact polynomial is negative on the positive half-line: Sturm isolation, then a point with few digits."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

from certify.kernel.poly import Polynomial, evaluate, odd_part, sign_changes, sturm_sequence


def round_to_digits(x: Fraction, digits: int) -> Fraction:
    """x to so many significant decimal digits, or one more.

    >>> round_to_digits(Fraction(2, 3), 2)
    Fraction(67, 100)
    """
    if not x:
        return x
    magnitude = (x.numerator.bit_length() - x.denominator.bit_length()) * 30103 // 100000
    unit = Fraction(10) ** (magnitude - digits)
    return round(x / unit) * unit


def magnitude(x: Fraction) -> int:
    """The exponent of the leading decimal digit of x != 0.

    >>> magnitude(Fraction(1234)), magnitude(Fraction(-1, 50))
    (3, -2)
    """
    exponent = len(str(abs(x.numerator))) - len(str(x.denominator))
    return exponent if abs(x) >= Fraction(10) ** exponent else exponent - 1


def square_root(x: Fraction, digits: int = 0) -> Fraction:
    """The square root of x >= 0, below it by less than one part in 10^digits."""
    shift = 4 * digits + 8
    return Fraction(isqrt(x.numerator * x.denominator << 2 * shift), x.denominator << shift)


def find_negative_point(p: Polynomial) -> Fraction | None:
    """An omega > 0 with p(omega^2) < 0, few digits if possible; None if p >= 0 on the whole half-line.

    >>> find_negative_point((Fraction(1), Fraction(-3), Fraction(1)))
    Fraction(6, 5)
    >>> find_negative_point((Fraction(1), Fraction(-2), Fraction(1))) is None
    True
    """
    while p and not p[0]:  # a factor omega^2 changes no sign
        p = p[1:]
    if not p:
        return None
    chain = sturm_sequence(odd_part(p))
    bound = 1 + max((abs(c / p[-1]) for c in p[:-1]), default=Fraction(0))
    # Bisect until each interval has at most one sign change of p, with no end a root: then the ends tell all.
    ends = [(x, sign_changes(chain, x)) for x in (Fraction(0), Fraction(1 << int(bound).bit_length()))]
    work = [(ends[0], ends[1])]
    while work:
        low, high = work.pop()
        for x, _ in (low, high):
            if evaluate(p, x) < 0:
                return _simple_square_root(p, x)
        if low[1] - high[1] > 1:
            x = _middle(low[0], high[0])
            while not evaluate(p, x):
                x = (x + high[0]) / 2
            middle = (x, sign_changes(chain, x))
            work += [(low, middle), (middle, high)]
    return None


def _middle(low: Fraction, high: Fraction) -> Fraction:
    """A point between, by orders of magnitude: the roots spread over many decades."""
    if low == 0:
        return high / 2**10
    if high > 4 * low:
        return round_to_digits(square_root(low * high), 2)
    return (low + high) / 2


def _simple_square_root(p: Polynomial, x: Fraction) -> Fraction:
    """An omega with p(omega^2) < 0, near the square root of x, with as few digits as it takes."""
    digits = 1
    while True:
        omega = round_to_digits(square_root(x, digits), digits)
        if omega and evaluate(p, omega * omega) < 0:
            return omega
        if not x and not digits % 4:  # negative at zero itself: approach it
            omega = Fraction(1, 10**digits)
            if evaluate(p, omega * omega) < 0:
                return omega
        digits += 1 if digits < 4 else digits // 2
