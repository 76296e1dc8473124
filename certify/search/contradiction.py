"""Why no storage function exists although every frequency looks well: identities among the entries of P (THEORY 4).

The faces that the reduction finds are turned into the chain of the kernel's rule `storage-contradiction`: each with
the multipliers of the equations before it, and at the end a form that is negative all over the family.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from flint import fmpq, fmpq_mat

from certify.kernel.linalg import ldl_pivots
from certify.kernel.model import LinearPort
from certify.search import exact
from certify.search.exact import Exact
from certify.search.facial import Family, Vectors
from certify.search.lmi import balance, round_float, to_float
from certify.search.proposal import to_rows, to_text
from certify.search.solvers import Block, largest_margin, symmetric_units
from certify.search.spectral import (
    Riccati,
    axis_factors,
    axis_pairs,
    conserved,
    face_of_pairs,
    polynomial_at,
    reduce_to_riccati,
)

MAX_STATES = 14  # identities among the entries of P take minutes beyond it


def find_unreached_mode(port: LinearPort) -> dict[str, Any] | None:
    """A contradiction from a mode that no input reaches, that does not decay and that the output shows, or None.

    With v' = A v that mode, the input d = -k C V v answers it with x = Pi v, Pi A = F Pi - k B C V: power flows out all
    the time although the motion comes from rest. So W = Pi Omega Pi' with A Omega + Omega A' >= 0 shows it. A growing
    mode leaves room for rounding: there W is sought in the span of that mode and of what inputs reach.
    """
    F, B, C = (exact.to_flint(a) for a in (port.F, port.B, port.C))
    reached = exact.spanned(F, B)
    if reached.ncols() == F.nrows():
        return None
    for g, _ in exact.quotient(F, reached).charpoly().numer().factor()[1]:
        signs = {0 if z.real == 0 or z.real.contains(0) else 1 if z.real > 0 else -1 for z, _ in g.complex_roots()}
        V = exact.null_space(polynomial_at(g, F))
        if len(signs) > 1 or -1 in signs or V.ncols() != g.degree() or (C * V).rank() == 0:
            continue
        A = exact.solve_columns(V, F * V)
        if 1 in signs:
            found = _growing(F, B, C, exact.block([[reached, V]])) or _answered(F, B, C, V, A, _lyapunov(A))
        else:
            found = _answered(F, B, C, V, A, conserved(A, g))
        if found:
            W, Y = found
            return {"faces": [], "W": to_rows(exact.from_flint(W)), "Y": to_rows(exact.from_flint(Y)), "y": []}
    return None


def _answered(F: Exact, B: Exact, C: Exact, V: Exact, A: Exact, Omega: Exact) -> tuple[Exact, Exact] | None:
    """W and Y from the exact answer Pi to the mode v' = A v, for a gain k small enough."""
    n, k = F.nrows(), A.nrows()
    right = fmpq_mat(n * k, 1, (-(B * C * V)).entries())
    x = exact.solve_any(_linear_map(n, k, lambda X: X * A - F * X), right)
    if x is None:
        return None
    for exponent in range(0, 60, 3):
        gain = fmpq(1, 10**exponent)
        Pi = V + fmpq_mat(n, k, x.entries()) * gain
        Y = Pi * Omega * (C * V * -gain).transpose()
        if sum(((C * Y)[i, i] for i in range(C.nrows())), fmpq(0)) < 0:
            return Pi * Omega * Pi.transpose(), Y
    return None


def _lyapunov(A: Exact) -> Exact:
    """Omega > 0 with A Omega + Omega A' = 1, for eigenvalues with positive real parts."""
    k = A.nrows()
    one = fmpq_mat(k * k, 1, exact.identity(k).entries())
    return fmpq_mat(k, k, _linear_map(k, k, lambda X: A * X + X * A.transpose()).solve(one).entries())


def _growing(F: Exact, B: Exact, C: Exact, T: Exact) -> tuple[Exact, Exact] | None:
    """W > 0 and Y with F W + W F' + B Y' + Y B' > 0 and tr(C Y) < 0, inside the span of the columns of T."""
    import numpy

    A, G, S = exact.solve_columns(T, F * T), exact.solve_columns(T, B), C * T
    q, m = A.nrows(), G.ncols()
    try:
        d = balance(Riccati(A, G, exact.identity(m), S, A * 0))
        D = exact.diagonal(d)
        A_f, G_f, S_f = to_float(D.inv() * A * D), to_float(D.inv() * G), to_float(S * D)
    except OverflowError:
        return None
    A_f, G_f, S_f = (a / max(float(numpy.abs(a).max()), 1e-300) for a in (A_f, G_f, S_f))
    pairs, units = symmetric_units(q)
    count = len(pairs) + q * m
    storage, rate, power = (numpy.zeros((count, k, k)) for k in (q, q, 1))
    half = A_f @ units
    storage[: len(pairs)], rate[: len(pairs)] = units, half + half.transpose(0, 2, 1)
    for k in range(q * m):
        Y = numpy.zeros((q, m))
        Y[divmod(k, m)] = 1.0
        half = G_f @ Y.T
        rate[len(pairs) + k] = half + half.T
        power[len(pairs) + k, 0, 0] = -numpy.trace(S_f @ Y)
    zero = numpy.zeros((q, q))
    for point in largest_margin([Block(zero, storage), Block(zero, rate), Block(zero[:1, :1], power)]):
        for digits in (3, 6, 10):
            values = [round_float(float(x), digits) for x in point[:-1]]
            W = [[Fraction(0)] * q for _ in range(q)]
            for value, (i, j) in zip(values, pairs, strict=False):
                W[i][j] = W[j][i] = value
            # the scales of A, G and S are left out of Y: B Y' takes up the ratio of the first two
            Y_rows = [values[len(pairs) + i * m : len(pairs) + (i + 1) * m] for i in range(q)]
            TD = T * D
            W_full, Y_full = TD * exact.to_flint(W) * TD.transpose(), TD * exact.to_flint(Y_rows) * _ratio(A, G, D)
            half = F * W_full + B * Y_full.transpose()
            if ldl_pivots(exact.from_flint(half + half.transpose()))[1]:
                return W_full, Y_full
    return None


def _ratio(A: Exact, G: Exact, D: Exact) -> Any:
    """max |A| / max |G| in scaled states, as a rational."""
    largest = [max(abs(x) for x in a.entries()) for a in (D.inv() * A * D, D.inv() * G)]
    ratio = round_float(float(exact.to_fraction(largest[0]) / exact.to_fraction(largest[1])), 3)
    return exact.rational(ratio)


def _linear_map(n: int, k: int, image: Any) -> Exact:
    """The matrix of a linear map of (n, k) matrices, row by row."""
    columns = []
    for i in range(n):
        for j in range(k):
            unit = fmpq_mat(n, k, [int((a, b) == (i, j)) for a in range(n) for b in range(k)])
            columns.append(image(unit).entries())
    return fmpq_mat(n * k, n * k, [column[r] for r in range(n * k) for column in columns])


def find_contradiction(port: LinearPort) -> dict[str, Any] | None:
    """Data of the kernel's rule `storage-contradiction`, or None."""
    if len(port.F) > MAX_STATES:
        return None
    family = Family(port)
    while family.reduce_known() and (_storage_faces(family) or _axis_faces(family)):
        pass
    zero = family.F * 0
    if family.point is None:
        W, target, trace = zero, zero, fmpq(-1)
    elif family.obstacle is not None:
        of_storage, direction = family.obstacle
        x = exact.to_flint([[value] for value in direction])
        square = x * x.transpose()
        W = zero if of_storage else square
        target, trace = (square, None) if of_storage else (-_twice(family.F * square), None)
    else:
        return None
    equations = Equations(family)
    faces = []
    for face in family.faces:
        square = face.U * exact.diagonal(face.weights) * face.U.transpose()
        found = equations.combination(_twice(square if face.of_storage else family.F * square), fmpq(0))
        if found is None:
            return None
        faces.append(
            {
                "of": "storage" if face.of_storage else "dissipation",
                "weights": to_text(face.weights),
                "U": to_rows(tuple(exact.column_vectors(face.U))),
                "Y": found[0],
                "y": found[1],
            }
        )
        equations.add(face)
    found = equations.combination(target, trace)
    return found and {"faces": faces, "W": to_rows(exact.from_flint(W)), "Y": found[0], "y": found[1]}


def _twice(a: Exact) -> Exact:
    return a + a.transpose()


def _storage_faces(family: Family) -> bool:
    """Impose P u = 0 where u'P u = 0 all over the family. It leaves singular P only: of use for contradictions."""
    if family.point is None:
        return False
    K, image = family.known()
    return bool(K.ncols()) and family.impose_face(K * exact.null_space(K.transpose() * image), of_storage=True)


def _axis_faces(family: Family) -> bool:
    """Impose a face of frequencies without dissipation, with the weights that make it an identity."""
    if not family.is_free():
        return False
    reduced = reduce_to_riccati(family)
    if not reduced.R.ncols():
        return False
    H = reduced.riccati.hamiltonian()
    for factor in axis_factors(H):
        pairs = axis_pairs(H, factor.f) if factor.entirely else exact.columns(H, ())
        for k in range(pairs.ncols()):
            V, weights = face_of_pairs(H, factor.f, exact.columns(pairs, [k]))
            if family.impose_face(reduced.lift(V), weights):
                return True
    return False


class Equations:
    """The linear equations that the entries of P satisfy, with their multipliers Y and y (rule's notation)."""

    def __init__(self, family: Family) -> None:
        self.n, self.m, self.F = family.n, family.m, family.F
        self.index = family.index
        self.vectors = 0
        # Columns: the entries on and above the diagonal of the symmetric matrix of each multiplier, then its trace.
        self.columns: list[list[Any]] = []
        for a in range(self.n):
            e = exact.columns(exact.identity(self.n), [a])
            for k in range(self.m):
                b = exact.columns(family.B, [k])
                self.columns.append([*self._upper(_twice(b * e.transpose())), family.C[k, a]])

    def _upper(self, A: Exact) -> list[Any]:
        return [A[i, j] for i, j in self.index]

    def add(self, face: Vectors) -> None:
        """The equations M u = 0, or P u = 0, of a face."""
        for j in range(face.U.ncols()):
            u = exact.columns(face.U, [j])
            image = self.F * u
            for a in range(self.n):
                e = exact.columns(exact.identity(self.n), [a])
                half = u * e.transpose()
                if not face.of_storage:
                    half = image * e.transpose() + u * (self.F * e).transpose()
                self.columns.append([*self._upper(_twice(half)), fmpq(0)])
            self.vectors += 1

    def combination(self, target: Exact, trace: Any | None) -> tuple[list[str], list[str]] | None:
        """Multipliers with E(Y, y) = target and tr(C Y) = trace (any if None), as rows of text."""
        size = len(self.index) + (trace is not None)
        right = [*self._upper(target), *([] if trace is None else [trace])]
        rows = [[column[i] for column in self.columns] for i in range(size)]
        x = exact.solve_any(exact.of_rows(rows, len(self.columns)), fmpq_mat(size, 1, right))
        if x is None:
            return None
        values = exact.from_flint(x)
        flat = [row[0] for row in values]
        n, m = self.n, self.m
        Y = tuple(tuple(flat[a * m : (a + 1) * m]) for a in range(n))
        rest = flat[n * m :]
        return to_rows(Y), to_rows(tuple(tuple(rest[f * n : (f + 1) * n]) for f in range(self.vectors)))
