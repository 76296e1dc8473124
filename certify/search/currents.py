"""Proofs and refutations of the monotonicity, on a disk, of a load given by rational functions of (Vd, Vq)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import Any

from certify.kernel.currents import Bivariate, CurrentLaw, add, recentred, total_degree
from certify.kernel.disks import (
    MAX_SUM_DEGREE,
    DiskSum,
    Form,
    current_pair,
    denominator_form,
    jacobian_form,
    jacobian_numerators,
    sum_of_squares,
)
from certify.kernel.errors import RuleFailure
from certify.kernel.reader import Pair
from certify.search.disk_sums import find_sum
from certify.search.proposal import Proposal, to_rows, to_text
from certify.search.roots import round_to_digits

SHARES = (0.95, 0.5, 0.1, 0.01)  # of what floats show, tried as a modulus or as a margin
GRID = 8  # steps along a radius in the search for pairs
DESCENTS = 6
STEPS = 120  # of one descent
MORE_DEGREES = 2  # above the least one possible
NEGLIGIBLE = 1e-9  # relative to the sizes of a Jacobian: what floats cannot tell from zero


@dataclass(frozen=True)
class View:
    """A law in floats on the unit disk; currents and denominator are divided by their largest coefficients."""

    numerators: tuple[Bivariate, Bivariate]
    denominator: Bivariate
    jacobian: tuple[Bivariate, ...]
    siemens: Fraction  # of an eigenvalue of 1

    def currents(self, points: Any) -> Any:
        """Shape: (2, number of points), like `points`."""
        import numpy

        q = _values(self.denominator, points)
        return numpy.array([_values(p, points) / q for p in self.numerators])

    def eigenvalue(self, points: Any) -> Any:
        """The smaller one of the symmetric part of the Jacobian at each point."""
        import numpy

        a, b, c, d = (_values(p, points) for p in self.jacobian)
        value = (a + d) / 2 - numpy.hypot((a - d) / 2, (b + c) / 2)
        return numpy.nan_to_num(value / _values(self.denominator, points) ** 2, nan=numpy.inf)

    def size(self, points: Any) -> float:
        """Of the entries of the Jacobian, at most, where they are finite."""
        import numpy

        q = _values(self.denominator, points) ** 2
        values = numpy.array([_values(p, points) / q for p in self.jacobian])
        return float(numpy.abs(values[numpy.isfinite(values)]).max(initial=0.0))


def _values(p: Bivariate, points: Any) -> Any:
    import numpy

    total = numpy.zeros(points.shape[1:])
    for (i, j), c in p:
        total = total + float(c) * points[0] ** i * points[1] ** j
    return total


def view_of(law: CurrentLaw, centre: Pair, radius: Fraction) -> View:
    def scaled(polynomials: Iterable[Bivariate]) -> tuple[list[Bivariate], Fraction]:
        parts = [recentred(p, centre, radius) for p in polynomials]
        largest = max((abs(c) for p in parts for _, c in p), default=Fraction(1))
        return [add((), p, 1 / largest) for p in parts], largest

    (q,), q_size = scaled([law.denominator])
    parts, size = scaled(law.numerators)
    J = jacobian_numerators(q, (parts[0], parts[1]))
    return View((parts[0], parts[1]), q, tuple(p for row in J for p in row), size / (q_size * radius))


def propose_current(law: CurrentLaw, centre: Pair, radius: Fraction, strongly: bool = False) -> Iterator[Proposal]:
    """Two voltages that refute, if floats see a place for them; else sums of squares that prove.

    `strongly`: first with a modulus of strong monotonicity, if there is one.
    """
    import numpy

    with numpy.errstate(all="ignore"):
        view = view_of(law, centre, radius)
        points = sunflower(600)
        places = descend(view.eigenvalue, points)
        least = float(view.eigenvalue(places).min())
        q = _values(view.denominator, points)
        pole = bool(q.min() <= 0 <= q.max())
        negligible = NEGLIGIBLE * view.size(points)
        if least < negligible or pole:
            pair = find_pair(law, centre, radius, view, places)
            if pair is not None:
                yield Proposal("refuted", "current-pair", {"U": to_text(pair[0]), "V": to_text(pair[1])})
                return
        if pole or not -negligible <= least < numpy.inf:
            return
        denominator = None
        if total_degree(law.denominator) > 0:
            denominator = _denominator(law, centre, radius, view, points)
            if denominator is None:
                return
    nearby = simple_points(places)
    moduli = [round_to_digits(Fraction(least * share) * view.siemens, 1) for share in SHARES if least > negligible]
    for modulus in chain(moduli if strongly else (), (Fraction(0),)):
        found = _sum(jacobian_form(law, centre, radius, modulus), 2, nearby)
        if found is not None:
            data = {**found, **(denominator or {}), **({"modulus": str(modulus)} if modulus else {})}
            yield Proposal("proved", "monotone-disk", data)
            return


def _denominator(law: CurrentLaw, centre: Pair, radius: Fraction, view: View, points: Any) -> dict[str, Any] | None:
    """The margin of the denominator and its proof, as data."""
    import numpy

    def size(p: Any) -> Any:
        return numpy.abs(_values(view.denominator, p))

    least = float(size(descend(size, points)).min())
    scale = max(abs(c) for _, c in recentred(law.denominator, centre, radius))
    for share in SHARES if 0 < least < numpy.inf else ():
        margin = round_to_digits(Fraction(least * share) * scale, 1)
        found = _sum(denominator_form(law, centre, radius, margin), 1)
        if found is not None:
            return {"denominator": {"margin": str(margin), **found}}
    return None


def simple_points(places: Any) -> list[Pair]:
    """Points of the disk near these places, with small denominators."""
    result = set()
    for limit in (10, 100):
        columns, rows = ({Fraction(float(e)).limit_denominator(limit) for e in part} | {Fraction(0)} for part in places)
        result |= {(x, y) for x in columns for y in rows if x * x + y * y <= 1}
    return sorted(result)


def _sum(form: Form, components: int, places: Sequence[Pair] = ()) -> dict[str, Any] | None:
    """A sum of squares that the kernel accepts, as data."""

    def accept(proof: DiskSum) -> bool:
        try:
            sum_of_squares(form, components, proof)
        except RuleFailure:
            return False
        return True

    least = (max((i + j for i, j, _, _ in form), default=0) + 1) // 2
    for degree in range(least, min(least + MORE_DEGREES, MAX_SUM_DEGREE) + 1):
        proof = find_sum(form, components, degree, accept, places)
        if proof is not None:
            return {"degree": str(proof.degree), "gram": to_rows(proof.gram), "disk": to_rows(proof.disk)}
    return None


# --- looking around in floats ---------------------------------------------------------------------------------------


def sunflower(count: int) -> Any:
    """Points spread evenly over the unit disk, the last ones on its border. Shape: (2, about 1.2 count)."""
    import numpy

    k = numpy.arange(count) + 0.5
    angle, edge = k * numpy.pi * (3 - 5**0.5), numpy.linspace(0, 2 * numpy.pi, count // 5, endpoint=False)
    inner = numpy.sqrt(k / count) * numpy.array([numpy.cos(angle), numpy.sin(angle)])
    return numpy.hstack([numpy.zeros((2, 1)), inner, numpy.array([numpy.cos(edge), numpy.sin(edge)])])


def descend(function: Callable[[Any], Any], points: Any) -> Any:
    """The places of the smallest values, each followed downhill inside the disk, best first. Shape: (2, DESCENTS)."""
    import numpy

    start = points[:, numpy.argsort(function(points))[:DESCENTS]]
    angle = numpy.arange(12) * numpy.pi / 6
    ways = numpy.array([numpy.cos(angle), numpy.sin(angle)])
    for k in range(DESCENTS):
        place, step = start[:, k], 0.1
        value = function(place[:, None])[0]
        for _ in range(STEPS):
            if step < 1e-9:
                break
            tried = place[:, None] + step * ways
            tried = tried / numpy.maximum(1.0, numpy.hypot(*tried))
            values = function(tried)
            best = int(values.argmin())
            if values[best] < value:
                place, value = tried[:, best], values[best]
            else:
                step /= 3
        start[:, k] = place
    return start[:, numpy.argsort(function(start))]


def find_pair(law: CurrentLaw, centre: Pair, radius: Fraction, view: View, places: Any) -> tuple[Pair, Pair] | None:
    """Two voltages with few digits that the kernel accepts as a refutation, or None."""
    for ends in chain(_far_pairs(view), _near_pairs(view, places)):
        U, V = ((centre[0] + radius * x, centre[1] + radius * y) for x, y in ends)
        try:
            current_pair(law, centre, radius, U, V)
        except RuleFailure:
            continue
        return U, V
    return None


def _far_pairs(view: View) -> Iterator[tuple[Pair, Pair]]:
    """Points of a grid, the most negative products by squared distance first."""
    import numpy

    steps = range(-GRID, GRID + 1)
    grid = [(i, j) for i in steps for j in steps if i * i + j * j <= GRID**2]
    points = numpy.array(grid).T / GRID
    away = points[:, :, None] - points[:, None, :]
    current = view.currents(points)
    product = (away * (current[:, :, None] - current[:, None, :])).sum(axis=0)
    slope = product / numpy.maximum((away**2).sum(axis=0), 1e-9)
    slope[~numpy.isfinite(slope)] = 0.0
    for index in numpy.argsort(slope, axis=None)[:3]:
        a, b = numpy.unravel_index(index, slope.shape)
        if slope[a, b] < 0:
            first, second = ((Fraction(grid[k][0], GRID), Fraction(grid[k][1], GRID)) for k in (int(a), int(b)))
            yield first, second


def _near_pairs(view: View, places: Any) -> Iterator[tuple[Pair, Pair]]:
    """Points on both sides of a place, along the direction in which the Jacobian is least, closer and closer."""
    import numpy

    for x, y in places.T[:3]:
        a, b, c, d = (float(_values(p, numpy.array([[x], [y]]))[0]) for p in view.jacobian)
        symmetric = numpy.array([[a, (b + c) / 2], [(b + c) / 2, d]])
        if not numpy.isfinite(symmetric).all():
            continue
        direction = numpy.linalg.eigh(symmetric)[1][:, 0]
        for k in range(3, 36, 2):
            digits, h = 2 + k // 3, Fraction(1, 2**k)
            # the point moved inwards, so that both ends stay in the disk
            middle = [Fraction(round(float(e) * 10**digits), 10**digits) * (1 - 2 * h) for e in (x, y)]
            way = [Fraction(round(float(e) * 100), 100) for e in direction]
            low, high = ([m + s * h * w for m, w in zip(middle, way, strict=True)] for s in (-1, 1))
            yield (low[0], low[1]), (high[0], high[1])
