"""Gains from wishes: the fastest or the smallest passive design of a DGU, and an exact proof of its decay rate.

Every design is a member of the parametrisation of THEORY 4 with X = x I, Bm = b I, H = -h I + g J (J the rotation by
90 degrees): passive for all x, b, h > 0, because H Bm + Bm H' = -2 h b I. In complex notation the closed loop is

    C (s + j w0) + b / (L s + h - j g) + x / s = 0,

a capacitor, a damped branch and an inductor in parallel: a cubic whose coefficients are affine in (b, x) for a given
H, and in (b, h, g) for a given x. "The modes decay faster than sigma" is a linear matrix inequality in such
coefficients once a central polynomial is chosen (D. Henrion, M. Sebek, V. Kucera, "Positive polynomials and robust
stabilization with fixed-order controllers", IEEE Trans. Automatic Control 48(7), 2003), and so are bounds on the
gains: Clarabel improves a design by a few of these convex problems, a derivative-free search polishes it, and it is
rounded to few digits. Floats only propose: the rate is proved on the rational matrix F by Routh's scheme.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.kernel.linalg import Matrix, add, identity, multiply, scale
from certify.kernel.model import I2, J, LinearPort, dgu_port
from certify.kernel.spec import Dgu, Filter, StateFeedback
from certify.search.lmi import round_float
from certify.search.roots import magnitude
from certify.search.solvers import Block, minimise

KINDS = ("pi", "ida-pbc")
UNIT_GAIN = Fraction(1)  # gains below this cost nothing: the largest entry of K11 of a filter left alone is 1 at most
WORTH = Fraction(11, 10)  # a rotation in H must lower the gains, or raise the rate, by this factor to be used
SLACK = Fraction(1, 200)  # room left by the float search for the rounding
DIGITS = (2, 3, 4, 6, 9)


# --- the exact part ---------------------------------------------------------------------------------------------


def characteristic_polynomial(F: Matrix) -> tuple[Fraction, ...]:
    """Coefficients of det(s I - F), leading one first, by the recursion of Faddeev and LeVerrier. F is (n, n).

    >>> [int(c) for c in characteristic_polynomial(((Fraction(0), Fraction(1)), (Fraction(-2), Fraction(-3))))]
    [1, 3, 2]
    """
    n = len(F)
    coefficients, term = [Fraction(1)], identity(n)
    for k in range(1, n + 1):
        product = multiply(F, term)
        coefficients.append(-sum((product[i][i] for i in range(n)), Fraction(0)) / k)
        term = add(product, scale(coefficients[-1], identity(n)))
    return tuple(coefficients)


def is_hurwitz(coefficients: Iterable[Fraction]) -> bool:
    """Whether all roots of a real polynomial, leading coefficient first and not zero, have negative real parts.

    Routh's scheme: iff every entry of its first column has the sign of the leading one.

    >>> is_hurwitz(map(Fraction, [1, 3, 2])), is_hurwitz(map(Fraction, [1, 0, 1]))
    (True, False)
    """
    p = list(coefficients)
    p = [c / p[0] for c in p]
    upper, lower = p[0::2], p[1::2]
    while lower:
        if lower[0] <= 0:
            return False
        ratio = upper[0] / lower[0]
        padded = [*lower[1:], *[Fraction(0)] * (len(upper) - len(lower))]
        upper, lower = lower, [a - ratio * c for a, c in zip(upper[1:], padded, strict=True)]
    return True


def decays_at(F: Matrix, rate: Fraction) -> bool:
    """Whether every mode of x' = F x decays faster than exp(-rate t), decided exactly. `rate` in 1/s, of any sign."""
    return is_hurwitz(characteristic_polynomial(add(F, scale(rate, identity(len(F))))))


def decay_bracket(F: Matrix, digits: int = 4) -> tuple[Fraction, Fraction]:
    """(low, high) in 1/s around the decay rate of the slowest mode: low is proved, high is refuted, both exactly.

    They have so many significant digits and differ by one unit of the last one; a negative rate is growth.

    >>> decay_bracket(((Fraction(-2),),))
    (Fraction(1999, 1000), Fraction(2, 1))
    """
    polynomial = characteristic_polynomial(F)

    def proved(rate: Fraction) -> bool:
        return is_hurwitz(_shifted(polynomial, -rate))

    if proved(Fraction(0)):
        high = Fraction(1)
        while proved(high):
            high *= 16
        low = high / 16
        while not proved(low):
            low, high = low / 16, low
    else:
        low = Fraction(-1)
        while not proved(low):
            low *= 16
        high = low / 16
        while proved(high):
            low, high = high, high / 16
            if abs(high) < Fraction(1, 10**9):  # as good as zero: an undamped mode
                return low, Fraction(0)
    while True:
        unit = Fraction(10) ** (magnitude(high if high > 0 else low) + 1 - digits)
        steps = (low / unit).__floor__(), -((-high / unit).__floor__())
        if steps[1] - steps[0] <= 1:
            return steps[0] * unit, steps[1] * unit
        # halve on the grid of few digits once it is coarser than the interval
        middle = (low + high) / 2 if steps[1] - steps[0] > 64 else (sum(steps) // 2) * unit
        if proved(middle):
            low = middle
        else:
            high = middle


def _shifted(coefficients: tuple[Fraction, ...], by: Fraction) -> tuple[Fraction, ...]:
    """The coefficients of p(s + by), leading one first: repeated synthetic division."""
    p = list(coefficients)
    for end in range(len(p), 1, -1):
        for k in range(1, end):
            p[k] += by * p[k - 1]
    return tuple(p)


def to_decimal(x: Fraction) -> str:
    """A rational with a finite decimal expansion, exactly; what has none, to 40 significant digits.

    >>> to_decimal(Fraction(1, 8)), to_decimal(Fraction(-230000000)), to_decimal(Fraction(3, 10**9))
    ('0.125', '-230000000', '3E-9')
    """
    from decimal import Context

    exact = Context(prec=40).divide(*(Context(prec=400).create_decimal(n) for n in x.as_integer_ratio()))
    exact = Context(prec=40).normalize(exact)
    return f"{exact:f}" if -6 <= exact.adjusted() < 15 else str(exact)


def to_percent(share: Fraction) -> str:
    """A share as a spec writes it.

    >>> to_percent(Fraction(123, 1000))
    '12.3 %'
    """
    return f"{to_decimal(100 * share)} %"


@dataclass(frozen=True)
class Plant:
    """What a design depends on: the filter, all capacitance at the node, the speed of the frame. SI units."""

    resistance_ohm: Fraction
    inductance_henry: Fraction
    capacitance_farad: Fraction
    w0: Fraction


@dataclass(frozen=True)
class Design:
    """X = x I, Bm = b I, H = -h I + g J; x in V/(A s), b without unit, h and g in ohm. Passive iff x, b, h > 0."""

    x: Fraction
    b: Fraction
    h: Fraction
    g: Fraction = Fraction(0)

    def gains(self, plant: Plant) -> StateFeedback:
        """K11 = I - Bm - L X, K12 = H + R I + w0 L J, K13 = -H X (THEORY 4)."""
        H = add(scale(-self.h, I2), scale(self.g, J))
        K12 = add(H, add(scale(plant.resistance_ohm, I2), scale(plant.w0 * plant.inductance_henry, J)))
        return StateFeedback(scale(1 - self.b - plant.inductance_henry * self.x, I2), K12, scale(-self.x, H))

    def port(self, plant: Plant) -> LinearPort:
        """The closed loop of the DGU alone, as the kernel builds it."""
        own = Filter(plant.resistance_ohm, plant.inductance_henry, plant.capacitance_farad)
        return dgu_port(
            Dgu(own, self.gains(plant), (Fraction(1), Fraction(0)), None), plant.capacitance_farad, plant.w0
        )

    def largest_gain(self, plant: Plant) -> Fraction:
        """The largest absolute value of an entry of K11 (no unit), K12 (ohm) and K13 (V/(V s))."""
        return largest_gain(self.gains(plant))


def largest_gain(law: StateFeedback) -> Fraction:
    """The largest absolute value of an entry of K11, K12 and K13, each in its SI unit."""
    return max(abs(x) for K in (law.K11, law.K12, law.K13 or ()) for row in K for x in row)


# --- the search, in floats ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """What the search has come to.

    `design` meets the wishes, or is None; then `fastest` is the best design within the bound on the gains and
    `smallest` the one with the smallest gains for the rate, as far as the search sees. `plain` is the best design
    without rotation (g = 0), if `design` has one.
    """

    design: Design | None
    plain: Design | None = None
    fastest: Design | None = None
    smallest: Design | None = None


def find_design(plant: Plant, kind: str, rate: Fraction | None, max_gain: Fraction | None) -> Found:
    """As `_find`, and nothing if the numbers of the plant are out of the range of floats."""
    import numpy

    try:
        with numpy.errstate(all="ignore"):
            return _find(plant, kind, rate, max_gain)
    except (ArithmeticError, ValueError):
        return Found(None)


def _find(plant: Plant, kind: str, rate: Fraction | None, max_gain: Fraction | None) -> Found:
    """A design that decays faster than `rate` (1/s) with no gain above `max_gain`; at least one of them is given.

    Without a rate: the fastest. Without a bound: the smallest gains, where what is below one counts as one, and among
    equals the fastest. With both: the smallest gains as well, if they are within the bound. `kind` "ida-pbc" has no
    rotation in H. Deterministic.
    """
    rotations = (False, True) if kind == "pi" else (False,)
    search = _Search(plant)
    if rate is None:
        if max_gain is None:
            raise ValueError("neither a rate nor a bound on the gains")
        candidates = [d for d in (search.fastest(max_gain, free) for free in rotations) if d]
        best, plain = _choose(candidates, lambda d: 1 / _rate(d, plant))
        return Found(best, plain)
    least = [d for d in (search.smallest(rate, free) for free in rotations) if d]
    best, plain = _choose(least, lambda d: max(d.largest_gain(plant), UNIT_GAIN))
    cap = UNIT_GAIN if max_gain is None else min(UNIT_GAIN, max_gain)
    if best is not None and best.largest_gain(plant) <= cap:
        quick = [d for d in (search.fastest(cap, free) for free in rotations) if d]
        quick = [d for d in quick if decays_at(d.port(plant).F, rate)]
        if quick:
            best, plain = _choose(quick, lambda d: 1 / _rate(d, plant))
    if best is not None and (max_gain is None or best.largest_gain(plant) <= max_gain):
        return Found(best, plain)
    # A rotation that was not worth its while may be what it takes.
    smallest = min(least, key=lambda d: d.largest_gain(plant), default=None)
    if smallest is not None and max_gain is not None and smallest.largest_gain(plant) <= max_gain:
        return Found(smallest, plain if smallest.g else None)
    if max_gain is None:
        return Found(None)
    quick = [d for d in (search.fastest(max_gain, free) for free in rotations) if d]
    fastest = max(quick, key=lambda d: _rate(d, plant), default=None)
    if fastest is not None and decays_at(fastest.port(plant).F, rate):
        return Found(fastest)
    return Found(None, None, fastest, smallest)


def _rate(design: Design, plant: Plant) -> Fraction:
    """The proved decay rate of the slowest mode, in 1/s."""
    return decay_bracket(design.port(plant).F)[0]


def _choose(designs: list[Design], cost: Callable[[Design], Fraction]) -> tuple[Design | None, Design | None]:
    """The design without rotation unless one with it is clearly better; and then also the one without."""
    if not designs:
        return None, None
    plain = next((d for d in designs if not d.g), None)
    turned = next((d for d in designs if d.g), None)
    if plain is None or turned is None:
        return plain or turned, None
    return (turned, plain) if cost(turned) * WORTH < cost(plain) else (plain, None)


class _Search:
    """Designs q = (h, b, x, g) in floats, as arrays of shape (4, ...), for one plant."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.R, self.L = float(plant.resistance_ohm), float(plant.inductance_henry)
        self.C, self.w0 = float(plant.capacitance_farad), float(plant.w0)
        self.turn = self.w0 * self.L  # the size of rotations that make sense: they compete with j w0 L

    def polynomial(self, q: Any) -> Any:
        """Coefficients of s^0, s^1, s^2 of the monic complex cubic, shape (3, ...)."""
        import numpy

        h, b, x, g = q
        eta, beta, xi = (h - 1j * g) / self.L, b / (self.L * self.C), x / self.C
        return numpy.array([xi * eta, 1j * self.w0 * eta + beta + xi, 1j * self.w0 + eta])

    def rate(self, q: Any) -> Any:
        """Decay rate of the slowest mode in 1/s."""
        import numpy

        a = self.polynomial(q)
        companion = numpy.zeros((*a.shape[1:], 3, 3), complex)
        companion[..., 0, 1] = companion[..., 1, 2] = 1
        companion[..., 2, :] = -numpy.moveaxis(a, 0, -1)
        return -numpy.linalg.eigvals(companion).real.max(axis=-1)

    def entries(self, q: Any) -> list[Any]:
        """The different entries of K11, K12, K13; affine in (b, x) for given H, and in (b, h, g) for given x."""
        h, b, x, g = q
        return [1 - b - self.L * x, self.R - h, self.turn + g, h * x, g * x]

    def gain(self, q: Any) -> Any:
        import numpy

        return numpy.max(numpy.abs(self.entries(q)), axis=0)

    def smallest(self, rate: Fraction, rotation: bool) -> Design | None:
        """The design with the smallest largest entry that decays faster than `rate`."""
        import numpy

        wanted = float(rate * (1 + SLACK))
        start = self._generous(wanted)
        if start is None:
            return None

        def cost(q: Any) -> Any:
            shortage = numpy.maximum(0, 1 - self.rate(q) / wanted)
            return numpy.log(self.gain(q)) + numpy.where(shortage > 0, 30 + 100 * shortage, 0)

        q = self._scan(cost, float(self.gain(start)), rotation, [start])
        q = self._convex(q, wanted, rotation)
        q = self._polish(cost, q, float(self.gain(start)), rotation)
        return self._rounded(
            q,
            self.gain,
            lambda points: self.rate(points) > wanted * (1 - 2 * float(SLACK)),
            lambda d: decays_at(d.port(self.plant).F, rate),
        )

    def fastest(self, max_gain: Fraction, rotation: bool) -> Design | None:
        """The design whose slowest mode decays fastest, with no gain above `max_gain`."""
        import numpy

        bound = float(max_gain * (1 - SLACK))

        def cost(q: Any) -> Any:
            rate = numpy.maximum(self.rate(q), 1e-30)
            excess = numpy.maximum(0, self.gain(q) / bound - 1)
            return -numpy.log(rate) + numpy.where(excess > 0, 100 + 10 * excess, 0)

        q = self._scan(cost, bound, rotation, [])
        if self.gain(q) <= bound:
            q = self._faster(q, bound, rotation)
        q = self._polish(cost, q, bound, rotation)
        return self._rounded(
            q,
            lambda points: -self.rate(points),
            lambda points: self.gain(points) < bound * (1 + 2 * float(SLACK)),
            lambda d: d.largest_gain(self.plant) <= max_gain and decays_at(d.port(self.plant).F, Fraction(0)),
        )

    def _generous(self, rate: float) -> Any:
        """Some design that is fast enough: three equal modes at ever higher speed, where w0 no longer matters."""
        import numpy

        for k in range(60):
            speed = rate * 1.5**k
            q = numpy.array([3 * speed * self.L, 8 / 3 * speed**2 * self.L * self.C, speed**2 * self.C / 3, 0.0])
            if self.rate(q) >= rate:
                return q
        return None

    def _box(self, gain: float, rotation: bool) -> Any:
        """Bounds of (log h, log b, log x, g): a larger h, b or x needs a gain above `gain`."""
        import numpy

        top = numpy.log([self.R + gain, 1 + gain, (1 + gain) / self.L])
        low = numpy.array([top - 18, top]).T
        turn = [-3 * self.turn, 3 * self.turn] if rotation else [0.0, 0.0]
        return numpy.vstack([low, turn])

    @staticmethod
    def _from_box(z: Any) -> Any:
        import numpy

        return numpy.concatenate([numpy.exp(z[:3]), z[3:]])

    def _scan(self, cost: Callable[[Any], Any], gain: float, rotation: bool, more: list[Any]) -> Any:
        """The best of many points spread over the box by a low-discrepancy sequence, and of some more."""
        import numpy

        box = self._box(gain, rotation)
        # Kronecker's sequence by powers of the generalised golden ratio of dimension four.
        ratio = 1.16730397826141868
        unit = numpy.outer(1 / ratio ** numpy.arange(1, 5), numpy.arange(1, 16385)) % 1
        points = self._from_box(box[:, :1] + unit * (box[:, 1:] - box[:, :1]))
        points = numpy.hstack([points, *(q[:, None] for q in more)])
        return points[:, int(numpy.argmin(cost(points)))]

    def _polish(self, cost: Callable[[Any], Any], q: Any, gain: float, rotation: bool) -> Any:
        """Differential evolution from q: derivative-free, because modes that meet make the rate not smooth."""
        import numpy
        from scipy.optimize import differential_evolution

        box = self._box(gain, rotation)
        free = slice(0, 4 if rotation else 3)
        z = numpy.concatenate([numpy.log(q[:3]), q[3:]])

        def value(part: Any) -> Any:
            tail = part[3:] if rotation else numpy.zeros((1, *part.shape[1:]))
            return cost(self._from_box(numpy.concatenate([part[:3], tail])))

        for width in (6.0, 0.3):
            room = numpy.array([width] * 3 + [width * self.turn])
            bounds = numpy.array([numpy.minimum(z - room, z), numpy.maximum(z + room, z)]).T
            # z itself stays inside by more than what is lost when bounds are scaled: a start beyond them is refused.
            margin = 1e-9 * (1 + numpy.abs(z))
            bounds[:, 0] = numpy.maximum(bounds[:, 0], numpy.minimum(box[:, 0], z - margin))
            bounds[:, 1] = numpy.minimum(bounds[:, 1], numpy.maximum(box[:, 1], z + margin))
            done = differential_evolution(
                value,
                bounds[free],
                x0=z[free],
                rng=1,
                maxiter=150,
                popsize=12,
                tol=1e-8,
                polish=False,
                vectorized=True,
                updating="deferred",
            )
            if done.fun < value(z[free][:, None])[0]:
                z = numpy.concatenate([done.x, z[len(done.x) :]])
        return self._from_box(z)

    def _convex(self, q: Any, rate: float, rotation: bool) -> Any:
        """A few convex problems, each of which can only lower the largest gain at this rate."""
        for _ in range(3):
            before = float(self.gain(q))
            for free in ((1, 2), (0, 1, 3) if rotation else (0, 1)):
                q = self._convex_step(q, rate, free) if self.rate(q) >= rate else q
            if self.gain(q) > 0.98 * before:
                break
        return q

    def _faster(self, q: Any, bound: float, rotation: bool) -> Any:
        """Bisection on the rate: each step asks a convex problem for the smallest gain at a higher rate."""
        step = 1.3
        while step > 1.01:
            rate, improved = float(self.rate(q)), False
            for free in ((1, 2), (0, 1, 3) if rotation else (0, 1)):
                trial = self._convex_step(q, step * rate, free)
                if self.rate(trial) > rate * (1 + (step - 1) / 2) and self.gain(trial) <= bound:
                    q, improved = trial, True
                    break
            if not improved:
                step = step**0.5
        return q

    def _convex_step(self, q: Any, rate: float, free: tuple[int, ...]) -> Any:
        """Minimise the largest gain over the entries `free` of q, given the others: a semidefinite programme.

        The cubic c, its variable shifted by `rate` and scaled, is stable if for the central polynomial d (that of q)
        and some Hermitian Q: d* c + c* d - (Pi1' Q Pi2 + Pi2' Q Pi1) >= 0, strictly. With v = (1, s, s^2, s^3) on the
        imaginary axis this says Re(conj(d) c) > 0, so c/d is strictly positive real.
        """
        import numpy

        speed = float(abs(self.polynomial(q)[0])) ** (1 / 3)

        def coefficients(q: Any, rate: float) -> Any:
            p = numpy.polynomial.Polynomial([*self.polynomial(q), 1])
            shifted = p(numpy.polynomial.Polynomial([-rate, 1])).coef
            return numpy.array([a * speed ** (k - 3) for k, a in enumerate(shifted)])

        # The centre must be stable itself: shifted by what q does reach.
        d = coefficients(q, min(rate, 0.98 * float(self.rate(q))))
        base = numpy.array(q, float)
        base[list(free)] = 0
        size = numpy.abs(numpy.array(q, float))
        size[3] = self.turn or 1.0
        c = [coefficients(base, rate)]
        rows = [numpy.array(self.entries(base), float)]
        for k in free:
            tip = base.copy()
            tip[k] = size[k]
            c.append(coefficients(tip, rate) - c[0])
            rows.append(numpy.array(self.entries(tip), float) - rows[0])
        forms = [self._embedded(numpy.outer(d.conj(), x) + numpy.outer(x.conj(), d)) for x in c]
        norm = max(float(numpy.abs(forms[0]).max()), 1e-300)
        margin = 1e-7 * self._embedded(numpy.outer(d.conj(), d))
        low, high = numpy.eye(3, 4), numpy.eye(3, 4, 1)
        crossed = [self._embedded(low.T @ Q @ high + high.T @ Q @ low) for Q in _hermitian_basis()]
        # unknowns: the parts of q that are free, the entries of Q, the largest gain relative to that of q
        none = numpy.zeros((8, 8))
        stable = (forms[0] - margin) / norm, [*(form / norm for form in forms[1:]), *(-x for x in crossed), none]
        constants, slopes = [], []
        unit, zero = float(self.gain(q)), [0.0] * len(crossed)
        for k in range(len(rows[0])):
            for sign in (1, -1):  # t - sign * entry >= 0
                constants.append(-sign * rows[0][k] / unit)
                slopes.append([*(-sign * row[k] / unit for row in rows[1:]), *zero, 1.0])
        for i, k in enumerate(free):
            if k != 3:  # h, b and x are positive
                constants.append(-1e-6)
                slopes.append([*(float(n == i) for n in range(len(free))), *zero, 0.0])
        constant, parts = stable
        cost = numpy.eye(len(parts))[-1]
        point = minimise(cost, [Block(constant, numpy.array(parts))], numpy.array(constants), numpy.array(slopes))
        if point is None:
            return q
        found = base.copy()
        for i, k in enumerate(free):
            found[k] = float(point[i]) * size[k]
        sound = (found[:3] > 0).all() and self.rate(found) >= rate * (1 - 1e-4)
        return found if sound else q

    @staticmethod
    def _embedded(a: Any) -> Any:
        """A Hermitian matrix as a real symmetric one of twice the size."""
        import numpy

        return numpy.block([[a.real, -a.imag], [a.imag, a.real]])

    def _rounded(
        self, q: Any, cost: Callable[[Any], Any], near: Callable[[Any], Any], meets: Callable[[Design], bool]
    ) -> Design | None:
        """The best neighbour of q with few digits that meets the wish exactly; more digits only if they pay.

        `cost` and `near` (whether the wish is met, or nearly so) are in floats and spare most of the exact tests.
        """
        import numpy

        h, b, x, g = (float(v) for v in q)
        best: tuple[float, Design] | None = None
        for digits in DIGITS:
            choices = [_neighbours(v, digits) for v in (x, b, h, g)]
            designs = [Design(*choice) for choice in itertools.product(*choices)]
            designs = [d for d in designs if d.x > 0 and d.b > 0 and d.h > 0]
            if not designs:
                continue
            points = numpy.array([[float(v) for v in (d.h, d.b, d.x, d.g)] for d in designs]).T
            costs, likely = cost(points), near(points)
            order = [k for k in numpy.argsort(costs, kind="stable") if likely[k]]
            k = next((k for k in order if meets(designs[k])), None)
            if k is None:
                continue
            value = float(costs[k])
            if best is not None and value >= best[0] - abs(best[0]) / 50:
                break
            best = value, designs[k]
            if digits >= 3:
                break
        return best[1] if best else None


def _hermitian_basis() -> list[Any]:
    """A basis over the reals of the Hermitian matrices of size 3."""
    import numpy

    basis = []
    for i in range(3):
        for j in range(i + 1):
            for factor in (1.0, 1j) if i > j else (0.5,):
                a = numpy.zeros((3, 3), complex)
                a[i, j] = factor
                basis.append(a + a.conj().T)
    return basis


def _neighbours(x: float, digits: int) -> list[Fraction]:
    """x rounded to so many digits, and one unit of the last digit to both sides of it; zero stays zero."""
    if not x:
        return [Fraction(0)]
    middle = round_float(x, digits)
    unit = Fraction(10) ** (magnitude(middle) + 1 - digits)
    return [middle - unit, middle, middle + unit]
