"""Rational powers x^e of positive rationals: exact comparison, and enclosures with directed rounding.

An interval is a pair (low, high) of rationals with the true value inside. Enclosures come from the series
of artanh and exp, each with its remainder bounded; every intermediate result is rounded outwards.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

Interval = tuple[Fraction, Fraction]

EXACT_BITS = 1 << 21  # comparisons by integer powers up to this size; beyond it, enclosures
PRECISIONS = (64, 160, 400, 1000, 2500)


def _outward(low: Fraction, high: Fraction, bits: int) -> Interval:
    """The smallest interval with denominators 2^bits around [low, high]."""
    unit = 1 << bits
    return (
        Fraction((low.numerator * unit) // low.denominator, unit),
        Fraction(-((-high.numerator * unit) // high.denominator), unit),
    )


def interval_sum(terms: Iterable[Interval]) -> Interval:
    low = high = Fraction(0)
    for a, b in terms:
        low, high = low + a, high + b
    return low, high


def interval_product(x: Interval, y: Interval) -> Interval:
    products = [a * b for a in x for b in y]
    return min(products), max(products)


def _artanh(y: Fraction, bits: int) -> Interval:
    """Enclosure of artanh(y), |y| <= 1/3: the remainder after a term is below |term| y^2 / (1 - y^2)."""
    low = high = Fraction(0)
    power, k, square = (y, y), 1, y * y
    while True:
        low, high = low + power[0] / k, high + power[1] / k
        low, high = _outward(low, high, bits)
        if max(abs(power[0]), abs(power[1])) <= Fraction(2, 1 << bits):
            rest = Fraction(1, 1 << bits)  # y^2 / (1 - y^2) <= 1/8 on our range
            return low - rest, high + rest
        power = _outward(*interval_product(power, (square, square)), bits)
        k += 2


def log_enclosure(x: Fraction, bits: int) -> Interval:
    """Enclosure of ln(x), x > 0, absolute width about 2^-bits times the number of terms."""
    if x <= 0:
        raise ValueError("logarithm of a number that is not positive")
    shift = x.numerator.bit_length() - x.denominator.bit_length()
    m = x / (Fraction(2) ** shift)  # in (1/2, 2)
    if m > Fraction(3, 2):
        m, shift = m / 2, shift + 1
    elif m < Fraction(3, 4):
        m, shift = m * 2, shift - 1
    main, two = _artanh((m - 1) / (m + 1), bits), _artanh(Fraction(1, 3), bits)
    return interval_sum([(2 * main[0], 2 * main[1]), interval_product((Fraction(2 * shift),) * 2, two)])


def exp_enclosure(t: Fraction, bits: int) -> Interval:
    """Enclosure of exp(t): t is halved until |t| <= 1/2, Taylor, remainder below the last term, squared back."""
    halvings = max(0, (abs(t.numerator) // t.denominator).bit_length() + 1)
    work = bits + 2 * halvings + 8
    r = _outward(t / (1 << halvings), t / (1 << halvings), work)
    total, term, n = (Fraction(1), Fraction(1)), (Fraction(1), Fraction(1)), 1
    while max(abs(term[0]), abs(term[1])) > Fraction(2, 1 << work):
        low, high = interval_product(term, r)
        term = _outward(low / n, high / n, work)
        total = interval_sum([total, term])
        n += 1
    rest = Fraction(2, 1 << work)
    total = (total[0] - rest, total[1] + rest)
    for _ in range(halvings):
        total = _outward(*interval_product(total, total), work)
    return max(total[0], Fraction(0)), total[1]


def power_enclosure(x: Fraction, e: Fraction, bits: int) -> Interval:
    """Enclosure of x^e, x > 0; exact when e is a small integer.

    >>> power_enclosure(Fraction(2), Fraction(3), 64)
    (Fraction(8, 1), Fraction(8, 1))
    >>> low, high = power_enclosure(Fraction(2), Fraction(1, 2), 64)
    >>> low**2 < 2 < high**2
    True
    """
    if e.denominator == 1 and abs(e.numerator) <= 64:
        exact = x**e.numerator
        return exact, exact
    low, high = interval_product((e, e), log_enclosure(x, bits))
    return exp_enclosure(low, bits)[0], exp_enclosure(high, bits)[1]


def compare_power(x: Fraction, e: Fraction, c: Fraction) -> int | None:
    """The sign of x^e - c for x > 0: 1, 0, -1, or None if the last precision does not tell.

    x^(p/q) > c iff x^p > c^q for c > 0 (THEORY 0).
    >>> compare_power(Fraction(1, 4), Fraction(1, 2), Fraction(1, 2))
    0
    """
    if c <= 0:
        return 1
    p, q = e.numerator, e.denominator
    size = [max(v.numerator.bit_length(), v.denominator.bit_length()) for v in (x, c)]
    if size[0] * abs(p) + size[1] * q <= EXACT_BITS:
        left, right = x**p, c**q
        return (left > right) - (left < right)
    for bits in PRECISIONS:
        low, high = power_enclosure(x, e, bits)
        if low > c or high < c:
            return 1 if low > c else -1
    return None
