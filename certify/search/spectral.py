"""What is left of the storage LMI once all known images are out: a Riccati inequality, and its Hamiltonian matrix.

In a basis [K, R] of the states, with P K known and X = R'PR free, M >= 0 is
    A'X + X A + Q + (X G + S') N^-1 (G'X + S) <= 0,
N > 0 being the part of M on K that does not vanish (THEORY 4). Its Hamiltonian matrix is rational, so whether it has
eigenvalues on the imaginary axis - frequencies at which nothing dissipates - is decided exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from flint import arb, arb_mat, ctx, fmpq, fmpq_mat, fmpq_poly, fmpz_poly

from certify.kernel.linalg import Matrix, Vector
from certify.search import exact
from certify.search.exact import Exact
from certify.search.facial import Family

# Margins tried, as powers of two, each with the precision in bits that it takes.
MARGINS = ((-8, 200), (-20, 200), (-50, 300), (-100, 500), (-200, 800), (-400, 1500))


@dataclass(frozen=True)
class Riccati:
    """A'X + X A + Q + (X G + S') N^-1 (G'X + S) <= 0. Shapes: A, Q (r, r), G (r, w), N (w, w), S (w, r)."""

    A: Exact
    G: Exact
    N: Exact
    S: Exact
    Q: Exact

    def hamiltonian(self, margin: Exact | None = None) -> Exact:
        """H = [[A_h, G N^-1 G'], [-Q_h, -A_h']]; `margin` is added to Q. Shape (2r, 2r)."""
        A, Q = self.A, self.Q if margin is None else self.Q + margin
        W = A * 0
        if self.N.nrows():
            inverse = self.N.inv()
            A = A + self.G * inverse * self.S
            Q = Q + self.S.transpose() * inverse * self.S
            W = self.G * inverse * self.G.transpose()
        return exact.block([[A, W], [-Q, -A.transpose()]])


@dataclass(frozen=True)
class Reduced:
    """The Riccati inequality of a family, and how to come back: P = T'^-1 [[a, b], [b', X]] T^-1, T = [K, R]."""

    riccati: Riccati
    K: Exact
    R: Exact
    a: Exact
    b: Exact
    inner: Exact  # the combinations of K on which N lives

    def storage(self, X: Exact) -> Exact:
        inverse = exact.block([[self.K, self.R]]).inv()
        whole = exact.block([[self.a, self.b], [self.b.transpose(), X]]) if self.K.ncols() else X
        return inverse.transpose() * whole * inverse

    def least(self) -> Exact:
        """b' a^-1 b: P > 0 iff X is larger."""
        zero = self.R.transpose() * self.R * 0
        return self.b.transpose() * self.a.inv() * self.b if self.K.ncols() else zero

    def lift(self, pairs: Exact) -> Exact:
        """The states at which M vanishes, from pairs [u; p] with X u = p. Shapes: (2r, k) to (n, k)."""
        r = self.R.ncols()
        rows = pairs.tolist()
        u = fmpq_mat(r, pairs.ncols(), [x for row in rows[:r] for x in row])
        p = fmpq_mat(r, pairs.ncols(), [x for row in rows[r:] for x in row])
        states = self.R * u
        if self.riccati.N.nrows():
            w = self.riccati.N.inv() * (self.riccati.G.transpose() * p + self.riccati.S * u)
            states += self.K * (self.inner * w)
        return states


def reduce_to_riccati(family: Family) -> Reduced:
    """The Riccati inequality of a family that `is_free`, after `reduce_known`."""
    K, image = family.known()
    R, k = exact.complement(K), K.ncols()
    T = exact.block([[K, R]])
    F = T.inv() * family.F * T
    a, b = K.transpose() * image, image.transpose() * R
    n = family.n

    def part(rows: range, cols: range) -> Exact:
        return fmpq_mat(len(rows), len(cols), [F[i, j] for i in rows for j in cols])

    known, rest = range(k), range(k, n)
    F_kk, F_kr, F_rk, F_rr = part(known, known), part(known, rest), part(rest, known), part(rest, rest)
    half = a * F_kk + b * F_rk
    N = -(half + half.transpose())
    inner = exact.complement(exact.null_space(N)) if k else N
    coupling = F_kk.transpose() * b + a * F_kr + b * F_rr
    cross = b.transpose() * F_kr if k else F_rr * 0
    riccati = Riccati(
        F_rr,
        F_rk * inner,
        inner.transpose() * N * inner,
        inner.transpose() * coupling,
        cross + cross.transpose(),
    )
    return Reduced(riccati, K, R, a, b, inner)


# --- the imaginary axis ---------------------------------------------------------------------------------------


def even_part(H: Exact) -> fmpz_poly:
    """h with det(s I - H) = c h(s^2), for a Hamiltonian matrix."""
    whole = H.charpoly().numer()
    return fmpz_poly([whole[k] for k in range(0, whole.degree() + 1, 2)])


def negative_roots(p: fmpz_poly) -> list[tuple[Any, int]]:
    """The real roots x <= 0 of p with their multiplicities, as balls."""
    return [(root.real, count) for root, count in p.complex_roots() if root.imag == 0 and not root.real > 0]


@dataclass(frozen=True)
class AxisFactor:
    """An irreducible factor f of h that vanishes on the imaginary axis, x = s^2: at all of its roots, or at some."""

    f: fmpz_poly
    multiplicity: int
    entirely: bool


def axis_factors(H: Exact) -> list[AxisFactor]:
    h = even_part(H)
    result = []
    for f, multiplicity in h.factor()[1]:
        count = len(negative_roots(f))
        if count:
            result.append(AxisFactor(f, multiplicity, count == f.degree()))
    return result


def axis_pairs(H: Exact, f: fmpz_poly) -> Exact:
    """All [u; p] in the eigenspaces of H at the roots of f(s^2). Shape (2r, k)."""
    if f.degree() == 1 and f[0] == 0:
        return exact.null_space(H)
    return exact.null_space(polynomial_at(f, H * H))


def face_of_pairs(H: Exact, f: fmpz_poly, e: Exact) -> tuple[Exact, Vector]:
    """Columns U and weights w > 0 with U diag(w) U' = the sum of v v* over the parts v of e at each root of f(s^2).

    All roots are imaginary, so conj(theta) = -theta, and the sum is a trace over the number field: rational.
    """
    theta = fmpq_poly([0, 1])
    g = fmpq_poly(f)(fmpq_poly([0, 0, 1])) if f.degree() > 1 or f[0] != 0 else theta
    d = g.degree()
    # g(s) / (s - theta) = sum over k of s^k c_k(theta), c_k = g_(k+1) + g_(k+2) theta + ...
    c = [fmpq_poly([g[i] for i in range(k + 1, d + 1)]) for k in range(d)]
    traces = []
    for k in range(d):  # of theta^k, by the companion matrix
        traces.append(sum((((theta ** (i + k)) % g)[i] for i in range(d)), fmpq(0)))

    def trace(q: fmpq_poly) -> fmpq:
        rest = q % g
        return sum((rest[i] * traces[i] for i in range(d)), fmpq(0))

    mirrored = fmpq_poly([0, -1])
    T = fmpq_mat(d, d, [trace(c[k] * c[j](mirrored)) for k in range(d) for j in range(d)])
    powers, column = [], e
    for _ in range(d):
        powers.append(column)
        column = H * column
    L, pivots = _ldl(exact.from_flint(T))
    V = exact.block([powers]) * exact.to_flint(L)
    kept = [k for k, w in enumerate(pivots) if w]
    return exact.columns(V, kept), tuple(pivots[k] for k in kept)


def _ldl(a: Matrix) -> tuple[list[list[Fraction]], list[Fraction]]:
    """L and the pivots of a positive semidefinite A = L D L'."""
    n = len(a)
    rows = [list(row) for row in a]
    L = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            if rows[k][k]:
                L[i][k] = rows[i][k] / rows[k][k]
                rows[i] = [x - L[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return L, [rows[k][k] for k in range(n)]


def polynomial_at(g: Any, F: Exact) -> Exact:
    value, one = F * 0, exact.identity(F.nrows())
    for k in range(g.degree(), -1, -1):
        value = value * F + one * fmpq(g[k])
    return value


def conserved(A: Exact, g: Any) -> Exact:
    """Omega > 0 with A Omega + Omega A' = 0, for the imaginary roots of an irreducible g."""
    if g.degree() == 1:
        return exact.identity(1)
    f = type(g)([g[i] for i in range(0, g.degree() + 1, 2)])
    U, weights = face_of_pairs(A, f, exact.columns(exact.identity(A.nrows()), [0]))
    return U * exact.diagonal(weights) * U.transpose()


def hidden_undamped_modes(family: Family) -> Iterator[tuple[Exact, Exact]]:
    """V and an image P V for each undamped mode that no input reaches and no output shows: any energy will do."""
    F, n = family.F, family.n
    for g, _ in F.charpoly().numer().factor()[1]:
        if not all(z.real == 0 for z, _ in g.complex_roots()):
            continue
        V, R = exact.null_space(polynomial_at(g, F)), exact.independent(polynomial_at(g, F))
        if V.ncols() != g.degree() or V.ncols() + R.ncols() != n or (family.C * V).rank():
            continue
        T = exact.block([[V, R]])
        if T.rank() < n:
            continue
        inverse = T.inv()
        rows = inverse.tolist()[: V.ncols()]
        if (exact.of_rows(rows, n) * family.B).rank():
            continue
        energy = conserved(exact.solve_columns(V, F * V), g).inv()
        yield (
            V,
            inverse.transpose() * exact.block([[energy], [exact.of_rows([[0] * V.ncols()] * R.ncols(), V.ncols())]]),
        )


# --- strictly feasible inequalities ---------------------------------------------------------------------------


def has_axis_eigenvalues(H: Exact) -> bool:
    return bool(negative_roots(even_part(H)))


def riccati_candidates(riccati: Riccati) -> Iterator[Exact]:
    """Solutions X of the inequality with some margin, from the invariant subspaces in high precision.

    The margin is a small multiple of a diagonal matrix; both extreme solutions and their mean are tried. None of them
    is trusted.
    """
    r = riccati.A.nrows()
    for exponent, bits in MARGINS:
        entries = [
            fmpq(2**10 + i + 1, 2**10) * _power(exponent) if i == j else fmpq(0) for i in range(r) for j in range(r)
        ]
        H = riccati.hamiltonian(fmpq_mat(r, r, entries))
        if has_axis_eigenvalues(H):
            continue
        ends = [X for X in (_extreme(H, bits, sign) for sign in (1, -1)) if X is not None]
        if len(ends) == 2:
            yield (ends[0] + ends[1]) * fmpq(1, 2)
        yield from ends


def _power(exponent: int) -> fmpq:
    return fmpq(1, 2**-exponent) if exponent < 0 else fmpq(2**exponent)


def _extreme(H: Exact, bits: int, sign: int) -> Exact | None:
    """X with H [I; X] = [I; X] (stable part), or the antistable one for the other sign: by the matrix sign function."""
    r = H.nrows() // 2
    with ctx.workprec(bits):
        try:
            W = arb_mat(H)
            one = arb_mat(exact.identity(2 * r))
            for _ in range(60 + bits // 8):
                inverse = W.inv().mid()
                size = (_norm(inverse) / _norm(W)).sqrt()
                factor = size if _norm(W - inverse) / _norm(W) > 0.1 else arb(1)
                after = ((W * factor + inverse * (1 / factor)) * 0.5).mid()
                change = _norm(after - W) / _norm(after)
                W = after
                if change < 2.0 ** (-bits // 2 + 10):
                    break
            else:
                return None
            W = W * sign + one
            rows = W.tolist()
            right = arb_mat(2 * r, r, [x for row in rows for x in row[r:]])
            left = arb_mat(2 * r, r, [-x for row in rows for x in row[:r]])
            X = (right.transpose() * right).solve(right.transpose() * left).mid()
            return _rational((X + X.transpose()) * 0.5)
        except (ZeroDivisionError, ValueError, OverflowError):
            return None


def _norm(a: arb_mat) -> Any:
    return sum((x * x for x in a.entries()), 0).sqrt()


def _rational(X: arb_mat) -> Exact:
    """The middles of balls as exact numbers."""
    entries = []
    for x in X.entries():
        mantissa, exponent = x.mid().man_exp()
        entries.append(fmpq(int(mantissa)) * _power(int(exponent)))
    return fmpq_mat(X.nrows(), X.ncols(), entries)
