"""Values of Python as a spec holds them: numbers as exact decimals, arrays as lists, phasors as pairs [d, q].

A spec has text, whole numbers, decimals, lists and tables. Nothing is rounded: a float is the shortest decimal that
names it, so that 0.1 is 1/10, as it was typed; a Fraction is its decimal, or the formula "1/3" if it has none.
"""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from fractions import Fraction
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import MAX_DIGITS, NumberText, shorten
from certify.kernel.reader import shown

# Y and I of a ZIP load are [active, reactive] parts: of a complex admittance the second has the other sign.
_POWERS = re.compile(r"(?:^|\.)[YI]$")
_PAIR = "give a pair [active, reactive]: Q = Y[1] v^2 + I[1] v, so that a complex admittance G + jB is [G, -B]"
_HALF = "text with half a letter in it (a lone surrogate), which no file can hold"
_CURRENTS = (".I[0]", ".I[1]")  # formulas too, in a load given by its current
MAX_DEPTH = 20  # of lists and tables in each other; a spec needs six


def to_plain(value: Any, path: str = "") -> Any:
    """The value as text, whole numbers, decimals (as `NumberText`), lists and tables.

    Takes int, float, Fraction, Decimal, complex (a pair [d, q]), scalars and arrays of numpy, lists, tuples and
    mappings of these. `path` is where it stands in the spec.
    Raises: SpecError with every value that no spec can hold, U030, or that is not finite, S201.

    >>> to_plain({"R": 0.1, "reference": 300 + 5j, "K13": Fraction(1, 3)}, "controller.x")
    {'R': '0.1', 'reference': ['300', '5'], 'K13': '1/3'}
    """
    faults: list[Fault] = []
    result = _plain(value, path, faults, 0)
    if faults:
        raise SpecError(tuple(faults))
    return result


def _plain(value: Any, path: str, faults: list[Fault], depth: int) -> Any:
    if depth > MAX_DEPTH:
        faults.append(Fault("S003", path, "nested too deeply; a spec needs no more than six levels"))
        return None
    if value is None or isinstance(value, bool | NumberText):
        return value
    if isinstance(value, str):
        if any("\ud800" <= letter <= "\udfff" for letter in value):
            faults.append(Fault("U030", path, _HALF))
        return str.__str__(value)  # of a subclass, such as a member of an Enum, what it holds and not how it is shown
    if isinstance(value, Mapping):
        return _table(value, path, faults, depth)
    if isinstance(value, list | tuple):
        return _list(value, path, faults, depth)
    if getattr(value, "dtype", None) is not None and getattr(value, "ndim", 0) > 0:  # an array of numpy, not imported
        return _list(value, path, faults, depth)
    if getattr(value, "dtype", None) is not None and hasattr(value, "__getitem__") and not _is_number(value):
        inner = value[()]  # an array without dimensions holds one value
        if type(inner) is not type(value):
            return _plain(inner, path, faults, depth + 1)
        if value.dtype.kind == "b":
            return bool(value)
    if isinstance(value, numbers.Complex) and not isinstance(value, numbers.Real):
        if _POWERS.search(path):
            faults.append(Fault("U030", path, _PAIR))
            return None
        return [_number(part, f"{path}{end}", faults) for part, end in ((value.real, "[0]"), (value.imag, "[1]"))]
    if _is_number(value):
        return _number(value, path, faults)
    message = f"a value of type {type(value).__name__}; a spec holds numbers, text, lists and tables"
    faults.append(Fault("U030", path, message))
    return None


def _table(value: Mapping[Any, Any], path: str, faults: list[Fault], depth: int) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, part in value.items():
        name = str(key) if isinstance(key, str | int) and not isinstance(key, bool) else None
        if name is None or name in table:
            reason = f"the key {shorten(key)} is given twice" if name else f"a key of type {type(key).__name__}"
            faults.append(Fault("U030", path, f"{reason}; the keys of a table are different texts"))
            continue
        table[name] = _plain(part, f"{path}.{shown(name)}" if path else shown(name), faults, depth + 1)
    return table


def _list(value: Iterable[Any], path: str, faults: list[Fault], depth: int) -> list[Any]:
    return [_plain(part, f"{path}[{k}]", faults, depth + 1) for k, part in enumerate(value)]


def _is_number(value: Any) -> bool:
    """Whether it is a real or complex number; scalars of numpy have said so to `numbers`."""
    duration = getattr(getattr(value, "dtype", None), "kind", "") == "m"  # which numpy takes for a whole number
    return isinstance(value, numbers.Complex | Decimal) and not duration


def _number(value: Any, path: str, faults: list[Fault]) -> Any:
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Rational):
        exact = Fraction(int(value.numerator), int(value.denominator))
        decimal = to_decimal_text(exact)
        if decimal is None and not path.startswith("controller.") and not path.endswith(_CURRENTS) and path:
            message = f"{shorten(f'{exact}')} is no finite decimal, and only gains may be fractions; round it, as float"
            faults.append(Fault("U030", path, message))
        return decimal or f"{exact.numerator}/{exact.denominator}"
    if not _is_finite(value):
        faults.append(Fault("S201", path, f"not a finite decimal number: {value}"))
        return None
    text = _decimal_text(value)
    if text is None:
        message = f"a value of type {type(value).__name__} that is not told to its last digit; give text, or a Fraction"
        faults.append(Fault("U030", path, message))
        return None
    text = text.removesuffix(".0")
    return NumberText("0" if text == "-0" else text)


def _is_finite(value: Any) -> bool:
    if isinstance(value, Decimal):
        return value.is_finite()
    if isinstance(value, float):
        return math.isfinite(value)
    return bool(value - value == 0)


def _decimal_text(value: Any) -> str | None:
    """The shortest decimal that names a number, whatever is set for how numbers are shown; None if that is not known.

    Numbers of other libraries may be shown with fewer digits than they have: theirs have to give them back.
    """
    if isinstance(value, float):
        return float.__repr__(value)
    if isinstance(value, Decimal):
        return str(value)
    if getattr(value, "dtype", None) is not None:
        import numpy

        plain = value == 0 or 1e-4 <= abs(float(value)) < 1e16
        to_text = numpy.format_float_positional if plain else numpy.format_float_scientific
        return str(to_text(value, unique=True, trim="-"))
    text = str(value)
    try:
        return text if type(value)(text) == value else None
    except (TypeError, ValueError, ArithmeticError):
        return None


def to_utf8(text: str) -> bytes:
    """The bytes of a text. Raises: SpecError U030 if it has half a letter in it, as JSON can say by an escape."""
    try:
        return text.encode()
    except UnicodeEncodeError:
        raise SpecError((Fault("U030", "", _HALF),)) from None


def to_decimal_text(x: Fraction) -> NumberText | None:
    """The decimal that is exactly x, or None if there is none that a spec can hold.

    >>> to_decimal_text(Fraction(1, 8)), to_decimal_text(Fraction(-5)), to_decimal_text(Fraction(1, 3))
    ('0.125', '-5', None)
    """
    rest = x.denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    if rest != 1 or x.denominator.bit_length() > 4 * MAX_DIGITS:
        return None
    places = 0
    while (10**places) % x.denominator:
        places += 1
    digits = f"{abs(x.numerator) * (10**places // x.denominator):0{places + 1}d}"
    text = ("-" if x < 0 else "") + (f"{digits[:-places]}.{digits[-places:]}" if places else digits)
    return NumberText(text) if len(text) <= MAX_DIGITS else None
