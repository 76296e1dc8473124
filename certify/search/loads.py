"""Proofs and refutations of the monotonicity of the static load at a node (THEORY 5)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction

from certify.kernel import poly
from certify.kernel.linalg import Vector
from certify.kernel.model import LoadLaw, PowerTerm, law_at, law_corners, less_conductance, power_polynomials
from certify.kernel.poly import Polynomial, to_polynomial
from certify.kernel.powers import power_enclosure
from certify.kernel.reader import Pair
from certify.kernel.rules import jacobian_enclosure, jacobian_polynomials
from certify.search.proposal import Proposal, to_text
from certify.search.roots import find_negative_point, round_to_digits, square_root

MAX_CELLS = 2000
MAX_CORNERS = 256
BITS = 64  # of the enclosures on cells
FINE_BITS = 600  # of the values from which a pair of voltages is built


def propose_load(law: LoadLaw, band: Pair, strongly: bool = False) -> Iterator[Proposal]:
    """The exact rules first; then cells; then voltages that refute, at the values and at corners of their box.

    `strongly`: with a modulus of strong monotonicity, if there is one.
    """
    names = law_corners(law)
    if len(names) > MAX_CORNERS:
        return
    corners = {signs: law_at(law, signs) for signs in names}
    plain = law_at(law, "0" * len((*law.active, *law.reactive)))
    if strongly:
        yield from _strongly(list(corners.values()), band)
    whole = power_polynomials(plain) is not None
    if whole:
        yield Proposal("proved", "monotone-polynomial")
    elif len(plain.active) == 1 and len(plain.reactive) <= 1:
        yield Proposal("proved", "monotone-exponential")
    if not whole and not any(find_violations(corner, band) for corner in corners.values()):
        points = _common_cells(corners.values(), band)
        if points:
            yield Proposal("proved", "monotone-enclosure", {"points": to_text(points), "bits": str(BITS)})
    for signs, corner in (
        {"": plain, **corners} if len(names) > 1 or any("-" in n for n in names) else {"": plain}
    ).items():
        # what is too small for floats to see is at an end of the band, if anywhere within reach
        for v in find_violations(corner, band) or ([] if whole else list(band)):
            for pair, t in find_pairs(corner, band, v):
                data = {"v": str(v), "pair": to_text(pair), "t": str(t)}
                yield Proposal("refuted", "voltage-pair", data | ({"corner": signs} if signs else {}))


def _common_cells(laws: Iterable[LoadLaw], band: Pair) -> Vector | None:
    """Points of a subdivision that serves all of these laws, or None."""
    points: set[Fraction] = set()
    for law in laws:
        found = find_cells(law, band)
        if found is None:
            return None
        points |= set(found)
    return tuple(sorted(points))


def _strongly(laws: list[LoadLaw], band: Pair) -> Iterator[Proposal]:
    """Proofs with a modulus: a round number below the smallest eigenvalue that a grid of voltages shows."""
    grid = [band[0] + (band[1] - band[0]) * Fraction(k, 32) for k in range(33)]
    least = min(smallest_eigenvalue(law, v) for law in laws for v in grid)
    for share in (0.95, 0.5, 0.1, 0.01):
        if least * share > 1e-300:
            modulus = round_to_digits(Fraction(least * share), 1)
            shifted = [less_conductance(law, modulus) for law in laws]
            if power_polynomials(shifted[0]) is not None:
                yield Proposal("proved", "monotone-polynomial", {"modulus": str(modulus)})
            elif points := _common_cells(shifted, band):
                data = {"modulus": str(modulus), "points": to_text(points), "bits": str(BITS)}
                yield Proposal("proved", "monotone-enclosure", data)


def smallest_eigenvalue(law: LoadLaw, v: Fraction) -> float:
    """Of the symmetric part of the Jacobian at one voltage, in siemens and in floats."""
    G, radial, cross = jacobian_value(law, v)
    return (G + radial) / 2 - math.hypot((radial - G) / 2, cross / 2)


def find_cells(law: LoadLaw, band: Pair) -> list[Fraction] | None:
    """Points of a subdivision on whose cells the enclosures of G and D are positive; None if too many are needed."""
    points, work = [band[0]], [band]
    for _ in range(2 * MAX_CELLS):
        if not work:
            return points
        low, high = work.pop()
        G, D = jacobian_enclosure(law, low, high, BITS)
        if G[0] > 0 and D[0] > 0:
            points.append(high)
            continue
        middle = round_to_digits((low + high) / 2, 8)
        if not low < middle < high or len(points) > MAX_CELLS:
            return None
        work += [(middle, high), (low, middle)]
    return None


def jacobian_value(law: LoadLaw, v: Fraction) -> tuple[float, float, float]:
    """G, G + v G' and v B' at one voltage, in floats: for looking around only."""

    def total(terms: tuple[PowerTerm, ...], weight: int) -> float:
        x = float(v)
        parts = ((t, float(t.coefficient) / x**2 * (x / float(t.base_volt)) ** float(t.exponent)) for t in terms)
        return math.fsum(value * (float(t.exponent) - weight if weight else 1.0) for t, value in parts)

    try:
        return total(law.active, 0), total(law.active, 1), -total(law.reactive, 2)
    except OverflowError:
        return 0.0, 0.0, 0.0


def determinant_value(law: LoadLaw, v: Fraction) -> tuple[float, float]:
    """G and D at one voltage, in floats."""
    G, radial, cross = jacobian_value(law, v)
    return G, G * radial - cross**2 / 4


def find_violations(law: LoadLaw, band: Pair) -> list[Fraction]:
    """Voltages of the band where G or D seems negative, the plainest first; exact for polynomial laws."""
    grid = [round_to_digits(band[0] + (band[1] - band[0]) * Fraction(k, 64), 4) for k in range(65)]
    grid = [band[0], *(v for v in grid if band[0] < v < band[1]), band[1]]
    found = []
    for v in grid:
        G, D = determinant_value(law, v)
        if min(G, D) < 0:
            found.append((D if D < 0 else G * abs(G), v))
    if found:
        best = sorted(found)
        return [best[0][1], best[len(best) // 2][1]]
    if power_polynomials(law) is None:
        return []
    P, D_poly = jacobian_polynomials(law)
    for p in (D_poly, P):
        omega = find_negative_point(on_half_line(p, band))
        if omega is not None:
            return [(band[0] + band[1] * omega**2) / (1 + omega**2)]
    return []


def on_half_line(p: Polynomial, band: Pair) -> Polynomial:
    """(1 + x)^n p((v1 + v2 x) / (1 + x)): the signs of p on the band, carried to x > 0."""
    n, result = len(p) - 1, to_polynomial([])
    for k, a in enumerate(p):
        term = to_polynomial([a])
        for _ in range(k):
            term = poly.multiply(term, to_polynomial(list(band)))
        rest = to_polynomial([math.comb(n - k, i) for i in range(n - k + 1)])
        result = poly.add(result, poly.multiply(term, rest))
    return result


def find_pairs(law: LoadLaw, band: Pair, v: Fraction) -> Iterator[tuple[Pair, Fraction]]:
    """Pairs of voltages around v, and the tangent of half their angle, whose product is negative as far as one sees."""
    G, D = jacobian_enclosure(law, v, v, FINE_BITS)
    if G[0] > 0 and D[0] > 0:
        return
    if G[0] < 0:
        yield (v, v), Fraction(1)  # turning the phasor is enough
    for k in (*range(1, 40, 2), *range(40, 400, 12)):
        step = (band[1] - band[0]) / 2**k
        ends = (round_to_digits(x, 3 + k // 2) for x in (v - step, v + step))
        a, b = (min(max(x, band[0]), band[1]) for x in ends)
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


def _value(terms: tuple[PowerTerm, ...], v: Fraction) -> Fraction:
    """A power at one voltage, to within FINE_BITS."""
    total = Fraction(0)
    for term in terms:
        low, high = power_enclosure(v / term.base_volt, term.exponent, FINE_BITS)
        total += term.coefficient * (low + high) / 2
    return total
