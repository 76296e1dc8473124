"""Numbers, units and formulas: from the text of a spec to exact rationals in SI.

Decimals mean what they say ("0.1" is 1/10). Formulas have their own small grammar and are never passed to
`eval`. Every number is bounded in length and exponent, so that hostile input is refused before it is computed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

MAX_DIGITS = 120  # characters in one number
MAX_EXPONENT = 60  # of a decimal literal
MAX_BITS = 1024  # numerator or denominator of any value of a formula
MAX_FORMULA = 500  # characters

_NUMBER = r"[+-]?(?:\d+(?:_\d+)*(?:\.(?:\d+(?:_\d+)*)?)?|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*([^\s\d+\-.][^\s]*)?\s*", re.ASCII | re.DOTALL)
_PREFIXES = {"f": -15, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "k": 3, "M": 6, "G": 9, "T": 12}
_BASES = {"ohm", "H", "F", "S", "V", "A", "W", "var", "VA", "Hz", "s", "m"}
_TOKEN = re.compile(r"\s*(?:((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\S))", re.ASCII)


class NumberText(str):
    """A number of the input file, as it was written."""


class QuantityError(ValueError):
    """A number, unit or formula that is not acceptable: its code and what is wrong."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code, self.message = code, message


def shorten(text: object, limit: int = 40) -> str:
    """A value as it may appear in a message: printable, quoted, not too long; of anything nested only the type."""
    if isinstance(text, str):
        shown = str(text) if isinstance(text, NumberText) else ascii(text)
    elif isinstance(text, bool | None) or (isinstance(text, int) and text.bit_length() < 200):
        shown = str(text)
    else:
        shown = f"a {type(text).__name__}"
    return shown if len(shown) <= limit else f"{shown[: limit - 3]}... ({len(shown)} characters)"


def parse_decimal(text: str) -> Fraction:
    """An exact decimal. Raises: QuantityError for anything else, or for an absurd size.

    >>> parse_decimal("-1.50e1")
    Fraction(-15, 1)
    """
    if len(text) > MAX_DIGITS:
        raise QuantityError("S202", f"number with {len(text)} characters; at most {MAX_DIGITS} are read")
    if not re.fullmatch(_NUMBER, text, re.ASCII):
        raise QuantityError("S201", f"not a finite decimal number: {shorten(text)}")
    _, _, exponent = text.lower().partition("e")
    if exponent and (len(exponent) > 5 or abs(int(exponent)) > MAX_EXPONENT):
        raise QuantityError("S202", f"exponent {shorten(exponent)} is absurd; at most {MAX_EXPONENT} in size")
    return Fraction(text.replace("_", ""))


def unit_factor(unit: str, wanted: str, per_unit: Mapping[str, Fraction]) -> Fraction:
    """What one `unit` is in SI, if it measures the same as `wanted` ("ohm", "H/m", "" for a pure number)."""
    if unit == "%" and wanted == "":
        return Fraction(1, 100)
    if unit == "pu":
        if wanted in per_unit:
            return per_unit[wanted]
        needs = {"V": "; it needs base_voltage"}.get(wanted, "; it needs base_voltage and base_power")
        hint = needs if wanted in _BASES - {"Hz", "s", "m"} else ""
        raise QuantityError("S204", f"pu is not defined for a value in {wanted or 'no unit'}{hint}")
    parts = unit.replace("\u03a9", "ohm").replace("\u2126", "ohm").split("/")
    expected = wanted.split("/") if wanted else []
    result, sign = Fraction(1), 1
    if len(parts) == len(expected):
        for part, base in zip(parts, expected, strict=True):
            if part != base:
                if part[1:] != base or part[0] not in _PREFIXES:
                    break
                result *= Fraction(10) ** (sign * _PREFIXES[part[0]])
            sign = -1
        else:
            return result
    known = unit == "%" or all(p in _BASES or (p[1:] in _BASES and p[0] in _PREFIXES) for p in parts)
    problem = f"unit {shorten(unit)} does not fit" if known else f"unknown unit {shorten(unit)}"
    raise QuantityError("S203", f"{problem}; expected {wanted or 'a plain number'}")


def parse_quantity(value: object, wanted: str, per_unit: Mapping[str, Fraction]) -> Fraction:
    """A number, or text such as "1.8 mH", to the exact SI value. A bare number is SI.

    >>> parse_quantity("1.8 mH", "H", {})
    Fraction(9, 5000)
    >>> parse_quantity("0.9 pu", "V", {"V": Fraction(20000)})
    Fraction(18000, 1)
    """
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise QuantityError("S201", f'expected a number or text such as "1.8 {wanted}", got {shorten(value)}')
    if isinstance(value, int):
        if value.bit_length() > 4 * MAX_DIGITS:
            raise QuantityError("S202", f"integer of {value.bit_length()} bits; at most {MAX_DIGITS} digits are read")
        return Fraction(value)
    if len(value) > MAX_DIGITS + 20:
        raise QuantityError("S202", f"text of {len(value)} characters where a number belongs")
    if isinstance(value, NumberText):
        return parse_decimal(value)
    match = _QUANTITY.fullmatch(value)
    if not match:
        raise QuantityError("S201", f"cannot read {shorten(value)} as a number with a unit")
    number = parse_decimal(match[1])
    return number if match[2] is None else number * unit_factor(match[2], wanted, per_unit)


@dataclass(frozen=True)
class Formula:
    """A parsed formula in postfix order: rationals, names, operators ("~" is unary minus)."""

    text: str
    postfix: tuple[Fraction | str, ...]
    names: frozenset[str]

    def evaluate(self, scope: Mapping[str, Fraction]) -> Fraction:
        """The exact value. Raises: QuantityError on an unknown name, division by zero or an absurd size."""
        stack: list[Fraction] = []
        for item in self.postfix:
            if isinstance(item, Fraction):
                stack.append(item)
            elif item in self.names:
                if item not in scope:
                    raise QuantityError("S206", f"unknown name {shorten(item)}; in scope: {', '.join(sorted(scope))}")
                stack.append(scope[item])
            elif item == "~":
                stack.append(-stack.pop())
            else:
                right, left = stack.pop(), stack.pop()
                stack.append(_combine(item, left, right))
        return stack[0]


def _combine(operator: str, left: Fraction, right: Fraction) -> Fraction:
    bits = left.numerator.bit_length() + left.denominator.bit_length()
    if operator == "^" and (right.denominator != 1 or abs(right) * max(bits, 1) > MAX_BITS):
        raise QuantityError("S205", "an exponent in a formula is not a small whole number")
    if (not right and operator == "/") or (not left and operator == "^" and right < 0):
        raise QuantityError("S207", "division by zero in a formula")
    if operator in "+-":
        result = left + right if operator == "+" else left - right
    elif operator == "^":
        result = left**right.numerator
    else:
        result = left * right if operator == "*" else left / right
    if max(result.numerator.bit_length(), result.denominator.bit_length()) > MAX_BITS:
        raise QuantityError("S202", "a value in a formula is absurdly large")
    return result


_PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "~": 3, "^": 4}


def parse_formula(value: object) -> Formula:
    """A number, or text with + - * / ^ ( ), names and decimals, by precedence: no recursion, never `eval`.

    >>> parse_formula("1 - kp*L").evaluate({"kp": Fraction(1000), "L": Fraction(9, 5000)})
    Fraction(-4, 5)
    """
    if isinstance(value, NumberText) or not isinstance(value, str):
        constant = parse_quantity(value, "", {})
        return Formula(str(value), (constant,), frozenset())
    if len(value) > MAX_FORMULA:
        raise QuantityError("S205", f"formula of {len(value)} characters; at most {MAX_FORMULA} are read")
    output: list[Fraction | str] = []
    waiting: list[str] = []
    names: set[str] = set()
    operand_next = True

    def unwind(level: int) -> None:
        while waiting and waiting[-1] != "(" and _PRECEDENCE[waiting[-1]] >= level:
            output.append(waiting.pop())

    for match in _TOKEN.finditer(value):
        number, name, symbol = match.groups()
        if operand_next and (number or name):
            output.append(parse_decimal(number) if number else name)
            names |= {name} if name else set()
            operand_next = False
        elif operand_next and symbol in ("(", "-", "+"):
            waiting += {"(": ["("], "-": ["~"], "+": []}[symbol]
        elif not operand_next and symbol == ")":
            unwind(0)
            if not waiting:
                break
            waiting.pop()
        elif not operand_next and symbol in _PRECEDENCE:
            if symbol == "^" and "".join(waiting).rstrip("~").endswith("^"):
                raise QuantityError("S205", f"a tower of powers in formula {shorten(value)}")
            unwind(_PRECEDENCE[symbol])
            waiting.append(symbol)
            operand_next = True
        else:
            raise QuantityError("S205", f"unexpected {shorten(match.group().strip())} in formula {shorten(value)}")
    else:
        unwind(0)
        if not operand_next and not waiting:
            return Formula(value, tuple(output), frozenset(names))
    raise QuantityError("S205", f"formula {shorten(value)} ends too early or its parentheses do not match")
