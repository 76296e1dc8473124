"""Exact numbers of foreign data and back: the only place of an import where digits are lost."""

from __future__ import annotations

import math
from fractions import Fraction

DIGITS = 34  # significant decimal digits of what is no finite decimal
_PREFIXES = tuple(
    (Fraction(10) ** exponent, prefix)
    for exponent, prefix in ((9, "G"), (6, "M"), (3, "k"), (0, ""), (-3, "m"), (-6, "u"), (-9, "n"), (-12, "p"))
)


def from_float(value: float) -> Fraction:
    """The shortest decimal that is this double, exactly: what a person wrote, if it had at most 15 digits.

    Raises: ValueError if it is no finite number.

    >>> from_float(0.1)
    Fraction(1, 10)
    """
    if not math.isfinite(value):
        raise ValueError("not a finite number")
    return Fraction(repr(float(value)))


def round_to(value: Fraction, digits: int = DIGITS) -> Fraction:
    """The nearest decimal with so many significant digits, ties to even; a shorter decimal is kept.

    >>> round_to(Fraction(2, 3), 3)
    Fraction(667, 1000)
    """
    if not value:
        return value
    # bit lengths give the decimal exponent up to one; the loop mends that
    exponent = math.floor((value.numerator.bit_length() - value.denominator.bit_length()) * 0.30103) - digits
    while abs(value) >= Fraction(10) ** (exponent + digits):
        exponent += 1
    unit = Fraction(10) ** exponent
    return round(value / unit) * unit


def root(square: Fraction) -> Fraction:
    """The square root of a rational that is not negative, rounded to DIGITS; exact if it is rational and short.

    >>> root(Fraction(9, 4))
    Fraction(3, 2)
    """
    if not square:
        return square
    scale = 10 ** (2 * DIGITS + max(0, (square.denominator.bit_length() - square.numerator.bit_length()) // 3))
    return round_to(Fraction(math.isqrt(square.numerator * scale * scale // square.denominator), scale))


def decimal(value: Fraction) -> str:
    """A decimal without exponent, rounded to DIGITS significant digits if it has more.

    >>> decimal(Fraction(-1, 8)), decimal(Fraction(20000))
    ('-0.125', '20000')
    """
    value = round_to(value)
    places = 0
    while (value * 10**places).denominator != 1:
        places += 1
    digits = str(abs(value.numerator * 10**places // value.denominator)).rjust(places + 1, "0")
    whole, part = (digits[:-places], digits[-places:]) if places else (digits, "")
    return ("-" if value < 0 else "") + whole + ("." + part if part else "")


def quantity(value: Fraction, unit: str) -> str:
    """A number with the prefix that keeps it short: "1.8 mH". `unit` may end in "/km"; the value is then per metre.

    >>> quantity(Fraction(9, 5000), "H"), quantity(Fraction(343, 10**6), "ohm/km"), quantity(Fraction(0), "W")
    ('1.8 mH', '343 mohm/km', '0 W')
    """
    if unit.endswith("/km"):
        value *= 1000
    size = abs(value)
    for factor, prefix in _PREFIXES:
        if size >= factor:
            return f"{decimal(value / factor)} {prefix}{unit}"
    return f"0 {unit}" if not size else f"{decimal(value * 10**15)} f{unit}"


def inductance(reactance_ohm: Fraction, w0: Fraction) -> Fraction:
    """L = X / w0, rounded to 34 significant digits, with the w0 that a spec of this frequency has: w0 L is X to 1e-33.

    >>> from certify.kernel.spec import angular_frequency
    >>> w0 = angular_frequency(Fraction(50))
    >>> abs(inductance(Fraction(1, 3), w0) * w0 * 3 - 1) < Fraction(1, 10**33)
    True
    """
    return round_to(reactance_ohm / w0)
