"""The proof rules. Each is a theorem of FORMAT.md: a pure function that checks its side conditions.

A rule raises `RuleFailure` with the condition that fails, and otherwise returns what it has established. It never
searches, repairs or rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from certify.kernel import poly
from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import (
    Matrix,
    Vector,
    add,
    apply,
    block,
    identity,
    is_symmetric,
    ldl_pivots,
    multiply,
    null_space,
    rank,
    row_reduce,
    scale,
    solve,
    transpose,
)
from certify.kernel.model import LinearPort, LoadLaw, PowerTerm, power_polynomials
from certify.kernel.poly import Polynomial, is_nonnegative_on, is_positive_on, to_polynomial
from certify.kernel.powers import (
    PRECISIONS,
    Interval,
    compare_power,
    interval_product,
    interval_sum,
    power_enclosure,
)

Pair = tuple[Fraction, Fraction]


def require(condition: bool, reason: str) -> None:
    if not condition:
        raise RuleFailure(reason)


# --- storage functions and their refutation (THEORY 3 and 4) ----------------------------------------------


def series_branch(resistance_ohm: Fraction, inductance_henry: Fraction) -> None:
    """Rule `series-branch`: S = L |I~|^2 / 2 has S' = <z~, d~> - R |I~|^2."""
    require(resistance_ohm > 0, "the resistance is not positive")
    require(inductance_henry > 0, "the inductance is not positive")


def dissipation(F: Matrix, P: Matrix) -> Matrix:
    """M = -(F' P + P F), so that d/dt (x' P x / 2) = -x' M x / 2 along x' = F x.

    >>> one = ((Fraction(1),),)
    >>> dissipation(((Fraction(-1),),), one)
    ((Fraction(2, 1),),)
    """
    half = multiply(P, F)
    return scale(-1, add(half, transpose(half)))


@dataclass(frozen=True)
class Storage:
    """What `quadratic-storage` has established; the pivots are of the LDL' factorisations of P and M."""

    M: Matrix
    storage_pivots: Vector
    dissipation_pivots: Vector


def quadratic_storage(port: LinearPort, P: Matrix) -> Storage:
    """Rule `quadratic-storage`: P > 0, P B = C', M = -(F'P + PF) >= 0, so S = x~'P x~/2 proves EIP."""
    n = len(port.F)
    require(len(P) == n and is_symmetric(P), f"the storage matrix is not a symmetric matrix of size {n}")
    require(multiply(P, port.B) == transpose(port.C), "P B = C' does not hold")
    storage_pivots, semidefinite = ldl_pivots(P)
    require(semidefinite and all(storage_pivots), "the storage matrix P is not positive definite")
    M = dissipation(port.F, P)
    dissipation_pivots, semidefinite = ldl_pivots(M)
    require(semidefinite, "the dissipation matrix -(F'P + PF) is not positive semidefinite")
    return Storage(M, storage_pivots, dissipation_pivots)


def frequency_witness(port: LinearPort, s0: Pair, u: Sequence[Pair]) -> Fraction:
    """Rule `frequency-witness`: Re s0 > 0, s0 no eigenvalue of F, Re(u* Z(s0) u) < 0. Returns that number."""
    (sigma, omega), n, m = s0, len(port.F), len(port.C)
    require(sigma > 0, "the real part of s0 is not positive")
    require(len(u) == m, f"u does not have {m} entries")
    inner = add(scale(sigma, identity(n)), scale(-1, port.F))
    cross = scale(omega, identity(n))
    u_parts = [tuple(part[k] for part in u) for k in (0, 1)]
    right = tuple((x,) for part in u_parts for x in apply(port.B, part))
    try:
        x = [row[0] for row in solve(block([[inner, scale(-1, cross)], [cross, inner]]), right)]
    except ZeroDivisionError:
        raise RuleFailure("s0 is an eigenvalue of F") from None
    z_parts = [apply(port.C, x[:n]), apply(port.C, x[n:])]
    value = sum((a * b for k in (0, 1) for a, b in zip(u_parts[k], z_parts[k], strict=True)), Fraction(0))
    require(value < 0, "Re(u* Z(s0) u) is not negative")
    return value


def storage_contradiction(
    port: LinearPort,
    faces: Sequence[tuple[Vector, Matrix, Sequence[Vector]]],
    W: Matrix,
    Y: Matrix,
    y: Sequence[Vector],
) -> None:
    """Rule `storage-contradiction`: no P >= 0 has P B = C' and M >= 0, so no storage function of any kind exists.

    Each face (u, Y, y) forces M u = 0 by an identity; the last identity has a positive and a negative side.
    Shapes: u (n,), Y (n, m), y a vector (n,) for each earlier face; W (n, n).
    """
    n, m = len(port.F), len(port.C)

    def combination(Y: Matrix, multipliers: Sequence[Vector], known: Sequence[Vector]) -> tuple[Matrix, Fraction]:
        """B Y' + Y B' + sum of F u y' + u y' F' + transposes; and tr(C Y). Its product with P is 2 tr(C Y)."""
        require(len(Y) == n and all(len(row) == m for row in Y), f"Y is not of shape ({n}, {m})")
        require(len(multipliers) == len(known), "a multiplier is missing")
        half = multiply(Y, transpose(port.B))
        for u, v in zip(known, multipliers, strict=True):
            require(len(v) == n, f"a multiplier does not have {n} entries")
            half = add(half, _outer(apply(port.F, u), v))
            half = add(half, _outer(u, apply(port.F, v)))
        trace = sum((port.C[i][k] * Y[k][i] for i in range(m) for k in range(n)), Fraction(0))
        return add(half, transpose(half)), trace

    require(len(faces) <= n, "more faces than states")
    known: list[Vector] = []
    for u, face_Y, multipliers in faces:
        require(len(u) == n, f"a face does not have {n} entries")
        square = _outer(apply(port.F, u), u)
        identity_side, trace = combination(face_Y, multipliers, known)
        require(add(square, transpose(square)) == identity_side and not trace, "a face is not forced to vanish")
        known.append(u)
    require(len(W) == n and is_symmetric(W) and ldl_pivots(W)[1], "W is not positive semidefinite")
    rest, trace = combination(Y, y, known)
    product = multiply(port.F, W)
    Q = add(add(product, transpose(product)), rest)
    require(ldl_pivots(Q)[1], "the left side of the last identity is not positive semidefinite")
    require(trace < 0, "tr(C Y) is not negative")


def _outer(a: Vector, b: Vector) -> Matrix:
    return tuple(tuple(x * y for y in b) for x in a)


# --- loads (THEORY 5) ---------------------------------------------------------------------------------------


def jacobian_polynomials(law: LoadLaw) -> tuple[Polynomial, Polynomial]:
    """P = G v^2 and D v^4 = P (v P' - P) - (v Q' - 2 Q)^2 / 4 as polynomials in v (THEORY 5)."""
    both = power_polynomials(law)
    if both is None:
        raise RuleFailure("an exponent is not a whole number from 0 to 12")
    P, Q = both
    v = to_polynomial([0, 1])
    radial = poly.add(poly.multiply(v, poly.derivative(P)), poly.scale(-1, P))
    cross = poly.add(poly.multiply(v, poly.derivative(Q)), poly.scale(-2, Q))
    return P, poly.add(poly.multiply(P, radial), poly.scale(Fraction(-1, 4), poly.multiply(cross, cross)))


def monotone_polynomial(law: LoadLaw, band: Pair) -> bool:
    """Rule `monotone-polynomial`: P >= 0 and D v^4 >= 0 on the band by Sturm counts; strict if both are > 0."""
    P, D = jacobian_polynomials(law)
    if is_positive_on(P, *band) and is_positive_on(D, *band):
        return True
    require(is_nonnegative_on(P, *band), "the conductance G is negative somewhere on the band")
    require(is_nonnegative_on(D, *band), "D = G (G + v G') - (v B')^2 / 4 is negative somewhere on the band")
    return False


def monotone_exponential(law: LoadLaw, band: Pair) -> bool:
    """Rule `monotone-exponential`: one exponent each for P and Q; the two ends of the band decide. True if strict."""
    require(len(law.active) == 1 and len(law.reactive) <= 1, "not a single exponential law")
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


def jacobian_enclosure(law: LoadLaw, low: Fraction, high: Fraction, bits: int) -> tuple[Interval, Interval]:
    """Enclosures of G and of D = G (G + v G') - (v B')^2 / 4 for every v in [low, high]."""

    def total(terms: tuple[PowerTerm, ...], weight: int) -> Interval:
        """Sum of (exponent - weight) coefficient / v^2 (v/base)^exponent, or without the factor if weight is 0."""
        parts = []
        for t in terms:
            ends = [power_enclosure(v / t.base_volt, t.exponent - 2, bits) for v in (low, high)]
            span = (min(e[0] for e in ends), max(e[1] for e in ends))
            factor = t.coefficient / t.base_volt**2 * (t.exponent - weight if weight else 1)
            parts.append(interval_product((factor, factor), span))
        return interval_sum(parts)

    G, radial, cross = total(law.active, 0), total(law.active, 1), total(law.reactive, 2)
    product, square = interval_product(G, radial), interval_product(cross, cross)
    least = Fraction(0) if cross[0] <= 0 <= cross[1] else square[0]
    return G, (product[0] - square[1] / 4, product[1] - least / 4)


def monotone_enclosure(law: LoadLaw, band: Pair, points: Sequence[Fraction], bits: int) -> bool:
    """Rule `monotone-enclosure`: G > 0 and D > 0 on every cell between consecutive points. Always strict."""
    require(points[:1] == [band[0]] and points[-1:] == [band[1]], "the points do not span the band")
    require(all(a < b for a, b in pairwise(points)), "the points do not increase")
    require(64 <= bits <= PRECISIONS[-1] and len(points) <= 100_000, "the precision or number of points is absurd")
    for low, high in pairwise(points):
        G, D = jacobian_enclosure(law, low, high, bits)
        require(G[0] > 0 and D[0] > 0, f"G or D may not be positive between {low} V and {high} V")
    return True


def voltage_pair(law: LoadLaw, band: Pair, v: Fraction, pair: Pair, t: Fraction) -> None:
    """Rule `voltage-pair`: G(v) < 0 or D(v) < 0 at a voltage of the band, and two voltages whose product is negative.

    The two are a = pair[0] at angle 0 and b = pair[1] at the angle with tan(angle/2) = t; the product is
    <V_b - V_a, I(V_b) - I(V_a)> = P(a) + P(b) - a b ((G_a + G_b) cos + (B_a - B_b) sin).
    """
    require(all(band[0] <= x <= band[1] for x in (v, *pair)), "a voltage is outside the band")
    cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)

    def negative_at(bits: int) -> tuple[bool, bool]:
        G, D = jacobian_enclosure(law, v, v, bits)
        values = []
        for x in pair:
            for terms, sign in ((law.active, 1), (law.reactive, -1)):
                powers = [power_enclosure(x / p.base_volt, p.exponent, bits) for p in terms]
                factors = [sign * p.coefficient / x**2 for p in terms]
                parts = [interval_product((f, f), p) for f, p in zip(factors, powers, strict=True)]
                values.append(interval_sum(parts))
        (a, b), (Ga, Ba, Gb, Bb) = pair, values
        parts = [
            interval_product(((a - b * cosine) * a,) * 2, Ga),
            interval_product(((b - a * cosine) * b,) * 2, Gb),
            interval_product((-a * b * sine,) * 2, Ba),
            interval_product((a * b * sine,) * 2, Bb),
        ]
        return G[1] < 0 or D[1] < 0, interval_sum(parts)[1] < 0

    results = (False, False)
    for bits in PRECISIONS:
        results = negative_at(bits)
        if all(results):
            return
    require(results[0], "neither G nor D is negative at the voltage named")
    raise RuleFailure("the product of the two voltages is not negative")


# --- the network (THEORY 2 and 6) ---------------------------------------------------------------------------


def skew_incidence(injection: dict[tuple[str, str], int], drop: dict[tuple[str, str], int]) -> None:
    """Rule `skew-incidence`: the map from outputs to inputs is skew-symmetric, so that sum <z, d> = 0."""
    require({key: -value for key, value in injection.items()} == drop, "the interconnection is not skew-symmetric")


def observed(rows: Matrix, F: Matrix, B: Matrix | None = None) -> list[list[Fraction]]:
    """Echelon rows r with r x = 0 on the largest invariant subspace inside {rows x = 0}.

    Invariant under F; with B, controlled-invariant for (F, B): only an r with r B = 0 is carried on to r F.
    """
    n = len(F)
    basis, _ = row_reduce(rows, n)
    while True:
        exact = tuple(tuple(r) for r in basis)
        carried: Matrix = exact
        if B is not None and exact:
            combinations = null_space(transpose(multiply(exact, B)), len(exact))
            carried = multiply(combinations, exact) if combinations else ()
        grown, _ = row_reduce((*exact, *(multiply(carried, F) if carried else ())), n)
        if len(grown) == len(basis):
            return basis
        basis = grown


def rests(port: LinearPort, M: Matrix) -> None:
    """Condition `rest` of rule `invariant-set`: no motion inside ker M with z = 0 but rest itself."""
    require(len(observed((*M, *port.C), port.F)) == len(port.F), "a motion with z = 0 and no dissipation remains")


def pins(port: LinearPort, M: Matrix, with_load: bool) -> None:
    """Condition `pin` of rule `invariant-set` by a DGU: inside ker M, z = 0 follows (any load current allowed)."""
    rows, n = observed(M, port.F, port.B if with_load else None), len(port.F)
    require(rank((*rows, *port.C), n) == len(rows), "a motion with z other than 0 and no dissipation remains")
