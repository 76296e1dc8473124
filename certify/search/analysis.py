"""All that is told of one load: whether it is monotone on its band, how strongly, and from which voltage on.

The result is an entry of a certificate; only the kernel accepts it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import chain
from typing import Any

from certify.kernel import loads
from certify.kernel.check_loads import CRITICAL_WIDTH, LoadVerdict, check_load
from certify.kernel.errors import RuleFailure
from certify.kernel.model import LoadLaw, Pieces, law_at, law_corners
from certify.kernel.poly import bernstein_signs, to_polynomial
from certify.search.loads import find_cells, find_cuts, propose_load
from certify.search.proposal import to_text
from certify.search.roots import find_negative_point, round_to_digits
from certify.search.voltages import float_law

Entry = dict[str, Any]
STEPS = (0.75,) * 48 + (0.1,) * 54  # by which floats look for it from the top of the band down, to 1e-60 of it
UNKNOWN: Entry = {"status": "unknown", "rule": None, "data": None, "critical": None}


def find_entries(pieces: Pieces, method: str | None = None) -> Iterator[Entry]:
    """Entries about a load, for the kernel to check: the first to come to mind, then one of parts that it accepts."""
    proposals = (
        {"status": p.status, "rule": p.rule, "data": p.data} for p in propose_load(pieces, method != "sampled", method)
    )
    criticals = ({"critical": critical} for critical in _criticals(pieces))
    first = (next(proposals, {}), next(criticals, {}))
    yield UNKNOWN | first[0] | first[1]
    yield UNKNOWN | _accepted(pieces, chain(first[:1], proposals)) | _accepted(pieces, chain(first[1:], criticals))


def analyse(pieces: Pieces, method: str | None = None) -> LoadVerdict:
    """What is shown of a load by the first entry that the kernel accepts."""
    for entry in find_entries(pieces, method):
        with suppress(RuleFailure):
            return check_load(pieces, entry)
    return check_load(pieces, UNKNOWN)


def _accepted(pieces: Pieces, options: Iterable[Entry]) -> Entry:
    for option in options:
        with suppress(RuleFailure):
            check_load(pieces, UNKNOWN | option)
            return option
    return {}


# --- the critical voltage -----------------------------------------------------------------------------------


def _criticals(pieces: Pieces) -> Iterator[Any]:
    """Brackets of the critical voltage of a load, each with what may prove it."""
    if len(pieces) != 1 or pieces[0][0][0] == 0:
        return
    ((_, top), law) = pieces[0]
    try:
        corners = [law_at(law, signs) for signs in law_corners(law)]
    except RuleFailure:
        return
    guesses = [_float_critical(corner, float(top)) for corner in corners]
    if math.inf in guesses:
        yield "never"
    lowest = max(guesses)
    if lowest == 0:
        yield {"bracket": "0 0", **_rule(corners, (Fraction(0), top))}
    elif lowest < float(top):
        for width in (Fraction(1, 10**12), CRITICAL_WIDTH / 3):  # narrower than it need be, for what rounding takes
            v = Fraction(lowest)
            ends = (round_to_digits(v * (1 - width), 13), round_to_digits(v * (1 + width), 13))
            if ends[1] < top:
                yield {"bracket": to_text(ends), **_rule(corners, (ends[1], top))}
    if all(loads.is_polynomial(corner) for corner in corners):
        yield from _exact(corners, top)
    elif lowest <= top * CRITICAL_WIDTH:
        bound = round_to_digits(top * CRITICAL_WIDTH * Fraction(9, 10), 2)
        yield {"bracket": to_text((Fraction(0), bound)), **_rule(corners, (bound, top))}


def _rule(corners: list[LoadLaw], band: tuple[Fraction, Fraction]) -> Entry:
    """By what a load is to be proved monotone above its critical voltage."""
    if all(loads.is_polynomial(law) for law in corners):
        if len(corners) == 1 and find_cuts(loads.jacobian_polynomials(corners[0]), band) == list(band):
            return {"rule": "monotone-bernstein", "data": {"points": to_text(band)}}
        return {"rule": "monotone-sturm", "data": {}}
    if all(len(law.active) == 1 and len(law.reactive) <= 1 for law in corners):
        return {"rule": "monotone-ends", "data": {}}
    points = set(band)
    for law in corners:
        points |= set(find_cells(law, band, 160) or ()) if band[0] else set()
    return {"rule": "monotone-enclosure", "data": {"points": to_text(tuple(sorted(points))), "bits": "160"}}


def _float_critical(law: LoadLaw, top: float) -> float:
    """Where G or D turns negative below the top: 0 if nowhere as far as floats look, infinity if at the top itself."""
    values = float_law(law)

    def fails(v: float) -> bool:
        G, radial, cross = values(v)
        return G < 0 or G * radial < cross * cross / 4

    if fails(top):
        return math.inf
    good = top
    exponential = _exponential_critical(law, top)
    if exponential is not None:
        return exponential
    for step in STEPS[:48] if loads.is_polynomial(law) else STEPS:
        bad = good * step
        if fails(bad):
            while good - bad > 1e-16 * good and (middle := (good + bad) / 2) not in (good, bad):
                good, bad = (good, middle) if fails(middle) else (middle, bad)
            return good
        good = bad
    return 0.0


def _exponential_critical(law: LoadLaw, below: float) -> float | None:
    """Where 4 (np - 1) P^2 = (nq - 2)^2 Q^2, if the load is one exponential law; 0 if that is nowhere below a voltage.

    Nearly equal exponents put it many decades below the band.
    """
    if len(law.active) != 1 or len(law.reactive) != 1:
        return None
    (P,), (Q,) = law.active, law.reactive
    ratio = (Q.exponent - 2) * Q.coefficient / P.coefficient
    if P.exponent <= 1 or P.exponent <= Q.exponent or not ratio:
        return 0.0
    logarithm = _log(ratio) - _log(4 * (P.exponent - 1)) / 2 + float(Q.exponent) * _log(P.base_volt / Q.base_volt)
    logarithm = _log(P.base_volt) + logarithm / float(P.exponent - Q.exponent)
    return math.exp(logarithm) if -600 < logarithm < math.log(below) else 0.0


def _log(x: Fraction) -> float:
    """ln |x|, also of what no float holds."""
    return math.log(abs(x.numerator)) - math.log(x.denominator)


def _exact(corners: list[LoadLaw], top: Fraction) -> Iterator[Any]:
    """By bisection with exact signs only: for what floats cannot tell, such as roots that lie close together."""
    polynomials = [p for law in corners for p in loads.jacobian_polynomials(law)]
    low, high = Fraction(0), top
    for p in polynomials:
        signs = bernstein_signs(p, Fraction(0), top)
        omega = find_negative_point(to_polynomial(signs))
        if omega is not None:
            low = max(low, top * omega**2 / (1 + omega**2))
    if not low:
        yield {"bracket": "0 0", **_rule(corners, (low, top))}
        return
    for _ in range(200):
        if high - low <= CRITICAL_WIDTH * high / 2:
            break
        middle = round_to_digits((low + high) / 2, 14)
        omegas = (find_negative_point(to_polynomial(bernstein_signs(p, middle, top))) for p in polynomials)
        found = [(middle + top * omega**2) / (1 + omega**2) for omega in omegas if omega is not None]
        low, high = (max(*found, low), high) if found else (low, middle)
    if high < top:
        ends = (round_to_digits(low, 40), high)
        yield {"bracket": to_text(ends), **_rule(corners, (high, top))}
