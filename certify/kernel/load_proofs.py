"""The proofs about loads: from the pieces of a load's law and the data of a certificate to the theorems of `loads`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from itertools import pairwise

from certify.kernel import loads
from certify.kernel.claims import Context, Fact, corner_facts, to_text
from certify.kernel.data import Data
from certify.kernel.errors import require
from certify.kernel.model import LoadLaw, Pieces, law_at, law_corners, less_conductance
from certify.kernel.powers import PRECISIONS
from certify.kernel.reader import Pair

# What a proof may cost, where a box of tolerances multiplies it: corners times the size of the work at each of them.
MAX_LOAD_WORK = 1 << 21  # squared degree times bits of a coefficient
MAX_CELL_WORK = 1 << 17  # points times bits
MAX_GRAM_WORK = 400_000  # characters of all Gram matrices
MAX_SAMPLES = 4096

Case = tuple[Pair, LoadLaw]  # one piece of the band, and the law there at one corner of its tolerances


def check_monotone(pieces: Pieces, method: str, data: Data, modulus: Fraction = Fraction(0)) -> bool:
    """Whether a load is strictly monotone on all of its band; fails unless it is shown to be monotone.

    At every corner of the coefficients: the symmetric part of the Jacobian is linear in them (THEORY 5). With a
    modulus m it is I - m V that is monotone.
    """
    corners = [(band, law_at(law, signs)) for band, law in pieces for signs in law_corners(law)]
    cases = [(band, less_conductance(law, modulus) if modulus else law) for band, law in corners]
    # A constant admittance needs no method, and none of the others would do at v = 0.
    plain = [loads.constant_admittance(law) for _, law in cases if loads.is_constant_admittance(law)]
    strict = METHODS[method]([case for case in cases if not loads.is_constant_admittance(case[1])], data)
    return strict and all(plain)


def _ends(cases: Sequence[Case], data: Data) -> bool:
    data.fields()
    return _all(loads.monotone_ends(law, band) for band, law in cases)


def _sturm(cases: Sequence[Case], data: Data) -> bool:
    data.fields()
    _limit_work(cases)
    return _all(loads.monotone_sturm(law, band) for band, law in cases)


def _bernstein(cases: Sequence[Case], data: Data) -> bool:
    points = data.fields("points")[0].vector()
    _limit_work(cases, len(points))
    return _all(loads.monotone_bernstein(law, _cells(points, band)) for band, law in cases)


def _sos(cases: Sequence[Case], data: Data) -> bool:
    grams = data.fields("grams")[0].items()
    require(len(grams) == len(cases), "a proof by sums of squares has one list of Gram matrices for each corner")
    require(data.size() <= MAX_GRAM_WORK, "the Gram matrices are too large")
    lists = [[matrix.matrix() for matrix in entry.items()] for entry in grams]
    return _all(loads.monotone_sos(law, band, own) for (band, law), own in zip(cases, lists, strict=True))


def _enclosure(cases: Sequence[Case], data: Data) -> bool:
    points, bits = (part.vector() for part in data.fields("points", "bits"))
    require(len(bits) == 1 and bits[0] in PRECISIONS[:3], "the precision is absurd")
    require(len(cases) * len(points) * bits[0] <= MAX_CELL_WORK, "too many points, bits or corners")
    return _all(loads.monotone_enclosure(law, _cells(points, band), bits[0].numerator) for band, law in cases)


def _sampled(cases: Sequence[Case], data: Data) -> bool:
    count = data.fields("points")[0].scalar()
    require(count.denominator == 1 and 0 < count <= MAX_SAMPLES // max(len(cases), 1), "the number of points is absurd")
    for band, law in cases:
        loads.sampled(law, band, count.numerator)
    return False


METHODS: dict[str, Callable[[Sequence[Case], Data], bool]] = {
    "monotone-ends": _ends,
    "monotone-sturm": _sturm,
    "monotone-bernstein": _bernstein,
    "monotone-sos": _sos,
    "monotone-enclosure": _enclosure,
    "sampled": _sampled,
}


def _all(results: Iterable[bool]) -> bool:
    """Whether all are true, having looked at each: a case that fails raises."""
    return all(list(results))


def _cells(points: Sequence[Fraction], band: Pair) -> tuple[Fraction, ...]:
    """The points inside a band between its ends."""
    require(all(a < b for a, b in pairwise(points)), "the points do not increase")
    return (band[0], *(v for v in points if band[0] < v < band[1]), band[1])


def _limit_work(cases: Sequence[Case], points: int = 1) -> None:
    """Against a box of tolerances, or a list of points, that multiplies the work with polynomials of many digits."""
    work = points * sum(law_work(law) for _, law in cases)
    require(len(cases) == points == 1 or work <= MAX_LOAD_WORK, "too many corners or points")


def law_work(law: LoadLaw) -> int:
    """What one Sturm sequence of a law costs, about: squared degree times bits."""
    terms = (*law.active, *law.reactive)
    degree = max((int(term.exponent) for term in terms), default=0)
    numbers = [x for t in terms for x in (t.coefficient, t.spread)]
    return degree**2 * max((x.numerator.bit_length() + x.denominator.bit_length() for x in numbers), default=0)


# --- handlers -------------------------------------------------------------------------------------------------


def monotone(method: str) -> Callable[[Context, str, Data], tuple[Fact, ...]]:
    """The handler of one method for the claim about the load at a node."""

    def handler(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
        given, rest = data.optional("modulus")
        modulus = given.scalar() if given else Fraction(0)
        require(modulus > 0 or given is None, "the modulus is not positive")
        pieces = context.pieces(name)
        key = (method, pieces, json.dumps(data.raw, sort_keys=True))
        if context.once(key, lambda: check_monotone(pieces, method, rest, modulus)) or modulus:
            context.strict_loads.add(name)
        context.moduli[name] = modulus
        facts: tuple[Fact, ...] = (("strictly monotone", Fraction(int(name in context.strict_loads)), ""),)
        return (*facts, ("strongly monotone with modulus", modulus, "S")) if modulus else facts

    return handler


def sampled(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """Evidence, not a proof: the claim becomes an assumption of the ledger."""
    pieces = context.pieces(name)
    context.once(("sampled", pieces, json.dumps(data.raw)), lambda: check_monotone(pieces, "sampled", data))
    context.sampled.add(name)
    return (("voltages tried without a violation", data.fields("points")[0].scalar(), ""),)


def pair(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """The handler of `voltage-pair`."""
    return check_pair(context.pieces(name), data)


def check_pair(pieces: Pieces, data: Data) -> tuple[Fact, ...]:
    """Fails unless two voltages refute the claim: at one corner of the tolerances, on one piece of the band."""
    signs, rest = data.corner()
    v, ends, t = rest.fields("v", "pair", "t")
    volts = (v.scalar(), *ends.vector())
    require(len(volts) == 3, "a pair has two voltages")
    around = [(band, law) for band, law in pieces if all(band[0] <= x <= band[1] for x in volts)]
    require(bool(around), "the voltages are not within one piece of the band")
    band, law = around[0]
    terms = (*law.active, *law.reactive)
    signs = signs or "0" * len(terms)
    require(len(signs) == len(terms), "a corner has one sign for each term")
    require(all(sign == "0" or x.spread for sign, x in zip(signs, terms, strict=True)), "no tolerance there")
    at_corner = law_at(law, signs, outer=False)
    product = loads.voltage_pair(at_corner, band, volts[0], (volts[1], volts[2]), t.scalar())
    quantities = (
        (f"{part} / (v / {to_text(x.base_volt)} V)^{to_text(x.exponent)}", x.coefficient, unit)
        for part, unit, side in (("P", "W", at_corner.active), ("Q", "var", at_corner.reactive))
        for x in side
    )
    facts = [("linearisation not passive at", volts[0], "V"), *(("voltage of the pair", e, "V") for e in volts[1:])]
    facts.append(("tangent of half the angle between them", t.scalar(), ""))
    facts.append(("violating product, at most", product[1], "W"))
    return (*(corner_facts(signs, quantities) if signs.strip("0") else ()), *facts)
