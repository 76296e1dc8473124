"""Each rule about loads with what it accepts and what it rejects, one row for each side condition."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest

from certify.kernel import loads
from certify.kernel.check_loads import check_load
from certify.kernel.data import Data
from certify.kernel.errors import RuleFailure
from certify.kernel.load_proofs import METHODS, check_monotone
from certify.kernel.model import LoadLaw, PowerTerm
from certify.search.analysis import analyse


def F_(x: Any, y: int = 1) -> Fraction:
    return Fraction(x) / y


def fails(match: str, rule: Any, *arguments: Any) -> None:
    with pytest.raises(RuleFailure, match=match):
        rule(*arguments)


def law(active: dict[Any, Any], reactive: dict[Any, Any] | None = None, base: Any = 1) -> LoadLaw:
    parts = [tuple(PowerTerm(F_(c), F_(base), F_(e)) for e, c in (part or {}).items()) for part in (active, reactive)]
    return LoadLaw(parts[0], parts[1])


BAND = (F_(1), F_(2))


def by(method: str, what: LoadLaw, data: dict[str, Any] | None = None, band: Any = BAND, modulus: Any = 0) -> bool:
    """Through the handler of the method, as a certificate would."""
    return check_monotone(((band, what),), f"monotone-{method}", Data(data or {}), F_(modulus))


def test_sturm() -> None:
    assert loads.monotone_sturm(law({2: 1}), BAND) is True
    assert loads.monotone_sturm(law({1: 1}), BAND) is False  # constant current: D = 0
    assert loads.monotone_sturm(law({}, {2: 5}), BAND) is False  # a pure reactance
    assert loads.monotone_sturm(law({}), BAND) is False
    assert loads.monotone_sturm(law({2: 1, 0: 1}), BAND) is False  # D = v^4 - 1 vanishes at the lower end
    assert loads.monotone_sturm(law({2: 1, 0: "0.999999999999999999999"}), BAND) is True
    fails("D = ", loads.monotone_sturm, law({2: 1, 0: "1.000000000000000000001"}), BAND)
    fails("D = ", loads.monotone_sturm, law({0: 1}), BAND)
    fails("D = ", loads.monotone_sturm, law({1: 1}, {1: "1e-30"}), BAND)
    fails("conductance G is negative", loads.monotone_sturm, law({2: -1}), BAND)
    fails("whole number", loads.monotone_sturm, law({"1.5": 1}), BAND)
    fails("whole number", loads.monotone_sturm, law({13: 1}), BAND)
    fails("whole number", loads.monotone_sturm, law({-1: 1}), BAND)
    both_ends = law({2: "0.0845", 1: "0.0577", 0: "-0.0199"}, {1: "0.357", 0: "-0.0485"})
    fails("D = ", loads.monotone_sturm, both_ends, (F_("0.3"), F_("1.5")))


def test_ends_of_an_exponential_load() -> None:
    assert loads.monotone_ends(law({"1.5": 1}), BAND) is True
    assert loads.monotone_ends(law({"1": 1}), BAND) is False
    assert loads.monotone_ends(law({"1": 1}, {2: 9}), BAND) is False
    assert loads.monotone_ends(law({"1.5": 1}, {"1.5": 1}), BAND) is True
    assert loads.monotone_ends(law({2: 1}, {0: 1}), BAND) is False  # equality at v = 1
    fails("np = 1", loads.monotone_ends, law({"1": 1}, {1: 1}), BAND)
    fails("P0 > 0", loads.monotone_ends, law({"0.99": 1}), BAND)
    fails("P0 > 0", loads.monotone_ends, law({"1.5": -1}), BAND)
    fails("neither a single", loads.monotone_ends, law({"1.5": 1, 2: 1}), BAND)
    assert loads.monotone_ends(law({}, {2: 1}), BAND) is False  # a pure reactance
    fails("end of the band", loads.monotone_ends, law({2: 1}, {0: 1}), (F_("0.999"), F_(2)))
    fails("end of the band", loads.monotone_ends, law({"1.5": 1}, {"4.5": 1}), BAND)  # the upper end fails
    mixed = LoadLaw((PowerTerm(F_(1), F_(3), F_("1.5")),), (PowerTerm(F_(1), F_(2), F_("1.4")),))
    fails("nominal voltages", loads.monotone_ends, mixed, BAND)
    rebased = LoadLaw((PowerTerm(F_(1), F_(1), F_(2)),), (PowerTerm(F_(1), F_(2), F_("1.5")),))
    assert loads.monotone_ends(rebased, BAND) is True


def test_ends_of_a_zip_load() -> None:
    good = law({2: 2, 1: 1, 0: 1}, {2: -9, 1: 1, 0: 1})  # a constant susceptance of either sign is harmless
    assert by("ends", good) is True
    assert by("ends", law({2: 1, 1: 0, 0: 1}, {2: 5})) is False  # D = v^4 - 1 vanishes at the lower end
    assert by("ends", law({1: 1}, {2: 5})) is False
    fails("increases", by, "ends", law({2: 1, 0: "1.000001"}, {2: 1}))
    for active, reactive in (
        ({2: 5, 0: -1}, {0: 1}),
        ({2: 5, 1: -1}, {0: 1}),
        ({2: 5, 0: 1}, {0: -1}),
        ({2: 5, 0: 1}, {1: -1}),
    ):
        fails("negative", by, "ends", law(active, reactive))
    fails("neither", by, "ends", law({2: 5, 3: 1}))
    fails("no data", by, "ends", good, {"points": "1 2"})
    # passes at both ends and fails between
    between = law({2: "0.0845", 1: "0.0577", 0: "-0.0199"}, {1: "0.357", 0: "-0.0485"})
    fails("negative", by, "ends", between, {}, (F_("0.3"), F_("1.5")))


def test_bernstein() -> None:
    assert by("bernstein", law({2: 1, 0: "0.5"}), {"points": "1 2"}) is True
    assert by("bernstein", law({2: 1, 0: 1}), {"points": "1 2"}) is False
    assert by("bernstein", law({}), {"points": "1 2"}) is False
    dip = law({2: 1, 1: -2, 0: "1.01"}, {})  # P > 0, but D is not
    fails("Bernstein", by, "bernstein", dip, {"points": "1 2"}, (F_("0.5"), F_(2)))
    close = law({4: 1, 2: "-2.8", 0: 6})  # P > 0 with a minimum inside: one cell is too few, more will do
    fails("P has a negative", loads.monotone_bernstein, close, [F_("0.6"), F_(4)])
    fails("increase", by, "bernstein", law({2: 1}, {1: "0.1"}), {"points": "1 2 2"})
    fails("needs", by, "bernstein", law({2: 1}, {1: "0.1"}), {})
    fails("whole number", by, "bernstein", law({"1.5": 1, 2: 1}), {"points": "1 2"})


# P = v^2 and D v^4 = v^4 on [1, 2]: with x = -1 .. 1 and v = (3 + x) / 2, P = (9 + 6 x + x^2) / 4
P_GRAMS = [["9/4 3/4", "3/4 1/4"], ["0"]]
D_GRAMS = [["81/16 27/8 9/16", "27/8 9/4 3/8", "9/16 3/8 1/16"], ["0 0", "0 0"]]
SQUARE = LoadLaw((PowerTerm(F_(1), F_(1), F_(2)),), (PowerTerm(F_(0), F_(1), F_(1)),))  # not a plain impedance


def test_sums_of_squares() -> None:
    def prove(*grams: Any) -> bool:
        return by("sos", SQUARE, {"grams": [list(grams)]})

    assert prove(*P_GRAMS, *D_GRAMS) is False  # of rank one: nonnegative is all that they show
    slack = [["9/4 3/4", "3/4 1/2"], ["1/4"]]
    fails("do not give", prove, *slack, *D_GRAMS)
    indefinite = ["81/16 27/8 9/8", "27/8 9/8 3/8", "9/8 3/8 1/16"]  # the same sum along each antidiagonal
    fails("not positive semidefinite", prove, *P_GRAMS, indefinite, ["0 0", "0 0"])
    fails("not positive semidefinite", prove, ["5/2 3/4", "3/4 0"], ["-1/4"], *D_GRAMS)
    fails("do not give", prove, *D_GRAMS, *P_GRAMS)
    fails("not symmetric", prove, ["9/4 1", "1/2 1/4"], ["0"], *D_GRAMS)
    fails("four", prove, *P_GRAMS)
    fails("one list", by, "sos", SQUARE, {"grams": []})
    fails("do not give", prove, [], [], *D_GRAMS)
    fails("do not give", prove, P_GRAMS[0], ["0 0", "0 1"], *D_GRAMS)
    fails("too large", prove, [" ".join("0" * 20)] * 20, [], *D_GRAMS)
    fails("lowest terms", prove, ["18/8 3/4", "3/4 1/4"], ["0"], *D_GRAMS)


def test_sums_of_squares_with_another_polynomial_of_equal_values_nowhere() -> None:
    """The identity is one of polynomials, not of samples: a term that vanishes on a grid is not let through."""
    grams = [["9/4 3/4 0", "3/4 1/4 0", "0 0 1"], ["0"]]
    fails("do not give", by, "sos", SQUARE, {"grams": [[*grams, *D_GRAMS]]})


def test_enclosure() -> None:
    good, ends = law({"1.5": 1, 0: "0.1"}), "1 3/2 2"
    assert by("enclosure", good, {"points": ends, "bits": "64"}) is True
    fails("may be negative", by, "enclosure", law({"1.5": 1, 0: 3}), {"points": ends, "bits": "64"})
    fails("increase", by, "enclosure", good, {"points": "1 1 2", "bits": "64"})
    fails("increase", by, "enclosure", good, {"points": "1 9 2", "bits": "64"})
    for bits in ("1", "1000000000", "64 64", "129/2"):
        fails("absurd", by, "enclosure", good, {"points": ends, "bits": bits})
    # D vanishes exactly at v = 1, all powers being 1 there, and rises: D(1) = 0.5 * 1 - 0.5 = 0
    edge = law({"2.5": 1, "0.5": "0.5"}, {"1.5": 0})
    falling = law({"1.5": 1}, {"3.5": "0.9428090415820633"})
    assert by("enclosure", edge, {"points": "1 2", "bits": "64"}) is True
    fails("may be negative", by, "enclosure", falling, {"points": "1 2", "bits": "64"}, (F_(1), F_(2)))


@pytest.mark.parametrize(("active", "reactive"), [({"2.5": 2, "1.5": 2}, {0: "3"}), ({"2.5": 1, "0.5": 3}, {})])
def test_enclosure_at_an_exact_zero_of_the_determinant(active: dict[Any, Any], reactive: dict[Any, Any]) -> None:
    """G = sum c, G + v G' = sum c (e-1), v B' = -sum c (e-2) at v = 1: 4 * 4 - 36/4 > 0, and 4 * (1.5 - 1.5) = 0."""
    strict = by("enclosure", law(active, reactive), {"points": "1 2", "bits": "64"})
    assert strict == (0 in reactive)


def test_sampled_is_no_proof() -> None:
    count = {"points": "40"}
    assert check_monotone(((BAND, law({2: 1, 0: "0.1"})),), "sampled", Data(count)) is False
    fails("sample", check_monotone, ((BAND, law({2: 1, 0: "1.1"})),), "sampled", Data(count))
    for absurd in ("0", "-3", "1/2", "5000"):
        fails("absurd", check_monotone, ((BAND, law({2: 1, 0: "0.1"})),), "sampled", Data({"points": absurd}))


def test_a_constant_admittance_needs_no_method_down_to_zero_volt() -> None:
    band = (F_(0), F_(1))
    for method in METHODS:
        data = {"monotone-bernstein": {"points": "0 1"}, "monotone-sos": {"grams": []}}.get(method, {})
        if method == "monotone-enclosure":
            data = {"points": "0 1", "bits": "64"}
        if method == "sampled":
            data = {"points": "1"}
        strict = check_monotone(((band, law({2: 1}, {2: -3})),), method, Data(data))
        assert strict == (method != "sampled")
        fails("conductance", check_monotone, ((band, law({2: -1})),), method, Data(data))


def test_modulus() -> None:
    """Of a conductance of 1 S beside a power of 1/2 W: D = (1 - m)^2 - 1/4 at 1 V, so that m = 1/2 is the limit."""
    load = law({2: 1, 0: "0.5"})
    assert by("sturm", load, modulus="0.499") is True
    assert by("sturm", load, modulus="0.5") is False
    fails("D = ", by, "sturm", load, {}, BAND, "0.501")
    fails("conductance G", by, "sturm", load, {}, BAND, "2")


def test_voltage_pair() -> None:
    constant_power = law({0: 1})
    loads.voltage_pair(constant_power, BAND, F_(1), (F_(1), F_(2)), F_(0))
    fails("outside", loads.voltage_pair, constant_power, BAND, F_(3), (F_(1), F_(2)), F_(0))
    fails("outside", loads.voltage_pair, constant_power, BAND, F_(1), (F_(1), F_(3)), F_(0))
    fails("neither", loads.voltage_pair, law({2: 1}), BAND, F_(1), (F_(1), F_(2)), F_(0))
    fails("product", loads.voltage_pair, constant_power, BAND, F_(1), (F_(1), F_(1)), F_(0))
    fails("product", loads.voltage_pair, constant_power, BAND, F_(1), (F_(1), F_(2)), F_(1))
    fails("outside", loads.voltage_pair, constant_power, (F_(0), F_(2)), F_(1), (F_(0), F_(2)), F_(0))


def test_a_critical_voltage_far_below_the_band_may_be_a_bound() -> None:
    """A sum with fractional exponents that holds down to 0 V, where enclosures cannot go."""
    both = law({"1.2": 1, "1.5": 1}, {"1.7": "0.1"})
    verdict = analyse(((BAND, both),))
    assert verdict.status == "proved"
    assert verdict.critical is not None
    assert verdict.critical[0] == 0 < verdict.critical[1] <= BAND[1] / 10**9
    entry = {"status": "unknown", "rule": None, "data": None}
    proof = {"rule": "monotone-enclosure", "data": {"points": "1/4 1/2 1 2", "bits": "160"}}
    fails("too wide", check_load, ((BAND, both),), {**entry, "critical": {"bracket": "0 1/4", **proof}})
    fails("too wide", check_load, ((BAND, both),), {**entry, "critical": {"bracket": "1/10 1/4", **proof}})
    falling = law({"1.2": 1, "0.5": 1})  # not monotone at 0.01 V, say
    tiny = {"rule": "monotone-enclosure", "data": {"points": "1/1000000000 2", "bits": "160"}}
    fails(
        "may be negative", check_load, ((BAND, falling),), {**entry, "critical": {"bracket": "0 1/1000000000", **tiny}}
    )
