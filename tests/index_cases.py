"""Inverter loops that are stable but not passive, and how many ohms they are short of it, exactly bracketed.

The shortage of a stable port is the least nu >= 0 with Z(jw) + Z(jw)* + 2 nu >= 0 for all w, so that some storage
has S' <= <z, d> + nu |d|^2: -1/2 times the infimum over w of lambda_min(Z(jw) + Z(jw)*). Whether a rational nu
suffices is decided exactly, as the oracle decides passivity: with Psi = D~ N + D N~, Psi + 2 nu D D~ has to be >= 0 on
the axis, by its trace and determinant, including w -> 0, w -> infinity and w < 0 (the port is real, so Z(-jw) is the
conjugate of Z(jw)). Bisection then gives as many digits as wanted, without any sweep.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from fractions import Fraction

from flint import fmpq, fmpq_poly

from certify.kernel.linalg import add, identity, scale, zeros
from certify.kernel.model import J, LinearPort
from tests.designs import Design, Filter, Gains, decimal, diagonal, gains_of, random_triple, signed, two_axes
from tests.loops import Loop, low_pass_current, virtual_impedance
from tests.oracle import decide, hermitian_numerator, is_hurwitz, is_nonnegative_on_axis, mirror, to_flint, transfer

I2 = identity(2)
CIGRE = Filter(
    Fraction("0.1"), Fraction("0.0018"), Fraction("25e-6"), Fraction("314.1592653589793238462643383279502884197")
)


class Response:
    """Psi and D D~ of a stable port. Raises: ValueError if F is not Hurwitz."""

    def __init__(self, port: LinearPort) -> None:
        N, D = transfer(*(to_flint(matrix) for matrix in (port.F, port.B, port.C)))
        if not is_hurwitz(D):
            raise ValueError("the loop is not asymptotically stable")
        self.Psi, self.square = hermitian_numerator(N, D), D * mirror(D)

    def suffices(self, nu: Fraction) -> bool:
        """Whether Z(jw) + Z(jw)* + 2 nu >= 0 for all real w; exact."""
        shift = self.square * fmpq_poly([fmpq(2 * nu.numerator, nu.denominator)])
        m = len(self.Psi)
        shifted = [[self.Psi[i][j] + (shift if i == j else fmpq_poly()) for j in range(m)] for i in range(m)]
        return is_nonnegative_on_axis(shifted, self.square)


def shortage_bracket(port: LinearPort, digits: int = 15) -> tuple[Fraction, Fraction]:
    """(low, high) in ohm: high suffices, low does not, and high - low <= 10^-digits high. (0, 0) if none is short."""
    response = Response(port)
    if response.suffices(Fraction(0)):
        return Fraction(0), Fraction(0)
    exponent = 0
    while response.suffices(Fraction(10) ** exponent):
        exponent -= 1
    while not response.suffices(Fraction(10) ** (exponent + 1)):
        exponent += 1
    low, step = Fraction(10) ** exponent, Fraction(10) ** exponent  # 1 <= shortage / step <= 10
    for _ in range(digits):  # one decimal digit more in each round
        step /= 10
        least, most = 0, 100 if step * 10 == low else 10  # low + least step fails, low + most step suffices
        while most - least > 1:
            middle = (least + most) // 2
            if response.suffices(low + middle * step):
                most = middle
            else:
                least = middle
        low += least * step
    return low, low + step


def true_shortage(port: LinearPort, digits: int = 15) -> Fraction:
    """The shortage in ohm, from above, to a relative 10^-digits: the upper end of the bracket suffices."""
    return shortage_bracket(port, digits)[1]


# --- designs ------------------------------------------------------------------------------------------------


def pi_gains(plant: Filter, kp: Fraction, ki: Fraction, cross: Fraction, factor: int = 1) -> Gains:
    """K11 = (1 - kp L) I, K12 = (R - ki (1/kp + 1)) I + factor cross J, K13 = ki I, of the controller's own R and L.

    `cross` is the controller's w0 L in ohm.
    """
    K12 = add(scale(plant.R - ki * (1 / kp + 1), I2), scale(factor * cross, J))
    return scale(1 - kp * plant.L, I2), K12, scale(ki, I2)


def wrong_inductance(plant: Filter, kp: Fraction, ki: Fraction, error: Fraction) -> Design:
    """The PI design of a controller that takes (1 + error) L for L."""
    believed = Filter(plant.R, plant.L * (1 + error), plant.C, plant.w0)
    return two_axes("wrong L", plant, pi_gains(believed, kp, ki, believed.w0 * believed.L))


def twice_the_cross_term(plant: Filter, kp: Fraction, ki: Fraction) -> Design:
    """The decoupling 2 w0 L of the source paper, at the right sign of K11."""
    return two_axes("2 w0 L", plant, pi_gains(plant, kp, ki, plant.w0 * plant.L, 2))


def _plant(rng: random.Random) -> Filter:
    w0 = rng.choice((CIGRE.w0, Fraction("376.99")))
    return Filter(decimal(rng, 1e-2, 0.5), decimal(rng, 5e-4, 5e-3), decimal(rng, 5e-6, 1e-4), w0)


def _believed(rng: random.Random, plant: Filter) -> Filter:
    """The controller's data: an error of 1e-3 to 0.2 in one or two of L, R, w0."""
    data = {"R": plant.R, "L": plant.L, "C": plant.C, "w0": plant.w0}
    for name in rng.sample(["L", "R", "w0"], rng.choice((1, 1, 2))):
        data[name] *= 1 + signed(rng, 1e-3, 0.2)
    return Filter(**data)


def _candidate(rng: random.Random) -> Design:
    plant = _plant(rng)
    choice = rng.choice(("2 w0 L", "PI", "triple", "triple", "gains", "gains, no integrator", "extra states"))
    if choice == "2 w0 L":
        return twice_the_cross_term(plant, decimal(rng, 100, 3000), decimal(rng, 10, 3000))
    if choice == "PI":
        believed = _believed(rng, plant)
        gains = pi_gains(believed, decimal(rng, 100, 3000), decimal(rng, 10, 3000), believed.w0 * believed.L)
        return two_axes("errors, PI", plant, gains)
    if choice == "extra states":
        loop = Loop(rng, rng.choice(("decoupled", "rotation-invariant")), 2, with_integrator=True)
        stage = rng.choice((low_pass_current, virtual_impedance))
        stage(rng, loop, "x")
        # the cross term of K12 is off by a share of w0 L, and K11 as by a wrong L
        share = signed(rng, 1e-3, 0.2)
        loop.put("I", I=scale(share * loop.plant.w0, J), V=scale(share, loop.X))
        return Design("extra states, errors", loop.port(fixed_rows=False))
    X, Bm, H = random_triple(rng, rng.choice(("decoupled", "rotation-invariant", "coupled")))
    if choice == "triple":
        return two_axes("errors, triple", plant, gains_of(_believed(rng, plant), X, Bm, H))
    without = "no integrator" in choice
    K11, K12, K13 = gains_of(plant, zeros(2, 2) if without else X, Bm, H)
    size = signed(rng, 1e-3, 0.2)
    wrong = diagonal(size * K11[0][0], Fraction(0)) if rng.random() < 0.3 else scale(size * K11[0][0], J)
    return two_axes(f"errors, {choice}", plant, (add(K11, wrong), K12, None if without else K13))


def index_cases(count: int = 200, seed: int = 1) -> Iterator[Design]:
    """Stable loops that are not passive: 4, 6 or 8 states. Candidates that are passive or unstable are left out."""
    rng = random.Random(f"index-{seed}")
    made = 0
    while made < count:
        design = _candidate(rng)
        if is_hurwitz(to_flint(design.port.F).charpoly()) and not decide(design.port).passive:
            made += 1
            yield design
