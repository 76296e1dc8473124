"""The proofs about loads: from the pieces of a load's law and the data of a certificate to the theorems of `loads`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from itertools import pairwise

from certify.kernel import disks, loads
from certify.kernel.claims import Context, Fact, corner_facts, to_text
from certify.kernel.data import Data
from certify.kernel.errors import require
from certify.kernel.model import LoadLaw, Pieces, law_at, law_corners, less_conductance
from certify.kernel.powers import PRECISIONS
from certify.kernel.reader import Pair

# What a proof may cost, where a box of tolerances multiplies it: corners times the size of the work at each of them.
MAX_LOAD_WORK = 1 << 21  # squared degree times bits of a coefficient
MAX_CELL_WORK = 1 << 17  # points times bits
MAX_POWER_WORK = 1 << 35  # squared bits of the whole powers of the points
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
    _limit_work(cases, points)
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
    work = sum((_bits(v) * _whole_power(law)) ** 2 for _, law in cases for v in points)
    require(work <= MAX_POWER_WORK, "the points have too many digits")
    return _all(loads.monotone_enclosure(law, _cells(points, band), bits[0].numerator) for band, law in cases)


def _sampled(cases: Sequence[Case], data: Data) -> bool:
    count = _read_count(data, MAX_SAMPLES // max(len(cases), 1))
    for band, law in cases:
        loads.sampled(law, band, count)
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


def _limit_work(cases: Sequence[Case], points: Sequence[Fraction] = (Fraction(1),)) -> None:
    """Against a box of tolerances, or a list of points, that multiplies the work with polynomials of many digits."""
    work = sum(law_work(law, _bits(v)) for _, law in cases for v in points)
    require(len(cases) == len(points) == 1 or work <= MAX_LOAD_WORK, "too many corners or points")


def _bits(x: Fraction) -> int:
    return x.numerator.bit_length() + x.denominator.bit_length()


def _whole_power(law: LoadLaw) -> int:
    """The largest power of a voltage that enclosures take exactly."""
    exponents = [t.exponent - 2 for t in (*law.active, *law.reactive)]
    return max((abs(e.numerator) for e in exponents if e.denominator == 1 and abs(e) <= 64), default=1)


def law_work(law: LoadLaw, bits: int = 0) -> int:
    """What one Sturm sequence of a law costs, about: squared degree times bits, of a coefficient or as given."""
    terms = (*law.active, *law.reactive)
    degree = max((int(term.exponent) for term in terms), default=0)
    numbers = [x for t in terms for x in (t.coefficient, t.spread)]
    return degree**2 * max((bits, *map(_bits, numbers)))


# --- handlers -------------------------------------------------------------------------------------------------


def read_modulus(data: Data) -> tuple[Fraction, Data]:
    """The modulus of strong monotonicity that a proof states, 0 if none, and the proof without it."""
    given, rest = data.optional("modulus")
    modulus = given.scalar() if given else Fraction(0)
    require(modulus > 0 or given is None, "the modulus is not positive")
    return modulus, rest


def _strictness(strict: bool, modulus: Fraction) -> tuple[Fact, ...]:
    facts: tuple[Fact, ...] = (("strictly monotone", Fraction(int(strict)), ""),)
    return (*facts, ("strongly monotone with modulus", modulus, "S")) if modulus else facts


def _read_count(data: Data, limit: int) -> int:
    """How many points are sampled."""
    count = data.fields("points")[0].scalar()
    require(count.denominator == 1 and 0 < count <= limit, "the number of points is absurd")
    return count.numerator


def monotone(method: str) -> Callable[[Context, str, Data], tuple[Fact, ...]]:
    """The handler of one method for the claim about the load at a node."""

    def handler(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
        modulus, rest = read_modulus(data)
        pieces = context.pieces(name)
        key = (method, pieces, json.dumps(data.raw, sort_keys=True))
        if context.once(key, lambda: check_monotone(pieces, method, rest, modulus)) or modulus:
            context.strict_loads.add(name)
        context.moduli[name] = modulus
        return _strictness(name in context.strict_loads, modulus)

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


def disk(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """The handler of `monotone-disk`."""
    law, centre, radius = context.disk(name)
    modulus, rest = read_modulus(data)
    below, rest = rest.optional("denominator")
    denominator = None
    if below is not None:
        margin, inner = below.optional("margin")
        require(margin is not None, "the denominator has no margin")
        context.margins[name] = margin.scalar() if margin else Fraction(0)
        denominator = (context.margins[name], _disk_sum(inner))
    strict = disks.monotone_disk(law, centre, radius, _disk_sum(rest), denominator, modulus)
    if strict:
        context.strict_loads.add(name)
    context.moduli[name] = modulus
    return _strictness(strict, modulus)


def _disk_sum(data: Data) -> disks.DiskSum:
    degree, gram, second = data.fields("degree", "gram", "disk")
    require(degree.scalar().denominator == 1, "a degree is a whole number")
    return disks.DiskSum(degree.scalar().numerator, gram.matrix(), second.matrix())


def sampled_disk(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """Evidence, as `sampled`, for a load given by its current."""
    count = _read_count(data, MAX_SAMPLES)
    disks.sampled_disk(*context.disk(name), count)
    context.sampled.add(name)
    return (("voltages tried without a violation", Fraction(count), ""),)


def current_pair(context: Context, name: str, data: Data) -> tuple[Fact, ...]:
    """The handler of `current-pair`."""
    U, V = (part.vector() for part in data.fields("U", "V"))
    require(len(U) == len(V) == 2, "a voltage has two components")
    product = disks.current_pair(*context.disk(name), (U[0], U[1]), (V[0], V[1]))
    named = [
        (f"{part} of voltage {k}", x, "V") for k, W in (("U", U), ("V", V)) for part, x in zip("dq", W, strict=True)
    ]
    return (*named, ("violating product", product, "W"))


def lipschitz(context: Context, name: str) -> Fraction:
    """A Lipschitz constant in siemens of the static load at a node, where its claim is made."""
    if context.nodes[name].current is None:
        pieces = context.pieces(name)
        bound: Fraction = context.once(("lipschitz", pieces), lambda: loads.lipschitz_bound(pieces))
        return bound
    return disks.lipschitz_bound_disk(*context.disk(name), context.margins.get(name, Fraction(0)))
