"""Exact arithmetic against other libraries: linear algebra and polynomials against FLINT, powers against mpmath."""

from __future__ import annotations

import itertools
from fractions import Fraction

import flint
import mpmath
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from certify.kernel import linalg, poly, powers
from certify.search.facial import find_negative_direction
from certify.search.roots import find_negative_point, round_to_digits, square_root

small = st.integers(-6, 6).map(Fraction) | st.fractions(-3, 3, max_denominator=7)
positive = st.fractions(Fraction(1, 10**6), Fraction(10**6), max_denominator=10**6)


@st.composite
def matrices(draw: st.DrawFn, rows: int | None = None, columns: int | None = None) -> linalg.Matrix:
    m, n = rows or draw(st.integers(1, 5)), columns or draw(st.integers(1, 5))
    return tuple(tuple(draw(small) for _ in range(n)) for _ in range(m))


@st.composite
def symmetric(draw: st.DrawFn) -> linalg.Matrix:
    """Symmetric matrices, often semidefinite and singular, often off by a little."""
    n = draw(st.integers(1, 5))
    factor = draw(matrices(rows=draw(st.integers(1, 5)), columns=n))
    a = linalg.multiply(linalg.transpose(factor), factor)
    if draw(st.booleans()):
        k = draw(st.integers(0, n - 1))
        bump = draw(st.sampled_from([Fraction(-1, 10**30), Fraction(1, 10**30), Fraction(-1)]))
        a = tuple(tuple(x + bump * (i == j == k) for j, x in enumerate(row)) for i, row in enumerate(a))
    return a


def to_flint(a: linalg.Matrix) -> flint.fmpq_mat:
    return flint.fmpq_mat(len(a), len(a[0]), [flint.fmpq(x.numerator, x.denominator) for row in a for x in row])


def eigenvalue_signs(a: linalg.Matrix) -> bool:
    """Positive semidefinite iff the characteristic polynomial has only coefficients of alternating sign."""
    p = to_flint(a).charpoly()
    return all(c * (-1) ** (p.degree() - k) >= 0 for k, c in enumerate(p.coeffs()))


@given(symmetric())
@settings(deadline=None)
def test_semidefiniteness(a: linalg.Matrix) -> None:
    pivots, semidefinite = linalg.ldl_pivots(a)
    assert semidefinite == eigenvalue_signs(a)
    assert (semidefinite and all(pivots)) == (eigenvalue_signs(a) and bool(to_flint(a).det()))
    x = find_negative_direction(a)
    assert (x is None) == eigenvalue_signs(a)
    if x is not None:
        assert sum(p * q for p, q in zip(x, linalg.apply(a, x), strict=True)) < 0


@given(matrices())
@settings(deadline=None)
def test_rank_and_null_space(a: linalg.Matrix) -> None:
    n = len(a[0])
    assert linalg.rank(a, n) == to_flint(a).rank()
    basis = linalg.null_space(a, n)
    assert len(basis) == n - linalg.rank(a, n)
    assert all(not any(linalg.apply(a, x)) for x in basis)
    assert not basis or linalg.rank(basis, n) == len(basis)


@given(matrices(4, 4), matrices(4, 2))
@settings(deadline=None)
def test_solve(a: linalg.Matrix, b: linalg.Matrix) -> None:
    if to_flint(a).det() == 0:
        with pytest.raises(ZeroDivisionError):
            linalg.solve(a, b)
    else:
        assert linalg.multiply(a, linalg.solve(a, b)) == b


polynomials = st.lists(st.integers(-5, 5), max_size=4)


@st.composite
def factored(draw: st.DrawFn) -> tuple[poly.Polynomial, list[Fraction]]:
    """A polynomial with known rational roots of any multiplicity, times one without real roots."""
    roots = draw(st.lists(st.fractions(-3, 3, max_denominator=4), max_size=5))
    p = poly.to_polynomial([draw(st.sampled_from([-2, 1, 3]))])
    for root in roots:
        p = poly.multiply(p, poly.to_polynomial([-root, 1]))
    if draw(st.booleans()):
        p = poly.multiply(p, poly.to_polynomial([draw(st.integers(1, 3)), draw(st.integers(-1, 1)), 1]))
    return p, roots


@given(factored(), st.fractions(-4, 4, max_denominator=4), st.fractions(-4, 4, max_denominator=4))
@settings(deadline=None, max_examples=120)
def test_signs_on_an_interval(case: tuple[poly.Polynomial, list[Fraction]], a: Fraction, b: Fraction) -> None:
    p, roots = case
    assume(a < b)
    inside = sorted({r for r in roots if a <= r <= b})
    marks = sorted({a, b, *inside})
    between = [(x + y) / 2 for x, y in itertools.pairwise(marks)]
    nonnegative = all(poly.evaluate(p, x) >= 0 for x in (*marks, *between))
    assert poly.is_nonnegative_on(p, a, b) == nonnegative
    assert poly.is_positive_on(p, a, b) == (nonnegative and not inside)
    if poly.evaluate(p, a):
        assert poly.count_roots(p, a, b) == len([r for r in inside if r > a])
    odd = {r for r in roots if roots.count(r) % 2}
    assert {r for r in roots if not poly.evaluate(poly.odd_part(p), r)} == odd


@given(factored())
@settings(deadline=None, max_examples=80)
def test_negative_points(case: tuple[poly.Polynomial, list[Fraction]]) -> None:
    p, roots = case
    marks = [Fraction(0), *sorted({r for r in roots if r > 0}), Fraction(100)]
    exists = any(poly.evaluate(p, (x + y) / 2) < 0 for x, y in itertools.pairwise(marks))
    omega = find_negative_point(p)
    assert (omega is not None) == exists
    if omega is not None:
        assert poly.evaluate(p, omega**2) < 0


@pytest.mark.parametrize("gap", [Fraction(1, 10**k) for k in (3, 12, 30)])
def test_negative_between_close_roots(gap: Fraction) -> None:
    p = poly.multiply(poly.to_polynomial([-2, 1]), poly.to_polynomial([-2 - gap, 1]))
    omega = find_negative_point(p)
    assert omega is not None
    assert 2 < omega**2 < 2 + gap
    assert find_negative_point(poly.multiply(poly.to_polynomial([-2, 1]), poly.to_polynomial([-2, 1]))) is None


@given(polynomials, polynomials)
def test_division_and_gcd(a: list[int], b: list[int]) -> None:
    p, q = poly.to_polynomial(a), poly.to_polynomial(b)
    assume(q)
    quotient, remainder = poly.divide(p, q)
    assert poly.add(poly.multiply(quotient, q), remainder) == p
    assert len(remainder) < len(q)
    common = flint.fmpz_poly([int(c) for c in p]).gcd(flint.fmpz_poly([int(c) for c in q]))
    assert len(poly.greatest_common_divisor(p, q)) == common.degree() + 1


def exactly(x: Fraction) -> mpmath.mpf:
    return mpmath.mpf(x.numerator) / x.denominator


@given(positive, st.fractions(-100, 100, max_denominator=1000), st.sampled_from([64, 160, 400]))
@settings(deadline=None, max_examples=80)
def test_power_enclosures_hold_the_power(x: Fraction, e: Fraction, bits: int) -> None:
    low, high = powers.power_enclosure(x, e, bits)
    with mpmath.workdps(900):
        value = mpmath.power(exactly(x), exactly(e))
        assert exactly(low) <= value * (1 + mpmath.mpf(10) ** -850)
        assert value * (1 - mpmath.mpf(10) ** -850) <= exactly(high)
    if abs(e) < 3 and Fraction(1, 100) < x < 100:
        assert high - low <= abs(high) / 2 ** (bits - 16)


@given(positive, st.fractions(-20, 20, max_denominator=60), st.integers(-1, 1), st.integers(5, 60))
@settings(deadline=None, max_examples=80)
def test_comparison_of_powers(x: Fraction, e: Fraction, side: int, digits: int) -> None:
    with mpmath.workdps(400):
        value = mpmath.power(exactly(x), exactly(e))
        man, exp = value.man_exp
        c = Fraction(int(man)) * Fraction(2) ** int(exp)
        c = round_to_digits(c, digits) * (1 + Fraction(side, 10 ** (digits + 3)))
        truth = mpmath.sign(value - exactly(c)) if abs(value / exactly(c) - 1) > mpmath.mpf(10) ** -350 else 0
    if x**e.numerator == c**e.denominator:
        truth = 0
    assert powers.compare_power(x, e, c) == truth


def test_huge_exponents_are_compared_by_enclosures() -> None:
    e = Fraction(123456789123456789, 10**17)
    low, high = powers.power_enclosure(Fraction(3, 2), e, 200)
    assert powers.compare_power(Fraction(3, 2), e, low - Fraction(1, 10**40)) == 1
    assert powers.compare_power(Fraction(3, 2), e, high + Fraction(1, 10**40)) == -1
    assert powers.compare_power(Fraction(3, 2), e, Fraction(-1)) == 1


@given(positive, st.integers(1, 60))
def test_square_root(x: Fraction, digits: int) -> None:
    root = square_root(x, digits)
    assert root**2 <= x < (root * (1 + Fraction(1, 10**digits))) ** 2
