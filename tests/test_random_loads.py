"""A sample of the random loads, the oracle's answers on loads known by hand, and pairs that refute or do not."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import pytest

from certify.search.proposal import Proposal
from tests.campaign_loads import RIGHT, UNKNOWN, compare, pair_fault
from tests.load_cases import B, Case, X, Z, load_case, load_cases
from tests.load_oracle import BOUNDARY, MONOTONE, NOT_MONOTONE, Law, exact_verdict, judge, product_sign

SAMPLE, SEED = 60, 7


@pytest.mark.parametrize("first", range(0, SAMPLE, 20))
def test_never_wrong(first: int) -> None:
    """What the kernel accepts is true, and oracle, construction and exact arithmetic agree."""
    for number in range(first, first + 20):
        result = compare(load_case(number, SEED))
        assert result.mark in (RIGHT, UNKNOWN), result
        assert not result.quarrel, result


def test_constructions_are_right_where_arithmetic_is_exact() -> None:
    compared: Counter[str | None] = Counter()
    for case in load_cases(150, seed=11):
        exact = exact_verdict(case.law, case.band) if case.expected else None
        assert exact in (None, case.expected), case
        compared[exact] += 1
    assert compared[MONOTONE] > 5
    assert compared[NOT_MONOTONE] > 5


# Y v^2 + P: N = (Y v^2)^2 - P^2. A constant current: N = 0. P = (v - 1)^2: N = (v - 1)^3 (v + 1).
KNOWN: dict[str, tuple[Law, str, str, str]] = {
    "impedance": ((Z("1 1", "0 0", "0 0"),), "1 2", MONOTONE, MONOTONE),
    "negative impedance": ((Z("-1 0", "0 0", "0 0"),), "1 2", NOT_MONOTONE, NOT_MONOTONE),
    "constant power": ((Z("0 0", "0 0", "1 0"),), "1 2", NOT_MONOTONE, NOT_MONOTONE),
    "on the edge": ((Z("1 0", "0 0", "1/4 0"),), "1/2 1", BOUNDARY, MONOTONE),
    "below it by a hair": (
        (Z("1 0", "0 0", f"{Fraction(1, 4) + Fraction(1, 10**30)} 0"),),
        "1/2 1",
        NOT_MONOTONE,
        NOT_MONOTONE,
    ),
    "above it by a hair": (
        (Z("1 0", "0 0", f"{Fraction(1, 4) - Fraction(1, 10**30)} 0"),),
        "1/2 1",
        MONOTONE,
        MONOTONE,
    ),
    "constant current": ((Z("0 3", "1 0", "0 0"),), "1 2", BOUNDARY, MONOTONE),
    "reactance": ((X("0 0 5 2 7"),), "1 2", BOUNDARY, MONOTONE),
    "nothing": ((Z("1 0", "0 0", "0 0"), X("-9 2 0 0 3")), "1 2", BOUNDARY, MONOTONE),
    "power with a double root at the end": ((Z("1 0", "-2 0", "1 0"),), "1 2", BOUNDARY, MONOTONE),
    "power with a double root inside": ((Z("1 0", "-2 0", "1 0"),), "1/2 2", NOT_MONOTONE, NOT_MONOTONE),
    "fails between the ends": (
        (Z("0.0845 0", "0.0577 0.357", "-0.0199 -0.0485"),),
        "0.3 1.5",
        NOT_MONOTONE,
        NOT_MONOTONE,
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_known_loads(name: str) -> None:
    law, ends, by_oracle, exactly = KNOWN[name]
    truth = judge(law, B(ends))
    assert (truth.verdict, truth.agree) == (by_oracle, True)
    assert exact_verdict(law, B(ends)) == exactly


# P = v^2 + 1 + 2 v^1.5 and R = v^2 - 1 + v^1.5. With Q = 4 v, N = P R - 4 v^2 is 0 at v = 1 and rises by 11 per ln v.
# With Q = 9.5 v - 2.75, N = P R - (4.75 v - 2.75)^2 and its derivative are 0 there, and the second one is 4.375.
@pytest.mark.parametrize("error", ["0", "1e-3", "1e-12", "1e-30"])
@pytest.mark.parametrize(("Q", "ends"), [("4 0", "1 1.1"), ("9.5 -2.75", "0.99 1.01")], ids=["end", "inside"])
def test_whole_and_fractional_powers_on_the_edge(Q: str, ends: str, error: str) -> None:
    """An error in the impedance is added to P and to R; exactly on the edge the oracle says so."""
    current, power = Q.split()
    for sign in (1, -1) if Fraction(error) else (0,):
        law = (Z(f"{1 + sign * Fraction(error)} 0", f"0 {current}", f"1 {power}"), X("2 3/2 0 0 1"))
        truth = judge(law, B(ends))
        assert truth.verdict == {0: BOUNDARY, 1: MONOTONE, -1: NOT_MONOTONE}[sign]
        assert truth.agree


def test_strict_or_not() -> None:
    """N = 0 at one voltage leaves the load strictly monotone; N = 0 at all, or P = 0 at one, does not."""
    strict = {name: judge(law, B(ends)).strict for name, (law, ends, _, _) in KNOWN.items()}
    assert {name for name, is_strict in strict.items() if is_strict} == {
        "impedance",
        "on the edge",
        "above it by a hair",
    }


def test_signs_of_products() -> None:
    """Constant power 1 W at 1 V and 2 V in phase: (2 - 1) (1/2 - 1) < 0; an impedance: (2 - 1) (2 - 1) > 0."""
    pair = (Fraction(1), Fraction(2))
    for exponents, sign in (("0 0 0 0", -1), ("0 2 0 2", 1), ("0 1 0 2", 0), ("0 1/2 0 2", -1), ("0 3/2 0 2", 1)):
        _, m, q, n = exponents.split()
        assert product_sign((X(f"1 {m} {q} {n} 1"),), pair, Fraction(0)) == sign
    # At a right angle P_a + P_b - ab (B_a - B_b) with Q = 8 v: 2 + 4 - 2 (8/2 - 8/1) = 14, and -2 the other way.
    current = (Z("0 0", "2 8", "0 0"),)
    assert product_sign(current, pair, Fraction(1)) == 1
    assert product_sign(current, pair, Fraction(-1)) == -1


def test_a_bad_pair_is_noticed() -> None:
    case = Case(0, "", "", (Z("0 0", "0 0", "1 0"),), B("1 2"), None)
    good = {"v": "1", "pair": "1 2", "t": "0"}
    for change, fault in (({}, ""), ({"pair": "1 3"}, "a voltage is outside the band"), ({"v": "3"}, "a voltage")):
        found = pair_fault(case, Proposal("refuted", "voltage-pair", good | change))
        assert found.startswith(fault)
        assert bool(found) == bool(fault)
    assert "sign" in pair_fault(case, Proposal("refuted", "voltage-pair", good | {"t": "1"}))
