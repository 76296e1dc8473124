"""An oracle for the passivity of a linear port x' = F x + B d, z = C x with one or two channels, exact in flint.

It never builds a storage function. It decides whether P >= 0 with P B = C', F'P + P F <= 0 exists from the
frequency response Z(s) = C (sI - F)^-1 B and from the modes that Z does not show. Z(-s)' is written Z~(s).

Theorem. A storage function of any kind exists iff, on the observable quotient of (F, B, C),
(1) Z is positive real: no pole in Re s > 0, Phi(jw) = Z(jw) + Z(jw)* >= 0 for all real w that are no poles, and
    the poles on the imaginary axis are simple with Hermitian residues >= 0 (Z is strictly proper, so there is
    nothing to check at infinity);
(2) every mode that no input reaches decays: the eigenvalues of F22 in Kalman's form [[F11, F12], [0, F22]],
    [B1; 0] have Re s < 0;
(3) U(-s)' C (sI - F)^-1 has no pole in Re s < 0, where the columns of the polynomial matrix U, of full rank at
    every s, span the null space of Phi(s) over the rational functions. (Void if Phi has full rank or F22 is empty.)

Sketch of the proof. The storage functions S >= 0 with S' <= z'd exist iff the available storage
S_a(x) = sup over d, T of -int_0^T z'd from x is finite for all x; it is then quadratic, x'Px/2, and P solves the
LMI. S_a does not see unobservable states, hence the quotient; there every solution has P > 0, since ker P is
invariant under F and lies in ker C.
- So F has no eigenvalue in Re s > 0. At an eigenvalue jw with right and left eigenbases R, L (L*R = I), M R = 0
  follows from R*M R = 0, so P R = L Phi0 with Phi0 = R*P R > 0, and P B = C' reads Phi0 (L*B) = (C R)*. Hence the
  residue K = C R L*B of Z is (L*B)* Phi0 (L*B), Hermitian and >= 0, and L*B has the rank of C R, which is injective
  by observability: so L*B has full row rank, and the mode is reached. Conversely Phi0 = (CR)* K^+ (CR) solves it.
  P splits along the spectral subspaces of Re s = 0 and Re s < 0, which leaves the latter.
- There -int z'd = -<z0, d> - <d, T d>/2 with z0 = C exp(Ft) x, T the Wiener-Hopf operator with symbol Phi = W~ W, W
  outer. Its supremum is finite iff z0 lies in the range of the adjoint of W. That adjoint maps exp(st) g to
  exp(st) W(-s)'g for Re s < 0, where W(-s)' is injective with rank r = rank Phi, so that by dimension (Jordan chains
  alike) the sums of exponentials in its range are those orthogonal to its complement {U q}: <z0, U q> = 0 for all
  q, which is (3). If (3) fails, some d = U q costs nothing, <d, T d> = 0, and gains -<z0, d> without bound: S_a is
  infinite. On reached modes (3) holds by itself, for U~ Z = -U~ Z~ has poles on neither side.

Example: one axis with 1 - K11 = L X and h < 0. Then Z is lossless (Phi = 0, U = 1), but the mode w = I - X v,
L w' = h w, is out of reach and drives V: the input that repeats the lossless response scaled by k gains k <z0, d>.

A positive *definite* P exists iff moreover (4) F is stable in the sense of Lyapunov: no eigenvalue in Re s > 0, those
on the imaginary axis semisimple; and (5) the dual port (F', C', B') has a storage function too.
Sketch. Needed: P gives (4), and P^-1 is a storage matrix of the dual. Enough: P splits along the spectral subspaces of
Re s = 0 and Re s < 0, as above. At jw, with X = L*B and Y = (C R)*, Phi0 X = Y has a solution Phi0 > 0 iff X*Y is
Hermitian >= 0 and rank X = rank Y = rank X*Y; that X*Y has these ranks is "every observable mode is reached" and its
dual. So let F be Hurwitz, and x = (c, r) with c the reached states. On the states c alone, (5) gives the observable
dual a storage matrix, all of which are definite, and its inverse is a Pc > 0; so all Pc in the relative interior of
the storage matrices there are. Let Pa >= 0 belong to the whole port, with the blocks Pa_c, Xa. For P = [[Pc, Xa],
[Xa', Y]], P B = C' holds, and if the off-diagonal block of M maps into the range of M_c = -(Fc'Pc + Pc Fc), then
Y = t Y0 with -(Fr'Y0 + Y0 Fr) > 0 and t large makes P > 0 and M >= 0. It does: k in ker M_c lies in the kernel of
every storage's M, since Pc is in the relative interior, and in that of D = Pc - Pa_c, so that k'M_cr = k'Ma_cr = 0.
(D k = 0: for Phi > 0 at some w, infinity say by a Moebius map of the axis, which keeps the set of storage matrices,
D solves A'D + D A + D B R^-1 B' D <= 0 with A the closed loop of the least storage. If D0 is the largest, the others
include all (D0^-1 + W)^-1 on the quotient by its kernel, W from A W + W A' < 0, and these have no common kernel k there.
Inputs with Phi(s) u(s) = 0 for all s lead to states x(s) with M x(s) = 0 and F'D x(s) = -s D x(s) for every P,
hence D x(s) = 0.) `tests/loops.py` tests the rule on ports built to have or lack a definite P.

What is exact: ranks, gcds, characteristic polynomials and divisions are rational. Signs of roots and of values at roots
are read off enclosures in ball arithmetic; whether such a sign is zero is decided by gcds first, so that a longer
enclosure always settles it, and one that does not is an ArithmeticError, never a verdict. flint isolates the
roots of an integer polynomial and returns real ones with an imaginary part of exactly zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flint import ctx, fmpq, fmpq_mat, fmpq_poly

from certify.kernel.linalg import Matrix
from certify.kernel.model import LinearPort

PolyMatrix = list[list[fmpq_poly]]
VARIABLE = fmpq_poly([0, 1])
MIRRORED = fmpq_poly([0, -1])
ONE = fmpq_poly([1])


@dataclass(frozen=True)
class Truth:
    """`passive`: some P >= 0 exists. `definite`: some P > 0 exists."""

    passive: bool
    reason: str
    definite: bool = False
    uncontrollable: int = 0
    unobservable: int = 0

    @property
    def verdict(self) -> str:
        if not self.passive:
            return "not passive"
        return "semidefinite" if self.definite is False else "passive"


def decide(port: LinearPort) -> Truth:
    """Whether a storage function exists, and a definite one. Raises: ValueError if there are more than two channels."""
    F, B, C = (to_flint(matrix) for matrix in (port.F, port.B, port.C))
    if B.ncols() > 2 or C.nrows() != B.ncols():
        raise ValueError("the oracle knows one or two channels")
    truth = decide_semidefinite(F, B, C)
    if not truth.passive or not truth.unobservable:
        return truth
    if not is_lyapunov_stable(F):
        return replace(truth, definite=False, reason="a mode that nobody sees grows")
    dual = decide_semidefinite(F.transpose(), C.transpose(), B.transpose())
    return truth if dual.passive else replace(truth, definite=False, reason=f"the dual port: {dual.reason}")


def decide_semidefinite(F: fmpq_mat, B: fmpq_mat, C: fmpq_mat) -> Truth:
    """Whether some P >= 0 exists, by the theorem; `definite` is True if it exists, of the observable part that is."""
    n = F.nrows()
    Fo, Bo, Co = observable_part(F, B, C)
    F1, B1, C1 = controllable_part(Fo, Bo, Co)
    hidden, unreached = n - Fo.nrows(), Fo.nrows() - F1.nrows()

    def refuted(reason: str) -> Truth:
        return Truth(False, reason, False, unreached, hidden)

    N, D = transfer(F1, B1, C1)
    symmetric, rest = split(D)
    if not has_imaginary_roots_only(symmetric) or not is_hurwitz(rest):
        return refuted("a pole in Re s > 0")
    Psi = hermitian_numerator(N, D)
    if not is_nonnegative_on_axis(Psi, D * mirror(D)):
        return refuted("Re Z(jw) < 0 at some w")
    reason = residue_fault(N, symmetric, rest)
    if reason:
        return refuted(reason)
    chi = Fo.charpoly()
    if not is_hurwitz(divide(chi, D)):
        return refuted("an observable mode out of reach does not decay")
    if unreached and not spares_lossless_channels(Psi, Fo, Co, chi):
        return refuted("an observable mode out of reach feeds a lossless channel")
    return Truth(True, "positive real, and the modes out of reach are harmless", True, unreached, hidden)


def is_lyapunov_stable(F: fmpq_mat) -> bool:
    """Whether x' = F x stays bounded: the imaginary eigenvalues semisimple, the others in Re s < 0."""
    symmetric, rest = split(F.charpoly())
    if not has_imaginary_roots_only(symmetric) or not is_hurwitz(rest):
        return False
    radical = divide(symmetric, symmetric.gcd(symmetric.derivative())) if symmetric.degree() > 0 else ONE
    return bool(F.nrows() - polynomial_at(radical, F).rank() == symmetric.degree())


# --- linear algebra -----------------------------------------------------------------------------------------


def to_flint(matrix: Matrix) -> fmpq_mat:
    return fmpq_mat([[fmpq(x.numerator, x.denominator) for x in row] for row in matrix])


def stacked(parts: list[fmpq_mat]) -> fmpq_mat:
    return fmpq_mat([row for part in parts for row in part.tolist()])


def echelon(matrix: fmpq_mat) -> tuple[fmpq_mat, list[int]]:
    """A basis of the row space in reduced echelon form, and its pivot columns."""
    reduced, rank = matrix.rref()
    rows = reduced.tolist()[:rank]
    return fmpq_mat(rank, matrix.ncols(), [x for row in rows for x in row]), [
        next(j for j, x in enumerate(row) if x != 0) for row in rows
    ]


def columns(matrix: fmpq_mat, chosen: list[int]) -> fmpq_mat:
    return fmpq_mat(matrix.nrows(), len(chosen), [row[j] for row in matrix.tolist() for j in chosen])


def null_columns(matrix: fmpq_mat) -> fmpq_mat:
    """A basis of {x : A x = 0} as columns."""
    basis, pivots = echelon(matrix)
    free = [j for j in range(matrix.ncols()) if j not in pivots]
    result = fmpq_mat(matrix.ncols(), len(free))
    for k, j in enumerate(free):
        result[j, k] = 1
        for i, pivot in enumerate(pivots):
            result[pivot, k] = -basis[i, j]
    return result


def observable_part(F: fmpq_mat, B: fmpq_mat, C: fmpq_mat) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat]:
    """The quotient by the unobservable states: y = T x with T F = Fo T and C = Co T."""
    T, pivots = echelon(stacked([C * F**k for k in range(F.nrows())]))
    return columns(T * F, pivots), T * B, columns(C, pivots)


def controllable_part(F: fmpq_mat, B: fmpq_mat, C: fmpq_mat) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat]:
    """The restriction to the states that the input reaches; dual to the observable part."""
    F1, C1, B1 = observable_part(F.transpose(), C.transpose(), B.transpose())
    return F1.transpose(), B1.transpose(), C1.transpose()


def polynomial_at(p: fmpq_poly, F: fmpq_mat) -> fmpq_mat:
    """p(F) by Horner's rule."""
    n = F.nrows()
    identity = fmpq_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    result = fmpq_mat(n, n)
    for c in reversed(p.coeffs()):
        result = result * F + c * identity
    return result


def transfer(F: fmpq_mat, B: fmpq_mat, C: fmpq_mat) -> tuple[PolyMatrix, fmpq_poly]:
    """N and D with C (sI - F)^-1 B = N / D, D the characteristic polynomial (Markov parameters times D)."""
    D, n = F.charpoly(), F.nrows()
    d = D.coeffs()
    markov, power = [], B
    for _ in range(n):
        markov.append(C * power)
        power = F * power
    N = [
        [
            fmpq_poly([sum((d[i + k + 1] * markov[k][row, col] for k in range(n - i)), fmpq(0)) for i in range(n)])
            for col in range(B.ncols())
        ]
        for row in range(C.nrows())
    ]
    return N, D


# --- polynomials --------------------------------------------------------------------------------------------


def mirror(p: fmpq_poly) -> fmpq_poly:
    return p(MIRRORED)


def divide(p: fmpq_poly, q: fmpq_poly) -> fmpq_poly:
    quotient, remainder = divmod(p, q)
    if remainder != 0:
        raise ValueError("the division leaves a remainder")
    return quotient


def split(p: fmpq_poly) -> tuple[fmpq_poly, fmpq_poly]:
    """p as (its roots r whose mirror image -r is a root too, the others). The others are not imaginary."""
    symmetric = p.gcd(mirror(p))
    return symmetric, divide(p, symmetric)


def in_square(p: fmpq_poly) -> fmpq_poly:
    """The q with p(s) = q(-s^2), for an even p: so p(jw) = q(w^2)."""
    coefficients = p.coeffs()
    if any(c != 0 for c in coefficients[1::2]):
        raise ValueError("the polynomial is not even")
    return fmpq_poly([(-1) ** k * c for k, c in enumerate(coefficients[::2])])


def is_nonnegative(q: fmpq_poly) -> bool:
    """Whether q(x) >= 0 for all x >= 0: the leading coefficient, and no positive root of odd multiplicity."""
    if q == 0:
        return True
    if q.leading_coefficient() < 0:
        return False
    odd = ONE
    for factor, multiplicity in q.factor_squarefree()[1]:
        if multiplicity % 2:
            odd *= factor
    if odd(0) == 0:
        odd = divide(odd, VARIABLE)
    # flint returns disjoint enclosures, and real roots with an imaginary part of exactly zero.
    return not any(root.imag.is_zero() and sign_of(root.real) > 0 for root, _ in odd.numer().complex_roots())


def sign_of(x: object) -> int:
    if x > 0:  # type: ignore[operator]
        return 1
    if x < 0:  # type: ignore[operator]
        return -1
    raise ArithmeticError("the enclosure contains zero")


def is_hurwitz(p: fmpq_poly) -> bool:
    """Whether all roots have Re s < 0. Imaginary roots are excluded exactly, so the enclosures become decisive."""
    symmetric, rest = split(p)
    if symmetric.degree() > 0:
        return False
    for precision in precisions():
        with ctx.workprec(precision):
            parts = [root.real for root, _ in rest.numer().complex_roots()]
        if all(x < 0 for x in parts):
            return True
        if any(x > 0 for x in parts):
            return False
    raise ArithmeticError("the roots are too close to the imaginary axis")


def has_imaginary_roots_only(p: fmpq_poly) -> bool:
    """Whether the roots of p, which lie symmetrically about 0, are all imaginary."""
    while p(0) == 0:
        p = divide(p, VARIABLE)
    roots = in_square(p).numer().complex_roots()  # x = -s^2 must be real and positive
    return all(root.imag.is_zero() and sign_of(root.real) > 0 for root, _ in roots)


def precisions() -> list[int]:
    return [64 * 2**k for k in range(10)]


def signs_at_roots(p: fmpq_poly, irreducible: fmpq_poly) -> set[int]:
    """The signs of Re p at the roots of an irreducible polynomial at which p is real."""
    p = p % irreducible
    if p == 0:
        return {0}
    for precision in precisions():
        with ctx.workprec(precision):
            values = [p.numer()(root).real for root, _ in irreducible.numer().complex_roots()]
        if all(x > 0 or x < 0 for x in values):
            return {sign_of(x) for x in values}
    raise ArithmeticError("a value is too close to zero")


# --- positive realness --------------------------------------------------------------------------------------


def hermitian_numerator(N: PolyMatrix, D: fmpq_poly) -> PolyMatrix:
    """Psi = D~ N + D N~, so that Psi(jw) = |D(jw)|^2 (Z(jw) + Z(jw)*)."""
    m = len(N)
    return [[N[i][j] * mirror(D) + mirror(N[j][i]) * D for j in range(m)] for i in range(m)]


def is_nonnegative_on_axis(Psi: PolyMatrix, square: fmpq_poly) -> bool:
    """Psi(jw) >= 0 for all w, by trace and determinant. At zeros of D this follows by continuity.

    `square` is D D~, which divides the determinant: the poles of Z + Z~ are those of diag(F, -F'), each minor alike.
    """
    if len(Psi) == 1:
        return is_nonnegative(in_square(Psi[0][0]))
    trace, determinant = Psi[0][0] + Psi[1][1], Psi[0][0] * Psi[1][1] - Psi[0][1] * Psi[1][0]
    return is_nonnegative(in_square(trace)) and is_nonnegative(in_square(divide(determinant, square)))


def residue_fault(N: PolyMatrix, symmetric: fmpq_poly, rest: fmpq_poly) -> str | None:
    """What is wrong with the poles on the imaginary axis (the roots of `symmetric`), or None."""
    m = len(N)
    for f, multiplicity in symmetric.factor()[1]:
        others = divide(symmetric, f**multiplicity) * rest
        power = f ** (multiplicity - 1)
        if any(entry % power != 0 for row in N for entry in row):
            return "a multiple pole on the imaginary axis"
        # Z = (N / power) / (f others), so the residue at a root of f is (N / power) / (f' others).
        _, inverse, _ = (f.derivative() * others).xgcd(f)
        K = [[divide(entry, power) * inverse % f for entry in row] for row in N]
        if any((K[i][j] - mirror(K[j][i])) % f != 0 for i in range(m) for j in range(m)):
            return "a residue on the imaginary axis is not Hermitian"
        minors = [K[i][i] for i in range(m)]
        if m == 2:
            minors.append(K[0][0] * K[1][1] - K[0][1] * K[1][0])
        if any(-1 in signs_at_roots(minor, f) for minor in minors):
            return "a residue on the imaginary axis is not positive semidefinite"
    return None


def spares_lossless_channels(Psi: PolyMatrix, F: fmpq_mat, C: fmpq_mat, chi: fmpq_poly) -> bool:
    """Condition (3) of the theorem, for an observable pair (F, C) with modes out of reach."""
    _, stable = split(chi)
    if len(Psi) == 1:
        kernel = [[ONE]] if Psi[0][0] == 0 else []
    elif Psi[0][0] * Psi[1][1] != Psi[0][1] * Psi[1][0]:
        kernel = []
    else:
        row = next((row for row in Psi if any(entry != 0 for entry in row)), None)
        if row is None:
            kernel = [[ONE, fmpq_poly()], [fmpq_poly(), ONE]]
        else:
            common = row[0].gcd(row[1])
            kernel = [[divide(row[1], common), -divide(row[0], common)]]
    n = F.nrows()
    N, _ = transfer(F, fmpq_mat(n, n, [int(i == j) for i in range(n) for j in range(n)]), C)
    for u in kernel:
        for k in range(n):
            entry = sum((mirror(u[i]) * N[i][k] for i in range(len(u))), fmpq_poly())
            if entry % stable != 0:
                return False
    return True
