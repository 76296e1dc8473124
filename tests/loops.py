"""Seeded random closed loops with a port, 1 or 2 channels and 2 to 12 states, and the verdict where the construction gives it.

Data have three significant digits (errors excepted) before exact operations that leave passivity as it is:
- a change of states x -> T x by elementary integer steps, and by powers of ten in the badly scaled loops;
- a skew feedback d -> d - S z, and a mixing Z -> T' Z T of the channels: both keep every storage matrix P.

Building blocks: port-Hamiltonian parts F = (J - R) Q, B = G, C = G'Q with J skew, R >= 0, Q > 0 (P = Q); parts with a
prescribed Z + Z~ = Psi / (D D~), from N D~ + N~ D = Psi; LC filters in the dq frame with the triple (X, Bm, H) of a
state feedback (tests/designs.py) and stages between its signals. In w = I - X v the triple reads L w' = H w - Bm V,
so u -= Bm Zf(s) w with Zf positive real keeps the loop passive: S gains the storage of Zf.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from fractions import Fraction

from certify.kernel.linalg import Matrix, add, block, identity, multiply, scale, solve, transpose, zeros
from certify.kernel.model import J, LinearPort
from tests.designs import (
    NOT_PASSIVE,
    PASSIVE,
    SEMIDEFINITE,
    Design,
    Filter,
    damping,
    decimal,
    random_filter,
    random_triple,
    signed,
    tiny,
)

Polynomial = list[Fraction]  # coefficients from the constant term on
Made = tuple[LinearPort, str | None]
ZERO, ONE = Fraction(0), Fraction(1)
MOST_STATES = 12


# --- exact operations on ports ------------------------------------------------------------------------------


def sizes(port: LinearPort) -> tuple[int, int]:
    return len(port.F), len(port.C)


def hidden(rng: random.Random, port: LinearPort) -> LinearPort:
    """The port in other states T x: a permutation and about 2 n elementary steps with small integers."""
    n, _ = sizes(port)
    order = rng.sample(range(n), n)
    F = [[port.F[i][j] for j in order] for i in order]
    B, C = [list(port.B[i]) for i in order], [[row[j] for j in order] for row in port.C]
    for _ in range(2 * n if n > 1 else 0):
        i, j = rng.sample(range(n), 2)
        c = rng.choice((-2, -1, 1, 2))
        F[i] = [a + c * b for a, b in zip(F[i], F[j], strict=True)]
        B[i] = [a + c * b for a, b in zip(B[i], B[j], strict=True)]
        for row in (*F, *C):
            row[j] -= c * row[i]
    return LinearPort(tuple(map(tuple, F)), tuple(map(tuple, B)), tuple(map(tuple, C)))


def rescaled(rng: random.Random, port: LinearPort) -> LinearPort:
    """Each state times a random power of ten between 1e-8 and 1e8."""
    t = [Fraction(10) ** rng.randint(-8, 8) for _ in port.F]
    F = tuple(tuple(t[i] * a / t[j] for j, a in enumerate(row)) for i, row in enumerate(port.F))
    B = tuple(tuple(t[i] * b for b in row) for i, row in enumerate(port.B))
    return LinearPort(F, B, tuple(tuple(c / t[j] for j, c in enumerate(row)) for row in port.C))


def fed_back(port: LinearPort, S: Matrix) -> LinearPort:
    """d -> d - S z. With S + S' = 0 a storage matrix stays one, and with S + S' >= 0 too."""
    return LinearPort(add(port.F, scale(-1, multiply(port.B, multiply(S, port.C)))), port.B, port.C)


def mixed(port: LinearPort, T: Matrix) -> LinearPort:
    """T' Z T."""
    return LinearPort(port.F, multiply(port.B, T), multiply(transpose(T), port.C))


def beside(a: LinearPort, b: LinearPort) -> LinearPort:
    """Two ports with channels of their own: diag(Za, Zb)."""
    (n, m), (k, l) = sizes(a), sizes(b)  # noqa: E741
    return LinearPort(
        block([[a.F, zeros(n, k)], [zeros(k, n), b.F]]),
        block([[a.B, zeros(n, l)], [zeros(k, m), b.B]]),
        block([[a.C, zeros(m, k)], [zeros(l, n), b.C]]),
    )


def in_series(a: LinearPort, b: LinearPort) -> LinearPort:
    """The same d into both, the outputs added: Za + Zb, like two impedances in series."""
    n, k = len(a.F), len(b.F)
    F = block([[a.F, zeros(n, k)], [zeros(k, n), b.F]])
    return LinearPort(F, block([[a.B], [b.B]]), block([[a.C, b.C]]))


def shaken(rng: random.Random, port: LinearPort) -> LinearPort:
    """A mixing of two channels and a skew feedback between them; one channel has neither."""
    if sizes(port)[1] == 1:
        return port
    a, b = Fraction(rng.randint(-9, 9), 10), Fraction(rng.randint(-9, 9), 10)
    port = mixed(port, ((ONE, a), (b, ONE))) if a * b != 1 else port
    return fed_back(port, scale(signed(rng, 0.1, 10), J)) if rng.random() < 0.7 else port


# --- building blocks ----------------------------------------------------------------------------------------


def channels(rng: random.Random) -> int:
    return 1 if rng.random() < 0.3 else 2


def states(rng: random.Random, low: int, high: int = MOST_STATES) -> int:
    return rng.randint(low, max(low, high))


def skew(rng: random.Random, n: int, density: float = 0.5) -> Matrix:
    rows = [[ZERO] * n for _ in range(n)]
    for i in range(n):
        for j in range(i):
            if i == j + 1 or rng.random() < density:
                rows[i][j] = signed(rng, 0.1, 10)
                rows[j][i] = -rows[i][j]
    return tuple(map(tuple, rows))


def positive(rng: random.Random, n: int, rank: int | None = None) -> Matrix:
    """T D T' with T sparse, unit lower triangular and D > 0, or D of the given rank (its zeros first)."""
    T = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
    for i in range(1, n):
        if rng.random() < 0.5:
            T[i][rng.randrange(i)] = Fraction(rng.randint(-9, 9), 10)
    lost = 0 if rank is None else n - rank
    D = [[decimal(rng, 0.1, 10) if i == j and i >= lost else ZERO for j in range(n)] for i in range(n)]
    half = tuple(map(tuple, T))
    return multiply(multiply(half, tuple(map(tuple, D))), transpose(half))


def hamiltonian(Jn: Matrix, R: Matrix, Q: Matrix, G: Matrix) -> LinearPort:
    return LinearPort(multiply(add(Jn, scale(-1, R)), Q), G, multiply(transpose(G), Q))


def entrance(rng: random.Random, n: int, m: int) -> Matrix:
    """G: d drives the first m states."""
    G = [[ZERO] * m for _ in range(n)]
    for i in range(m):
        G[i][i] = decimal(rng, 0.1, 10)
    if m == 2 and rng.random() < 0.5:
        G[1][0] = signed(rng, 0.1, 1)
    return tuple(map(tuple, G))


def damped(rng: random.Random, n: int, m: int) -> LinearPort:
    """R > 0: Phi(jw) > 0 at all w."""
    return hamiltonian(skew(rng, n), positive(rng, n), positive(rng, n), entrance(rng, n, m))


def lossless_port(rng: random.Random, n: int, m: int) -> LinearPort:
    """R > 0 but for the states at the port, and Q without a coupling of the two: Z ~ 1/s without loss at infinity."""
    R = block([[zeros(m, m), zeros(m, n - m)], [zeros(n - m, m), positive(rng, n - m)]])
    Q = block([[positive(rng, m), zeros(m, n - m)], [zeros(n - m, m), positive(rng, n - m)]])
    return hamiltonian(skew(rng, n), R, Q, entrance(rng, n, m))


def stable_matrix(rng: random.Random, k: int) -> Matrix:
    return multiply(add(skew(rng, k), scale(-1, positive(rng, k))), positive(rng, k))


def lossless_matrix(rng: random.Random, k: int) -> Matrix:
    return multiply(skew(rng, k), positive(rng, k))


def growing_matrix(rng: random.Random, k: int) -> Matrix:
    return scale(-1, stable_matrix(rng, k))


def resonance(rng: random.Random, m: int, irrational: bool) -> LinearPort:
    """k s / (s^2 + w^2) in one channel, or a residue of rank 1 or 2 in two; w^2 is a square or not."""
    w = decimal(rng, 0.1, 10)
    stiffness = w * w * (rng.choice((2, 3, 5)) if irrational else 1)
    single = LinearPort(((ZERO, -stiffness), (ONE, ZERO)), ((decimal(rng, 0.1, 10),), (ZERO,)), ((ONE, ZERO),))
    if m == 1:
        return single
    if rng.random() < 0.5:
        a = signed(rng, 0.1, 10)
        return LinearPort(single.F, multiply(single.B, ((ONE, a),)), multiply(((ONE,), (a,)), single.C))
    # x' = w0 (j x) + d: Hermitian, complex residues
    return LinearPort(scale(w, J), identity(2), identity(2))


def ladder(rng: random.Random, n: int, losses: dict[int, Fraction]) -> LinearPort:
    """C, L, C, ... from the port on: x_i' = (x_{i-1} - x_{i+1} - r_i x_i) / a_i. Shape (n, n), one channel."""
    a = [decimal(rng, 0.1, 10) for _ in range(n)]
    F = [[ZERO] * n for _ in range(n)]
    for i in range(n):
        F[i][i] = -losses.get(i, ZERO) / a[i]
        if i:
            F[i][i - 1] = 1 / a[i]
        if i + 1 < n:
            F[i][i + 1] = -1 / a[i]
    first = [ONE] + [ZERO] * (n - 1)
    return LinearPort(tuple(map(tuple, F)), tuple((x / a[0],) for x in first), (tuple(first),))


def with_integral_action(rng: random.Random, port: LinearPort) -> LinearPort:
    """d -> d - kI xi, xi' = z with kI = kI' > 0: S gains xi' kI xi / 2."""
    m = len(port.C)
    kI = positive(rng, m)
    F = block([[port.F, scale(-1, multiply(port.B, kI))], [port.C, zeros(m, m)]])
    return LinearPort(F, block([[port.B], [zeros(m, m)]]), block([[port.C, zeros(m, m)]]))


# polynomials: only what N D~ + N~ D = Psi needs


def product(p: Polynomial, q: Polynomial) -> Polynomial:
    out = [ZERO] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            out[i + j] += a * b
    return out


def short(rng: random.Random, low: int, high: int) -> Fraction:
    return Fraction(rng.randint(low, high), rng.choice((1, 2, 4, 5, 10)))


def hurwitz_polynomial(rng: random.Random, n: int) -> Polynomial:
    D = [ONE]
    while len(D) <= n:
        quadratic = len(D) < n and rng.random() < 0.5
        a = short(rng, 1, 20)
        D = product(D, [short(rng, 1, 40), a, ONE] if quadratic else [a, ONE])
    return D


def companion(D: Polynomial, N: Polynomial) -> LinearPort:
    """N / D in the controllable form."""
    n = len(D) - 1
    F = [[ONE if j == i + 1 else ZERO for j in range(n)] for i in range(n - 1)] + [[-d for d in D[:-1]]]
    B = tuple((ONE if i == n - 1 else ZERO,) for i in range(n))
    return LinearPort(tuple(map(tuple, F)), B, (tuple((N + [ZERO] * n)[:n]),))


def with_real_part(D: Polynomial, q: Polynomial) -> LinearPort:
    """The port N / D with 2 Re Z(jw) = q(w^2) / |D(jw)|^2; D Hurwitz of degree n, q of degree < n."""
    n = len(D) - 1
    rows = [[ZERO] * n for _ in range(n)]
    for i in range(n):  # s^i D~ + (-s)^i D: the coefficient of s^(2k), to be (-1)^k q_k
        for j, d in enumerate(D):
            if (i + j) % 2 == 0:
                rows[(i + j) // 2][i] += 2 * (-1) ** j * d
    right = tuple(((-1) ** k * (q[k] if k < len(q) else ZERO),) for k in range(n))
    N = solve(tuple(map(tuple, rows)), right)
    return companion(D, [row[0] for row in N])


def touching(rng: random.Random, n: int, irrational: bool, error: Fraction = ZERO) -> LinearPort:
    """One channel with Re Z = (w^2 - a)^2 r(w^2) + error at its zeros; n >= 3. r has no positive root.

    Irrational: a is no square, or (n >= 5) the two roots of x^2 - b x + c instead of a are irrational.
    """
    w = short(rng, 1, 12)
    a = w * w * (rng.choice((2, 3, 5)) if irrational else 1)
    square = product([-a, ONE], [-a, ONE])
    if irrational and n >= 5 and rng.random() < 0.5:
        p = short(rng, 2, 9)
        root = [p * p - Fraction(rng.choice((2, 3, 5)), 7) * p * p, -2 * p, ONE]
        square = product(root, root)
    square[0] += error
    while len(square) < n and rng.random() < 0.5:
        square = product(square, [short(rng, 1, 9), ONE])
    size = decimal(rng, 0.1, 10)
    return with_real_part(hurwitz_polynomial(rng, n), [size * c for c in square])


# --- inverter loops: an LC filter with a triple (X, Bm, H) and stages -----------------------------------------


Entries = dict[tuple[str, str], Matrix]


class Loop:
    """A loop in blocks of m states each: x_a' = sum_b entries[a, b] x_b, the port at V. Blocks of shape (m, m)."""

    def __init__(self, rng: random.Random, kind: str, m: int, with_integrator: bool) -> None:
        self.m, self.one = m, identity(m)
        plant = random_filter(rng)
        if m == 1:
            plant = Filter(plant.R, plant.L, plant.C)
            x, b, h = ((decimal(rng, *span),) for span in ((1, 1e4), (1e-2, 10), (1e-2, 20)))
            self.X, self.Bm, self.H = (x,), (b,), scale(-1, (h,))
        else:
            self.X, self.Bm, self.H = random_triple(rng, kind)
        if not with_integrator:
            self.X = zeros(m, m)
        self.plant, self.with_integrator = plant, with_integrator
        self.turn = scale(plant.w0, J) if m == 2 else zeros(1, 1)
        self.names = ["V", "I", *(["v"] if with_integrator else [])]
        G = add(self.Bm, scale(plant.L, self.X))
        self.K11 = add(self.one, scale(-1, G))
        self.K12 = add(self.H, add(scale(plant.R, self.one), scale(plant.L, self.turn)))
        self.K13 = scale(-1, multiply(self.H, self.X))
        self.entries: Entries = {}
        self.put("V", V=scale(-1, self.turn), I=scale(1 / plant.C, self.one))
        self.put("I", V=scale(-1 / plant.L, G), I=scale(1 / plant.L, self.H))
        if with_integrator:
            self.put("I", v=scale(1 / plant.L, self.K13))
            self.put("v", V=scale(-1, self.one))

    def put(self, row: str, **columns: Matrix) -> None:
        """Add to a row of blocks; a name not met before is a new state."""
        if row not in self.names:
            self.names.append(row)
        for column, a in columns.items():
            self.entries[row, column] = add(self.entries.get((row, column), zeros(self.m, self.m)), a)

    def put_w(self, row: str, factor: Matrix) -> None:
        """Add factor (I - X v) to a row."""
        self.put(row, I=factor)
        if self.with_integrator:
            self.put(row, v=scale(-1, multiply(factor, self.X)))

    def push(self, **columns: Matrix) -> None:
        """u -= Bm zeta, zeta = sum of the columns."""
        self.put("I", **{name: scale(-1 / self.plant.L, multiply(self.Bm, a)) for name, a in columns.items()})

    def eye(self, factor: Fraction) -> Matrix:
        return scale(factor, self.one)

    def port(self, fixed_rows: bool) -> LinearPort:
        Z = zeros(self.m, self.m)
        rows = [[self.entries.get((a, b), Z) for b in self.names] for a in self.names]
        rest = len(self.names) - 1
        B = block([[self.eye(1 / self.plant.C)], *([Z] for _ in range(rest))])
        C = block([[self.one, *(Z for _ in range(rest))]])
        return LinearPort(block(rows), B, C, self.plant.C if fixed_rows and self.m == 2 else None)


def low_pass_current(rng: random.Random, loop: Loop, name: str) -> str | None:
    """tau xf' = w - xf, zeta = k xf."""
    k, tau = decimal(rng, 0.1, 20), decimal(rng, 1e-5, 1e-1)
    loop.put(name, **{name: loop.eye(-1 / tau)})
    loop.put_w(name, loop.eye(1 / tau))
    loop.push(**{name: loop.eye(k)})
    return PASSIVE


def virtual_impedance(rng: random.Random, loop: Loop, name: str) -> str | None:
    """zeta = k s / (tau s + 1) w + r w: a virtual inductance with a filtered derivative, and a resistance."""
    k, tau, r = decimal(rng, 1e-4, 1e-1), decimal(rng, 1e-5, 1e-2), decimal(rng, 1e-2, 10)
    loop.put(name, **{name: loop.eye(-1 / tau)})
    loop.put_w(name, loop.eye(1 / tau))
    loop.push(**{name: loop.eye(-k / tau)})
    loop.put_w("I", scale(-(k / tau + r) / loop.plant.L, loop.Bm))
    return PASSIVE


def resonant(rng: random.Random, loop: Loop, name: str) -> str | None:
    """zeta = k (s + wc) / ((s + wc)^2 + wr^2) w per axis, or k / (s + wc - j wr) w in the dq frame; wc may be zero."""
    k, wr = decimal(rng, 1, 1e3), decimal(rng, 100, 3000)
    wc = ZERO if rng.random() < 0.5 else decimal(rng, 0.1, 100)
    loop.put_w(name, loop.eye(k))
    loop.push(**{name: loop.one})
    if loop.m == 2 and rng.random() < 0.5:
        loop.put(name, **{name: add(loop.eye(-wc), scale(wr, J))})
    else:
        other = name + "q"
        loop.put(name, **{name: loop.eye(-wc), other: loop.eye(wr)})
        loop.put(other, **{name: loop.eye(-wr), other: loop.eye(-wc)})
    return PASSIVE


def second_order(rng: random.Random, loop: Loop, name: str) -> str | None:
    """zeta = k wn^2 / (s^2 + 2 d wn s + wn^2) w: a measuring filter, not positive real by itself."""
    k, wn, d = decimal(rng, 0.01, 5), decimal(rng, 100, 1e5), decimal(rng, 0.3, 1)
    other = name + "2"
    loop.put(name, **{other: loop.eye(wn)})
    loop.put(other, **{name: loop.eye(-wn), other: loop.eye(-2 * d * wn)})
    loop.put_w(other, loop.eye(wn))
    loop.push(**{name: loop.eye(k)})
    return None


def low_pass_voltage(rng: random.Random, loop: Loop, name: str) -> str | None:
    """zeta = k V / (tau s + 1): a filtered feedforward, harmless or not."""
    k, tau = signed(rng, 0.01, 1), decimal(rng, 1e-6, 1e-2)
    loop.put(name, **{name: loop.eye(-1 / tau)}, V=loop.eye(1 / tau))
    loop.push(**{name: loop.eye(k)})
    return None


def observer(rng: random.Random, loop: Loop, name: str) -> str | None:
    """u uses an estimate of I; its error e = I^ - I obeys e' = -(R/L + j w0 + l) e, out of reach: u += K12 e.

    Passive by condition (3) of the oracle if H is damped in all directions, as then Phi has full rank.
    """
    l = decimal(rng, 1e-1, 1e4)  # noqa: E741
    loop.put(name, **{name: add(loop.eye(-loop.plant.R / loop.plant.L - l), scale(-1, loop.turn))})
    loop.put("I", **{name: scale(1 / loop.plant.L, loop.K12)})
    return PASSIVE


def delay(rng: random.Random, loop: Loop, name: str) -> str | None:
    """u passes (1 - s T/2) / (1 + s T/2): xd' = (u - xd) 2/T, and 2 xd - u acts."""
    rate = 2 / decimal(rng, 1e-6, 1e-3)
    gains = {"V": loop.K11, "I": loop.K12, **({"v": loop.K13} if loop.with_integrator else {})}
    loop.put(name, **{name: loop.eye(-rate)}, **{k: scale(rate, K) for k, K in gains.items()})
    loop.put("I", **{name: loop.eye(2 / loop.plant.L)}, **{k: scale(-2 / loop.plant.L, K) for k, K in gains.items()})
    return None


def lag(rng: random.Random, loop: Loop, name: str) -> str | None:
    """The inner loop sees I through 1 / (tau s + 1): K12 acts on it."""
    tau = decimal(rng, 1e-6, 1e-2)
    loop.put(name, **{name: loop.eye(-1 / tau)}, I=loop.eye(1 / tau))
    loop.put("I", **{name: scale(1 / loop.plant.L, loop.K12)}, I=scale(-1 / loop.plant.L, loop.K12))
    return None


def wrong_sign(rng: random.Random, loop: Loop, name: str) -> str | None:
    """A low-pass stage with zeta = -k xf."""
    k, tau = decimal(rng, 0.1, 20), decimal(rng, 1e-5, 1e-1)
    loop.put(name, **{name: loop.eye(-1 / tau)})
    loop.put_w(name, loop.eye(1 / tau))
    loop.push(**{name: loop.eye(-k)})
    return None


STAGES: dict[str, Callable[[random.Random, Loop, str], str | None]] = {
    "low-pass on the current": low_pass_current,
    "virtual impedance": virtual_impedance,
    "resonant": resonant,
    "second-order filter": second_order,
    "low-pass on the voltage": low_pass_voltage,
    "observer": observer,
    "delay": delay,
    "lag": lag,
    "wrong sign": wrong_sign,
}


def inverter(rng: random.Random, kind: str) -> Made:
    """ "filter with PI" and then the names of its stages, or "two stages"."""
    m = channels(rng)
    names = [name for name in STAGES if name in kind]
    if "two stages" in kind:
        names = rng.sample(["low-pass on the current", "virtual impedance", "resonant"], 2)
    strict = "observer" in names
    family = rng.choice(
        ("decoupled", "rotation-invariant", "coupled", "one lossless direction", "lossless")[: 3 if strict else 5]
    )
    loop = Loop(rng, family, m, with_integrator=rng.random() < 0.7)
    verdicts = [STAGES[name](rng, loop, f"x{k}") for k, name in enumerate(names)]
    known = PASSIVE if all(v == PASSIVE for v in verdicts) else None
    return loop.port(fixed_rows=rng.random() < 0.3), known


# --- kinds --------------------------------------------------------------------------------------------------


def passive_hamiltonian(rng: random.Random, kind: str) -> Made:
    m = channels(rng)
    n = states(rng, max(2, m + 1))
    make = lossless_port if "lossless port" in kind else damped
    return make(rng, n, m), PASSIVE


def deficient(rng: random.Random, kind: str) -> Made:
    m = channels(rng)
    n = states(rng, max(2, m))
    rank = 0 if kind.startswith("lossless") else rng.randint(0, n - 1)
    return hamiltonian(skew(rng, n, 0.3), positive(rng, n, rank), positive(rng, n), entrance(rng, n, m)), PASSIVE


def ladders(rng: random.Random, _: str) -> Made:
    """Lossless, or with losses at some places, in one channel or two, the second with a ladder of its own."""

    def one(n: int) -> LinearPort:
        return ladder(rng, n, {i: decimal(rng, 0.1, 10) for i in rng.sample(range(n), rng.choice((0, 1, 1, 2)))})

    if channels(rng) == 1:
        return one(states(rng, 2)), PASSIVE
    return shaken(rng, beside(one(rng.randint(2, 6)), one(rng.randint(2, 6)))), PASSIVE


def beside_lossy(rng: random.Random, kind: str) -> Made:
    m = channels(rng)
    lossy = damped(rng, states(rng, m, 6), m)
    for _ in range(rng.randint(1, 2)):
        lossy = in_series(lossy, resonance(rng, m, "irrational" in kind))
    if rng.random() < 0.5:  # an integrator too: a pole at zero
        lossy = in_series(lossy, LinearPort(zeros(m, m), identity(m), positive(rng, m)))
    return shaken(rng, lossy), PASSIVE


def integral_action(rng: random.Random, kind: str) -> Made:
    m = channels(rng)
    n = states(rng, max(2, m + 1), MOST_STATES - m)
    if "lossless" in kind:
        port = hamiltonian(skew(rng, n), positive(rng, n, rng.randint(0, n - 1)), positive(rng, n), entrance(rng, n, m))
    else:
        port = damped(rng, n, m)
    port = with_integral_action(rng, port)
    return port, PASSIVE


def current_source(rng: random.Random, kind: str) -> Made:
    """A capacitor fed by a current that obeys stable dynamics of its own; with a conductance it is passive."""
    m = channels(rng)
    k = states(rng, 1, MOST_STATES - m)
    E = tuple(tuple(signed(rng, 0.1, 10) for _ in range(k)) for _ in range(m))
    turn = scale(signed(rng, 0.1, 10), J) if m == 2 else zeros(1, 1)
    loss = positive(rng, m) if "conductance" in kind else zeros(m, m)
    F = block([[add(turn, scale(-1, loss)), E], [zeros(k, m), stable_matrix(rng, k)]])
    port = LinearPort(F, block([[identity(m)], [zeros(k, m)]]), block([[identity(m), zeros(m, k)]]))
    return port, PASSIVE if "conductance" in kind else NOT_PASSIVE


def widened(rng: random.Random, port: LinearPort) -> LinearPort:
    """The port, or two channels that mix it with another positive real one."""
    room = MOST_STATES - len(port.F)
    if channels(rng) == 1 or room < 1:
        return port
    other = damped(rng, rng.randint(1, min(room, 4)), 1)
    if room >= 2 and rng.random() < 0.3:
        other = ladder(rng, rng.randint(2, min(room, 4)), {})
    return shaken(rng, beside(port, other))


def touch(rng: random.Random, kind: str) -> Made:
    """Re Z touches zero; with an error it crosses zero or stays away by 10^-3 to 10^-30."""
    error = ZERO
    if kind.startswith("error"):
        error = rng.choice((-1, 1)) * Fraction(1, 10 ** rng.randint(3, 30))
    port = touching(rng, rng.randint(3, 6), "irrational" in kind, error)
    return widened(rng, port), PASSIVE if error >= 0 else NOT_PASSIVE


def zero_damping(rng: random.Random, kind: str) -> Made:
    """The inverter with H Bm + Bm H' = 0, or -10^-k I or +10^-k I; no integrator, since K13 = -H X = 0."""
    m = channels(rng)
    loop = Loop(rng, "coupled", m, with_integrator=False)
    error = rng.choice((-1, 1)) * Fraction(1, 10 ** rng.randint(3, 30)) if kind.startswith("error") else ZERO
    N = scale(error, identity(m))
    loop.H = damping(rng, loop.Bm, N, skew=rng.random() < 0.7) if m == 2 else scale(-1, N)
    loop.entries["I", "I"] = scale(1 / loop.plant.L, loop.H)
    return loop.port(fixed_rows=rng.random() < 0.3), PASSIVE if error >= 0 else NOT_PASSIVE


def with_entry_error(rng: random.Random, port: LinearPort, relative: Fraction | None = None) -> LinearPort:
    """A tiny (or the given relative) error in one entry of F or of C that is not zero."""
    which = "C" if rng.random() < 0.2 else "F"
    rows = [list(row) for row in getattr(port, which)]
    i, j = rng.choice([(i, j) for i, row in enumerate(rows) for j, x in enumerate(row) if x])
    rows[i][j] += tiny(rng, rows[i][j]) if relative is None else relative * rows[i][j]
    changed = tuple(map(tuple, rows))
    if which == "C":
        return LinearPort(port.F, port.B, changed)
    return LinearPort(changed, port.B, port.C)


def entry_error(rng: random.Random, kind: str) -> Made:
    """A design on the boundary or in the interior with an error in one entry. The construction does not decide."""
    base = KINDS[kind.removeprefix("error, entry of: ")][1]
    port, _ = base(rng, kind.removeprefix("error, entry of: "))
    return with_entry_error(rng, port), None


def perturbed(rng: random.Random, _: str) -> Made:
    m = channels(rng)
    n = states(rng, max(2, m + 1))
    make = rng.choice((damped, lossless_port))
    return with_entry_error(rng, make(rng, n, m), rng.choice((-1, 1)) * decimal(rng, 0.01, 3)), None


def full(rng: random.Random, rows: int, width: int) -> Matrix:
    return tuple(tuple(signed(rng, 0.1, 10) for _ in range(width)) for _ in range(rows))


def generic(rng: random.Random, kind: str) -> Made:
    """Random F, B, C, F shifted to be stable by Gershgorin's bound; in half of them C = (Q B)' with Q > 0."""
    m = channels(rng)
    n = states(rng, max(2, m))
    F, B = full(rng, n, n), full(rng, n, m)
    radius = max(sum(map(abs, row)) for row in F)
    if "stable" in kind:
        F = add(F, scale(-radius, identity(n)))
    if rng.random() < 0.5:
        return LinearPort(F, B, full(rng, m, n)), None
    return LinearPort(F, B, transpose(multiply(positive(rng, n), B))), None


def wrong_damping(rng: random.Random, _: str) -> Made:
    """R with one negative direction: F'P + PF <= 0 fails for P = Q, though another P might do."""
    m = channels(rng)
    n = states(rng, max(2, m + 1))
    R = [list(row) for row in positive(rng, n)]
    k = rng.randrange(n)
    R[k][k] -= 2 * R[k][k] + decimal(rng, 0.1, 10)
    return hamiltonian(skew(rng, n), tuple(map(tuple, R)), positive(rng, n), entrance(rng, n, m)), None


def non_minimum_phase(rng: random.Random, _: str) -> Made:
    """N / D with D Hurwitz and a zero in Re s > 0: never positive real."""
    n = rng.randint(2, 7)
    N = product([-decimal(rng, 0.1, 10), decimal(rng, 0.1, 10)], hurwitz_polynomial(rng, rng.randint(0, n - 2)))
    return widened(rng, companion(hurwitz_polynomial(rng, n), N)), NOT_PASSIVE


def negative_symmetric(rng: random.Random, _: str) -> Made:
    """C B is not symmetric or not >= 0 though F and B are those of a passive port: P B = C' has no P >= 0."""
    m = channels(rng)
    port = damped(rng, states(rng, max(2, m)), m)
    turned = (
        scale(-1, port.C)
        if m == 1 or rng.random() < 0.3
        else multiply(add(identity(2), scale(signed(rng, 1e-3, 10), J)), port.C)
    )
    return LinearPort(port.F, port.B, turned), NOT_PASSIVE


def with_autonomous(rng: random.Random, kind: str) -> Made:
    """States that the input does not reach ("unreached") or that the output does not see ("unseen").

    The base is damped (Phi > 0 everywhere), unless the kind says "lossless port". Then:
    - unreached and seen: stable ones are harmless, others (undamped, growing) are not;
    - unseen, driven by the base: stable ones are harmless, others leave singular storage functions only;
    - apart from everything: stable and undamped ones are harmless, growing ones leave singular ones only.
    """
    m = channels(rng)
    n = states(rng, max(2, m + 1), 8)
    k = states(rng, 1, min(4, MOST_STATES - n))
    lossless = "lossless port" in kind
    base = (lossless_port if lossless else damped)(rng, n, m)
    if "growing" in kind:
        A = growing_matrix(rng, k)
    else:
        A = lossless_matrix(rng, k) if "undamped" in kind else stable_matrix(rng, k)
    E, Z = full(rng, n, k), zeros(n, k)
    tame = "undamped" not in kind and "growing" not in kind
    if kind.startswith("unreached"):
        F, expected = block([[base.F, E], [zeros(k, n), A]]), PASSIVE if tame else NOT_PASSIVE
    elif kind.startswith("unseen"):
        F, expected = block([[base.F, Z], [transpose(E), A]]), PASSIVE if tame else SEMIDEFINITE
    else:
        F, expected = block([[base.F, Z], [zeros(k, n), A]]), SEMIDEFINITE if "growing" in kind else PASSIVE
    port = LinearPort(F, block([[base.B], [zeros(k, m)]]), block([[base.C, zeros(m, k)]]))
    return port, None if lossless else expected


Maker = Callable[[random.Random, str], Made]
# Weights and makers. The inverter loops stay in their own states half of the time; the others are always hidden.
KINDS: dict[str, tuple[int, Maker]] = {
    "port-Hamiltonian": (5, passive_hamiltonian),
    "port-Hamiltonian, lossless port": (6, passive_hamiltonian),
    "port-Hamiltonian, deficient damping": (7, deficient),
    "lossless": (3, deficient),
    "ladder": (5, ladders),
    "resonance beside a lossy part, rational": (4, beside_lossy),
    "resonance beside a lossy part, irrational": (4, beside_lossy),
    "integral action": (3, integral_action),
    "integral action, lossless parts": (3, integral_action),
    "current source": (2, current_source),
    "current source with a conductance": (2, current_source),
    "filter with PI": (3, inverter),
    "filter with PI, low-pass on the current": (4, inverter),
    "filter with PI, virtual impedance": (3, inverter),
    "filter with PI, resonant": (4, inverter),
    "filter with PI, two stages": (3, inverter),
    "filter with PI, observer": (3, inverter),
    "filter with PI, second-order filter": (3, inverter),
    "filter with PI, low-pass on the voltage": (3, inverter),
    "filter with PI, delay": (3, inverter),
    "filter with PI, lag": (3, inverter),
    "filter with PI, wrong sign": (2, inverter),
    "touching at a rational frequency": (3, touch),
    "touching at an irrational frequency": (3, touch),
    "no damping": (2, zero_damping),
    "error, touching at a rational frequency": (3, touch),
    "error, touching at an irrational frequency": (3, touch),
    "error, no damping": (4, zero_damping),
    "error, entry of: port-Hamiltonian, deficient damping": (2, entry_error),
    "error, entry of: port-Hamiltonian, lossless port": (2, entry_error),
    "error, entry of: lossless": (2, entry_error),
    "error, entry of: resonance beside a lossy part, irrational": (2, entry_error),
    "error, entry of: integral action": (2, entry_error),
    "error, entry of: filter with PI": (2, entry_error),
    "error, entry of: filter with PI, resonant": (2, entry_error),
    "error, entry of: touching at a rational frequency": (2, entry_error),
    "generic, stable": (3, generic),
    "generic": (2, generic),
    "perturbed": (4, perturbed),
    "wrong sign of damping": (3, wrong_damping),
    "non-minimum phase": (3, non_minimum_phase),
    "wrong output": (2, negative_symmetric),
    "unreached": (2, with_autonomous),
    "unreached, lossless port": (2, with_autonomous),
    "unreached, undamped": (1, with_autonomous),
    "unreached, growing": (1, with_autonomous),
    "unseen": (2, with_autonomous),
    "unseen, lossless port": (2, with_autonomous),
    "unseen, undamped": (1, with_autonomous),
    "unseen, growing": (1, with_autonomous),
    "apart": (1, with_autonomous),
    "apart, undamped": (1, with_autonomous),
    "apart, growing": (1, with_autonomous),
}
BADLY_SCALED = "badly scaled"
SHARE_BADLY_SCALED = 0.12


def make_loop(rng: random.Random, kind: str) -> Design:
    """A loop of a kind, hidden behind a change of states; "badly scaled" is any of the kinds, rescaled."""
    badly = kind == BADLY_SCALED
    origin = rng.choice(list(KINDS)) if badly else kind
    port, expected = KINDS[origin][1](rng, origin)
    if ("filter" not in origin and "damping" not in origin) or (port.capacitance_farad is None and rng.random() < 0.6):
        port = hidden(rng, port)
    if badly:
        port = rescaled(rng, port)
    numbers: dict[str, object] = {"states": len(port.F), "origin": origin, "F": port.F, "B": port.B, "C": port.C}
    return Design(kind, port, numbers, expected)


def loops(count: int, seed: int = 1) -> Iterator[Design]:
    """`count` loops; each kind occurs once at least if `count` allows. Each has a random stream of its own."""
    rng = random.Random(f"loops-{seed}")
    names = [*KINDS, BADLY_SCALED]
    weights = [weight for weight, _ in KINDS.values()]
    weights.append(round(sum(weights) * SHARE_BADLY_SCALED))
    drawn = names + rng.choices(names, weights, k=max(0, count - len(names)))
    if count < len(names):
        drawn = rng.sample(names, count)
    for k, kind in enumerate(drawn):
        yield make_loop(random.Random(f"loops-{seed}-{k}-{kind}"), kind)


def damping_series() -> Iterator[tuple[int | None, LinearPort]]:
    """(k, port) of an LC filter with a state feedback and damping H = +10^-k I, k = 1..30, then (None, H = 0).

    Negative damping: never passive. At zero: passive, with S = (C|V|^2 + L|I|^2 / b) / 2. R, L, C, w0 of a usual filter.
    """
    plant = Filter(Fraction("0.1"), Fraction("1.8e-3"), Fraction("25e-6"), Fraction("314.159265358979"))
    Z, one, b = zeros(2, 2), identity(2), Fraction("0.7")
    for k in (*range(1, 31), None):
        H = scale(Fraction(1, 10**k) if k else ZERO, one)
        F = block([[scale(-plant.w0, J), scale(1 / plant.C, one)], [scale(-b / plant.L, one), scale(1 / plant.L, H)]])
        yield k, LinearPort(F, block([[scale(1 / plant.C, one)], [Z]]), block([[one, Z]]))
