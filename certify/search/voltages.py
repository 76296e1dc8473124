"""Voltages at which a load is not monotone, or nearly not, and pairs of them that show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction

from certify.kernel import loads, poly
from certify.kernel.model import LoadLaw, PowerTerm
from certify.kernel.poly import to_polynomial
from certify.kernel.powers import power_enclosure
from certify.kernel.reader import Pair
from certify.search.roots import find_negative_point, round_to_digits, square_root

FINE_BITS = 600  # of the values from which a pair of voltages is built
GRID = 32
HUGE = 1e150


def float_terms(terms: Iterable[PowerTerm]) -> list[tuple[float, ...]]:
    """Coefficient, base and exponent of each term."""
    return [
        tuple(x.numerator / x.denominator for x in (t.coefficient, t.base_volt, t.exponent))  # faster than float(x)
        for t in terms
    ]


def float_law(law: LoadLaw) -> Callable[[float], tuple[float, float, float]]:
    """G, G + v G' and v B' as functions of v, in floats: for looking around only. Zeros where floats overflow."""
    try:
        active, reactive = (
            [(c / base**2, base, e - 2) for c, base, e in float_terms(part)] for part in (law.active, law.reactive)
        )
    except (OverflowError, ZeroDivisionError):
        return lambda _: (0.0, 0.0, 0.0)

    def values(v: float) -> tuple[float, float, float]:
        G = radial = cross = 0.0
        try:
            for c, base, e in active:
                value = c * (v / base) ** e
                G, radial = G + value, radial + value * (e + 1)
            for c, base, e in reactive:
                cross -= c * (v / base) ** e * e
        except (OverflowError, ZeroDivisionError):
            return 0.0, 0.0, 0.0
        # what is so large that its square would overflow is as unknown as what does
        return (G, radial, cross) if abs(G) + abs(radial) + abs(cross) < HUGE else (0.0, 0.0, 0.0)

    return values


def _bottom(band: Pair) -> Fraction:
    """The lower end of a band, or a voltage far below it if that is zero: nothing happens below a cut-off."""
    return band[0] or band[1] / 2**20


def smallest_eigenvalue(G: float, radial: float, cross: float) -> float:
    """Of the symmetric part of the Jacobian, in siemens."""
    return (G + radial) / 2 - math.hypot((radial - G) / 2, cross / 2)


def least_eigenvalue(law: LoadLaw, band: Pair, points: int = 24) -> float:
    """The smallest eigenvalue on a grid of voltages, improved by a parabola around the lowest point."""
    low, high = float(_bottom(band)), float(band[1])
    values = float_law(law)

    def at(v: float) -> float:
        return smallest_eigenvalue(*values(v))

    step = (high - low) / points
    grid = [at(low + step * k) for k in range(points + 1)]
    k = min(range(points + 1), key=grid.__getitem__)
    least = grid[k]
    if 0 < k < points:
        bend = grid[k - 1] - 2 * least + grid[k + 1]
        if bend > 0:
            least -= (grid[k + 1] - grid[k - 1]) ** 2 / (8 * bend)
    return least


def may_be_violated(law: LoadLaw, band: Pair, points: int = 16) -> bool:
    """Whether G or D is negative at one of a few voltages, or so small that a refutation should be tried first."""
    low, high = float(_bottom(band)), float(band[1])
    values = float_law(law)
    return any(_is_below(1e-4, *values(low + (high - low) * k / points)) for k in range(points + 1))


def _is_below(share: float, G: float, radial: float, cross: float) -> bool:
    """Whether G or D is below a share of the size of the Jacobian."""
    size = abs(G) + abs(radial) + abs(cross)
    return share * size > G or share * size**2 > G * radial - cross * cross / 4


def _inside(v: float, band: Pair) -> Fraction:
    """A voltage of the band near v, of few digits unless it is an end."""
    return min(max(round_to_digits(Fraction(v), 4), _bottom(band)), band[1])


def _grid(band: Pair) -> list[Fraction]:
    low = _bottom(band)
    inner = (round_to_digits(low + (band[1] - low) * Fraction(k, GRID), 4) for k in range(1, GRID))
    return [low, *(v for v in inner if low < v < band[1]), band[1]]


def find_violations(law: LoadLaw, band: Pair) -> list[Fraction]:
    """Voltages of the band where G or D is negative as far as one sees, the plainest first."""
    found, values = [], float_law(law)
    low, high = float(_bottom(band)), float(band[1])
    for k in range(GRID + 1):
        v = low + (high - low) * k / GRID
        G, radial, cross = values(v)
        if _is_below(-1e-9, G, radial, cross):  # by more than rounding explains
            D = G * radial - cross**2 / 4
            found.append((D if D < 0 else G * abs(G), v))
    if found:
        found.sort()
        return [_inside(v, band) for v in (found[0][1], found[len(found) // 2][1])]
    if not loads.is_polynomial(law):
        return [v for v in _lowest(law, band) if min(x[1] for x in loads.jacobian_enclosure(law, v, FINE_BITS)) < 0]
    for p in loads.jacobian_polynomials(law)[::-1]:
        omega = find_negative_point(to_polynomial(poly.bernstein_signs(p, *band)))  # the band, carried to x > 0
        if omega is not None:
            return [(band[0] + band[1] * omega**2) / (1 + omega**2)]
    return []


def _lowest(law: LoadLaw, band: Pair) -> list[Fraction]:
    """Where D is lowest, to about a hundred digits: the ends of the band, and roots of its derivative by Newton."""
    grid = _grid(band)
    looks = [float_law(law)(float(v)) for v in grid]
    values = [G * radial - cross**2 / 4 for G, radial, cross in looks]
    found = [band[0] or grid[0], band[1]]
    for k in range(1, len(grid) - 1):
        if any(looks[k]) and values[k] <= min(values[k - 1], values[k + 1]):
            v = grid[k]
            for _ in range(12):
                _, slope, bend = _middles(law, v)
                if bend <= 0 or abs(slope) >= bend / 4:  # no minimum that a step of Newton's in ln v finds
                    break
                v = round_to_digits(v * (1 - slope / bend), 120)
            if band[0] < v < band[1]:
                found.append(v)
    return found


def _middles(law: LoadLaw, v: Fraction) -> tuple[Fraction, ...]:
    active, reactive = (loads.admittances(terms, v, FINE_BITS) for terms in (law.active, law.reactive))
    _, D = loads.jets(active, reactive)
    return tuple((low + high) / 2 for low, high in D)


def find_touching(law: LoadLaw, band: Pair) -> list[Fraction]:
    """Voltages where D may vanish exactly: nominal ones, and those of few digits at a minimum of D."""
    found = [term.base_volt for term in (*law.active, *law.reactive)]
    for v in _lowest(law, band)[2:]:
        for base in {term.base_volt for term in (*law.active, *law.reactive)}:
            simple = (v / base).limit_denominator(10**6)
            if abs(v / base - simple) < Fraction(1, 10**20):
                found.append(base * simple)
    return found


def find_pairs(law: LoadLaw, band: Pair, v: Fraction) -> Iterator[tuple[Pair, Fraction]]:
    """Pairs of voltages around v, and the tangent of half their angle, whose product is negative as far as one sees."""
    if not any(term.blur for term in (*law.active, *law.reactive)):
        yield from _plain_pairs(law, band, v)
    G, D = loads.jacobian_enclosure(law, v, FINE_BITS)
    if G[0] > 0 and D[0] > 0:
        return
    if G[0] < 0:
        yield (v, v), Fraction(1)  # turning the phasor is enough
    for k in (*range(1, 40, 2), *range(40, 400, 12)):
        step = (band[1] - band[0]) / 2**k
        ends = (round_to_digits(x, 3 + k // 2) for x in (v - step, v + step))
        a, b = (min(max(x, band[0] or v / 2), band[1]) for x in ends)
        if a >= b:
            continue
        P_a, Q_a, P_b, Q_b = (_value(terms, x) for x in (a, b) for terms in (law.active, law.reactive))
        conductance = P_a / a**2 + P_b / b**2
        susceptance = Q_b / b**2 - Q_a / a**2  # B_a - B_b, with B = -Q / v^2
        if conductance > 0:
            y = round_to_digits(susceptance / conductance, 150)
            t = y / (1 + square_root(1 + y * y, 60))
            tangents = [round_to_digits(t, digits) for digits in (2, 6, 20, 60)]
        else:
            tangents = [Fraction(1), Fraction(-1)]
        for t in tangents:  # the product of rule `voltage-pair` at middle values: the rule itself costs too much to try
            cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
            if P_a + P_b < a * b * (conductance * cosine + susceptance * sine):
                yield (a, b), t
                break


def _plain_pairs(law: LoadLaw, band: Pair, v: Fraction) -> Iterator[tuple[Pair, Fraction]]:
    """A pair that floats find and can trust: most loads that are not monotone are so by far."""
    try:
        terms = [float_terms(part) for part in (law.active, law.reactive)]
    except OverflowError:
        return
    low = band[0] or v / 2
    for k in (1, 2, 4, 6, 8):
        step = (band[1] - band[0]) / 2**k
        a, b = (min(max(round_to_digits(x, 4), low), band[1]) for x in (v - step, v + step))
        if a >= b:
            continue
        try:
            x, y = float(a), float(b)
            (P_a, Q_a), (P_b, Q_b) = ([sum(c * (u / s) ** e for c, s, e in part) for part in terms] for u in (x, y))
            conductance, susceptance = P_a / x**2 + P_b / y**2, Q_b / y**2 - Q_a / x**2
            half_angle = math.atan2(susceptance, conductance) / 2
            if not abs(half_angle) <= 1.5:
                continue
            t = round_to_digits(Fraction(math.tan(half_angle)), 3)
            angle = 2 * math.atan(float(t))
            product = P_a + P_b - x * y * (conductance * math.cos(angle) + susceptance * math.sin(angle))
            size = abs(P_a) + abs(P_b) + x * y * (abs(conductance) + abs(susceptance))
        except (OverflowError, ZeroDivisionError):
            return
        if product < -1e-10 * size:
            yield (a, b), t
            return


def _value(terms: tuple[PowerTerm, ...], v: Fraction) -> Fraction:
    """A power at one voltage, to within FINE_BITS."""
    total = Fraction(0)
    for term in terms:
        low, high = power_enclosure(v / term.base_volt, term.exponent, FINE_BITS)
        total += term.coefficient * (low + high) / 2
    return total
