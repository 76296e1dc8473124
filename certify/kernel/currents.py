"""Loads whose current is a pair of rational functions of (Vd, Vq): from formulas to exact polynomials.

A polynomial is a tuple of ((i, j), coefficient of Vd^i Vq^j), sorted, no zero coefficients; () is zero. Degrees and
coefficients are bounded before anything is multiplied, so that hostile formulas are refused early.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import lcm

from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import ONE, ZERO
from certify.kernel.quantity import MAX_BITS, Formula, QuantityError, shorten
from certify.kernel.reader import Pair

Bivariate = tuple[tuple[tuple[int, int], Fraction], ...]
Quotient = tuple[Bivariate, Bivariate]  # numerator and denominator; the latter is not zero, and UNIT if it is constant

MAX_DEGREE = 12  # of a numerator or denominator
MAX_POWER = 64
UNIT: Bivariate = (((0, 0), ONE),)
NAMES: dict[str, Bivariate] = {"Vd": (((1, 0), ONE),), "Vq": (((0, 1), ONE),)}


# --- polynomials in two variables ------------------------------------------------------------------------------------


def tidy(terms: Mapping[tuple[int, int], Fraction]) -> Bivariate:
    return tuple(sorted((key, c) for key, c in terms.items() if c))


def total_degree(p: Bivariate) -> int:
    """-1 for the zero polynomial."""
    return max((i + j for (i, j), _ in p), default=-1)


def add(p: Bivariate, q: Bivariate, factor: Fraction | int = 1) -> Bivariate:
    """p + factor q."""
    terms = dict(p)
    for key, c in q:
        terms[key] = terms.get(key, ZERO) + factor * c
    return tidy(terms)


def multiply(p: Bivariate, q: Bivariate) -> Bivariate:
    """In integers over a common denominator: much faster than with fractions."""
    a, b = (lcm(*(c.denominator for _, c in side)) for side in (p, q))
    left, right = ([(key, c.numerator * (d // c.denominator)) for key, c in s] for s, d in ((p, a), (q, b)))
    terms: dict[tuple[int, int], int] = {}
    for (i, j), x in left:
        for (k, m), y in right:
            terms[i + k, j + m] = terms.get((i + k, j + m), 0) + x * y
    return tidy({key: Fraction(x, a * b) for key, x in terms.items()})


def divide(p: Bivariate, q: Bivariate) -> Bivariate | None:
    """The polynomial p / q, or None if q does not divide p or the quotient is absurdly large; q is not zero.

    >>> square = multiply(NAMES["Vd"], NAMES["Vd"])
    >>> divide(square, NAMES["Vd"]) == NAMES["Vd"], divide(square, NAMES["Vq"])
    (True, None)
    """
    rest, quotient = dict(p), {}

    def order(key: tuple[int, int]) -> tuple[int, int]:
        """Of the leading terms: by degree, which therefore never grows, then by Vd."""
        return sum(key), key[0]

    (top_i, top_j), top = max(q, key=lambda term: order(term[0]))
    while rest:
        i, j = max(rest, key=order)
        factor = rest[i, j] / top
        if i < top_i or j < top_j or _bits(factor) > MAX_BITS:
            return None
        quotient[i - top_i, j - top_j] = factor
        for (k, m), c in q:
            key = (i - top_i + k, j - top_j + m)
            rest[key] = rest.get(key, ZERO) - factor * c
            if not rest[key]:
                del rest[key]
    return tidy(quotient)


def _bits(x: Fraction) -> int:
    return max(x.numerator.bit_length(), x.denominator.bit_length())


def derivative(p: Bivariate, axis: int) -> Bivariate:
    return tidy({(i - 1, j) if axis == 0 else (i, j - 1): (i, j)[axis] * c for (i, j), c in p})


def evaluate(p: Bivariate, V: Pair) -> Fraction:
    return sum((c * V[0] ** i * V[1] ** j for (i, j), c in p), ZERO)


def recentred(p: Bivariate, centre: Pair, radius: Fraction) -> Bivariate:
    """p(centre + radius (x, y)) as a polynomial in x and y: by Horner's rule in Vd, its coefficients by that in Vq."""
    lines = [add(tidy({(0, 0): c}), name, radius) for c, name in zip(centre, NAMES.values(), strict=True)]
    result: Bivariate = ()
    for i in range(max((i for (i, _), _ in p), default=-1), -1, -1):
        column: Bivariate = ()
        terms = {j: c for (k, j), c in p if k == i}
        for j in range(max(terms, default=-1), -1, -1):
            column = add(multiply(column, lines[1]), tidy({(0, 0): terms.get(j, ZERO)}))
        result = add(multiply(result, lines[0]), column)
    return result


# --- laws ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CurrentLaw:
    """I_d = numerators[0] / denominator, I_q = numerators[1] / denominator, in ampere, of (Vd, Vq) in volt."""

    numerators: tuple[Bivariate, Bivariate]
    denominator: Bivariate

    def current(self, V: Pair) -> Pair:
        """Raises: RuleFailure where the denominator vanishes."""
        q = evaluate(self.denominator, V)
        if not q:
            raise RuleFailure("the current is not defined at a voltage: its denominator vanishes")
        return evaluate(self.numerators[0], V) / q, evaluate(self.numerators[1], V) / q


def current_law(I_d: Formula, I_q: Formula) -> CurrentLaw:
    """The law of two formulas in Vd and Vq.

    Raises: QuantityError for unknown names, division by zero, degrees above 12, or absurdly large coefficients.
    >>> from certify.kernel.quantity import parse_formula
    >>> law = current_law(parse_formula("2*Vd/(1 + Vq^2)"), parse_formula("Vq"))
    >>> law.current((Fraction(3), Fraction(1)))
    (Fraction(3, 1), Fraction(1, 1))
    """
    (a, b), (c, d) = _rational_function(I_d), _rational_function(I_q)
    denominator, left, right = _common_multiple(b, d)
    return CurrentLaw((_product(a, left), _product(c, right)), denominator)


def plus_isotropic(law: CurrentLaw, Y: Pair, P: Pair) -> CurrentLaw:
    """The law and (Y_p - j Y_q) V + (P_p - j P_q) V / |V|^2: an admittance in siemens, a power in watt and var.

    Raises: QuantityError if degrees or coefficients become too large.
    """
    Vd, Vq = NAMES["Vd"], NAMES["Vq"]
    square = add(multiply(Vd, Vd), multiply(Vq, Vq))
    q, left, right = _common_multiple(law.denominator, square if any(P) else UNIT)
    G, minus_B = (_checked(add(tidy({}), q, y)) for y in Y)  # times q; right is q / |V|^2
    G, minus_B = _checked(add(G, right, P[0])), _checked(add(minus_B, right, P[1]))
    I_d = add(_product(G, Vd), _product(minus_B, Vq))
    I_q = add(_product(G, Vq), _product(minus_B, Vd), -1)
    parts = [_checked(add(_product(p, left), extra)) for p, extra in zip(law.numerators, (I_d, I_q), strict=True)]
    return CurrentLaw((parts[0], parts[1]), q)


def _rational_function(formula: Formula) -> Quotient:
    """The formula as an element of the field of rational functions, evaluated as `Formula.evaluate` does."""
    stack: list[Quotient] = []
    for item in formula.postfix:
        if isinstance(item, Fraction):
            stack.append((tidy({(0, 0): item}), UNIT))
        elif item in formula.names:
            if item not in NAMES:
                raise QuantityError("S206", f"unknown name {shorten(item)}; in scope: Vd, Vq")
            stack.append((NAMES[item], UNIT))
        elif item == "~":
            numerator, denominator = stack.pop()
            stack.append((add((), numerator, -1), denominator))
        else:
            right, left = stack.pop(), stack.pop()
            stack.append(_combine(item, left, right))
    return stack[0]


def _combine(operator: str, left: Quotient, right: Quotient) -> Quotient:
    (a, b), (c, d) = left, right
    if operator == "^":
        exponent = evaluate(c, (ZERO, ZERO))
        if total_degree(c) > 0 or d != UNIT or exponent.denominator != 1 or abs(exponent) > MAX_POWER:
            raise QuantityError("S205", "an exponent in a formula is not a small whole number")
        base, result = left if exponent >= 0 else _quotient(b, a), (UNIT, UNIT)
        for _ in range(abs(exponent.numerator)):
            result = _product(result[0], base[0]), _product(result[1], base[1])
        return result
    if operator in "+-":
        q, s, t = _common_multiple(b, d)
        return _quotient(add(_product(a, s), _product(c, t), 1 if operator == "+" else -1), q)
    if operator == "/":
        c, d = d, c
    return _quotient(_product(a, c), _product(b, d))


def _quotient(p: Bivariate, q: Bivariate) -> Quotient:
    """p / q, with 1 for a constant denominator, and cancelled if one divides the other."""
    if not q:
        raise QuantityError("S207", "division by zero in a formula")
    if (whole := divide(p, q)) is not None:
        p, q = whole, UNIT
    elif total_degree(p) > 0 and (inverse := divide(q, p)) is not None:
        p, q = UNIT, inverse
    return _checked(p), _checked(q)


def _common_multiple(b: Bivariate, d: Bivariate) -> tuple[Bivariate, Bivariate, Bivariate]:
    """A common multiple m of two denominators, m/b and m/d: the larger one if the other divides it."""
    if (factor := divide(b, d)) is not None:
        return b, UNIT, factor
    if (factor := divide(d, b)) is not None:
        return d, factor, UNIT
    return _product(b, d), d, b


def _product(p: Bivariate, q: Bivariate) -> Bivariate:
    if p and q and total_degree(p) + total_degree(q) > MAX_DEGREE:
        raise QuantityError("S205", f"a current of a degree above {MAX_DEGREE}")
    return _checked(multiply(p, q))


def _checked(p: Bivariate) -> Bivariate:
    if any(_bits(c) > MAX_BITS for _, c in p):
        raise QuantityError("S202", "a coefficient of a current is absurdly large")
    return p
