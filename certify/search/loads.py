"""Proofs that the static loads at a node are monotone, by one method or by the cheapest that decides (THEORY 5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise

from certify.kernel import loads
from certify.kernel.claims import Context
from certify.kernel.errors import RuleFailure
from certify.kernel.load_proofs import Case
from certify.kernel.model import LoadLaw, Pieces, law_at, law_corners, less_conductance
from certify.kernel.poly import Whole, bernstein_signs, substitute
from certify.kernel.powers import PRECISIONS
from certify.kernel.reader import Pair
from certify.search.proposal import Proposal, to_rows, to_text
from certify.search.roots import round_to_digits
from certify.search.voltages import find_pairs, find_touching, find_violations, least_eigenvalue, may_be_violated

MAX_CELLS = 1000
MAX_CUTS = 40  # of a band into cells for Bernstein coefficients; where it takes more, Sturm sequences cost less
SAMPLES = 1024
Data = dict[str, object] | None  # of a proof by some method; None if the method does not apply


def propose_load(pieces: Pieces, strongly: bool = False, method: str | None = None) -> Iterator[Proposal]:
    """What may prove the claim about a load, or refute it: by one method, or by all of them, the cheapest first.

    `strongly`: with a modulus of strong monotonicity, if there is one.
    """
    corners: list[tuple[str, Case]] = []
    try:
        for band, law in pieces:
            corners += [(signs, (band, law_at(law, signs))) for signs in law_corners(law)]
    except RuleFailure:  # a box of too many corners
        return
    cases = [case for _, case in corners]
    if method == "sampled":
        yield Proposal("conditional", "sampled", {"points": str(max(SAMPLES // len(cases), 1))})
    first = any(may_be_violated(law, band) for band, law in cases)
    if first:
        yield from _refutations(pieces)
    if strongly:
        yield from _strongly(cases, method)
    yield from _proofs(cases, method)
    if not first:
        yield from _refutations(pieces)


def propose_disk(context: Context, node: str, strongly: bool = False, method: str | None = None) -> Iterator[Proposal]:
    """The same for a load given by its current: by sums of squares, or evidence if that is asked for."""
    from certify.search.currents import propose_current

    if method == "sampled":
        yield Proposal("conditional", "sampled", {"points": str(SAMPLES)})
    try:
        law, centre, radius = context.disk(node)
    except RuleFailure:  # the sum of the loads is too large
        return
    for proposal in propose_current(law, centre, radius, strongly):
        if proposal.status == "refuted" or method in (None, "sos"):
            yield proposal


def _refutations(pieces: Pieces) -> Iterator[Proposal]:
    """Pairs of voltages at the values themselves, then at the corners of their tolerances."""
    for at_values in (True, False):
        for band, law in pieces:
            names = ["0" * len((*law.active, *law.reactive))] if at_values else law_corners(law)
            for signs in names:
                if not at_values and not set(signs) - {"0"}:
                    continue
                corner = law_at(law, signs, outer=False)
                for v in find_violations(corner, band):
                    for pair, t in find_pairs(corner, band, v):
                        data = {"v": str(v), "pair": to_text(pair), "t": str(t)}
                        yield Proposal("refuted", "voltage-pair", data | ({} if at_values else {"corner": signs}))


# --- methods ------------------------------------------------------------------------------------------------


def _proofs(cases: Sequence[Case], method: str | None) -> Iterator[Proposal]:
    cases = [case for case in cases if not loads.is_constant_admittance(case[1])]  # what is left needs a method
    for name, propose in METHODS.items():
        if method in (None, name):
            data = propose(cases)
            if data is not None:
                yield Proposal("proved", f"monotone-{name}", data)
                if name == "sturm" and len(cases) == 1:
                    return  # if that is no proof there is none; it is refused only for boxes that cost too much


def _no_data(_: Sequence[Case]) -> Data:
    return {}


def _ends(cases: Sequence[Case]) -> Data:
    """For one exponential law, or a ZIP load without negative parameters."""
    for _, law in cases:
        single = len(law.active) == 1 and len(law.reactive) <= 1
        terms = (*law.active, *(t for t in law.reactive if t.exponent != 2))
        if not single and any(t.exponent not in (0, 1, 2) or t.coefficient < 0 for t in terms):
            return None
    return {}


def _for_polynomials(
    propose: Callable[[Sequence[Case]], Data],
) -> Callable[[Sequence[Case]], Data]:
    return lambda cases: propose(cases) if all(loads.is_polynomial(law) for _, law in cases) else None


def _bernstein(cases: Sequence[Case]) -> Data:
    points: set[Fraction] = {v for band, _ in cases for v in band} or {Fraction(0)}
    for band, law in cases:
        found = find_cuts(loads.jacobian_polynomials(law), band)
        if found is None:
            return None
        points |= set(found)
    return {"points": to_text(tuple(sorted(points)))}


def _sos(cases: Sequence[Case]) -> Data:
    from certify.search.sos import find_gram_matrices

    grams = []
    for band, law in cases:
        found = []
        for p in loads.jacobian_polynomials(law):
            pair = find_gram_matrices(substitute(p, (band[0] + band[1]) / 2, (band[1] - band[0]) / 2))
            if pair is None:
                return None
            found += [to_rows(gram) for gram in pair]
        grams.append(found)
    return {"grams": grams}


def _enclosure(cases: Sequence[Case]) -> Data:
    for bits in PRECISIONS[:3]:
        points: set[Fraction] = {v for band, _ in cases for v in band} or {Fraction(0)}
        for band, law in cases:
            found = find_cells(law, band, bits)
            if found is None:
                break
            points |= set(found)
        else:
            return {"points": to_text(tuple(sorted(points))), "bits": str(bits)}
    return None


METHODS: dict[str, Callable[[Sequence[Case]], Data]] = {
    "ends": _ends,
    "bernstein": _for_polynomials(_bernstein),
    "sturm": _for_polynomials(_no_data),
    "enclosure": _enclosure,
    "sos": _for_polynomials(_sos),
}


def find_cuts(polynomials: Sequence[Whole], band: Pair) -> list[Fraction] | None:
    """Points between which no Bernstein coefficient is negative; None if they are too many, or a value is negative."""
    points, work = [band[0]], [band]
    while work:
        low, high = work.pop()
        signs = [bernstein_signs(p, low, high) for p in polynomials]
        if any(s and min(s[0], s[-1]) < 0 for s in signs) or len(points) > MAX_CUTS:
            return None
        if min(min(s, default=0) for s in signs) >= 0:
            points.append(high)
            continue
        middle = round_to_digits((low + high) / 2, 4)
        if not low < middle < high or len(work) > MAX_CUTS:
            return None
        work += [(middle, high), (low, middle)]
    return points


def find_cells(law: LoadLaw, band: Pair, bits: int) -> list[Fraction] | None:
    """Points between which enclosures tell that G and D are not negative; None if too many are needed.

    If plain bisection comes to a halt, D may vanish at a voltage that has to be one of the points.
    """
    found = _bisect(law, [band], bits)
    if found is None:
        ends = sorted({*band, *(v for v in find_touching(law, band) if band[0] < v < band[1])})
        found = _bisect(law, list(pairwise(ends))[::-1], bits) if len(ends) > 2 else None
    return found


def _bisect(law: LoadLaw, work: list[Pair], bits: int) -> list[Fraction] | None:
    known = {v: loads.enclose(law, v, bits) for band in work for v in band}
    points = [work[-1][0]]
    while work:
        low, high = work.pop()
        if loads.cell_sign(known[low], known[high]) is not None:
            points.append(high)
            continue
        middle = round_to_digits((low + high) / 2, 8)
        if not low < middle < high or len(points) + len(work) > MAX_CELLS:
            return None
        known[middle] = loads.enclose(law, middle, bits)
        if any(x[0][1] < 0 for x in known[middle][2]):
            return None
        work += [(middle, high), (low, middle)]
    return points


def _strongly(cases: Sequence[Case], method: str | None) -> Iterator[Proposal]:
    """Proofs with a modulus: a number of few digits below the smallest eigenvalue that floats show."""
    least = min(least_eigenvalue(law, band) for band, law in cases)
    for share, digits in ((0.999, 3), (0.95, 1), (0.5, 1), (0.1, 1), (0.01, 1)):
        if least * share > 1e-300:
            modulus = round_to_digits(Fraction(least * share), digits)
            shifted = [(band, less_conductance(law, modulus)) for band, law in cases]
            for proposal in _proofs(shifted, method):
                yield Proposal("proved", proposal.rule, proposal.data | {"modulus": str(modulus)})
