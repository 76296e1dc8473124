"""Margins of many loads at many voltages at once, in floats: for pictures, never for a verdict (THEORY 5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from certify.kernel.model import LoadLaw

if TYPE_CHECKING:
    import numpy
    from numpy.typing import NDArray

    Floats = NDArray[numpy.float64]

ROWS = 250  # loads at a time: the arrays stay small enough for the cache
NOISE = 1e-12  # relative to the sum of all terms: below, floats cannot tell a sign, and the margin is shown as zero


def load_margins(loads: Sequence[tuple[LoadLaw, Fraction]], voltages_pu: Floats) -> Floats:
    """Smallest eigenvalue of the symmetric part of the Jacobian of I(V), for each load and each |V| / V0.

    Shapes: loads n pairs (law, V0 in volt), voltages_pu (m,); result (n, m).
    Units:  per unit of the load's own admittance |S(V0)| / V0^2; of 1 VA / V0^2 if S(V0) = 0.
    A law counts with its values themselves: tolerances are left out.
    """
    import numpy

    parts = [
        _rows(loads[start : start + ROWS], numpy.log(voltages_pu), numpy)
        for start in range(0, max(len(loads), 1), ROWS)
    ]
    return numpy.concatenate(parts)


def smallest(G: Floats, radial: Floats, cross: Floats) -> Floats:
    """Smallest eigenvalue of [[radial, cross / 2], [cross / 2, G]], with radial = G + v G' and cross = v B'."""
    import numpy

    result: Floats = (G + radial) / 2 - numpy.hypot((radial - G) / 2, cross / 2)
    return result


def _rows(loads: Sequence[tuple[LoadLaw, Fraction]], logs: Floats, numpy: Any) -> Floats:
    scaled = [_scaled(law, V0) for law, V0 in loads]
    width = max((len(terms) for terms in scaled), default=0)
    w, e, of_Q = numpy.zeros((3, len(scaled), width))
    for row, terms in enumerate(scaled):
        if terms:
            w[row, : len(terms)], e[row, : len(terms)], of_Q[row, : len(terms)] = zip(*terms, strict=True)
    # each term of P / v^2 or Q / v^2 is w v^(e - 2); what it adds to G, v G' + G, v B', and to the size of it all
    of_P = 1 - of_Q
    weights = numpy.stack((of_P * w, of_P * (e - 1) * w, -of_Q * (e - 2) * w, (1 + abs(e)) * abs(w)), axis=1)
    powers = numpy.exp((e[:, :, None] - 2) * logs)
    G, radial, cross, size = numpy.moveaxis(weights @ powers, 1, 0)
    result: Floats = smallest(G, radial, cross)
    result[abs(result) <= NOISE * size] = 0
    return result


def _scaled(law: LoadLaw, V0: Fraction) -> list[tuple[float, float, float]]:
    """(share of |S(V0)|, exponent, 1 if reactive) of each term; by logarithms, since v^100 would overflow."""
    found, nominal = [], _log(V0)
    for kind, terms in ((0.0, law.active), (1.0, law.reactive)):
        for term in terms:
            if term.coefficient.numerator:
                e = float(term.exponent)
                size = _log(term.coefficient) + e * (nominal - _log(term.base_volt))
                found.append((size, 1.0 if term.coefficient.numerator > 0 else -1.0, e, kind))
    top = max((size for size, *_ in found), default=0.0)
    shares = [(sign * math.exp(size - top), e, kind) for size, sign, e, kind in found]
    P, Q = (math.fsum(share for share, _, kind in shares if kind == part) for part in (0.0, 1.0))
    whole = math.hypot(P, Q)
    if whole <= NOISE:  # nothing is drawn at V0
        whole = math.exp(-min(top, 700.0))
    return [(share / whole, e, kind) for share, e, kind in shares]


def _log(x: Fraction) -> float:
    """ln |x|, for numbers of any size."""
    return math.log(abs(x.numerator)) - math.log(x.denominator)
