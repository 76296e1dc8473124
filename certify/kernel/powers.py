"""Rational powers x^e of positive rationals: exact comparison, and enclosures with directed rounding.

An interval is a pair (low, high) of rationals with the true value inside. Enclosures come from the series
of artanh and exp, each with its remainder bounded; every intermediate result is rounded outwards.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from functools import lru_cache

Interval = tuple[Fraction, Fraction]

EXACT_BITS = 1 << 21  # comparisons by integer powers up to this size; beyond it, enclosures
PRECISIONS = (64, 160, 400, 1000, 2500)


def interval_sum(terms: Iterable[Interval]) -> Interval:
    low = high = Fraction(0)
    for a, b in terms:
        low, high = low + a, high + b
    return low, high


def interval_product(x: Interval, y: Interval) -> Interval:
    products = [a * b for a in x for b in y]
    return min(products), max(products)


def radical_inverse(k: int, base: int) -> Fraction:
    """The digits of k in a base, mirrored at the point: the van der Corput sequence, dense in [0, 1).

    >>> [str(radical_inverse(k, 2)) for k in range(5)]
    ['0', '1/2', '1/4', '3/4', '1/8']
    """
    value, place = Fraction(0), Fraction(1)
    while k:
        k, digit = divmod(k, base)
        place /= base
        value += digit * place
    return value


def _floor(x: Fraction, bits: int) -> int:
    return (x.numerator << bits) // x.denominator


def _ceiling(x: Fraction, bits: int) -> int:
    return -((-x.numerator << bits) // x.denominator)


def _artanh(y: Fraction, bits: int) -> Interval:
    """Enclosure of artanh(y), |y| <= 1/3, by its series in integers scaled by 2^bits."""
    if y < 0:
        mirrored = _artanh(-y, bits)
        return -mirrored[1], -mirrored[0]
    low = high = 0
    power, square = (_floor(y, bits), _ceiling(y, bits)), (_floor(y * y, bits), _ceiling(y * y, bits))
    k = 1
    while power[1] > 1:
        low, high = low + power[0] // k, high - (-power[1] // k)
        power = (power[0] * square[0] >> bits, -(-power[1] * square[1] >> bits))
        k += 2
    return Fraction(low, 1 << bits), Fraction(high + 2, 1 << bits)  # the rest is below 1 + 1/9 + 1/81 + ... units


@lru_cache(256)  # the powers of one load share their voltages
def log_enclosure(x: Fraction, bits: int) -> Interval:
    """Enclosure of ln(x), x > 0: ln x = 2 artanh((m - 1)/(m + 1)) + shift ln 2 with m in [3/4, 3/2]."""
    if x <= 0:
        raise ValueError("logarithm of a number that is not positive")
    shift = x.numerator.bit_length() - x.denominator.bit_length()
    m = x / (Fraction(2) ** shift)  # in (1/2, 2)
    if m > Fraction(3, 2):
        m, shift = m / 2, shift + 1
    elif m < Fraction(3, 4):
        m, shift = m * 2, shift - 1
    main, two = _artanh((m - 1) / (m + 1), bits), _artanh(Fraction(1, 3), bits) if shift else (Fraction(0),) * 2
    return interval_sum([(2 * main[0], 2 * main[1]), interval_product((Fraction(2 * shift),) * 2, two)])


@lru_cache(256)
def exp_enclosure(t: Fraction, bits: int) -> Interval:
    """Enclosure of exp(t): t is halved until it is at most 1/2, then Taylor, then squared back; 1/exp(-t) for t < 0."""
    if t < 0:
        inverse = exp_enclosure(-t, bits)
        return 1 / inverse[1], 1 / inverse[0]
    halvings = (t.numerator // t.denominator).bit_length() + 1
    work = bits + 2 * halvings + 8
    r = (_floor(t / (1 << halvings), work), _ceiling(t / (1 << halvings), work))
    low, high, term, n = 0, 0, (1 << work, 1 << work), 1
    while term[1] > 1:
        low, high = low + term[0], high + term[1]
        term = ((term[0] * r[0] >> work) // n, -((-term[1] * r[1] >> work) // n))
        n += 1
    high += 2  # the rest is below 1 + 1/2 + 1/4 + ... units
    for _ in range(halvings):
        low, high = low * low >> work, -(-high * high >> work)
    return Fraction(low, 1 << work), Fraction(high, 1 << work)


def _whole_root(n: int, q: int) -> int | None:
    """The q-th root of n >= 0 if it is whole."""
    if n < 2 or n.bit_length() <= q:  # below 2^q only 0 and 1 have one
        return n if n < 2 else None
    root = 1 << -(-n.bit_length() // q)  # Newton's iteration from above
    while True:
        better = ((q - 1) * root + n // root ** (q - 1)) // q
        if better >= root:
            return root if root**q == n else None
        root = better


def power_enclosure(x: Fraction, e: Fraction, bits: int) -> Interval:
    """Enclosure of x^e, x > 0; exact when e is a small integer, or x a perfect power of the denominator of e.

    >>> power_enclosure(Fraction(2), Fraction(3), 64)
    (Fraction(8, 1), Fraction(8, 1))
    >>> low, high = power_enclosure(Fraction(2), Fraction(1, 2), 64)
    >>> low**2 < 2 < high**2
    True
    >>> power_enclosure(Fraction(4, 9), Fraction(-3, 2), 64)
    (Fraction(27, 8), Fraction(27, 8))
    """
    if e.denominator == 1 and abs(e.numerator) <= 64:
        exact = x**e.numerator
        return exact, exact
    if abs(e.numerator) <= 64 * e.denominator and x > 0:
        above, below = _whole_root(x.numerator, e.denominator), _whole_root(x.denominator, e.denominator)
        if above and below and abs(e.numerator) * max(above, below).bit_length() <= EXACT_BITS:
            exact = Fraction(above, below) ** e.numerator
            return exact, exact
    low, high = interval_product((e, e), log_enclosure(x, bits))
    return exp_enclosure(low, bits)[0], exp_enclosure(high, bits)[1]


def compare_power(x: Fraction, e: Fraction, c: Fraction) -> int | None:
    """The sign of x^e - c for x >= 0: 1, 0, -1, or None if the last precision does not tell; 0^e has no bound if e < 0.

    x^(p/q) > c iff x^p > c^q for c > 0 (THEORY 0).
    >>> compare_power(Fraction(1, 4), Fraction(1, 2), Fraction(1, 2))
    0
    """
    if c < 0 or (x and not c) or (not x and e < 0):
        return 1
    if not x:
        return ((not e) > c) - ((not e) < c)
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
