"""An oracle for the monotonicity of a load current on an annulus, in 60 digits and more, from THEORY 5 alone.

The question: I(V) = (P(v) - jQ(v)) / v^2 * V with v = |V|; is <V - U, I(V) - I(U)> >= 0 for all v1 <= |U|, |V| <= v2?
With x = ln(v / v1), a dash for d/dx, and P, Q sums of c exp(e x), it is answered twice.

(a) One voltage. N = v^4 D = P (P' - P) - (Q' / 2 - Q)^2 and P must be nowhere negative. Both are divided by what they
    would be if nothing cancelled, sampled densely in floats, again in 60 digits if the least value is small, and every
    local minimum is refined by Newton steps inside its bracket.
(b) Two voltages. At moduli a, b the least product over the angle is P_a + P_b - ab |(G_a + G_b) + j(B_a - B_b)|, so
    both P_a + P_b and E = ((P_a + P_b)^2 - (ab)^2 ((G_a + G_b)^2 + (B_a - B_b)^2)) / (a^2 - b^2)^2 must not be
    negative. Sampled over pairs, distant and close; coordinate search from the least; Newton steps by finite
    differences along pairs as close as 1e-60. Nothing here knows of D, save for the unit in which E is measured.
(c) If all exponents are whole, the signs of N and P as polynomials: square-free parts and Sturm chains, exactly.

"boundary" means that the least value is zero to within 1e-40: what is true then, only (c) or a construction can tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from flint import fmpq, fmpq_poly
from mpmath import mp, mpf

from certify.kernel.spec import ExpLoad, ZipLoad

MONOTONE, NOT_MONOTONE, BOUNDARY = "monotone", "not monotone", "boundary"
DIGITS, MANY_DIGITS = 60, 240
ZERO = mpf(0)
NEAR = mpf("1e-40")  # what counts as zero
HALF = 0.5
CLEAR = -1e-3  # so negative that nothing more is asked
SMALL = 1e-6  # below it, floats are not trusted
Law = tuple[ZipLoad | ExpLoad, ...]
Band = tuple[Fraction, Fraction]
Powers = dict[tuple[Fraction, Fraction], Fraction]  # (exponent, base) to coefficient


@dataclass(frozen=True)
class Truth:
    """`least` is the smaller of the two least values of (a), `pair` that of (b); `agree`: (a) and (b) say the same.

    `strict`: the product vanishes for U = V only. On the boundary that is so unless N = 0 all over or P = 0 somewhere:
    the bound of the lemma is strict if D vanishes at single voltages only, and N is analytic.
    """

    verdict: str
    least: mpf
    pair: mpf
    at: mpf
    agree: bool
    strict: bool


# --- the laws -------------------------------------------------------------------------------------------------


def powers(law: Law) -> tuple[Powers, Powers]:
    """P and Q as sums of c (v / base)^e; whole powers have the base 1, and what cancels exactly is gone."""
    parts: tuple[Powers, Powers] = ({}, {})

    def put(part: int, coefficient: Fraction, exponent: Fraction, base: Fraction) -> None:
        if exponent.denominator == 1:
            coefficient, base = coefficient / base**exponent.numerator, Fraction(1)
        parts[part][exponent, base] = parts[part].get((exponent, base), Fraction(0)) + coefficient

    for load in law:
        if isinstance(load, ZipLoad):
            for exponent, pair in ((2, load.Y), (1, load.I), (0, load.P)):
                for part in (0, 1):
                    put(part, pair[part], Fraction(exponent), Fraction(1))
        else:
            put(0, load.P0_watt, load.np, load.V0_volt)
            put(1, load.Q0_var, load.nq, load.V0_volt)
    P, Q = ({key: c for key, c in part.items() if c} for part in parts)
    return P, Q


def to_mpf(x: Fraction) -> mpf:
    return mpf(x.numerator) / x.denominator


def term_value(coefficient: Fraction, exponent: Fraction, base: Fraction, voltage: Fraction) -> mpf:
    return to_mpf(coefficient) * mp.power(to_mpf(voltage / base), to_mpf(exponent))


class Curves:
    """P and Q as sums of c exp(e x), x = ln(v / v1), at the precision of the moment of making."""

    def __init__(self, law: Law, band: Band) -> None:
        self.length = mp.log(to_mpf(band[1] / band[0]))
        self.active, self.reactive = (self.merged(part, band[0]) for part in powers(law))
        self.less_one = [e - 1 for _, e in self.active]
        self.half_less_one = [e / 2 - 1 for _, e in self.reactive]

    @staticmethod
    def merged(part: Powers, v1: Fraction) -> list[tuple[mpf, mpf]]:
        sums: dict[Fraction, tuple[mpf, mpf]] = {}
        for (exponent, base), coefficient in part.items():
            value = term_value(coefficient, exponent, base, v1)
            total, size = sums.get(exponent, (ZERO, ZERO))
            sums[exponent] = (total + value, size + abs(value))
        return [(total, to_mpf(e)) for e, (total, size) in sums.items() if abs(total) > size * mpf("1e-50")]

    def at(self, x: mpf) -> tuple[list[mpf], list[mpf]]:
        """The values of all terms at x."""
        return [c * mp.exp(e * x) for c, e in self.active], [c * mp.exp(e * x) for c, e in self.reactive]

    def on_grid(self, count: int, start: mpf) -> Iterable[tuple[mpf, list[mpf], list[mpf]]]:
        """As `at`, for x = start + k length / (count - 1), one multiplication for each term and step."""
        step = self.length / (count - 1)
        P, Q = self.at(start)
        p_ratio, q_ratio = ([mp.exp(e * step) for _, e in part] for part in (self.active, self.reactive))
        for k in range(count):
            yield start + k * step, P, Q
            P = [t * r for t, r in zip(P, p_ratio, strict=True)]
            Q = [t * r for t, r in zip(Q, q_ratio, strict=True)]

    def values_on_grid(self, count: int, start: mpf) -> Iterable[tuple[mpf, Values]]:
        s, ratio = mp.exp(2 * start), mp.exp(2 * self.length / (count - 1))
        for x, P, Q in self.on_grid(count, start):
            yield x, values_at(self, P, Q, s)
            s *= ratio

    # (a) needs derivatives with respect to x.

    def determinant(self, P: list[mpf], Q: list[mpf], order: int) -> tuple[list[mpf], list[mpf]]:
        """N and what it would be without cancellation, each with derivatives up to the order (0 or 2)."""
        a = [[t] for t in P]
        for row, (_, e) in zip(a, self.active, strict=True):
            row.extend(row[0] * e**k for k in range(1, order + 1))
        b = [[t * less] for t, less in zip(Q, self.half_less_one, strict=True)]
        for row, (_, e) in zip(b, self.reactive, strict=True):
            row.extend(row[0] * e**k for k in range(1, order + 1))
        orders = range(order + 1)
        p = [sum((row[k] for row in a), ZERO) for k in orders]
        r = [sum((row[k] * m for row, m in zip(a, self.less_one, strict=True)), ZERO) for k in orders]
        c = [sum((row[k] for row in b), ZERO) for k in orders]
        sizes = [1 if row[0] >= 0 else -1 for row in a], [1 if row[0] >= 0 else -1 for row in b]
        p_ = [sum((s * row[k] for s, row in zip(sizes[0], a, strict=True)), ZERO) for k in orders]
        r_ = [
            sum((s * row[k] * abs(m) for s, row, m in zip(sizes[0], a, self.less_one, strict=True)), ZERO)
            for k in orders
        ]
        c_ = [sum((s * row[k] for s, row in zip(sizes[1], b, strict=True)), ZERO) for k in orders]
        value = [x - y for x, y in zip(product(p, r), product(c, c), strict=True)]
        size = [x + y for x, y in zip(product(p_, r_), product(c_, c_), strict=True)]
        return value, size

    def conductance(self, P: list[mpf], order: int) -> tuple[list[mpf], list[mpf]]:
        """P and the sum of the sizes of its terms, each with derivatives up to the order."""
        rows = [(t, e) for t, (_, e) in zip(P, self.active, strict=True)]
        value = [sum((t * e**k for t, e in rows), ZERO) for k in range(order + 1)]
        return value, [sum((abs(t) * e**k for t, e in rows), ZERO) for k in range(order + 1)]


def product(a: Sequence[mpf], b: Sequence[mpf]) -> list[mpf]:
    """The product of two functions with derivatives up to order 0 or 2."""
    if len(a) == 1:
        return [a[0] * b[0]]
    return [a[0] * b[0], a[1] * b[0] + a[0] * b[1], a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2]]


def quotient(value: Sequence[mpf], size: Sequence[mpf]) -> tuple[mpf, mpf, mpf]:
    """value / size; something with the sign of its slope; the derivative of that, so far as Newton needs it."""
    if not size[0]:
        return ZERO, ZERO, ZERO
    slope = value[1] * size[0] - value[0] * size[1]
    return value[0] / size[0], slope, value[2] * size[0] - value[0] * size[2]


# --- (a) one voltage ------------------------------------------------------------------------------------------


def float_grid(length: float) -> np.ndarray[Any, Any]:
    """Even in ln v, even in v, and crowded at both ends."""
    even = np.linspace(0, length, 500)
    in_volts = np.log1p(np.linspace(0, 1, 300) * np.expm1(min(length, 600)))
    crowd = length * 0.5 ** np.arange(1, 20)
    grid = np.concatenate([even, in_volts, crowd, length - crowd])
    return np.unique(np.clip(grid, 0, length))


def float_samples(curves: Curves, x: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """The quotients of P and N at all x, in floats, whatever the orders of magnitude."""
    logs = []
    for part in (curves.active, curves.reactive):
        c = np.array([float(mp.log(abs(c))) for c, _ in part])
        logs.append(c[:, None] + np.array([float(e) for _, e in part])[:, None] * x[None, :])
    top = np.max(np.concatenate([*logs, np.full((1, len(x)), -1e9)]), axis=0)
    signs = [np.array([float(mp.sign(c)) for c, _ in part])[:, None] for part in (curves.active, curves.reactive)]
    p, q = (np.exp(log - top) for log in logs)
    m, n = (np.array([float(e) for _, e in part])[:, None] for part in (curves.active, curves.reactive))
    P, sizes = (signs[0] * p).sum(0), p.sum(0)
    N = P * (signs[0] * p * (m - 1)).sum(0) - ((signs[1] * q * (n / 2 - 1)).sum(0)) ** 2
    S = sizes * (p * abs(m - 1)).sum(0) + ((q * abs(n / 2 - 1)).sum(0)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sizes > 0, P / sizes, 0.0), np.where(S > 0, N / S, 0.0)


def valleys(values: Sequence[Any]) -> list[int]:
    """The positions of the local minima of a series, ends included, the lowest three."""
    last = len(values) - 1
    low = [
        k
        for k in range(last + 1)
        if (k == 0 or values[k] <= values[k - 1]) and (k == last or values[k] < values[k + 1])
    ] or [0]
    return sorted(low, key=lambda k: values[k])[:3]


Jet = Callable[[mpf], tuple[mpf, mpf, mpf]]


def refine(jet: Jet, low: mpf, start: mpf, high: mpf) -> tuple[mpf, mpf]:
    """The least value met on the way to a stationary point in [low, high], and where; Newton, or else bisection.

    Stops where the value leaves no doubt, and after a step so short that the error of the next value is its square.
    """
    ends = [(jet(x), x) for x in (low, high)]
    best = min((value, x) for (value, _, _), x in ends)
    if ends[0][0][1] >= 0 or ends[1][0][1] <= 0:
        return min(best, (jet(start)[0], start))  # floats saw a valley that is none
    x, short = start, mpf(10) ** (-mp.dps * 2 // 5)
    last = False
    for _ in range(120):
        value, slope, curvature = jet(x)
        best = min(best, (value, x))
        if last or not slope or value < CLEAR:
            break
        if slope > 0:
            high = x
        else:
            low = x
        following = x - slope / curvature if curvature > 0 else (low + high) / 2
        last = abs(following - x) <= short and curvature > 0
        if not low <= following <= high:
            following = (low + high) / 2
            last = high - low <= short**2
        x = following
    return best


def least_one_voltage(law: Law, band: Band) -> tuple[mpf, mpf, mpf, bool]:
    """The least quotient of P, that of N, where the smaller one is, and whether N vanishes all over."""
    with mp.workdps(DIGITS):
        curves = Curves(law, band)

        def of_power(x: mpf) -> tuple[mpf, mpf, mpf]:
            return quotient(*curves.conductance(curves.at(x)[0], 2))

        def of_determinant(x: mpf) -> tuple[mpf, mpf, mpf]:
            return quotient(*curves.determinant(*curves.at(x), 2))

        grid = float_grid(float(curves.length))
        points: list[mpf] = [mpf(float(x)) for x in grid]
        points[-1] = curves.length
        sampled: list[Sequence[Any]] = [list(values) for values in float_samples(curves, grid)]
        flat = False
        if min(map(min, sampled)) > -SMALL and any(min(values) < SMALL for values in sampled):
            exact = list(curves.on_grid(257, ZERO))
            points = [x for x, _, _ in exact]
            of_p = [curves.conductance(P, 0) for _, P, _ in exact]
            of_n = [curves.determinant(P, Q, 0) for _, P, Q in exact]
            sampled = [[v[0] / s[0] if s[0] else ZERO for v, s in values] for values in (of_p, of_n)]
            flat = all(abs(x) < NEAR for x in sampled[1])
        found = []
        for values, jet in zip(sampled, (of_power, of_determinant), strict=True):
            ends = {0: jet(ZERO), len(points) - 1: jet(curves.length)}
            best = min((value, points[k]) for k, (value, _, _) in ends.items())
            for k in valleys(values):
                if k in ends and (ends[k][1] >= 0 if k == 0 else ends[k][1] <= 0):
                    continue  # the least value is at the end itself
                if values[k] > HALF:
                    continue  # hardly anything cancels there, nor between it and its neighbours
                low, high = points[max(0, k - 1)], points[min(len(points) - 1, k + 1)]
                best = min(best, refine(jet, low, points[k], high))
            found.append(best)
        return found[0][0], found[1][0], min(found)[1], flat


# --- (b) two voltages -----------------------------------------------------------------------------------------

Values = tuple[mpf, mpf, mpf, mpf, mpf, mpf, mpf]  # s = (v / v1)^2, P, P/s, Q/s, sizes of P and Q/s, the unit of E


def values_at(curves: Curves, P: list[mpf], Q: list[mpf], s: mpf) -> Values:
    """From the values of the terms at one modulus."""
    p, p_size = sum(P, ZERO), sum(map(abs, P), ZERO)
    b, b_size = sum(Q, ZERO) / s, sum(map(abs, Q), ZERO) / s
    radial = sum((abs(t * less) for t, less in zip(P, curves.less_one, strict=True)), ZERO)
    cross = sum((abs(t * less) for t, less in zip(Q, curves.half_less_one, strict=True)), ZERO)
    return s, p, p / s, b, p_size, b_size, (p_size * radial + cross**2) / s**2


def pair_value(one: Values, two: Values) -> mpf:
    """The smaller of P_a + P_b and E, in units that make them comparable with (a); zero if rounding hides E."""
    (s, p, g, b, p_size, b_size, unit), (s_, p_, g_, b_, p_size_, b_size_, unit_) = one, two
    both, sizes = p + p_, p_size + p_size_
    least = both / sizes if sizes else ZERO
    if abs(s - s_) <= s * mpf(10) ** (-mp.dps * 9 // 20):  # one modulus, up to rounding
        return least
    numerator = both**2 - s * s_ * ((g + g_) ** 2 + (b_ - b) ** 2)
    noise = sizes**2 + s * s_ * ((p_size / s + p_size_ / s_) ** 2 + (b_size + b_size_) ** 2)
    if abs(numerator) <= noise * mpf(10) ** (5 - mp.dps):
        return min(least, ZERO)
    return min(least, 2 * numerator / ((s - s_) ** 2 * (unit + unit_)))


def least_two_voltages(law: Law, band: Band) -> mpf:
    """The least value over pairs: in 60 digits if that leaves no doubt, and in 300 otherwise."""
    for digits, close, halvings in ((DIGITS, mpf("1e-14"), 5), (MANY_DIGITS, mpf("1e-55"), 0)):
        with mp.workdps(digits):
            least = search_pairs(Curves(law, band), close, halvings)
        if abs(least) > SMALL:
            break
    return least


def search_pairs(curves: Curves, close: mpf, halvings: int) -> mpf:
    """`close` is the relative distance of the closest pairs, far above the square root of the precision.

    `halvings` of the step of the coordinate search.
    """
    length = curves.length
    gap = min(close, length * close)

    def at(x: mpf) -> Values:
        return values_at(curves, *curves.at(x), mp.exp(2 * x))

    def of_pair(x: mpf, y: mpf) -> mpf:
        return pair_value(at(x), at(y))

    def of_close(x: mpf) -> mpf:
        return of_pair(x, x + gap)

    count = 85 if halvings else 57
    grid = list(curves.values_on_grid(count, ZERO))
    coarse = grid[::7]
    pairs = [(pair_value(v, w), x, y) for k, (x, v) in enumerate(coarse) for y, w in coarse[k:]]
    best, x, y = min(pairs)
    if best < -SMALL:
        return best
    step = length / 32
    for _ in range(halvings):  # coordinate search
        for _ in range(20):
            moves = [(x + i * step, y + j * step) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1))]
            inside = [(of_pair(u, w), u, w) for u, w in moves if 0 <= u <= w <= length]
            least = min(inside, default=(best, x, y))
            if least[0] >= best:
                break
            best, x, y = least
        step /= 2
    # Newton's steps along close pairs; the shift by half a gap does not matter.
    shifted = [value for _, value in curves.values_on_grid(count, gap)]
    along = [pair_value(v, w) for (_, v), w in zip(grid[:-1], shifted[:-1], strict=True)]
    points = [u for u, _ in grid[:-1]]
    along.append(of_pair(length - gap, length))
    points.append(length - gap)
    best = min(best, min(along))
    h = gap ** mpf("0.5") * min(1, length)

    def jet(u: mpf) -> tuple[mpf, mpf, mpf]:
        middle = min(max(u, h), length - gap - h)  # differences stay inside; the ends are met as such
        left, centre, right = of_close(middle - h), of_close(middle), of_close(middle + h)
        slope = (right - left) / (2 * h)
        curvature = (right - 2 * centre + left) / h**2
        return (centre if middle == u else of_close(u)), slope, curvature

    for k in valleys(along):
        low, high = points[max(0, k - 1)], points[min(len(points) - 1, k + 1)]
        best = min(best, refine_pairs(jet, low, points[k], high, gap))
    return best


def refine_pairs(jet: Jet, low: mpf, start: mpf, high: mpf, gap: mpf) -> mpf:
    """As `refine`, with slopes that are differences: stops when a step is smaller than the gap."""
    x, best = start, mpf("inf")
    for _ in range(60):
        value, slope, curvature = jet(x)
        best = min(best, value)
        if slope > 0:
            high = x
        elif slope < 0:
            low = x
        else:
            break
        following = x - slope / curvature if curvature > 0 else (low + high) / 2
        if not low < following < high:
            following = (low + high) / 2
        if abs(following - x) <= gap or high - low <= gap or value < CLEAR:
            break
        x = following
    return best


# --- (c) whole exponents, exactly -----------------------------------------------------------------------------


def derivative(p: fmpq_poly) -> fmpq_poly:
    return p.derivative()


def odd_part(p: fmpq_poly) -> fmpq_poly:
    """The product of the square-free factors of odd multiplicity (Yun)."""
    result = fmpq_poly([1])
    common = p.gcd(derivative(p))
    rest = divmod(p, common)[0]
    k = 1
    while rest.degree() > 0:
        shared = rest.gcd(common)
        if k % 2:
            result *= divmod(rest, shared)[0]
        rest, common, k = shared, divmod(common, shared)[0], k + 1
    return result


def roots_between(p: fmpq_poly, low: fmpq, high: fmpq) -> int:
    """How many roots a square-free polynomial has in the open interval (Sturm)."""
    for end in (low, high):
        if p(end) == 0:
            p = divmod(p, fmpq_poly([-end, 1]))[0]
    chain = [p, derivative(p)]
    while chain[-1].degree() >= 0:
        chain.append(-(chain[-2] % chain[-1]))

    def changes(x: fmpq) -> int:
        signs = [value > 0 for value in (q(x) for q in chain) if value != 0]
        return sum(a != b for a, b in pairwise(signs))

    return changes(low) - changes(high)


def is_nonnegative(p: fmpq_poly, low: fmpq, high: fmpq) -> bool:
    if p.degree() < 0:
        return True
    if p.degree() > 0 and roots_between(odd_part(p), low, high):
        return False
    at = low
    while p(at) == 0:  # halves its distance to the upper end until it is no root
        at = (at + high) / 2
    return bool(p(at) > 0)


def exact_verdict(law: Law, band: Band) -> str | None:
    """The exact answer if all exponents are whole, or else None."""
    parts = powers(law)
    if any(e.denominator > 1 for part in parts for e, _ in part):
        return None
    exponents = [e.numerator for part in parts for e, _ in part]
    shift, top = min([0, *exponents]), max([0, *exponents])

    def polynomial(part: Powers, factor: Callable[[int], Fraction]) -> fmpq_poly:
        coefficients = [fmpq(0)] * (top - shift + 1)
        for (exponent, _), c in part.items():
            value = c * factor(exponent.numerator)
            coefficients[exponent.numerator - shift] += fmpq(value.numerator, value.denominator)
        return fmpq_poly(coefficients)

    P, R = polynomial(parts[0], lambda _: Fraction(1)), polynomial(parts[0], lambda e: Fraction(e - 1))
    C = polynomial(parts[1], lambda e: Fraction(e, 2) - 1)
    ends = [fmpq(v.numerator, v.denominator) for v in band]
    return MONOTONE if all(is_nonnegative(p, *ends) for p in (P, P * R - C * C)) else NOT_MONOTONE


# --- verdicts, and products of single pairs -------------------------------------------------------------------


def verdict_of(least: mpf) -> str:
    if abs(least) <= NEAR:
        return BOUNDARY
    return MONOTONE if least > 0 else NOT_MONOTONE


def judge(law: Law, band: Band) -> Truth:
    """What the oracle says about a load."""
    power, determinant, at, flat = least_one_voltage(law, band)
    pair = least_two_voltages(law, band)
    one, two = verdict_of(min(power, determinant)), verdict_of(pair)
    strict = one == MONOTONE or (one == BOUNDARY and not flat and power > NEAR)
    return Truth(one, min(power, determinant), pair, at, one == two, strict)


def product_sign(law: Law, pair: tuple[Fraction, Fraction], half_tangent: Fraction) -> int:
    """The sign of <V - U, I(V) - I(U)> for U = a and V = b at the angle with this tangent of its half.

    Exact if all exponents are whole; otherwise in as many digits as make it clear, and 0 if 1,000 do not.
    """
    a, b = pair
    cosine = (1 - half_tangent**2) / (1 + half_tangent**2)
    sine = 2 * half_tangent / (1 + half_tangent**2)
    parts = powers(law)
    if all(e.denominator == 1 for part in parts for e, _ in part):
        (pa, qa), (pb, qb) = (
            [sum((c * v**e.numerator for (e, _), c in part.items()), Fraction(0)) for part in parts] for v in pair
        )
        value = pa + pb - a * b * ((pa / a**2 + pb / b**2) * cosine + (qb / b**2 - qa / a**2) * sine)
        return (value > 0) - (value < 0)
    for digits in (DIGITS, 250, 1000):
        with mp.workdps(digits):
            terms = [[[term_value(c, e, base, v) for (e, base), c in part.items()] for part in parts] for v in pair]
            (Pa, Qa), (Pb, Qb) = ([mp.fsum(part) for part in both] for both in terms)
            size = mp.fsum(abs(t) for both in terms for part in both for t in part) * to_mpf(a / b + b / a)
            conductances = Pa * to_mpf(b / a) + Pb * to_mpf(a / b)
            susceptances = Qb * to_mpf(a / b) - Qa * to_mpf(b / a)
            total = Pa + Pb - conductances * to_mpf(cosine) - susceptances * to_mpf(sine)
            if abs(total) > size * mpf(10) ** (10 - digits):
                return int(mp.sign(total))
    return 0
