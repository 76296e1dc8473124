"""Seeded random designs of inverter loops as exact ports, with the verdict where the construction determines it.

Single axis: C V' = I + d, L I' = -(1 - k11) V + (k12 - R) I + k13 v, v' = -V, with k12 = h + R, k11 = 1 - b - L x,
k13 = -h x. Two axes: the state-feedback inverter, K12 = H + R + w0 L J, K11 = 1 - Bm - L X, K13 = -H X.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from certify.kernel.linalg import (
    Matrix,
    add,
    block,
    identity,
    ldl_pivots,
    multiply,
    scale,
    solve,
    transpose,
    zeros,
)
from certify.kernel.model import J, LinearPort

PASSIVE, SEMIDEFINITE, NOT_PASSIVE = "passive", "semidefinite", "not passive"
I2 = identity(2)
SPEEDS = (Fraction("314.1592653589793238462643383279502884197"), Fraction("376.99"), Fraction(314), Fraction(0))
Gains = tuple[Matrix, Matrix, Matrix | None]


def is_semidefinite(a: Matrix) -> bool:
    return ldl_pivots(a)[1]


def is_definite(a: Matrix) -> bool:
    pivots, semidefinite = ldl_pivots(a)
    return semidefinite and all(pivots)


@dataclass(frozen=True)
class Design:
    """A port with its kind, the numbers to rebuild it, and the verdict if the construction gives it."""

    kind: str
    port: LinearPort
    numbers: dict[str, object] = field(default_factory=dict)
    expected: str | None = None


@dataclass(frozen=True)
class Filter:
    """R, L, C of the plant in SI units, and the speed of the frame."""

    R: Fraction
    L: Fraction
    C: Fraction
    w0: Fraction = Fraction(0)


def decimal(rng: random.Random, low: float, high: float) -> Fraction:
    """A decimal of three significant digits, its logarithm uniform."""
    return Fraction(f"{low * (high / low) ** rng.random():.2e}")


def signed(rng: random.Random, low: float, high: float) -> Fraction:
    return rng.choice((-1, 1)) * decimal(rng, low, high)


def random_filter(rng: random.Random) -> Filter:
    return Filter(decimal(rng, 1e-3, 1), decimal(rng, 1e-4, 1e-1), decimal(rng, 1e-6, 1e-3), rng.choice(SPEEDS))


def tiny(rng: random.Random, size: Fraction) -> Fraction:
    """An error of 10^-3 to 10^-30 relative to a gain, or absolute if the gain is zero, of either sign."""
    return rng.choice((-1, 1)) * (abs(size) or Fraction(1)) * Fraction(1, 10 ** rng.randint(3, 30))


# --- single axis --------------------------------------------------------------------------------------------


def single_axis(kind: str, plant: Filter, k11: Fraction, k12: Fraction, k13: Fraction) -> Design:
    R, L, C = plant.R, plant.L, plant.C
    F = (
        (Fraction(0), 1 / C, Fraction(0)),
        (-(1 - k11) / L, (k12 - R) / L, k13 / L),
        (Fraction(-1), Fraction(0), Fraction(0)),
    )
    port = LinearPort(F, ((1 / C,), (Fraction(0),), (Fraction(0),)), ((Fraction(1), Fraction(0), Fraction(0)),))
    numbers: dict[str, object] = {"R": R, "L": L, "C": C, "k11": k11, "k12": k12, "k13": k13}
    return Design(kind, port, numbers, expected_single(plant, k11, k12, k13))


def expected_single(plant: Filter, k11: Fraction, k12: Fraction, k13: Fraction) -> str:
    """The verdict in closed form.

    With k13 != 0: passive iff h < 0, x = -k13/h > 0 and b = 1 - k11 - L x > 0. With k13 = 0 the integrator is unused:
    (V, I) is passive iff 1 - k11 > 0 and h <= 0, but if h < 0, v is reached and invisible at s = 0, where Z has no
    pole, so that every P is singular along v.
    """
    h, rho = k12 - plant.R, 1 - k11
    if k13:
        return PASSIVE if h < 0 and -k13 / h > 0 and rho + plant.L * k13 / h > 0 else NOT_PASSIVE
    if rho <= 0 or h > 0:
        return NOT_PASSIVE
    return SEMIDEFINITE if h else PASSIVE


def _single(rng: random.Random, kind: str) -> Design:
    plant = random_filter(rng)
    b, x, h = decimal(rng, 1e-2, 10), decimal(rng, 1, 1e4), -decimal(rng, 1e-2, 20)
    if kind == "generic":
        k11, k12, k13 = signed(rng, 0.1, 10), signed(rng, 1e-2, 20), signed(rng, 1, 1e4)
        return single_axis(kind, plant, k11, k12, k13)
    if kind == "negative b":
        b = -b
    if kind == "zero damping" or kind.startswith("error, zero damping") or kind == "both boundaries":
        h = Fraction(0)
    if kind == "rho = L x" or kind.startswith("error, rho = L x") or kind == "both boundaries":
        b = Fraction(0)
    gains = [1 - b - plant.L * x, h + plant.R, -h * x]
    if kind == "integrator unused":
        gains[2] = Fraction(0)
    if kind.startswith("current source"):
        gains = [Fraction(1), plant.R + (Fraction(0) if kind.endswith("no damping") else h), Fraction(0)]
    if kind.startswith("error"):
        k = rng.randrange(3)
        if kind.endswith("k13"):
            k = 2
        gains[k] += tiny(rng, gains[k])
    return single_axis(kind, plant, *gains)


# Kinds and how often they occur.
SINGLE_KINDS = {
    "generic": 4,
    "passive": 3,
    "negative b": 1,
    "zero damping": 1,
    "rho = L x": 2,
    "both boundaries": 1,
    "integrator unused": 1,
    "error, passive": 2,
    "error, zero damping": 3,
    "error, zero damping, k13": 1,
    "error, rho = L x": 5,
    "current source": 1,
    "current source, no damping": 1,
}


# --- two axes -----------------------------------------------------------------------------------------------


def two_axes(kind: str, plant: Filter, gains: Gains, expected: str | None = None, fixed_rows: bool = True) -> Design:
    """The port of a state-feedback inverter: six states, or four if K13 is None.

    Without `fixed_rows` the search is not told of the capacitor.
    """
    K11, K12, K13 = gains
    R, L, C, w0 = plant.R, plant.L, plant.C, plant.w0
    Z = zeros(2, 2)
    G = add(I2, scale(-1, K11))
    H = add(K12, add(scale(-R, I2), scale(-w0 * L, J)))
    rows = [[scale(-w0, J), scale(1 / C, I2)], [scale(-1 / L, G), scale(1 / L, H)]]
    inputs, outputs = [[scale(1 / C, I2)], [Z]], [I2, Z]
    if K13 is not None:
        rows = [[*rows[0], Z], [*rows[1], scale(1 / L, K13)], [scale(-1, I2), Z, Z]]
        inputs, outputs = [*inputs, [Z]], [*outputs, Z]
    port = LinearPort(block(rows), block(inputs), block([outputs]), C if fixed_rows else None)
    numbers: dict[str, object] = {"R": R, "L": L, "C": C, "w0": w0, "K11": K11, "K12": K12, "K13": K13}
    known = expected_two_axes(plant, gains)
    if expected and known and expected != known:
        raise AssertionError(f"{kind}: the construction says {expected}, the closed form {known}")
    return Design(kind, port, numbers, expected or known)


def expected_two_axes(plant: Filter, gains: Gains) -> str | None:
    """The closed form: with K13 nonsingular G = G', X = X' > 0, Bm = G - L X > 0, H Bm + Bm H' <= 0.

    Without integrator the same holds with X = 0. With a singular K13 the result is None.
    """
    K11, K12, K13 = gains
    G = add(I2, scale(-1, K11))
    H = add(K12, add(scale(-plant.R, I2), scale(-plant.w0 * plant.L, J)))
    if K13 is None:
        X, stiff = zeros(2, 2), True
    elif not determinant(K13):
        return None
    elif not determinant(H):
        return NOT_PASSIVE
    else:
        X = scale(-1, solve(H, K13))
        stiff = is_definite(X) if transpose(X) == X else False
    Bm = add(G, scale(-plant.L, X))
    if transpose(G) != G or not stiff:
        return NOT_PASSIVE
    product = multiply(H, Bm)
    (a, b), (_, d) = scale(-1, add(product, transpose(product)))
    damped = a >= 0 and d >= 0 and a * d >= b * b
    return PASSIVE if damped and is_definite(Bm) else NOT_PASSIVE


def determinant(a: Matrix) -> Fraction:
    return a[0][0] * a[1][1] - a[0][1] * a[1][0]


def diagonal(a: Fraction, b: Fraction) -> Matrix:
    return ((a, Fraction(0)), (Fraction(0), b))


def symmetric(rng: random.Random, low: float, high: float, singular: bool = False) -> Matrix:
    """A symmetric positive definite matrix T D T' with small rational entries, or one of rank 1."""
    T = (
        (Fraction(1), Fraction(rng.randint(-9, 9), 10)),
        (Fraction(rng.randint(-9, 9), 10), Fraction(1)),
    )
    D = diagonal(decimal(rng, low, high), Fraction(0) if singular else decimal(rng, low, high))
    return multiply(multiply(T, D), transpose(T))


def gains_of(plant: Filter, X: Matrix, Bm: Matrix, H: Matrix) -> Gains:
    """The gains of a triple, by the formulas with the controller's own R, L and w0."""
    K12 = add(H, add(scale(plant.R, I2), scale(plant.w0 * plant.L, J)))
    K11 = add(I2, scale(-1, add(Bm, scale(plant.L, X))))
    return K11, K12, scale(-1, multiply(H, X))


def damping(rng: random.Random, Bm: Matrix, N: Matrix, skew: bool) -> Matrix:
    """H = (S - N) Bm^-1 with S skew, so that H Bm + Bm H' = -2 N."""
    s = signed(rng, 1e-2, 20) if skew else Fraction(0)
    return transpose(solve(Bm, transpose(add(scale(s, J), scale(-1, N)))))


def random_triple(rng: random.Random, kind: str) -> tuple[Matrix, Matrix, Matrix]:
    """(X, Bm, H) for the construction that the first words of the kind name."""
    if kind.startswith("decoupled"):
        if rng.random() < 0.5:
            x, b, h = decimal(rng, 1, 1e4), decimal(rng, 1e-2, 10), -decimal(rng, 1e-2, 20)
            return scale(x, I2), scale(b, I2), scale(h, I2)
        X = diagonal(decimal(rng, 1, 1e4), decimal(rng, 1, 1e4))
        Bm = diagonal(decimal(rng, 1e-2, 10), decimal(rng, 1e-2, 10))
        return X, Bm, diagonal(-decimal(rng, 1e-2, 20), -decimal(rng, 1e-2, 20))
    if kind.startswith("rotation-invariant"):
        x, b = decimal(rng, 1, 1e4), decimal(rng, 1e-2, 10)
        H = add(scale(-decimal(rng, 1e-2, 20), I2), scale(signed(rng, 1e-2, 20), J))
        return scale(x, I2), scale(b, I2), H
    X, Bm = symmetric(rng, 1, 1e4), symmetric(rng, 1e-2, 10)
    if kind.startswith("one lossless direction"):
        return X, Bm, damping(rng, Bm, symmetric(rng, 1e-2, 20, singular=True), skew="no skew" not in kind)
    if kind.startswith("lossless"):
        return X, Bm, damping(rng, Bm, zeros(2, 2), skew=True)
    if kind.startswith("no damping"):
        scalar = rng.random() < 0.5
        return X, scale(Bm[0][0], I2) if scalar else Bm, zeros(2, 2)
    if kind.startswith("singular Bm"):
        choice = rng.randrange(3)
        if choice == 0:
            return X, zeros(2, 2), scale(-decimal(rng, 1e-2, 20), I2)
        if choice == 1:
            half = diagonal(decimal(rng, 1e-2, 10), Fraction(0))
            return scale(X[0][0], I2), half, diagonal(-decimal(rng, 1e-2, 20), -decimal(rng, 1e-2, 20))
        return X, symmetric(rng, 1e-2, 10, singular=True), scale(-decimal(rng, 1e-2, 20), I2)
    return X, Bm, damping(rng, Bm, symmetric(rng, 1e-2, 20), skew=True)


def _two_axes(rng: random.Random, kind: str) -> Design:
    plant = random_filter(rng)
    fixed = not kind.endswith("general path")
    if kind.startswith("generic"):

        def full(low: float, high: float) -> Matrix:
            return tuple(tuple(signed(rng, low, high) for _ in range(2)) for _ in range(2))

        return two_axes(kind, plant, (full(0.1, 10), full(1e-2, 20), full(1, 1e4)), fixed_rows=fixed)
    if kind.startswith("wrong L"):
        X, Bm, H = random_triple(rng, "decoupled")
        believed = Filter(plant.R, plant.L + tiny(rng, plant.L), plant.C, plant.w0)
        return two_axes(kind, plant, gains_of(believed, X, Bm, H), fixed_rows=fixed)
    error = kind.startswith("error, ")
    X, Bm, H = random_triple(rng, kind.removeprefix("error, "))
    passive = not kind.startswith("singular Bm")  # by the storage of the triple, whatever its damping
    if kind.startswith("integrator on one axis"):
        X, passive = diagonal(decimal(rng, 1, 1e4), Fraction(0)), False
    if kind.startswith("current source on one axis"):
        Bm, passive = diagonal(decimal(rng, 1e-2, 10), Fraction(0)), False
        X, H = zeros(2, 2), diagonal(-decimal(rng, 1e-2, 20), Fraction(0))
    gains = gains_of(plant, X, Bm, H)
    if "no integrator" in kind:
        K11, K12, _ = gains_of(plant, zeros(2, 2), Bm, H)
        gains = K11, K12, None
    if error:
        choice = rng.randrange(2 if gains[2] is None else 3), rng.randrange(2), rng.randrange(2)
        gains = with_error(rng, gains, *choice)
    return two_axes(kind, plant, gains, PASSIVE if passive and not error else None, fixed)


def with_error(rng: random.Random, gains: Gains, which: int, row: int, column: int) -> Gains:
    """The gains with a tiny error in one entry."""
    changed = [None if K is None else [list(r) for r in K] for K in gains]
    entry = changed[which]
    if entry is None:
        raise ValueError("there is no such gain")
    entry[row][column] += tiny(rng, entry[row][column])
    K11, K12, K13 = (None if K is None else tuple(tuple(r) for r in K) for K in changed)
    if K11 is None or K12 is None:
        raise ValueError("K11 and K12 are always there")
    return K11, K12, K13


DQ_KINDS = {
    "generic": 3,
    "decoupled": 2,
    "rotation-invariant": 2,
    "coupled": 4,
    "one lossless direction": 3,
    "lossless": 2,
    "singular Bm": 3,
    "wrong L": 4,
    "error, decoupled": 4,
    "error, rotation-invariant": 2,
    "error, coupled": 4,
    "error, one lossless direction": 3,
    "error, lossless": 2,
    "error, singular Bm": 3,
    "decoupled, general path": 1,
    "coupled, general path": 2,
    "one lossless direction, general path": 1,
    "singular Bm, general path": 1,
    "wrong L, general path": 2,
    "error, coupled, general path": 2,
    "no integrator": 2,
    "error, no integrator": 2,
    "no integrator, general path": 1,
    "integrator on one axis": 1,
    "one lossless direction, no skew": 4,
    "no damping": 2,
    "current source on one axis": 1,
}

# Degenerate loops (singular K13): a search by a numerical solver, or by rank-one faces alone, may leave some open.
HARD_KINDS = {
    "current source, no damping",
    "one lossless direction, no skew",
    "no damping",
    "current source on one axis",
}


# --- streams ------------------------------------------------------------------------------------------------


def _stream(
    count: int, seed: int, name: str, kinds: dict[str, int], make: Callable[[random.Random, str], Design]
) -> Iterator[Design]:
    rng = random.Random(f"{name}-{seed}")
    names = list(kinds)
    drawn = names + rng.choices(names, list(kinds.values()), k=max(0, count - len(names)))
    for kind in drawn[:count]:
        yield make(rng, kind)


def single_designs(count: int, seed: int = 1) -> Iterator[Design]:
    """Single-axis designs; each kind occurs once at least if `count` allows."""
    return _stream(count, seed, "single", SINGLE_KINDS, _single)


def dq_designs(count: int, seed: int = 1) -> Iterator[Design]:
    """Two-axis designs; each kind occurs once at least if `count` allows."""
    return _stream(count, seed, "dq", DQ_KINDS, _two_axes)
