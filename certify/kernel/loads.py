"""The rules about static loads (THEORY 5): when a load current is monotone in the voltage, and when it is not.

Each is a theorem of FORMAT.md, on one band of voltages |V| in which the load is one sum of power laws. With
G = P/v^2, B = -Q/v^2 and D = G (G + v G') - (v B')^2 / 4, every rule that proves shows G >= 0 and D >= 0 on the band,
and returns whether both are shown to be positive; it raises `RuleFailure` if it does not show the former.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm

from certify.kernel.errors import require
from certify.kernel.linalg import Matrix, is_symmetric, ldl_pivots
from certify.kernel.model import LoadLaw, PowerTerm
from certify.kernel.poly import (
    Polynomial,
    Whole,
    bernstein_signs,
    is_nonnegative_on,
    is_positive_on,
    sign_at,
    substitute,
    to_polynomial,
)
from certify.kernel.powers import (
    PRECISIONS,
    Interval,
    compare_power,
    interval_product,
    interval_sum,
    power_enclosure,
    radical_inverse,
)
from certify.kernel.reader import Pair

MAX_DEGREE = 12  # of P and Q as polynomials in v
NEGATIVE_G = "the conductance G is negative somewhere on the band"
NEGATIVE_D = "D = G (G + v G') - (v B')^2 / 4 is negative somewhere on the band"


def is_polynomial(law: LoadLaw) -> bool:
    """Whether P and Q are polynomials in v of a degree that the exact rules take."""
    exponents = [t.exponent for t in (*law.active, *law.reactive)]
    return all(e.denominator == 1 and 0 <= e.numerator <= MAX_DEGREE for e in exponents)


def jacobian_polynomials(law: LoadLaw) -> tuple[Whole, Whole]:
    """Positive multiples of P = G v^2 and of D v^4 = P (v P' - P) - (v Q' - 2 Q)^2 / 4, as polynomials in v."""
    require(is_polynomial(law), f"an exponent is not a whole number from 0 to {MAX_DEGREE}")
    powers = [
        [
            (e, t.coefficient if t.base_volt == 1 else t.coefficient / t.base_volt**e)
            for t in part
            for e in (t.exponent.numerator,)
        ]
        for part in (law.active, law.reactive)
    ]
    common = lcm(*(c.denominator for part in powers for _, c in part))
    active, reactive = ([(e, c.numerator * (common // c.denominator)) for e, c in part] for part in powers)
    P, D = [0] * (MAX_DEGREE + 1), [0] * (2 * MAX_DEGREE + 1)
    for i, a in active:
        P[i] += a
        for j, b in active:
            D[i + j] += 4 * a * b * (j - 1)
    for i, a in reactive:
        for j, b in reactive:
            D[i + j] -= (i - 2) * (j - 2) * a * b
    return _primitive(P), _primitive(D)


def _primitive(p: list[int]) -> Whole:
    while p and not p[-1]:
        p.pop()
    content = gcd(*p) or 1
    return tuple(c // content for c in p)


def is_constant_admittance(law: LoadLaw) -> bool:
    return all(t.exponent == 2 for t in (*law.active, *law.reactive))


def constant_admittance(law: LoadLaw) -> bool:
    """Below every cut-off, down to v = 0: D = G^2, so G >= 0 is all. True if G > 0."""
    G = sum((t.coefficient / t.base_volt**2 for t in law.active), Fraction(0))
    require(G >= 0, NEGATIVE_G)
    return G > 0


# --- exact methods ------------------------------------------------------------------------------------------


def monotone_ends(law: LoadLaw, band: Pair) -> bool:
    """Rule `monotone-ends`: the ends of the band decide for one exponential load or a ZIP load of no negative part."""
    if len(law.active) == 1 and len(law.reactive) <= 1:
        return _exponential_ends(law, band)
    terms = (*law.active, *law.reactive)
    require(all(t.exponent in (0, 1, 2) for t in terms), "neither a single exponential law nor a ZIP load")
    worst = (*law.active, *(t for t in law.reactive if t.exponent != 2))  # a constant susceptance does not enter D
    require(all(t.coefficient >= 0 for t in worst), "a parameter of the ZIP load is negative")
    require(band[0] > 0, "D v^4 tells nothing at zero")
    sign = sign_at(jacobian_polynomials(law)[1], band[0])
    require(sign >= 0, "D v^2, which increases, is negative at the lower end of the band")
    return sign > 0


def _exponential_ends(law: LoadLaw, band: Pair) -> bool:
    P = law.active[0]
    require(P.coefficient > 0 and P.exponent >= 1, "the active power does not have P0 > 0 and np >= 1")
    if not law.reactive or law.reactive[0].exponent == 2:
        return P.exponent > 1
    Q = law.reactive[0]
    require(P.exponent > 1, "np = 1 leaves nothing to make up for the reactive power")
    base = Q.base_volt if P.exponent.denominator == 1 else P.base_volt
    P, Q = _rebased(P, base), _rebased(Q, base)
    bound = ((Q.exponent - 2) * Q.coefficient / P.coefficient) ** 2 / (4 * (P.exponent - 1))
    signs = [compare_power(v / base, 2 * (P.exponent - Q.exponent), bound) for v in band]
    require(None not in signs, "a power is too close to its bound to be told apart")
    require(min(s or 0 for s in signs) >= 0, "4 (np-1) P^2 < (nq-2)^2 Q^2 at an end of the band")
    return 0 not in signs


def _rebased(term: PowerTerm, base: Fraction) -> PowerTerm:
    if term.base_volt == base:
        return term
    require(term.exponent.denominator == 1, "two different nominal voltages with broken exponents")
    factor = (base / term.base_volt) ** term.exponent.numerator
    return PowerTerm(term.coefficient * factor, base, term.exponent)


def monotone_sturm(law: LoadLaw, band: Pair) -> bool:
    """Rule `monotone-sturm`: P >= 0 and D v^4 >= 0 on the band by Sturm counts."""
    P, D = (to_polynomial(p) for p in jacobian_polynomials(law))
    if is_positive_on(P, *band) and is_positive_on(D, *band):
        return True
    require(is_nonnegative_on(P, *band), NEGATIVE_G)
    require(is_nonnegative_on(D, *band), NEGATIVE_D)
    return False


def monotone_bernstein(law: LoadLaw, cells: Sequence[Fraction]) -> bool:
    """Rule `monotone-bernstein`: on each cell, P and D v^4 have no negative coefficient in the Bernstein basis."""
    strict = True
    for p, what in zip(jacobian_polynomials(law), "PD", strict=True):
        for low, high in pairwise(cells):
            signs = bernstein_signs(p, low, high)
            require(min(signs, default=0) >= 0, f"{what} has a negative Bernstein coefficient on {low} V to {high} V")
            strict = strict and bool(signs) and signs[0] > 0 and signs[-1] > 0
    return strict


def monotone_sos(law: LoadLaw, band: Pair, grams: Sequence[Matrix]) -> bool:
    """Rule `monotone-sos`: P and D v^4 as sigma0 + (1 - x^2) sigma1, sums of squares in x = -1 .. 1 along the band.

    `grams`: the Gram matrices of sigma0 and sigma1 for P, then for D v^4, in the monomials 1, x, x^2, ...
    """
    require(len(grams) == 4, "a proof by sums of squares has four Gram matrices")
    middle, half = (band[0] + band[1]) / 2, (band[1] - band[0]) / 2
    strict = [
        _sum_of_squares(substitute(p, middle, half), *pair)
        for p, pair in zip(jacobian_polynomials(law), (grams[:2], grams[2:]), strict=True)
    ]
    return all(strict)


def _sum_of_squares(p: Polynomial, first: Matrix, second: Matrix) -> bool:
    """Whether sigma0 is positive definite; fails unless p = sigma0 + (1 - x^2) sigma1 with Gram matrices >= 0."""
    size = max(len(first), len(second))
    require(size <= MAX_DEGREE + 2, "the Gram matrices are too large")
    total = [Fraction(0)] * (2 * size + 2)
    for gram, shifts in ((first, ((0, 1),)), (second, ((0, 1), (2, -1)))):
        require(is_symmetric(gram), "a Gram matrix is not symmetric")
        for i, row in enumerate(gram):
            for j, entry in enumerate(row):
                for shift, sign in shifts:
                    total[i + j + shift] += sign * entry
    require(to_polynomial(total) == p, "the Gram matrices do not give the polynomial")
    pivots = []
    for gram in (first, second):
        diagonal, semidefinite = ldl_pivots(gram)
        require(semidefinite, "a Gram matrix is not positive semidefinite")
        pivots.append(diagonal)
    return len(first) > 0 and all(x > 0 for x in pivots[0])


# --- enclosures ---------------------------------------------------------------------------------------------

Jet = Sequence[Interval]  # a value and its first derivatives with respect to ln v
Parts = list[tuple[Fraction, Interval]]
Enclosed = tuple[Parts, Parts, tuple[Jet, Jet]]  # a law at one voltage: its admittances, and the jets of G and D


def admittances(terms: Iterable[PowerTerm], v: Fraction, bits: int) -> Parts:
    """For each term, its exponent and an enclosure of its power over v^2, in siemens."""
    result = []
    for t in terms:
        low, high = power_enclosure(v / t.base_volt, t.exponent - 2, bits)
        unit = t.base_volt**2
        if t.blur:
            ends = interval_product(((t.coefficient - t.blur) / unit, (t.coefficient + t.blur) / unit), (low, high))
        else:
            c = t.coefficient / unit
            ends = (c * low, c * high) if c >= 0 else (c * high, c * low)
        result.append((t.exponent, ends))
    return result


def total(parts: Parts, factors: Sequence[Fraction | int] = ()) -> Interval:
    """The sum of the parts, each times its factor."""
    if not factors:
        return interval_sum(x for _, x in parts)
    return interval_sum(
        (f * a, f * b) if f >= 0 else (f * b, f * a) for (_, (a, b)), f in zip(parts, factors, strict=True)
    )


def jets(active: Parts, reactive: Parts, orders: int = 3) -> tuple[Jet, Jet]:
    """Enclosures of G and D with their derivatives, from those of the terms; d/d ln v of v^(e-2) is (e-2) v^(e-2)."""
    G = [total(active, [(e - 2) ** k for e, _ in active]) for k in range(orders)]
    R = [total(active, [(e - 1) * (e - 2) ** k for e, _ in active]) for k in range(orders)]  # G + v G'
    X = [total(reactive, [(e - 2) ** (k + 1) for e, _ in reactive]) for k in range(orders)]  # -v B'
    D = []
    for k in range(orders):  # D = G R - X^2 / 4, by the product rule
        low = high = Fraction(0)
        for j, ways in enumerate(((1,), (1, 1), (1, 2, 1))[k]):  # binomial coefficients
            gain = interval_product(G[j], R[k - j])
            loss = interval_product(X[j], X[k - j])
            if 2 * j == k and loss[0] < 0:  # a square
                loss = (Fraction(0), loss[1])
            low, high = low + ways * (gain[0] - loss[1] / 4), high + ways * (gain[1] - loss[0] / 4)
        D.append((low, high))
    return G, D


def jacobian_enclosure(law: LoadLaw, v: Fraction, bits: int) -> tuple[Interval, Interval]:
    """Enclosures of G and D at one voltage."""
    G, D = jets(admittances(law.active, v, bits), admittances(law.reactive, v, bits), 1)
    return G[0], D[0]


def is_violated_at(law: LoadLaw, v: Fraction) -> bool:
    """Whether G(v) < 0 or D(v) < 0, v > 0: then the load is not monotone around v. False also if it cannot be told."""
    if is_polynomial(law) and not any(t.blur for t in (*law.active, *law.reactive)):
        return any(sign_at(p, v) < 0 for p in jacobian_polynomials(law))
    for bits in PRECISIONS:
        values = jacobian_enclosure(law, v, bits)
        if min(x[1] for x in values) < 0:
            return True
        if min(x[0] for x in values) >= 0:
            return False
    return False


def _sign_on_cell(cell: Jet, low: Jet, high: Jet) -> bool | None:
    """Whether a function is positive (True) or at least not negative (False) on a cell, as far as enclosures tell.

    By its values on the cell; or by its value f at one end, if it does not decrease from there; or if its second
    derivative on the cell is at least b >= 0, and its slope s from that end inwards is s >= 0 or s^2 <= 2 b f.
    """
    if cell[0][0] > 0:
        return True
    for value, slope, inner in ((low[0][0], low[1][0], cell[1][0]), (high[0][0], -high[1][1], -cell[1][1])):
        if value >= 0 and (inner >= 0 or (cell[2][0] >= 0 and slope >= 0)):
            return value > 0
        if value > 0 and slope**2 <= 2 * cell[2][0] * value and cell[2][0] > 0:
            return slope**2 < 2 * cell[2][0] * value
    return False if cell[0][0] == 0 else None


def enclose(law: LoadLaw, v: Fraction, bits: int) -> Enclosed:
    active, reactive = admittances(law.active, v, bits), admittances(law.reactive, v, bits)
    return active, reactive, jets(active, reactive)


def cell_sign(low: Enclosed, high: Enclosed) -> bool | None:
    """For G and D together, on the cell between two voltages."""

    def hull(a: Parts, b: Parts) -> Parts:
        # each power is monotone in v, so its values at the ends enclose it
        return [(e, (min(x[0], y[0]), max(x[1], y[1]))) for (e, x), (_, y) in zip(a, b, strict=True)]

    cell = jets(hull(low[0], high[0]), hull(low[1], high[1]))
    signs = [_sign_on_cell(*parts) for parts in zip(cell, low[2], high[2], strict=True)]
    return None if None in signs else all(signs)


def monotone_enclosure(law: LoadLaw, cells: Sequence[Fraction], bits: int) -> bool:
    """Rule `monotone-enclosure`: G and D on every cell between consecutive voltages, by enclosures rounded outwards."""
    require(cells[0] > 0, "a power may have no bound at zero")
    strict = True
    for low, high in pairwise(enclose(law, v, bits) for v in cells):
        sign = cell_sign(low, high)
        require(sign is not None, "G or D may be negative on a cell")
        strict = strict and bool(sign)
    return strict


def sampled(law: LoadLaw, band: Pair, count: int) -> None:
    """Rule `sampled`: no violation at the upper end and `count` points of the van der Corput sequence. No proof."""
    for k in range(count + 1):
        v = band[0] + (band[1] - band[0]) * radical_inverse(k, 2) if k < count else band[1]
        G, D = jacobian_enclosure(law, v, PRECISIONS[0])
        require(G[1] >= 0 and D[1] >= 0, "a sample shows that the load is not monotone")


def is_monotone_beyond(law: LoadLaw, v: Fraction, upward: bool) -> bool:
    """Whether G >= 0 and D >= 0 are shown for all voltages above v, or below it; below also that I(V) -> 0 for V -> 0.

    G and D v^2 are sums of powers a_k t^(e_k), t = (voltage / v) >= 1: not negative if no partial sum of the a_k is,
    taken from the largest exponent down (Abel's summation); below v from the smallest exponent up.
    """
    if is_constant_admittance(law):
        return sum((t.coefficient / t.base_volt**2 for t in law.active), Fraction(0)) >= 0
    if not v or (not upward and any(t.exponent <= 1 for t in (*law.active, *law.reactive))):
        return False
    active, reactive = (admittances(terms, v, PRECISIONS[0]) for terms in (law.active, law.reactive))
    G: dict[Fraction, list[Interval]] = {}
    D: dict[Fraction, list[Interval]] = {}
    for e, x in active:
        G.setdefault(e, []).append(x)
        for f, y in active:
            D.setdefault(e + f, []).append(total([(f, interval_product(x, y))], [f - 1]))
    for e, x in reactive:
        for f, y in reactive:
            D.setdefault(e + f, []).append(total([(f, interval_product(x, y))], [-(e - 2) * (f - 2) / 4]))
    for powers in (G, D):
        partial = Fraction(0)
        for e in sorted(powers, reverse=upward):
            partial += interval_sum(powers[e])[0]
            if partial < 0:
                return False
    return bool(active)


# --- refutation, and numbers that later rules use -----------------------------------------------------------------


def voltage_pair(law: LoadLaw, band: Pair, v: Fraction, pair: Pair, t: Fraction) -> Interval:
    """Rule `voltage-pair`: G(v) < 0 or D(v) < 0 at a voltage of the band, and two voltages whose product is negative.

    The two are a = pair[0] at angle 0 and b = pair[1] at the angle with tan(angle/2) = t; the product is
    <V_b - V_a, I(V_b) - I(V_a)> = P(a) + P(b) - a b ((G_a + G_b) cos + (B_a - B_b) sin). Returns it, enclosed, in W.
    """
    require(all(x > 0 and band[0] <= x <= band[1] for x in (v, *pair)), "a voltage is outside the band")
    (a, b), cosine, sine = pair, (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    # the product, as a sum of G_a, G_b, -B_a, -B_b times these
    factors = ((a - b * cosine) * a, (b - a * cosine) * b, a * b * sine, -a * b * sine)
    require(is_violated_at(law, v), "neither G nor D is negative at the voltage named")
    for bits in PRECISIONS:
        sides = [(x, total(admittances(terms, x, bits))) for terms in (law.active, law.reactive) for x in pair]
        product = total(sides, factors)
        if product[1] < 0 or product[0] >= 0:
            break
    require(product[1] < 0, "the product of the two voltages is not negative")
    return product


def lipschitz_bound(pieces: Iterable[tuple[Pair, LoadLaw]]) -> Fraction:
    """A Lambda with |I(V) - I(U)| <= Lambda |V - U| on the band, for every law of the box: FORMAT.md, section 4.

    It is sup |Y| + sup |v Y'|, each term of the power laws taken at the worse end of its piece of the band.
    """
    values, slopes = [Fraction(0)], [Fraction(0)]
    for band, law in pieces:
        value = slope = Fraction(0)
        for t in (*law.active, *law.reactive):
            e = t.exponent - 2
            top = power_enclosure(band[e > 0] / t.base_volt, e, PRECISIONS[0])[1]
            size = (abs(t.coefficient) + t.spread + t.blur) / t.base_volt**2 * top
            value, slope = value + size, slope + abs(e) * size
        values.append(value)
        slopes.append(slope)
    return max(values) + max(slopes)
