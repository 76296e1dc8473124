"""Sums of squares: exact Gram matrices for every monotone ZIP load, those with double roots included."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.kernel import loads, poly
from certify.kernel.data import Data
from certify.kernel.errors import RuleFailure
from certify.kernel.load_proofs import check_monotone
from certify.kernel.poly import Polynomial, is_nonnegative_on, to_polynomial
from certify.search.loads import METHODS
from certify.search.sos import find_gram_matrices
from tests.load_cases import load_cases
from tests.test_loads import node

COUNT = 500
KINDS = (
    *("ZIP", "ZIP, nonnegative", "ZIP + ZIP", "generation made up for"),
    *("edge: at an end, ZIP", "edge: touching inside, ZIP", "edge: touching inside, ZIP, any band"),
    *("edge: nonnegative ZIP at the lower end", "edge: power and impedance", "edge: active power with a root"),
)
TINY = ("+1e-12", "+1e-30", "-1e-12", "-1e-30")


def test_five_hundred_zip_loads_have_sums_of_squares() -> None:
    """Of random ZIP loads, and of ones exactly on the edge: all that Sturm sequences prove, and no others."""
    proved: dict[str, int] = {}
    handed_on = 0
    for case in load_cases(100_000, 7, KINDS):
        law = node(*case.law)
        if loads.is_constant_admittance(law):
            continue
        try:
            loads.monotone_sturm(law, case.band)
        except RuleFailure:
            continue
        data, pieces = METHODS["sos"]([(case.band, law)]), ((case.band, law),)
        if data is None:  # a margin too small for a solver in floats: other methods decide it
            wide = case.band[1] > 8 * case.band[0]  # then D ranges over many decades
            assert wide or case.error in TINY, case
            handed_on += 1
            continue
        check_monotone(pieces, "monotone-sos", Data(data))  # raises unless the kernel accepts
        kind = "edge" if case.kind.startswith("edge") else "inside"
        proved[kind] = proved.get(kind, 0) + 1
        if sum(proved.values()) == COUNT:
            break
    assert sum(proved.values()) == COUNT
    assert handed_on < COUNT // 3
    assert min(proved.get("edge", 0), proved.get("inside", 0)) >= 100


small = st.fractions(-3, 3, max_denominator=8)


def product(*factors: list[Fraction | int]) -> Polynomial:
    result = to_polynomial([1])
    for factor in factors:
        result = poly.multiply(result, to_polynomial(factor))
    return result


@given(st.lists(small, min_size=1, max_size=5), st.lists(small, max_size=2), st.integers(0, 3), st.booleans())
@settings(max_examples=60, deadline=None)
def test_found_iff_nonnegative(rest: list[Fraction], roots: list[Fraction], ends: int, irrational: bool) -> None:
    """On [-1, 1], with squared roots that may be irrational, and with roots at either end."""
    p = product(rest, *([-r, 1] for r in roots for _ in (0, 1)))
    p = product([*p], [1, 1] if ends & 1 else [1], [1, -1] if ends & 2 else [1])
    p = product([*p], *([[-Fraction(1, 2), 0, 1]] * 2 if irrational else []))
    found = find_gram_matrices(p)
    assert (found is not None) == is_nonnegative_on(p, Fraction(-1), Fraction(1))
    if found is not None:
        loads._sum_of_squares(p, *found)  # raises unless the identity holds


@pytest.mark.parametrize("p", [[0, 0, 1], [1, -2, 1], [1, 0, -1], [1, 1], [Fraction(1, 4), 0, -1, 0, 1], [0], [5]])
def test_on_the_edge(p: list[Fraction | int]) -> None:
    found = find_gram_matrices(to_polynomial(p))
    assert found is not None
    loads._sum_of_squares(to_polynomial(p), *found)
