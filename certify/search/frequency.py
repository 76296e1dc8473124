"""Frequency witnesses: a point of the right half-plane where a port takes power out of nothing (THEORY 4).

First a sweep in floats for a witness with small numbers, then exact polynomials: on a vertical line the smallest
eigenvalue of Z + Z* is negative somewhere iff one of three rational polynomials in the squared frequency is, and
Sturm sequences decide that. Both only propose; the kernel's rule disposes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from certify.kernel import poly
from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix, add, identity, multiply, scale
from certify.kernel.model import LinearPort
from certify.kernel.poly import Polynomial, to_polynomial
from certify.kernel.rules import frequency_witness
from certify.search.roots import find_negative_point, round_to_digits

MAX_EXACT_DEGREE = 10  # beyond it the exact polynomials take minutes
Complex = tuple[Fraction, Fraction]
Witness = tuple[Complex, tuple[Complex, ...]]


@dataclass(frozen=True)
class Transfer:
    """Z(s) = N(s) / D(s): matrix of polynomials over the characteristic polynomial of F."""

    N: tuple[tuple[Polynomial, ...], ...]
    D: Polynomial


def transfer(port: LinearPort) -> Transfer:
    """The exact transfer function from d to z, by the recursion of Faddeev and LeVerrier."""
    n, m = len(port.F), len(port.C)
    coefficients = [Fraction(1)]  # of D, leading one first
    term: Matrix = identity(n)
    numerators = []
    for k in range(1, n + 1):
        numerators.append(multiply(port.C, multiply(term, port.B)))
        product = multiply(port.F, term)
        coefficients.append(-sum((product[i][i] for i in range(n)), Fraction(0)) / k)
        term = add(product, scale(coefficients[-1], identity(n)))
    N = tuple(tuple(to_polynomial(x[i][j] for x in reversed(numerators)) for j in range(m)) for i in range(m))
    return Transfer(N, to_polynomial(reversed(coefficients)))


def find_frequency_witness(port: LinearPort) -> Witness | None:
    """A witness that the kernel accepts, or None if none is found."""
    system = transfer(port)
    for s0 in _candidates(system):
        witness = _witness_at(port, system, s0)
        if witness:
            return witness
    return None


def _candidates(system: Transfer) -> Iterator[Complex]:
    yield from _sweep(system)
    if len(system.D) > MAX_EXACT_DEGREE + 1:
        return
    on_axis = _negative_frequency(system, Fraction(0))
    if on_axis is not None:
        yield from ((on_axis / 10**k, on_axis) for k in range(0, 140, 2))
    for sigma in _lines(system):
        omega = _negative_frequency(system, sigma)
        if omega is not None:
            yield sigma, omega


def _float_value(p: Polynomial, s: complex) -> complex:
    total = 0j
    for a in reversed(p):
        total = total * s + float(a)
    return total


def _sweep(system: Transfer) -> Iterator[Complex]:
    """Points with two digits near the most negative place of a coarse sweep along the imaginary axis."""
    found = []
    try:
        for k in range(-30, 71):
            omega = 10 ** (k / 10)
            denominator = _float_value(system.D, 1j * omega)
            if not denominator:
                continue
            values = [[_float_value(p, 1j * omega) / denominator for p in row] for row in system.N]
            size = sum(abs(x) for row in values for x in row)
            least = values[0][0].real
            if len(values) == 2:
                a, d = values[0][0].real, values[1][1].real
                b = abs(values[0][1] + values[1][0].conjugate()) / 2
                least = (a + d) / 2 - math.hypot((a - d) / 2, b)
            if least < -1e-9 * size:
                found.append((least / size, omega))
    except OverflowError:
        return
    for _, omega in sorted(found)[:3]:
        exponent = math.floor(math.log10(omega)) - 1
        rounded = round(omega / 10.0**exponent) * Fraction(10) ** exponent
        for k in range(6):
            yield rounded / 10**k, rounded


def _on_line(p: Polynomial, sigma: Fraction) -> tuple[Polynomial, Polynomial]:
    """Real and imaginary part of p(sigma + j omega) as polynomials in omega."""
    shifted: Polynomial = ()
    for a in reversed(p):
        shifted = poly.add(poly.multiply(shifted, to_polynomial([sigma, 1])), to_polynomial([a]))
    signs = (1, 1, -1, -1)
    parts = [[c * signs[k % 4] if k % 2 == part else 0 for k, c in enumerate(shifted)] for part in (0, 1)]
    return to_polynomial(parts[0]), to_polynomial(parts[1])


def _hermitian(system: Transfer, sigma: Fraction) -> list[Polynomial]:
    """Polynomials in x = omega^2 that are all >= 0 iff Z + Z* >= 0 on the line Re s = sigma."""
    D = _on_line(system.D, sigma)
    N = [[_on_line(p, sigma) for p in row] for row in system.N]

    def times_conjugate(a: tuple[Polynomial, Polynomial], b: tuple[Polynomial, Polynomial]) -> tuple[Polynomial, ...]:
        real = poly.add(poly.multiply(a[0], b[0]), poly.multiply(a[1], b[1]))
        return real, poly.add(poly.multiply(a[1], b[0]), poly.scale(-1, poly.multiply(a[0], b[1])))

    diagonal = [poly.scale(2, times_conjugate(N[i][i], D)[0]) for i in range(len(N))]
    result = list(diagonal)
    if len(N) == 2:
        upper, lower = times_conjugate(N[0][1], D), times_conjugate(N[1][0], D)
        real, imaginary = poly.add(upper[0], lower[0]), poly.add(upper[1], poly.scale(-1, lower[1]))
        square = poly.add(poly.multiply(real, real), poly.multiply(imaginary, imaginary))
        determinant = poly.add(poly.multiply(diagonal[0], diagonal[1]), poly.scale(-1, square))
        modulus = poly.add(poly.multiply(D[0], D[0]), poly.multiply(D[1], D[1]))
        result.append(poly.divide(determinant, modulus)[0])
    return [to_polynomial(p[0::2]) for p in result]


def _negative_frequency(system: Transfer, sigma: Fraction) -> Fraction | None:
    """A frequency at which Z + Z* is not positive semidefinite on the line Re s = sigma, if there is one."""
    for p in _hermitian(system, sigma):
        omega = find_negative_point(p)
        if omega is not None:
            return omega
    return None


def _lines(system: Transfer) -> Iterator[Fraction]:
    """Real parts worth trying when the imaginary axis shows nothing: around each pole, and all over."""
    import numpy

    sizes = [abs(float(c)) ** (1 / (len(system.D) - 1 - k)) for k, c in enumerate(system.D[:-1]) if c]
    scale_ = max([1.0, *sizes])
    scaled = [float(c / Fraction(scale_) ** (len(system.D) - 1 - k)) for k, c in enumerate(system.D)]
    poles = [scale_ * complex(z) for z in numpy.roots(scaled[::-1])]
    for k in (1, 3, 6, 10, 15, 20, 30):
        for pole in poles:
            if pole.real > 0:
                yield from (Fraction(pole.real) * (1 + sign * Fraction(1, 2**k)) for sign in (1, -1))
    for k in range(-60, 13, 4):
        yield Fraction(10) ** k


def _witness_at(port: LinearPort, system: Transfer, s0: Complex) -> Witness | None:
    """A direction u for this point, with few digits if possible."""
    sigma, omega = s0
    if sigma <= 0:
        return None

    def value(p: Polynomial) -> Complex:
        real, imaginary = _on_line(p, sigma)
        return poly.evaluate(real, omega), poly.evaluate(imaginary, omega)

    d = value(system.D)
    size = d[0] ** 2 + d[1] ** 2
    if not size:
        return None
    Z = [[_divide(value(p), d, size) for p in row] for row in system.N]
    one, zero = (Fraction(1), Fraction(0)), (Fraction(0), Fraction(0))
    directions: list[tuple[Complex, ...]] = []
    if len(Z) == 1:
        directions = [(one,)]
    else:
        a, c = Z[0][0][0], Z[1][1][0]
        b = ((Z[0][1][0] + Z[1][0][0]) / 2, (Z[0][1][1] - Z[1][0][1]) / 2)  # upper corner of the Hermitian part
        if a >= 0 and c >= 0 and a * c >= b[0] ** 2 + b[1] ** 2:
            return None
        directions = [(one, zero), (zero, one)]
        if a > 0 or c > 0:
            exact = (-b[0] / c, b[1] / c) if c > 0 else (-b[0] / a, -b[1] / a)
            for digits in (1, 2, 4, 8, 16, 40, 90):
                rounded = (round_to_digits(exact[0], digits), round_to_digits(exact[1], digits))
                directions.append((one, rounded) if c > 0 else (rounded, one))
            directions.append((one, exact) if c > 0 else (exact, one))
        else:
            directions += [(one, (x, y)) for x in (Fraction(1), Fraction(-1)) for y in (Fraction(1), Fraction(-1))]
    for u in directions:
        try:
            frequency_witness(port, s0, u)
        except RuleFailure:
            continue
        return s0, u
    return None


def _divide(a: Complex, d: Complex, size: Fraction) -> Complex:
    return (a[0] * d[0] + a[1] * d[1]) / size, (a[1] * d[0] - a[0] * d[1]) / size
