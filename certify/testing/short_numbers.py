"""Strategies for numbers as engineers write them: few digits, a fitting prefix, a unit. They shrink to round ones."""

from __future__ import annotations

import math
from bisect import bisect_right
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate
from typing import Any

from hypothesis import strategies as st

from certify.kernel.quantity import NumberText, QuantityError, parse_quantity
from certify.values import to_plain

_PREFIXES = {12: "T", 9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "u", -9: "n", -12: "p", -15: "f"}
_PLAIN_BELOW_ONE = {"ohm", "pu", "%"}  # 0.1 ohm, and not 100 mohm
_BARE = {"", "pu", "%"}  # units that take no prefix


def quantities(unit: str, low: Any, high: Any, digits: int = 2) -> st.SearchStrategy[str]:
    """Values such as "1.8 mH" from `low` to `high`, with so many significant digits; all decades are equally likely.

    `low` and `high` are text with the unit, or numbers in SI, above zero. Shrinks to a power of ten in the middle of
    the range, if there is one. Raises: ValueError for a range without such a number.
    """
    return significands(_exact(low, unit), _exact(high, unit), digits).map(lambda number: write(*number, unit))


def decimals(low: Any, high: Any, digits: int = 2) -> st.SearchStrategy[Any]:
    """Numbers without a unit, as `quantities` otherwise: ints, and decimals as text."""
    return significands(_exact(low, ""), _exact(high, ""), digits).map(lambda number: plain(*number))


def _exact(value: Any, unit: str) -> Fraction:
    if isinstance(value, Fraction):
        return value
    if isinstance(value, str) and unit in ("pu", "%"):
        value = value.removesuffix(unit).strip()
    try:
        return parse_quantity(to_plain(value), "" if unit in _BARE else unit, {})
    except QuantityError as error:
        raise ValueError(f"{error.message}, as the end of a range") from None


@lru_cache(maxsize=256)
def significands(low: Fraction, high: Fraction, digits: int) -> st.SearchStrategy[tuple[int, int]]:
    """(m, e) with low <= m 10^e <= high and m of so many digits, the decade in the middle first.

    They are one choice out of a list: what takes as many choices for all of its values shrinks to the first.
    """
    if not 0 < low <= high:
        raise ValueError(f"a range from {float(low):g} to {float(high):g}: it has to begin above 0, and not end before")
    decades = []
    for e in range(math.floor(math.log10(low)) - 1, math.floor(math.log10(high)) + 2):
        unit = Fraction(10) ** (e - digits + 1)
        first, last = max(math.ceil(low / unit), 10 ** (digits - 1)), min(math.floor(high / unit), 10**digits - 1)
        if first <= last:
            decades.append((range(first, last + 1), e - digits + 1))
    if not decades:
        raise ValueError(f"no number of {digits} digits from {float(low):g} to {float(high):g}: allow more digits")
    middle = (math.log10(low) + math.log10(high)) / 2
    decades.sort(key=lambda d: (abs(math.log10(d[0][0]) + d[1] - middle), d[1]))
    ends = list(accumulate(len(numbers) for numbers, _ in decades))

    def pick(k: int) -> tuple[int, int]:
        which = bisect_right(ends, k)
        numbers, e = decades[which]
        return numbers[k - ends[which]], e  # counted from the end of this decade

    return st.integers(0, ends[-1] - 1).map(pick)


def plain(m: int, e: int = 0) -> Any:
    """m 10^e as an int, or as the text of a decimal.

    >>> plain(3), plain(125, -3), plain(-70, -3)
    (3, '0.125', '-0.07')
    """
    while m and e < 0 and m % 10 == 0:
        m, e = m // 10, e + 1
    if e >= 0 or not m:
        return m * 10**e if m else 0
    digits = f"{abs(m):0{1 - e}d}"
    return NumberText(("-" if m < 0 else "") + f"{digits[:e]}.{digits[e:]}")


def write(m: int, e: int, unit: str) -> str:
    """m 10^e with its unit and the prefix that leaves one to three digits before the point.

    >>> write(18, -4, "H"), write(10, -2, "ohm"), write(25, -6, "F"), write(20, 3, "V"), write(95, -2, "pu")
    ('1.8 mH', '0.1 ohm', '25 uF', '20 kV', '0.95 pu')
    """
    first = e + len(str(abs(m))) - 1 if m else 0  # the power of ten of the first digit
    power = min(max(3 * (first // 3), -15), 12)
    if unit in _BARE or not m or (unit in _PLAIN_BELOW_ONE and -2 <= first < 0):
        power = 0
    return f"{plain(m, e - power)} {_PREFIXES[power]}{unit}".rstrip()


def in_range(unit: str, given: Any) -> st.SearchStrategy[Any]:
    """A strategy out of what a caller gave for a quantity: a pair of ends, one value, or a strategy."""
    if isinstance(given, st.SearchStrategy):
        return given
    if isinstance(given, tuple | list):
        if len(given) != 2:
            raise ValueError(f"a range has two ends, not {len(given)}: {given!r}")
        return quantities(unit, *given)
    return st.just(to_plain(given))
