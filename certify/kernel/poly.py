"""Exact univariate polynomials: arithmetic, Sturm sequences, sign on an interval.

A polynomial is a tuple of `Fraction` coefficients, constant term first, no trailing zero; () is zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm

Polynomial = tuple[Fraction, ...]
Whole = tuple[int, ...]  # the same with integers, of which many are compared quickly


def to_polynomial(coefficients: Iterable[int | Fraction]) -> Polynomial:
    p = [Fraction(c) for c in coefficients]
    while p and not p[-1]:
        p.pop()
    return tuple(p)


def add(p: Polynomial, q: Polynomial) -> Polynomial:
    n = max(len(p), len(q))
    zero = Fraction(0)
    padded = ((*p, *[zero] * (n - len(p))), (*q, *[zero] * (n - len(q))))
    return to_polynomial(a + b for a, b in zip(*padded, strict=True))


def scale(factor: Fraction | int, p: Polynomial) -> Polynomial:
    return to_polynomial(factor * a for a in p)


def multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    if not p or not q:
        return ()
    out = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        if a:
            for j, b in enumerate(q):
                out[i + j] += a * b
    return to_polynomial(out)


def derivative(p: Polynomial) -> Polynomial:
    return to_polynomial(i * a for i, a in enumerate(p) if i)


def evaluate(p: Polynomial, x: Fraction) -> Fraction:
    result = Fraction(0)
    for a in reversed(p):
        result = result * x + a
    return result


def primitive(p: Polynomial) -> Polynomial:
    """A positive multiple of p with coprime integer coefficients: the same signs, smaller numbers."""
    if not p:
        return p
    common = lcm(*(a.denominator for a in p))
    whole = [a.numerator * (common // a.denominator) for a in p]
    content = gcd(*whole)
    return tuple(Fraction(a // content) for a in whole)


def divide(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder of p by q.

    >>> divide(to_polynomial([-1, 0, 1]), to_polynomial([1, 1]))
    ((Fraction(-1, 1), Fraction(1, 1)), ())
    """
    rest, quotient = list(p), [Fraction(0)] * max(len(p) - len(q) + 1, 0)
    while len(rest) >= len(q):
        shift, factor = len(rest) - len(q), rest[-1] / q[-1]
        quotient[shift] = factor
        for i, b in enumerate(q):
            rest[shift + i] -= factor * b
        rest.pop()
        while rest and not rest[-1]:
            rest.pop()
    return to_polynomial(quotient), tuple(rest)


def greatest_common_divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    while q:
        p, q = q, primitive(divide(p, q)[1])
    return primitive(p)


def sturm_sequence(p: Polynomial) -> list[Polynomial]:
    """The Sturm sequence of the squarefree part of a nonzero p; remainders are scaled by positive factors only."""
    chain = [primitive(p), primitive(derivative(p))]
    while chain[-1]:
        chain.append(scale(-1, primitive(divide(chain[-2], chain[-1])[1])))
    return [divide(q, chain[-2])[0] for q in chain[:-1]]  # by the greatest common divisor of p and p'


def sign_changes(chain: list[Polynomial], x: Fraction) -> int:
    """How often the sign changes along the values of a sequence at x, zeros left out."""
    signs = [value > 0 for value in (evaluate(q, x) for q in chain) if value]
    return sum(a != b for a, b in pairwise(signs))


def count_roots(p: Polynomial, low: Fraction, high: Fraction) -> int:
    """How many distinct real roots p has in the half-open interval (low, high]; p(low) is not zero.

    >>> count_roots(to_polynomial([-2, 0, 1]), Fraction(0), Fraction(2))
    1
    """
    if not evaluate(p, low):
        raise ValueError("the left end is a root")
    chain = sturm_sequence(p)
    return sign_changes(chain, low) - sign_changes(chain, high)


def is_positive_on(p: Polynomial, low: Fraction, high: Fraction) -> bool:
    """Whether p(x) > 0 for every x in [low, high]."""
    if not p or evaluate(p, low) <= 0:
        return False
    return low == high or count_roots(p, low, high) == 0


def odd_part(p: Polynomial) -> Polynomial:
    """The product of the distinct irreducible factors of odd multiplicity: p changes sign at its roots only.

    >>> odd_part(to_polynomial([0, 1, -2, 1]))  # x (x - 1)^2
    (Fraction(0, 1), Fraction(1, 1))
    """
    result: Polynomial = to_polynomial([1])
    common = greatest_common_divisor(p, derivative(p))
    rest = divide(p, common)[0]  # the product of all distinct factors
    odd = True
    while len(rest) > 1:
        further = greatest_common_divisor(rest, common)  # those of multiplicity above the current one
        if odd:
            result = multiply(result, divide(rest, further)[0])
        common, rest, odd = divide(common, further)[0], further, not odd
    return primitive(result)


def is_nonnegative_on(p: Polynomial, low: Fraction, high: Fraction) -> bool:
    """Whether p(x) >= 0 for every x in [low, high], low < high."""
    if not p:
        return True
    ends = [e for e in (low, high) if not evaluate(p, e)]
    if any(evaluate(p, e) < 0 for e in (low, high)):
        return False
    if len(p) == 1:
        return True
    changes = odd_part(p)
    for end in ends:  # a sign change at an end itself is harmless: divide it out
        quotient, remainder = divide(changes, to_polynomial([-end, 1]))
        changes = changes if remainder else quotient
    if len(changes) > 1 and count_roots(changes, low, high):
        return False
    # No sign change inside, so one point that is no root decides; p has at most len(p) - 1 roots.
    steps = len(p) + 1
    samples = (evaluate(p, low + (high - low) * Fraction(k, steps)) for k in range(1, steps))
    return next(value for value in samples if value) > 0


def bernstein_signs(p: Whole, low: Fraction, high: Fraction) -> list[int]:
    """Positive multiples of the coefficients of p in the Bernstein basis of [low, high]; the ends are values of p.

    With v = (a y + b x) / d, d^n p = sum_k c_k (a y + b x)^k d^(n-k) (y + x)^(n-k) is homogeneous in x and y = 1 - x.
    >>> bernstein_signs((0, 0, 1), Fraction(-1), Fraction(1))
    [1, -2, 1]
    """
    a, b, d = low.numerator * high.denominator, high.numerator * low.denominator, low.denominator * high.denominator
    result: list[int] = []
    ones, power = [1], 1  # d^(n-k) and the coefficients of (y + x)^(n-k)
    for c in reversed(p):
        result = [a * u + b * v for u, v in zip([*result, 0], [0, *result], strict=True)] if result else [0]
        result = [u + c * power * v for u, v in zip(result, ones, strict=True)]
        ones = [u + v for u, v in zip([*ones, 0], [0, *ones], strict=True)]
        power *= d
    return result


def sign_at(p: Whole, x: Fraction) -> int:
    """The sign of p(x): 1, 0 or -1."""
    value, power = 0, 1
    for c in reversed(p):
        value = value * x.numerator + c * power
        power *= x.denominator
    return (value > 0) - (value < 0)


def substitute(p: Whole, middle: Fraction, half: Fraction) -> Polynomial:
    """p(middle + half x) as a polynomial in x."""
    result: Polynomial = ()
    for c in reversed(p):
        result = add(multiply(result, (middle, half)), to_polynomial([c]))
    return result
