"""Seeded random loads with the band on which monotonicity is asked, and the exact answer where a construction gives it.

In w = v / V0 and x = ln w, a dash for d/dx: N = P R - C^2 with R = P' - P and C = Q'/2 - Q, and P, must be nowhere
negative on the band. A term p w^m adds (m - 1) p w^m to R, a term q w^n adds (n/2 - 1) q w^n to C. So at w = 1 all of
P, R, C and the derivative of C are linear in the coefficients with rational factors, whatever the exponents; solving for
some coefficients puts N on the boundary there, exactly. Taylor's bound in x with exact bounds on derivatives gives a
band on which the answer is then certain, and it stays certain with an error of 1e-3 to 1e-30 in a coefficient.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from fractions import Fraction

from mpmath import mp, mpf

from certify.kernel.spec import ExpLoad, ZipLoad
from tests.load_oracle import MONOTONE, NOT_MONOTONE, Band, Curves, Law

NOTHING, ONE = (Fraction(0), Fraction(0)), Fraction(1)
ERRORS = tuple(Fraction(s) for s in ("0", "1e-3", "-1e-3", "1e-12", "-1e-12", "1e-30", "-1e-30"))
VOLTAGES = tuple(Fraction(v) for v in ("1", "230", "325.27", "400", "13200", "20000"))
Made = tuple[Law, Band, str | None]
Terms = list[tuple[Fraction, Fraction]]  # (coefficient, exponent) in w


class AgainError(Exception):
    """The numbers drawn do not fit the construction: draw again."""


@dataclass(frozen=True)
class Case:
    """`error`: by how much of itself a coefficient is off the boundary, "" for loads that were not put there."""

    number: int
    kind: str
    error: str
    law: Law
    band: Band
    expected: str | None


def shown(case: Case) -> str:
    """The law and the band as Python that makes them again.

    >>> shown(Case(0, "", "", (ZipLoad(NOTHING, (ONE, ONE / 3), NOTHING),), (ONE, 2 * ONE), None))
    "((Z('0 0', '1 1/3', '0 0'),), B('1 2'))"
    """
    parts = []
    for load in case.law:
        if isinstance(load, ZipLoad):
            parts.append("Z(" + ", ".join(f"'{a} {b}'" for a, b in (load.Y, load.I, load.P)) + ")")
        else:
            numbers = (load.P0_watt, load.np, load.Q0_var, load.nq, load.V0_volt)
            parts.append("X('" + " ".join(map(str, numbers)) + "')")
    return f"(({', '.join(parts)},), B('{case.band[0]} {case.band[1]}'))"


def Z(Y: str, I: str, P: str) -> ZipLoad:  # noqa: E741
    """A ZIP load from three texts of two rationals, as `shown` writes it."""
    pairs = [tuple(Fraction(x) for x in text.split()) for text in (Y, I, P)]
    return ZipLoad(*pairs)  # type: ignore[arg-type]


def X(numbers: str) -> ExpLoad:
    """An exponential load from "P0 np Q0 nq V0"."""
    return ExpLoad(*(Fraction(x) for x in numbers.split()))  # type: ignore[arg-type]


def B(ends: str) -> Band:
    low, high = (Fraction(x) for x in ends.split())
    return low, high


# --- random numbers -------------------------------------------------------------------------------------------


def decimal(rng: random.Random, low: float, high: float) -> Fraction:
    """With three significant digits."""
    return Fraction(f"{rng.uniform(low, high):.3g}")


def signed(rng: random.Random, size: float = 2) -> Fraction:
    return decimal(rng, -size, size)


def log_decimal(rng: random.Random, low: int, high: int) -> Fraction:
    """Of either sign, its size between two powers of ten."""
    return rng.choice((-1, 1)) * Fraction(f"{10 ** rng.uniform(low, high):.2e}")


def nonzero(rng: random.Random, size: float = 2) -> Fraction:
    return signed(rng, size) or ONE


def exponent(rng: random.Random, high: int) -> Fraction:
    """From 0 to `high`: two decimals, a half, a third, or whole."""
    kind = rng.random()
    if kind < 0.5:
        return Fraction(rng.randint(0, 100 * high), 100)
    if kind < 0.7:
        return Fraction(rng.randint(0, 2 * high), 2)
    return Fraction(rng.randint(0, 3 * high), 3) if kind < 0.85 else Fraction(rng.randint(0, high))


def random_band(rng: random.Random) -> Band:
    """In per unit: typical, wide, narrow or extreme."""
    kind = rng.random()
    if kind < 0.5:
        return Fraction("0.9"), Fraction("1.1")
    if kind < 0.75:
        return decimal(rng, 0.05, 0.95), decimal(rng, 1.05, 3)
    if kind < 0.9:
        middle = decimal(rng, 0.5, 1.5)
        return middle, middle * (1 + Fraction(1, 10 ** rng.randint(2, 9)))
    return Fraction(1, 10 ** rng.randint(2, 6)), Fraction(10 ** rng.randint(1, 6))


def volts(rng: random.Random, band: Band) -> tuple[Fraction, Band]:
    V0 = rng.choice(VOLTAGES)
    return V0, (band[0] * V0, band[1] * V0)


def zip_law(V0: Fraction, power: Fraction, active: list[Fraction], reactive: list[Fraction]) -> ZipLoad:
    """From per-unit coefficients of w^2, w, 1."""
    (Y, I, P) = (  # noqa: E741
        (p * power / V0**k, q * power / V0**k) for k, p, q in zip((2, 1, 0), active, reactive, strict=True)
    )
    return ZipLoad(Y, I, P)


# --- loads of all sorts ---------------------------------------------------------------------------------------


def some_zip(rng: random.Random, V0: Fraction, power: Fraction = ONE) -> ZipLoad:
    """Any signs; in most the impedance prevails, so that both answers occur."""
    share = Fraction(rng.choice(("0", "0.1", "0.3", "1")))
    active, reactive = [signed(rng) for _ in range(3)], [share * signed(rng) for _ in range(3)]
    if rng.random() < 0.7:
        active[0], active[2] = abs(active[0]) + Fraction(1, 2), active[2] / 4
    return zip_law(V0, power, active, reactive)


def some_exp(rng: random.Random, V0: Fraction, power: Fraction = ONE) -> ExpLoad:
    """np from 0 to 3, nq from 0 to 6; in many of them Q0 is near its largest size at V0."""
    m, n, P0 = exponent(rng, 3), exponent(rng, 6), nonzero(rng)
    if rng.random() < 0.6:
        m, P0 = max(m, Fraction(rng.choice(("1.01", "1.2", "1.5")))), abs(P0)
    Q0 = signed(rng)
    if rng.random() < 0.6 and m > 1 and n != 2:
        Q0 = Fraction(f"{2 * float(m - 1) ** 0.5 * float(P0 / abs(n - 2)) * rng.uniform(-1.2, 1.2):.3g}")
    return ExpLoad(P0 * power, m, Q0 * power, n, V0)


def general(*makers: Callable[[random.Random, Fraction], ZipLoad | ExpLoad]) -> Callable[[random.Random], Made]:
    """A sum of loads with the same V0, on any band."""

    def make(rng: random.Random) -> Made:
        V0, band = volts(rng, random_band(rng))
        return tuple(maker(rng, V0) for maker in makers), band, None

    return make


def nonnegative_zip(rng: random.Random) -> Made:
    V0, band = volts(rng, random_band(rng))
    active, reactive = ([abs(signed(rng)) for _ in range(3)] for _ in range(2))
    share = Fraction(rng.choice(("0", "0.1", "0.5", "1")))
    return (zip_law(V0, ONE, active, [q * share for q in reactive]),), band, None


def two_bases(rng: random.Random) -> Made:
    V0, band = volts(rng, random_band(rng))
    return (some_exp(rng, V0), some_exp(rng, V0 * decimal(rng, 0.3, 3))), band, None


def generation(rng: random.Random) -> Made:
    """Constant power fed in or taken, and something with a conductance to make up for it."""
    V0, band = volts(rng, random_band(rng))
    power = zip_law(V0, ONE, [Fraction(0), Fraction(0), signed(rng, 1.5)], [Fraction(0), Fraction(0), signed(rng, 0.5)])
    other = rng.choice((some_zip, some_exp))(rng, V0)
    impedance = zip_law(V0, ONE, [decimal(rng, 0.3, 2), Fraction(0), Fraction(0)], [signed(rng), *NOTHING])
    return rng.choice(((power, impedance), (power, other, impedance), (power, other))), band, None


def badly_scaled(rng: random.Random) -> Made:
    """Voltages and coefficients over twelve powers of ten, independently of each other."""
    V0, low = abs(log_decimal(rng, -6, 6)), abs(log_decimal(rng, -6, 6))
    band = (low, low * (1 + abs(log_decimal(rng, -6, 6))))
    shapes = [ZipLoad(*((log_decimal(rng, -6, 6), log_decimal(rng, -6, 6)) for _ in range(3)))]
    for _ in range(2):
        m, n = exponent(rng, 3), exponent(rng, 6)
        shapes.append(ExpLoad(log_decimal(rng, -6, 6), m, log_decimal(rng, -6, 6), n, V0))  # type: ignore[arg-type]
    if rng.random() < 0.6:  # only powers fed out, less reactive ones
        shapes = [positive(load) for load in shapes]  # type: ignore[misc]
    law: list[Law] = [(shapes[0],), (shapes[1],), (shapes[0], shapes[1]), (shapes[1], shapes[2])]
    return rng.choice(law), band, None


def positive(load: ZipLoad | ExpLoad) -> ZipLoad | ExpLoad:
    if isinstance(load, ZipLoad):
        Y, I, P = ((abs(p), q / 10**6) for p, q in (load.Y, load.I, load.P))  # noqa: E741
        return ZipLoad(Y, I, P)
    return ExpLoad(abs(load.P0_watt), load.np + 1, load.Q0_var / 10**6, load.nq, load.V0_volt)


def unusual_exponents(rng: random.Random) -> Made:
    """Negative, large, or with a large denominator, and next to 1 and 2."""
    V0, band = volts(rng, random_band(rng))

    def any_exponent(special: int) -> Fraction:
        tiny = Fraction(rng.choice((-1, 1)), 10 ** rng.randint(2, 12))
        return rng.choice((signed(rng, 12), special + tiny, Fraction(rng.randint(-300, 900), 997), special * ONE))

    loads = [ExpLoad(nonzero(rng), any_exponent(1), nonzero(rng), any_exponent(2), V0) for _ in range(2)]
    return rng.choice((tuple(loads), (loads[0],), (loads[0], some_zip(rng, V0)))), band, None


def near_critical_voltage(rng: random.Random) -> Made:
    """The band starts a little above or below where N changes its sign (in 60 digits; not exactly there)."""
    V0 = rng.choice(VOLTAGES)
    makers = rng.choice(((some_zip,), (some_exp, some_exp), (some_zip, some_exp)))
    law: Law = tuple(maker(rng, V0) for maker in makers)
    wide = (V0 / 4, V0 * 2)
    with mp.workdps(60):
        curves = Curves(law, wide)

        def is_negative(x: mpf) -> bool:
            P, Q = curves.at(x)
            return bool(curves.determinant(P, Q, 0)[0][0] < 0 or curves.conductance(P, 0)[0][0] < 0)

        marks = [is_negative(x) for x in (curves.length * k / 200 for k in range(201))]
        places = [k for k in range(200) if marks[k] != marks[k + 1]]
        if not places:
            raise AgainError
        k = rng.choice(places)
        low, high = curves.length * k / 200, curves.length * (k + 1) / 200
        for _ in range(170):
            middle = (low + high) / 2
            low, high = (middle, high) if is_negative(middle) == marks[k] else (low, middle)
        root = Fraction(mp.nstr(mp.exp(low), 50)) * wide[0]
    root *= 1 + rng.choice(ERRORS[1:])
    width = 1 + Fraction(rng.choice(("0.3", "0.05", "1e-3")))
    return law, (root, root * width) if marks[k] else (root / width, root), None


# --- on the boundary, with or without an error ----------------------------------------------------------------


def total(terms: Terms, factor: Callable[[Fraction], Fraction]) -> Fraction:
    return sum((c * factor(e) for c, e in terms), Fraction(0))


def size(terms: Terms, factor: Callable[[Fraction], Fraction]) -> Fraction:
    """A bound of the sum for v between V0 / 2 and 2 V0."""
    return sum((abs(c * factor(e)) * 2 ** -(-abs(e) // 1) for c, e in terms), Fraction(0))


@dataclass(frozen=True)
class Taylor:
    """Exact derivatives at w = 1 of P and N, and bounds of their sizes for v between V0 / 2 and 2 V0."""

    power: tuple[Fraction, ...]
    power_bounds: tuple[Fraction, ...]
    n: tuple[Fraction, ...]
    n_bounds: tuple[Fraction, ...]


def leibniz(k: int, a: list[Fraction], b: list[Fraction]) -> Fraction:
    choose = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))[k]
    return sum((choose[i] * a[i] * b[k - i] for i in range(k + 1)), Fraction(0))


def taylor(active: Terms, reactive: Terms) -> Taylor:
    def derivatives(measure: Callable[[Terms, Callable[[Fraction], Fraction]], Fraction]) -> list[list[Fraction]]:
        return [
            [measure(active, lambda e, k=k: e**k) for k in range(4)],  # type: ignore[misc]
            [measure(active, lambda e, k=k: (e - 1) * e**k) for k in range(4)],  # type: ignore[misc]
            [measure(reactive, lambda e, k=k: (e / 2 - 1) * e**k) for k in range(4)],  # type: ignore[misc]
        ]

    P, R, C = derivatives(total)
    P_, R_, C_ = derivatives(size)
    n = tuple(leibniz(k, P, R) - leibniz(k, C, C) for k in range(4))
    bounds = tuple(leibniz(k, P_, R_) + leibniz(k, C_, C_) for k in range(4))
    return Taylor(tuple(P), tuple(P_), n, bounds)


@dataclass(frozen=True)
class Shape:
    """Exponents of a sum of a ZIP load (if any) and exponential loads, with a way back to the loads."""

    with_zip: bool
    exponents: tuple[tuple[Fraction, Fraction], ...]
    ratios: tuple[Fraction, ...]  # V0 of each exponential load over the common V0

    def active(self) -> list[Fraction]:
        return [Fraction(k) for k in (2, 1, 0) if self.with_zip] + [m for m, _ in self.exponents]

    def reactive(self) -> list[Fraction]:
        return [Fraction(k) for k in (2, 1, 0) if self.with_zip] + [n for _, n in self.exponents]

    def law(self, V0: Fraction, power: Fraction, active: Terms, reactive: Terms) -> Law:
        p, q = ([c for c, _ in terms] for terms in (active, reactive))
        loads: list[ZipLoad | ExpLoad] = []
        if self.with_zip:
            loads.append(zip_law(V0, power, p[:3], q[:3]))
            p, q = p[3:], q[3:]
        for c, d, (m, n), ratio in zip(p, q, self.exponents, self.ratios, strict=True):
            # c (v / V0)^m = c ratio^m (v / (ratio V0))^m, and ratio^m is rational by the choice of the ratio
            loads.append(ExpLoad(c * power * exact(ratio, m), m, d * power * exact(ratio, n), n, ratio * V0))
        return tuple(loads)


def exact(base: Fraction, exponent: Fraction) -> Fraction:
    """A rational power of a rational that is one."""
    parts = []
    for whole in (base.numerator, base.denominator):
        root = round(whole ** (1 / exponent.denominator))
        if root**exponent.denominator != whole:
            raise ArithmeticError(f"{base}^{exponent} is not rational")
        parts.append(root)
    return Fraction(*parts) ** exponent.numerator


def random_shape(rng: random.Random, kind: str) -> Shape:
    pairs = [(exponent(rng, 3), exponent(rng, 6)) for _ in range(2)]
    if kind == "two V0":
        pairs = [(Fraction(rng.randint(0, 6), 2), Fraction(rng.randint(0, 12), 2)) for _ in range(2)]
        return Shape(False, tuple(pairs), (ONE, Fraction(rng.randint(1, 5), rng.randint(1, 5)) ** 2))
    if kind == "EXP + EXP":
        return Shape(False, tuple(pairs), (ONE, ONE))
    return Shape(True, tuple(pairs[:1]) if kind == "ZIP + EXP" else (), (ONE,) if kind == "ZIP + EXP" else ())


def solved(
    rng: random.Random, exponents: list[Fraction], weights: list[Callable[[Fraction], Fraction]], values: list[Fraction]
) -> Terms:
    """Random coefficients with sum of c weight(e) = value for one or two weights."""
    c = [signed(rng, 1) for _ in exponents]
    places = rng.sample(range(len(c)), min(len(c), len(weights)))
    if len(places) < len(weights):
        raise AgainError
    rest = [
        v - sum(c[k] * w(exponents[k]) for k in range(len(c)) if k not in places)
        for w, v in zip(weights, values, strict=True)
    ]
    rows = [[w(exponents[k]) for k in places] for w in weights]
    if len(places) == 1:
        if not rows[0][0]:
            raise AgainError
        c[places[0]] = rest[0] / rows[0][0]
    else:
        determinant = rows[0][0] * rows[1][1] - rows[0][1] * rows[1][0]
        if not determinant:
            raise AgainError
        c[places[0]] = (rest[0] * rows[1][1] - rest[1] * rows[0][1]) / determinant
        c[places[1]] = (rest[1] * rows[0][0] - rest[0] * rows[1][0]) / determinant
    return list(zip(c, exponents, strict=True))


def boundary_terms(rng: random.Random, shape: Shape, stationary: bool) -> tuple[Terms, Terms]:
    """Coefficients with N = 0 at w = 1, P > 0 and R > 0 there, and N' = 0 too if wanted."""
    scale, s, t = decimal(rng, 0.2, 2), decimal(rng, 0.3, 2), decimal(rng, 0.3, 2)
    P, R, C = scale * s * s, scale * t * t, scale * s * t * rng.choice((-1, 1))
    active = solved(rng, shape.active(), [lambda _: ONE, lambda m: m - 1], [P, R])
    weights: list[Callable[[Fraction], Fraction]] = [lambda n: n / 2 - 1, lambda n: (n / 2 - 1) * n]
    if not stationary:
        return active, solved(rng, shape.reactive(), weights[:1], [C])
    first = [total(active, lambda m: m), total(active, lambda m: (m - 1) * m)]
    return active, solved(rng, shape.reactive(), weights, [C, (first[0] * R + P * first[1]) / (2 * C)])


def disturbed(rng: random.Random, active: Terms, error: Fraction) -> tuple[Terms, Fraction]:
    """One active coefficient with exponent 1 or more off by a share of itself; what was added, and its exponent."""
    places = [k for k, (c, e) in enumerate(active) if c and e >= 1]
    if not places:
        raise AgainError
    k = rng.choice(places)
    c, e = active[k]
    return [*active[:k], (c + error * abs(c), e), *active[k + 1 :]], e


def rounded_down(x: Fraction) -> Fraction:
    """To two significant digits, so that the band stays short."""
    unit = Fraction(10) ** (len(str(int(x))) - 2) if x >= 1 else Fraction(1, 10 ** (len(str(int(1 / x))) + 1))
    return x // unit * unit


def at_an_end(kind: str) -> Callable[[random.Random, Fraction], Made]:
    """N = 0 at the lower or the upper end, rising or falling into the band."""

    def make(rng: random.Random, error: Fraction) -> Made:
        shape, upward = random_shape(rng, kind), rng.random() < 0.6
        active, reactive = boundary_terms(rng, shape, stationary=False)
        active, _ = disturbed(rng, active, error)
        found = taylor(active, reactive)
        value, slope = found.n[0], found.n[1] if upward else -found.n[1]
        limit = Fraction(2, 5)
        if value < 0:
            width, expected = decimal(rng, 0.01, 0.4), NOT_MONOTONE
        elif slope > 0:  # N >= slope x - bound x^2 / 2
            limit = min(limit, 2 * slope / found.n_bounds[2], found.power[0] / found.power_bounds[1])
            width, expected = rounded_down(limit * decimal(rng, 0.2, 0.99)), MONOTONE
        elif slope < 0:  # N <= value + slope x / 2 as far as x = -slope / bound
            reach = min(Fraction(3, 10), -slope / found.n_bounds[2])
            if value >= -slope * reach / 2:
                raise AgainError
            width, expected = max(decimal(rng, 0.01, 0.4), rounded_down(reach * Fraction(3, 2))), NOT_MONOTONE
        else:
            raise AgainError
        if width <= 0:
            raise AgainError
        V0 = rng.choice(VOLTAGES)
        band = (V0, V0 * (1 + width)) if upward else (V0 / (1 + width), V0)
        return shape.law(V0, decimal(rng, 1, 1000), active, reactive), band, expected

    return make


def touching(kind: str) -> Callable[[random.Random, Fraction], Made]:
    """N = N' = 0 at V0 inside the band."""

    def make(rng: random.Random, error: Fraction) -> Made:
        shape = random_shape(rng, kind)
        active, reactive = boundary_terms(rng, shape, stationary=True)
        changed, m = disturbed(rng, active, error)
        exact_one, now = taylor(active, reactive), taylor(changed, reactive)
        second = exact_one.n[2]
        if not second:
            raise AgainError
        limit = min(Fraction(3, 10), 3 * abs(second) / exact_one.n_bounds[3])
        if now.n[0] < 0:
            width, expected = rounded_down(limit), NOT_MONOTONE
        elif second < 0:  # on one side N <= value + second x^2 / 2 + third x^3 / 6
            reach = min(limit, -3 * now.n[2] / now.n_bounds[3] / 2)
            if reach <= 0 or now.n[0] >= -now.n[2] * reach**2 / 4:
                raise AgainError
            width, expected = Fraction(2, 5), NOT_MONOTONE
        else:  # an addition d w^m to P adds d w^m (R + (m - 1) P) + (m - 1) d^2 w^(2 m) to N
            R, P = total(active, lambda e: e - 1), exact_one.power[0]
            steep = size(active, lambda e: (e - 1) * e) + (m - 1) * size(active, lambda e: e)
            width = min(limit, P / exact_one.power_bounds[1], (R + (m - 1) * P) / steep if steep else limit)
            width, expected = rounded_down(width * decimal(rng, 0.2, 0.99)), MONOTONE
        if width <= 0:
            raise AgainError
        V0 = rng.choice(VOLTAGES)
        below = width if expected == NOT_MONOTONE else width * decimal(rng, 0.1, 1)
        return shape.law(V0, decimal(rng, 1, 1000), changed, reactive), (V0 / (1 + below), V0 * (1 + width)), expected

    return make


def zip_touching_far(rng: random.Random, error: Fraction) -> Made:
    """N = (w - 1)^2 (w^2 + 2 w - s), with t: k = t + 1/t, s = k^2 - 3, on any band above the root of the last factor."""
    t = ONE + Fraction(rng.randint(1, 90), 100)
    k, m = t + 1 / t, t - 1 / t
    s = k * k - 3
    power = rng.choice((-1, 1)) * m / k * (1 + error)
    low, high = Fraction(rng.randint(42, 99), 100), decimal(rng, 1.01, 50)
    if low**2 + 2 * low < s or low**2 + power <= 0:
        raise AgainError
    V0 = rng.choice(VOLTAGES)
    law = zip_law(V0, decimal(rng, 1, 1000), [ONE, Fraction(0), power], [signed(rng), 2 * k, -(k * k - 2) / k])
    return (law,), (low * V0, high * V0), NOT_MONOTONE if error > 0 else MONOTONE


def power_and_impedance(rng: random.Random, error: Fraction) -> Made:
    """Y w^2 + P: N = (Y w^2)^2 - P^2, so that Y w^2 >= |P| at the lower end is all."""
    V0, low, Y = rng.choice(VOLTAGES), decimal(rng, 0.2, 1), decimal(rng, 0.1, 5)
    P = rng.choice((-1, 1)) * Y * low**2 * (1 + error)
    impedance = zip_law(V0, ONE, [Y, Fraction(0), Fraction(0)], [signed(rng), *NOTHING])
    law = (impedance, zip_law(V0, ONE, [Fraction(0), Fraction(0), P], [Fraction(0)] * 3))
    return law, (low * V0, low * V0 * (1 + decimal(rng, 0.1, 2))), NOT_MONOTONE if error > 0 else MONOTONE


def power_with_a_root(rng: random.Random, error: Fraction) -> Made:
    """P = (w - 1)(w + b), 2 Q' - 4 Q = -i (w - 1) up to a factor: P and N vanish at the lower end or inside."""
    V0, b, i = rng.choice(VOLTAGES), decimal(rng, 0, 2), decimal(rng, 0, 1.9)
    active, reactive = [ONE, b - 1, -b], [signed(rng), i, -i / 2]
    kind = rng.choice(("simple", "inside", "double", "upper"))
    low, high, expected = ONE, 1 + decimal(rng, 0.05, 2), MONOTONE
    # The error goes to the constant term: P(1) < 0 if negative. If positive, R = w^2 + b - error and P w^0 + error.
    if kind == "inside":
        low, expected = decimal(rng, 0.5, 0.99), NOT_MONOTONE
    elif kind == "double":  # P = (w - 1)^2, R = w^2 - 1
        active, reactive = [ONE, Fraction(-2), ONE], [signed(rng), Fraction(0), Fraction(0)]
        if error:  # P = (w - 1)^2 + d, R = w^2 - 1 - d: at w = 1, N = -d^2
            expected = NOT_MONOTONE
    elif kind == "upper":
        active, low, high, expected = [-c for c in active], decimal(rng, 0.5, 0.99), ONE, NOT_MONOTONE
    if kind == "simple" and error:
        # P R = ((w - 1)(w + b) + d)(w^2 + b - d) against (i/2)^2 (w - 1)^2 < (w - 1) w^3: d > 0 only helps while small
        if b < Fraction(1, 100):
            raise AgainError
        expected = NOT_MONOTONE if error < 0 else MONOTONE
    active[2] += error
    if kind == "inside" and error and 1 - low < Fraction(1, 20):
        raise AgainError
    return (zip_law(V0, decimal(rng, 1, 1000), active, reactive),), (low * V0, high * V0), expected


def vanishing(rng: random.Random, error: Fraction) -> Made:
    """N = 0 at every voltage: constant currents and reactances only; the error is one more part."""
    V0, band = volts(rng, random_band(rng))
    zero, i, d = Fraction(0), decimal(rng, 0.1, 3), abs(error)
    low = band[0] / V0
    kind = rng.choice(("current", "reactance", "exp current", "negative current"))
    sign = 1 if error >= 0 else -1
    where = rng.choice(("Y", "P", "iq")) if error else ""
    y, p, q = (sign * d if where == name else zero for name in ("Y", "P", "iq"))
    current = {"reactance": zero, "negative current": -i}.get(kind, i)
    # With an active current i > 0: N = (y w^2 - p)(y w^2 + i w + p) - (q w / 2)^2.
    if kind == "negative current" or where == "iq":
        expected = NOT_MONOTONE
    elif kind == "reactance":
        expected = MONOTONE if not error or (where == "Y" and sign > 0) else NOT_MONOTONE
    elif where == "P":
        expected = MONOTONE if sign < 0 and i * low >= d else NOT_MONOTONE
    elif where == "Y":
        expected = MONOTONE if sign > 0 else NOT_MONOTONE
    else:
        expected = MONOTONE
    if kind == "negative current" and error and (i * low <= d or d * band[1] / V0 >= i):
        raise AgainError
    rest = zip_law(V0, ONE, [y, zero if kind == "exp current" else current, p], [signed(rng), q, zero])
    if kind != "exp current":
        return (rest,), band, expected
    return (ExpLoad(i, ONE, signed(rng), Fraction(2), V0), *((rest,) if error else ())), band, expected


def no_load(rng: random.Random, error: Fraction) -> Made:
    """Loads that cancel exactly, and what is left of them with an error: an impedance or its negative."""
    V0, band = volts(rng, random_band(rng))
    Y = decimal(rng, 0.1, 2)
    one = zip_law(V0, ONE, [Y, Fraction(0), Fraction(0)], [Fraction(0)] * 3)
    other = ExpLoad(-Y * (1 + error), Fraction(2), Fraction(0), Fraction(0), V0)
    return (one, other), band, NOT_MONOTONE if error > 0 else MONOTONE


def exp_on_the_edge(rng: random.Random, error: Fraction) -> Made:
    """2 r P0 W^np = |nq - 2| |Q0| W^nq with np = 1 + r^2, at an end W = (k / l)^d that makes the powers rational."""
    r = Fraction(rng.randint(1, 8), rng.choice((2, 3, 4, 5, 6)))
    m, n, P0 = 1 + r * r, exponent(rng, 6), decimal(rng, 0.1, 5)
    if rng.random() < 0.2:
        n = m
    if n == 2:
        raise AgainError
    W = Fraction(rng.randint(1, 9), rng.randint(1, 9)) ** (m - n).denominator if (m - n).denominator < 9 else ONE
    if not Fraction(1, 10**6) < W < 10**6:
        W = ONE
    Q0 = rng.choice((-1, 1)) * 2 * r * P0 * exact(W, m - n) / abs(n - 2) * (1 + error)
    V0, upward = rng.choice(VOLTAGES), rng.random() < 0.5
    width = 1 + decimal(rng, 0.05, 2)
    # The other end is on the good side iff the powers differ in the direction of the band.
    good = m == n or (m > n) == upward
    if error < 0 and not good:
        raise AgainError
    expected = MONOTONE if good and error <= 0 else NOT_MONOTONE
    band = (W * V0, W * V0 * width) if upward else (W * V0 / width, W * V0)
    return (ExpLoad(P0, m, Q0, n, V0),), band, expected


def nonnegative_zip_edge(rng: random.Random, error: Fraction) -> Made:
    """N = 0 at the lower end, all parameters nonnegative, so that N / w^2 increases: any upper end."""
    zero_current = rng.random() < 0.2
    a, s, t = decimal(rng, 0.1, 1), decimal(rng, 0.3, 2), decimal(rng, 0.3, 2)
    a, b = a * s * s, a * t * t  # a = Y - P, b = Y + I + P, a b = (iq / 2 + pq)^2
    c = decimal(rng, 0, 1)
    P = (b - a) / 2 if zero_current else (b - a) / 2 * c
    Y, root = a + P, (a * b) / (a * t / s) if s else ONE
    current = b - Y - P
    share = decimal(rng, 0, 1)
    iq, pq = 2 * root * share, root * (1 - share)
    if root * root != a * b or min(Y, current, P) < 0 or P < 0:
        raise AgainError
    V0 = rng.choice(VOLTAGES)
    iq, pq = iq * (1 + error), pq * (1 + error)
    law = zip_law(V0, decimal(rng, 1, 1000), [Y, current, P], [signed(rng), iq, pq])
    return (law,), (V0, V0 * decimal(rng, 1.01, 5)), NOT_MONOTONE if error > 0 else MONOTONE


GENERAL: tuple[tuple[str, int, Callable[[random.Random], Made]], ...] = (
    ("ZIP", 10, general(some_zip)),
    ("ZIP, nonnegative", 4, nonnegative_zip),
    ("EXP", 8, general(some_exp)),
    ("ZIP + EXP", 8, general(some_zip, some_exp)),
    ("EXP + EXP", 8, general(some_exp, some_exp)),
    ("EXP + EXP, two V0", 6, two_bases),
    ("ZIP + ZIP", 3, general(some_zip, some_zip)),
    ("ZIP + EXP + EXP", 3, general(some_zip, some_exp, some_exp)),
    ("generation made up for", 5, generation),
    ("badly scaled", 5, badly_scaled),
    ("unusual exponents", 3, unusual_exponents),
    ("next to the critical voltage", 6, near_critical_voltage),
)
EDGE: tuple[tuple[str, int, Callable[[random.Random, Fraction], Made]], ...] = (
    ("edge: at an end, ZIP", 3, at_an_end("ZIP")),
    ("edge: at an end, ZIP + EXP", 3, at_an_end("ZIP + EXP")),
    ("edge: at an end, EXP + EXP", 3, at_an_end("EXP + EXP")),
    ("edge: at an end, EXP + EXP, two V0", 2, at_an_end("two V0")),
    ("edge: touching inside, ZIP", 2, touching("ZIP")),
    ("edge: touching inside, ZIP + EXP", 3, touching("ZIP + EXP")),
    ("edge: touching inside, EXP + EXP", 2, touching("EXP + EXP")),
    ("edge: touching inside, EXP + EXP, two V0", 2, touching("two V0")),
    ("edge: touching inside, ZIP, any band", 2, zip_touching_far),
    ("edge: nonnegative ZIP at the lower end", 2, nonnegative_zip_edge),
    ("edge: power and impedance", 2, power_and_impedance),
    ("edge: active power with a root", 2, power_with_a_root),
    ("edge: zero at every voltage", 2, vanishing),
    ("edge: loads that cancel", 1, no_load),
    ("edge: EXP", 4, exp_on_the_edge),
)


def load_case(number: int, seed: int = 1, only: Collection[str] = ()) -> Case | None:
    """The case with this number, whatever the count; None if it is not of one of the kinds wanted."""
    rng = random.Random(f"{seed}/{number}")
    kinds = [*GENERAL, *EDGE]
    k = rng.choices(range(len(kinds)), [weight for _, weight, _ in kinds])[0]
    if only and kinds[k][0] not in only:
        return None
    name = kinds[k][0]
    error = rng.choice((ERRORS[0], *ERRORS)) if k >= len(GENERAL) else None
    for _ in range(10_000):
        try:
            if error is None:
                law, band, expected = GENERAL[k][2](rng)
                return Case(number, name, "", law, band, expected)
            law, band, expected = EDGE[k - len(GENERAL)][2](rng, error)
            return Case(number, name, f"{float(error):+.0e}" if error else "0", law, band, expected)
        except AgainError:
            continue
    raise ArithmeticError(f"no case of kind {name} with an error of {error}")


def load_cases(count: int, seed: int = 1, only: Collection[str] = ()) -> Iterator[Case]:
    """The cases up to a number, or those of some kinds among them."""
    return (case for number in range(count) if (case := load_case(number, seed, only)))
