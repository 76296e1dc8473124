"""Loads given by their current: formulas to exact laws, the rules on disks as tables, decisions against sampling."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from certify.kernel.currents import CurrentLaw, current_law, divide, multiply, plus_isotropic, recentred, total_degree
from certify.kernel.disks import (
    DiskSum,
    current_pair,
    denominator_form,
    jacobian_form,
    lipschitz_bound_disk,
    monomials,
    monotone_disk,
    sum_of_squares,
)
from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import ldl_pivots, to_matrix
from certify.kernel.loads import monotone_sturm
from certify.kernel.model import LoadLaw, PowerTerm
from certify.kernel.proofs import Data
from certify.kernel.quantity import QuantityError, parse_formula
from certify.search.currents import propose_current
from certify.search.proposal import Proposal

F_ = Fraction
Pair = tuple[Fraction, Fraction]
ZERO = (F_(0), F_(0))
Proof = tuple[DiskSum, tuple[Fraction, DiskSum] | None, Fraction]


def law(I_d: str, I_q: str) -> CurrentLaw:
    return current_law(parse_formula(I_d), parse_formula(I_q))


def read_sum(data: Data) -> DiskSum:
    degree, gram, disk = data.fields("degree", "gram", "disk")
    return DiskSum(int(degree.scalar()), gram.matrix(), disk.matrix())


def read_proof(raw: dict[str, Any]) -> Proof:
    """As a handler of the kernel reads it."""
    rest, denominator = dict(raw), None
    modulus = Data(rest.pop("modulus", "0")).scalar()
    if "denominator" in rest:
        inner = dict(rest.pop("denominator"))
        denominator = (Data(inner.pop("margin")).scalar(), read_sum(Data(inner)))
    return read_sum(Data(rest)), denominator, modulus


def read_pair(raw: dict[str, Any]) -> tuple[Pair, Pair]:
    U, V = (end.vector() for end in Data(raw).fields("U", "V"))
    return (U[0], U[1]), (V[0], V[1])


def decide(
    load: CurrentLaw, centre: Pair, radius: Fraction, strongly: bool = False
) -> tuple[str, Any, Proposal | None]:
    """Status, what the kernel says to the first proposal (which it must accept), and that proposal."""
    for proposal in propose_current(load, centre, radius, strongly):
        if proposal.status == "refuted":
            return "refuted", current_pair(load, centre, radius, *read_pair(proposal.data)), proposal
        return "proved", monotone_disk(load, centre, radius, *read_proof(proposal.data)), proposal
    return "unknown", None, None


# --- laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "code"),
    [
        ("((Vd+Vq)^9)^9", "S205"),
        ("Vd^13", "S205"),
        ("Vd^99999999999", "S205"),
        ("Vd^(1/2)", "S205"),
        ("2^Vd", "S205"),
        ("Vd^(Vd/Vd + 1/Vq)", "S205"),
        ("1/(1+Vd)^7 + 1/(1+Vq)^7", "S205"),
        ("(1+Vd+Vq)^12 * (1+Vd+Vq)^12 / (1+Vd+Vq)^12", "S205"),
        ("1/(Vd-Vd)", "S207"),
        ("(Vd-Vd)^-1", "S207"),
        ("Vd/0", "S207"),
        ("V", "S206"),
        ("Vd + vq", "S206"),
        ("w0*Vd", "S206"),
        ("(1e60)^64*Vd", "S202"),
        ("((1e60)^9)^9", "S202"),
        ("(1.234567890123456789012345678901*Vd + 1e-30)^12", "S202"),
        ("1e60^60 - 1e60^60 + Vd", "S202"),
        ("+".join(f"1/({k}+Vd*Vq)" for k in range(10, 40)), "S205"),
    ],
)
def test_hostile_formulas_are_refused(formula: str, code: str) -> None:
    for both in ((formula, "Vq"), ("Vq", formula)):
        with pytest.raises(QuantityError) as caught:
            law(*both)
        assert caught.value.code == code


def test_a_law_over_a_common_denominator_has_a_bounded_degree() -> None:
    with pytest.raises(QuantityError, match="degree"):
        law("1/(1+Vd)^7", "1/(1+Vq)^7")
    with pytest.raises(QuantityError, match="degree"):
        plus_isotropic(law("Vd^12", "Vq"), ZERO, (F_(1), F_(0)))


def test_denominators_are_shared_not_squared() -> None:
    assert total_degree(law("Vd/(1+Vd^2)", "Vq/(2+2*Vd^2)").denominator) == 2
    assert total_degree(law("Vd/(1+Vd^2) + 1/(1+Vd^2)^2", "Vq").denominator) == 4
    assert law("Vd^3/Vd", "(Vd^2-Vq^2)/(Vd+Vq)") == law("Vd^2", "Vd-Vq")
    assert law("Vd^2/3/Vd", "(2/3)^-2") == law("Vd/3", "2.25")


numbers = st.fractions(-2, 2, max_denominator=12)
small = st.fractions(-1, 1, max_denominator=8)
points = st.tuples(numbers, numbers)
leaves = st.sampled_from(["Vd", "Vq", "2", "0.5", "3", "Vd*Vq"])
formulas = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(inner, st.integers(-2, 3)).map(lambda t: f"({t[0]})^{t[1]}"),
        inner.map(lambda t: f"(-{t})"),
    ),
    max_leaves=6,
)


@given(formulas, formulas, points)
@settings(max_examples=60, deadline=None)
def test_a_law_has_the_values_of_its_formulas(I_d: str, I_q: str, V: Pair) -> None:
    scope = dict(zip(("Vd", "Vq"), V, strict=True))
    try:
        expected = tuple(parse_formula(f).evaluate(scope) for f in (I_d, I_q))
        found = law(I_d, I_q)
    except QuantityError:
        assume(False)
    assert found.current(V) == expected


@given(points, points, points, points)
@settings(max_examples=20, deadline=None)
def test_isotropic_parts_are_added(V: Pair, Y: Pair, P: Pair, centre: Pair) -> None:
    assume(any(V))
    load = law("Vd*Vq/(7 + Vd)", "1")
    current = complex(*map(float, plus_isotropic(load, Y, P).current(V)))
    phasor, own = complex(*map(float, V)), complex(*map(float, load.current(V)))
    added = complex(float(Y[0]), -float(Y[1])) * phasor
    added += complex(float(P[0]), -float(P[1])) / abs(phasor) ** 2 * phasor
    assert abs(current - own - added) < 1e-9 * (1 + abs(current) + abs(added))
    q = load.denominator
    assert dict(recentred(q, centre, F_(1, 3))).get((0, 0), 0) == 7 + centre[0]


def test_division_is_exact_or_none() -> None:
    p, q = law("1 + Vd*Vq - 3*Vq^2", "Vd + Vq^3").numerators
    assert divide(multiply(p, q), p) == q
    assert divide(multiply(p, q), q) == p
    assert divide(p, q) is divide(q, p) is None


# --- the rules --------------------------------------------------------------------------------------------------------


def fails(reason: str, rule: Any, *arguments: Any) -> None:
    with pytest.raises(RuleFailure, match=reason):
        rule(*arguments)


HALF = (F_(1), F_(0)), F_(1, 2)  # 1/2 <= Vd <= 3/2 on this disk
FALLING = law("1/Vd", "Vq")
RISING = law("-1/Vd", "Vq")  # J = diag(1/Vd^2, 1)
CUBIC = law("Vd^3", "Vq^3")
RESISTOR = law("Vd", "Vq")


def proof_of(load: CurrentLaw, centre: Pair, radius: Fraction, strongly: bool = False) -> Proof:
    status, _, proposal = decide(load, centre, radius, strongly)
    assert status == "proved"
    assert proposal
    return read_proof(proposal.data)


def changed(gram: Any, i: int, j: int, by: Fraction, both: bool = True) -> Any:
    rows = [list(row) for row in gram]
    rows[i][j] += by
    if both and i != j:
        rows[j][i] += by
    return tuple(tuple(row) for row in rows)


def test_monotone_disk_rejects() -> None:
    form, denominator, _ = proof_of(RISING, *HALF)
    assert denominator is not None
    assert monotone_disk(RISING, *HALF, form, denominator) is True
    margin, bottom = denominator
    tiny = F_(1, 10**40)
    for reason, broken in (
        ("is not the form", dataclasses.replace(form, gram=changed(form.gram, 0, 0, tiny))),
        ("is not the form", dataclasses.replace(form, gram=changed(form.gram, 0, 3, tiny))),
        ("is not the form", dataclasses.replace(form, disk=changed(form.disk, 1, 1, tiny))),
        ("not symmetric", dataclasses.replace(form, gram=changed(form.gram, 0, 3, tiny, both=False))),
        ("not symmetric", dataclasses.replace(form, gram=form.gram[:-1])),
        ("not symmetric", dataclasses.replace(form, gram=tuple(row[:-1] for row in form.gram))),
        ("not symmetric", dataclasses.replace(form, disk=())),
        ("not symmetric", dataclasses.replace(form, degree=form.degree + 1)),
        ("not symmetric", dataclasses.replace(form, degree=form.degree - 1)),
        ("not from 0 to 6", dataclasses.replace(form, degree=-1)),
        ("not from 0 to 6", dataclasses.replace(form, degree=7)),
    ):
        fails(reason, monotone_disk, RISING, *HALF, broken, denominator)
    fails("is not the form", monotone_disk, RISING, *HALF, form, denominator, F_(1, 10))
    fails("modulus is negative", monotone_disk, RISING, *HALF, form, denominator, F_(-1, 10))
    fails("is not the form", monotone_disk, FALLING, *HALF, form, denominator)
    fails("is not the form", monotone_disk, RISING, HALF[0], F_(51, 100), form, denominator)
    fails("is not the form", monotone_disk, RISING, (F_(1), F_(1, 9)), HALF[1], form, (margin, bottom), F_(1))
    for radius in (F_(0), F_(-1, 2)):
        fails("radius", monotone_disk, RISING, HALF[0], radius, form, denominator)
    fails("not constant", monotone_disk, RISING, *HALF, form, None)
    for wrong in (F_(0), -margin):
        fails("margin", monotone_disk, RISING, *HALF, form, (wrong, bottom))
    fails("is not the form", monotone_disk, RISING, *HALF, form, (margin + tiny, bottom))
    fails("not symmetric", monotone_disk, RISING, *HALF, form, (margin, form))
    fails("not symmetric", monotone_disk, RISING, *HALF, bottom, denominator)


def test_gram_matrices_must_be_semidefinite() -> None:
    """An identity alone proves nothing: with an indefinite matrix every form has one."""
    one, zero = to_matrix([[1]]), to_matrix([[0]])
    minus = {(0, 0, 0, 0): F_(-1)}
    fails("semidefinite", sum_of_squares, minus, 1, DiskSum(0, to_matrix([[-1]]), ()))
    square = {(2, 0, 0, 0): F_(-1), (0, 2, 0, 0): F_(-1)}  # -(x^2 + y^2) = (1 - rho) - 1
    fails("semidefinite", sum_of_squares, square, 1, DiskSum(1, to_matrix([[-1, 0, 0], [0, 0, 0], [0, 0, 0]]), one))
    growing = {(0, 0, 0, 0): F_(-1), (2, 0, 0, 0): F_(1), (0, 2, 0, 0): F_(1)}  # rho - 1
    fails("semidefinite", sum_of_squares, growing, 1, DiskSum(1, to_matrix([[0] * 3] * 3), to_matrix([[-1]])))
    inside = {key: -x for key, x in growing.items()}  # 1 - rho
    assert sum_of_squares(inside, 1, DiskSum(1, to_matrix([[0] * 3] * 3), one)) is False
    # 1 + 2 x y as [[1, 1], [1, 0]]-like matrices: a zero on the diagonal beside an entry
    fails(
        "semidefinite",
        sum_of_squares,
        {(1, 0, 0, 0): F_(2)},
        1,
        DiskSum(1, to_matrix([[0, 1, 0], [1, 0, 0], [0] * 3]), zero),
    )
    # w1^2 and w2^2 differ: what is positive in one is not in the other
    fails("is not the form", sum_of_squares, {(0, 0, 0, 0): F_(1)}, 2, DiskSum(0, to_matrix([[0, 0], [0, 1]]), ()))
    fails("is not the form", sum_of_squares, {(0, 0, 0, 1): F_(1)}, 2, DiskSum(0, to_matrix([[1, 1], [1, 1]]), ()))
    fails(
        "too many digits",
        sum_of_squares,
        {(0, 0, 0, 0): F_(1, 2**40_000)},
        1,
        DiskSum(0, to_matrix([[F_(1, 2**40_000)]]), ()),
    )


def symmetric(n: int) -> st.SearchStrategy[Any]:
    """B D B' with small integers, D of 0, 1 and, now and then, -1."""
    rows = st.lists(st.lists(st.integers(-2, 2), min_size=2, max_size=2), min_size=n, max_size=n)
    signs = st.lists(st.sampled_from([0, 1, 1, 1, 1, -1]), min_size=2, max_size=2)
    return st.tuples(rows, signs).map(
        lambda t: to_matrix([[sum(a * d * b for a, d, b in zip(r, t[1], s, strict=True)) for s in t[0]] for r in t[0]])
    )


@given(symmetric(6), symmetric(2), st.lists(st.tuples(small, small, small, small), min_size=4, max_size=4))
@settings(max_examples=40, deadline=None)
def test_what_is_accepted_is_nonnegative(gram: Any, disk: Any, places: list[tuple[Fraction, ...]]) -> None:
    """The form is built by other means; an accepted one is nonnegative wherever it is looked at in the disk."""
    x, y = law("Vd", "Vq").numerators
    one = law("1", "1").numerators[0]
    ring = law("1 - Vd^2 - Vq^2", "0").numerators[0]
    form: dict[tuple[int, int, int, int], Fraction] = {}
    for matrix, powers, weight in ((gram, (one, x, y), one), (disk, (one,), ring)):
        for s, row in enumerate(matrix):
            for t, entry in enumerate(row):
                for (i, j), c in multiply(multiply(powers[s // 2], powers[t // 2]), weight):
                    key = (i, j, *sorted((s % 2, t % 2)))
                    form[key] = form.get(key, F_(0)) + c * entry
    form = {key: c for key, c in form.items() if c}
    try:
        definite = sum_of_squares(form, 2, DiskSum(1, gram, disk))
    except RuleFailure:
        assert not all(ldl_pivots(matrix)[1] for matrix in (gram, disk))
        return
    for a, b, *w in places:
        value = sum(c * a**i * b**j * w[k] * w[m] for (i, j, k, m), c in form.items())
        assert a * a + b * b > 1 or value >= 0
        assert a * a + b * b > 1 or not definite or value > 0 or not any(w)


def test_an_order_of_monomials_is_fixed() -> None:
    assert monomials(2) == [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    assert monomials(-1) == []
    form = {(2, 0, 0, 0): F_(1)}
    sum_of_squares(form, 1, DiskSum(1, to_matrix([[0, 0, 0], [0, 1, 0], [0, 0, 0]]), to_matrix([[0]])))
    fails("is not", sum_of_squares, form, 1, DiskSum(1, to_matrix([[0, 0, 0], [0, 0, 0], [0, 0, 1]]), to_matrix([[0]])))


def test_a_denominator_with_a_zero_is_never_proved() -> None:
    """For -1/Vd the form q^2 J is a sum of squares everywhere: the denominator alone stands in the way."""
    one = to_matrix([[0] * 6] * 6)
    for radius, status in ((F_(1), "unknown"), (F_(3, 2), "refuted")):
        # radius (w1^2 + (1 + radius x)^2 w2^2), in the basis w1, w2, x w1, x w2, y w1, y w2
        gram = changed(changed(changed(changed(one, 0, 0, radius), 1, 1, radius), 3, 3, radius**3), 1, 3, radius**2)
        form = DiskSum(1, gram, to_matrix([[0, 0], [0, 0]]))
        assert sum_of_squares(jacobian_form(RISING, HALF[0], radius), 2, form) is False
        fails("not constant", monotone_disk, RISING, HALF[0], radius, form)
        for wrong in (DiskSum(0, to_matrix([[1]]), ()), DiskSum(1, to_matrix([[0] * 3] * 3), to_matrix([[0]]))):
            fails("is not the form", monotone_disk, RISING, HALF[0], radius, form, (F_(1, 100), wrong))
        # 1 - margin + radius x has an identity, but no semidefinite one
        line = changed(changed(to_matrix([[0] * 3] * 3), 0, 0, F_(99, 100)), 0, 1, radius / 2)
        for square in (F_(0), F_(1, 4)):  # a share of x^2 + y^2 moved into the disk part and back
            shifted = changed(changed(changed(line, 0, 0, -square), 1, 1, square), 2, 2, square)
            bottom = DiskSum(1, shifted, to_matrix([[square]]))
            fails("semidefinite", monotone_disk, RISING, HALF[0], radius, form, (F_(1, 100), bottom))
        assert decide(RISING, HALF[0], radius)[0] == status
    # the sign of q is that at the centre
    assert denominator_form(RISING, (F_(-1), F_(0)), F_(1, 2), F_(1, 4))[0, 0, 0, 0] == F_(3, 4)
    assert denominator_form(RISING, (F_(0), F_(0)), F_(1, 2), F_(1, 4))[0, 0, 0, 0] == F_(-1, 4)
    status, strict, _ = decide(RISING, (F_(-1), F_(0)), F_(1, 2))
    assert (status, strict) == ("proved", True)


def test_strict_only_if_proved() -> None:
    assert decide(RESISTOR, *HALF)[:2] == ("proved", True)
    assert decide(CUBIC, ZERO, F_(1))[:2] == ("proved", False)
    assert decide(law("Vd", "3"), *HALF)[:2] == ("proved", False)
    for skew in (law("Vq", "-Vd"), law("1", "2")):
        assert decide(skew, *HALF)[:2] == ("proved", False)
    form, denominator, modulus = proof_of(RISING, *HALF, strongly=True)
    assert F_(2, 5) <= modulus <= F_(4, 9)  # the smallest eigenvalue is 4/9, at Vd = 3/2
    assert monotone_disk(RISING, *HALF, form, denominator, modulus) is True
    fails("is not the form", monotone_disk, RISING, *HALF, form, denominator, modulus + F_(1, 100))


def test_current_pair() -> None:
    U, V = (F_(1, 2), F_(0)), (F_(3, 2), F_(0))
    assert current_pair(FALLING, *HALF, U, V) == F_(2, 3) - 2
    assert current_pair(FALLING, *HALF, V, U) == F_(2, 3) - 2
    fails("outside", current_pair, FALLING, *HALF, U, (F_(3, 2), F_(1, 10**30)))
    fails("outside", current_pair, FALLING, *HALF, (F_(4, 10), F_(0)), V)
    fails("outside", current_pair, FALLING, HALF[0], F_(1, 3), U, V)
    fails("radius", current_pair, FALLING, HALF[0], F_(-1, 2), U, V)
    fails("not negative", current_pair, RISING, *HALF, U, V)
    fails("not negative", current_pair, FALLING, *HALF, U, U)
    fails("not negative", current_pair, law("3", "4"), *HALF, U, V)
    fails("vanishes", current_pair, FALLING, ZERO, F_(2), ZERO, V)
    fails("vanishes", current_pair, FALLING, ZERO, F_(2), V, (F_(0), F_(1)))
    # across the pole, which both voltages avoid
    assert current_pair(RISING, ZERO, F_(1), (F_(-1), F_(0)), (F_(1), F_(0))) == -4


def test_lipschitz_bound() -> None:
    assert 1 <= lipschitz_bound_disk(RESISTOR, *HALF) < 1 + F_(1, 10**8)
    assert 4 <= lipschitz_bound_disk(RISING, *HALF) < 8
    assert lipschitz_bound_disk(RISING, *HALF, F_(49, 100)) <= lipschitz_bound_disk(RISING, *HALF)
    fails("may vanish", lipschitz_bound_disk, RISING, HALF[0], F_(1))
    fails("radius", lipschitz_bound_disk, RISING, HALF[0], F_(0), F_(1))
    fails("margin", lipschitz_bound_disk, RISING, *HALF, F_(-1))


# --- decisions --------------------------------------------------------------------------------------------------------


DECIDED = [
    (law("Vd/(1+Vd^2)", "Vq/(1+Vq^2)"), ZERO, F_(9, 10), "proved"),
    (law("Vd/(1+Vd^2)", "Vq/(1+Vq^2)"), ZERO, F_(1), "proved"),  # zero on the border
    (law("Vd/(1+Vd^2)", "Vq/(1+Vq^2)"), ZERO, F_(11, 10), "refuted"),
    (law("Vd + 0.1*Vd/(1+Vd^2+Vq^2)", "Vq + 0.2*Vq^2"), ZERO, F_(1), "proved"),
    (law("Vd^5", "Vq"), ZERO, F_(2), "proved"),  # zero on a line
    (law("Vd*(Vd^2+Vq^2)", "Vq*(Vd^2+Vq^2)"), ZERO, F_(1), "proved"),
    (law("(Vd-1/3)^3", "(Vq-1/5)^3"), ZERO, F_(1), "proved"),  # zero on lines off the grid
    (law("Vd^3 - 1e-3*Vd", "Vq"), ZERO, F_(1), "refuted"),
    (law("Vd + 3*Vq", "Vq - 3*Vd"), ZERO, F_(1), "proved"),
    (law("Vd + 3*Vq", "Vq"), ZERO, F_(1), "refuted"),
    (law("1e-5*Vd*(1+(Vd/20000)^2)", "1e-5*Vq"), (F_(20_000), F_(0)), F_(2_000), "proved"),
    (law("1e-9*(1-Vd/19000)", "1e-12*Vq"), (F_(20_000), F_(0)), F_(2_000), "refuted"),
    (law("0", "0"), ZERO, F_(1), "proved"),
    (
        law("Vd^5/5 - 2*Vd^3/9 + Vd/9", "Vq"),
        ZERO,
        F_(1),
        "unknown",
    ),  # true: J = diag((Vd^2 - 1/3)^2, 1), an irrational zero
]


@pytest.mark.parametrize(("load", "centre", "radius", "status"), DECIDED)
def test_decided(load: CurrentLaw, centre: Pair, radius: Fraction, status: str) -> None:
    assert decide(load, centre, radius)[0] == status


@st.composite
def random_laws(draw: Any) -> CurrentLaw:
    """A resistor, bent and divided at random."""
    names = ["Vd", "Vq", "Vd*Vq", "Vd^2", "Vq^2", "Vd^2*Vq"]

    def bent(main: str) -> str:
        extra = "".join(f" + ({draw(small)})*{name}*{draw(st.sampled_from(['0', '1/3', '1']))}" for name in names[:5])
        return f"{main} + ({extra})"

    divisor = draw(st.sampled_from(["1", "(2+Vd)", "(1+Vd^2+Vq^2)", "(3+Vd*Vq)", "(1/2-Vq)"]))
    return law(f"({bent('Vd')})/{divisor}", f"({bent('Vq')})/{draw(st.sampled_from(['1', divisor]))}")


def slow_product(load: CurrentLaw, U: Pair, V: Pair) -> float:
    """By plain evaluation in floats, one term after the other."""

    def value(p: Any, at: Pair) -> float:
        return math.fsum(float(c) * float(at[0]) ** i * float(at[1]) ** j for (i, j), c in p)

    total = 0.0
    for k in (0, 1):
        rise = [value(load.numerators[k], at) / value(load.denominator, at) for at in (U, V)]
        total += (float(V[k]) - float(U[k])) * (rise[1] - rise[0])
    return total


unit = st.tuples(small, small).filter(lambda p: p[0] ** 2 + p[1] ** 2 <= 1)


@given(
    random_laws(),
    points,
    st.fractions(Fraction(1, 4), Fraction(3, 2), max_denominator=4),
    st.lists(st.tuples(unit, unit), min_size=8, max_size=8),
)
@settings(max_examples=8, deadline=None)
def test_random_laws(load: CurrentLaw, centre: Pair, radius: Fraction, ends: list[tuple[Pair, Pair]]) -> None:
    status, detail, proposal = decide(load, centre, radius)
    lipschitz = None
    if status == "proved":
        denominator = read_proof(proposal.data)[1] if proposal else None
        lipschitz = lipschitz_bound_disk(load, centre, radius, denominator[0] if denominator else F_(0))
    for pair in ends:
        U, V = ((centre[0] + radius * x, centre[1] + radius * y) for x, y in pair)
        if status == "proved":
            a, b = load.current(U), load.current(V)
            product = sum((v - u) * (y - x) for u, v, x, y in zip(U, V, a, b, strict=True))
            assert product >= 0
            assert not detail or product > 0 or U == V
            rise, step = (sum((x - y) ** 2 for x, y in zip(*both, strict=True)) for both in ((a, b), (U, V)))
            assert lipschitz is not None
            assert rise <= lipschitz**2 * step
    if status == "refuted":
        assert proposal
        assert slow_product(load, *read_pair(proposal.data)) == pytest.approx(float(detail), rel=1e-3, abs=1e-9)
    least = least_eigenvalue(load, centre, radius)
    if status == "unknown":
        assert least is None or abs(least) < 1e-2  # a pole, or near the edge
    elif least is not None:
        assert (least > -1e-6) if status == "proved" else (least < 1e-6)


def least_eigenvalue(load: CurrentLaw, centre: Pair, radius: Fraction) -> float | None:
    """Of the symmetric part of the Jacobian by difference quotients on a grid; None if the denominator changes sign."""
    worst, signs, h = math.inf, set(), 1e-4

    def value(p: Any, x: float, y: float) -> float:
        return math.fsum(float(c) * x**i * y**j for (i, j), c in p)

    for k in range(24):
        for m in range(13):
            x = float(centre[0]) + float(radius) * m / 12 * math.cos(math.tau * k / 24)
            y = float(centre[1]) + float(radius) * m / 12 * math.sin(math.tau * k / 24)
            signs.add(value(load.denominator, x, y) > 0)
            if len(signs) > 1 or abs(value(load.denominator, x, y)) < 1e-2:
                return None
            J = [
                [
                    sum(
                        s
                        * value(p, x + s * h * (a == 0), y + s * h * (a == 1))
                        / value(load.denominator, x + s * h * (a == 0), y + s * h * (a == 1))
                        for s in (-1, 1)
                    )
                    / (2 * h)
                    for a in (0, 1)
                ]
                for p in load.numerators
            ]
            half, off = (J[0][0] - J[1][1]) / 2, (J[0][1] + J[1][0]) / 2
            worst = min(worst, (J[0][0] + J[1][1]) / 2 - math.hypot(half, off))
    return worst


@given(
    st.tuples(st.fractions(Fraction(1, 10), 1, max_denominator=20), small),
    st.tuples(st.fractions(-1, 1, max_denominator=20), st.fractions(-1, 1, max_denominator=20)),
    st.fractions(Fraction(1, 20), Fraction(2, 5), max_denominator=20),
)
@settings(max_examples=15, deadline=None)
def test_agrees_with_the_rule_of_isotropic_loads(Y: Pair, P: Pair, radius: Fraction) -> None:
    """The disk around 1 V touches both ends of the annulus, and the law does not depend on the angle."""
    active, reactive = ((PowerTerm(y, F_(1), F_(2)), PowerTerm(p, F_(1), F_(0))) for y, p in zip(Y, P, strict=True))
    try:
        strict: bool | None = monotone_sturm(LoadLaw(active, reactive), (1 - radius, 1 + radius))
    except RuleFailure:
        strict = None
    load = plus_isotropic(law("0", "0"), Y, P)
    status, found, _ = decide(load, (F_(1), F_(0)), radius)
    assert status == ("refuted" if strict is None else "proved")
    assert not found or strict is not False
