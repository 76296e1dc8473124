"""The proof rules. Each is a theorem of FORMAT.md: a pure function that checks its side conditions.

A rule raises `RuleFailure` with the condition that fails, and otherwise returns what it has established. It never
searches or repairs, and where it rounds (enclosures, `covered_shortages`), only to the safe side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from heapq import heapify, heappop, heappush

from certify.kernel import linalg as la
from certify.kernel.errors import RuleFailure, require
from certify.kernel.linalg import Matrix, Vector
from certify.kernel.model import LinearPort
from certify.kernel.reader import Pair

# --- storage functions and their refutation (THEORY 3 and 4) ----------------------------------------------


def series_branch(resistance_ohm: Fraction, inductance_henry: Fraction) -> None:
    """Rule `series-branch`: S = L |I~|^2 / 2 has S' = <z~, d~> - R |I~|^2."""
    require(resistance_ohm > 0, "the resistance is not positive")
    require(inductance_henry > 0, "the inductance is not positive")


def dissipation(F: Matrix, P: Matrix) -> Matrix:
    """M = -(F' P + P F), so that d/dt (x' P x / 2) = -x' M x / 2 along x' = F x.

    >>> one = ((Fraction(1),),)
    >>> dissipation(((Fraction(-1),),), one)
    ((Fraction(2, 1),),)
    """
    half = la.multiply(P, F)
    return la.scale(-1, la.add(half, la.transpose(half)))


@dataclass(frozen=True)
class Storage:
    """What `quadratic-storage` has established; the pivots are of the LDL' factorisations of P and M."""

    M: Matrix
    storage_pivots: Vector
    dissipation_pivots: Vector


def quadratic_storage(port: LinearPort, P: Matrix) -> Storage:
    """Rule `quadratic-storage`: P > 0, P B = C', M = -(F'P + PF) >= 0, so S = x~'P x~/2 proves EIP."""
    n = len(port.F)
    require(len(P) == n and la.is_symmetric(P), f"the storage matrix is not a symmetric matrix of size {n}")
    require(la.multiply(P, port.B) == la.transpose(port.C), "P B = C' does not hold")
    storage_pivots, semidefinite = la.ldl_pivots(P)
    require(semidefinite and all(storage_pivots), "the storage matrix P is not positive definite")
    M = dissipation(port.F, P)
    dissipation_pivots, semidefinite = la.ldl_pivots(M)
    require(semidefinite, "the dissipation matrix -(F'P + PF) is not positive semidefinite")
    return Storage(M, storage_pivots, dissipation_pivots)


def storage_at(port: LinearPort, P0: Matrix) -> Matrix:
    """P at the capacitance c of a port: P0 in the charge c V and the other states, plus c |V|^2; P0 itself without c.

    With it the inequality of `index-storage` is affine in each of R, 1/L and 1/c (THEORY 10).
    """
    c, n = port.capacitance_farad, len(P0)
    if c is None:
        return P0
    size = [c if i < 2 else la.ONE for i in range(n)]
    return tuple(tuple(size[i] * P0[i][j] * size[j] + (c if i == j < 2 else 0) for j in range(n)) for i in range(n))


def index_storage(port: LinearPort, P: Matrix, shortage: Fraction) -> Storage:
    """Rule `index-storage`: P > 0 and [[M, C' - P B], [., 2 eps I]] >= 0, so S' <= <z~, d~> + eps |d~|^2."""
    n, m = len(port.F), len(port.C)
    require(len(P) == n and la.is_symmetric(P), f"the storage matrix is not a symmetric matrix of size {n}")
    require(shortage > 0, "the shortage is not positive")
    storage_pivots, semidefinite = la.ldl_pivots(P)
    require(semidefinite and all(storage_pivots), "the storage matrix P is not positive definite")
    M = dissipation(port.F, P)
    gap = la.add(la.transpose(port.C), la.scale(-1, la.multiply(P, port.B)))
    supply = la.scale(2 * shortage, la.identity(m))
    pivots, semidefinite = la.ldl_pivots(la.block([[M, gap], [la.transpose(gap), supply]]))
    require(semidefinite, "the dissipation inequality with this shortage does not hold")
    return Storage(M, storage_pivots, pivots[:n])


def frequency_witness(port: LinearPort, s0: Pair, u: Sequence[Pair]) -> Fraction:
    """Rule `frequency-witness`: Re s0 > 0, s0 no eigenvalue of F, Re(u* Z(s0) u) < 0. Returns that number."""
    (sigma, omega), n, m = s0, len(port.F), len(port.C)
    require(sigma > 0, "the real part of s0 is not positive")
    require(len(u) == m, f"u does not have {m} entries")
    inner = la.add(la.scale(sigma, la.identity(n)), la.scale(-1, port.F))
    cross = la.scale(omega, la.identity(n))
    u_parts = [tuple(part[k] for part in u) for k in (0, 1)]
    right = tuple((x,) for part in u_parts for x in la.apply(port.B, part))
    try:
        x = [row[0] for row in la.solve(la.block([[inner, la.scale(-1, cross)], [cross, inner]]), right)]
    except ZeroDivisionError:
        raise RuleFailure("s0 is an eigenvalue of F") from None
    z_parts = [la.apply(port.C, x[:n]), la.apply(port.C, x[n:])]
    value = sum((a * b for k in (0, 1) for a, b in zip(u_parts[k], z_parts[k], strict=True)), Fraction(0))
    require(value < 0, "Re(u* Z(s0) u) is not negative")
    return value


@dataclass(frozen=True)
class Face:
    """An identity that forces M u = 0 for each row u of U, or P u = 0 if `of_storage`.

    Shapes: weights (k,), all positive; U (k, n); Y (n, m); y has one row of n for each vector of earlier faces.
    """

    of_storage: bool
    weights: Vector
    U: Matrix
    Y: Matrix
    y: Matrix


def storage_contradiction(port: LinearPort, faces: Sequence[Face], W: Matrix, Y: Matrix, y: Matrix) -> None:
    """Rule `storage-contradiction`: no P >= 0 has P B = C' and M >= 0, so no storage function of any kind exists.

    The faces come one after the other; the last identity has a positive and a negative side. W (n, n).
    """
    n, m = len(port.F), len(port.C)
    known: list[tuple[bool, Vector]] = []  # the vectors of the faces so far

    def combination(Y: Matrix, y: Matrix) -> tuple[Matrix, Fraction]:
        """E(Y, y) and tr(C Y): the product of E with P is 2 tr(C Y)."""
        require(len(Y) == n and all(len(row) == m for row in Y), f"Y is not of shape ({n}, {m})")
        require(len(y) == len(known) and all(len(v) == n for v in y), f"y is not of shape ({len(known)}, {n})")
        half = la.multiply(Y, la.transpose(port.B))
        for (of_storage, u), v in zip(known, y, strict=True):
            half = la.add(half, face_equation(port.F, of_storage, u, v))
        trace = sum((port.C[i][k] * Y[k][i] for i in range(m) for k in range(n)), Fraction(0))
        return la.add(half, la.transpose(half)), trace

    require(sum(len(face.U) for face in faces) <= 2 * n, "more faces than there can be")
    for face in faces:
        require(len(face.weights) == len(face.U) and min(face.weights) > 0, "a weight of a face is not positive")
        require(all(len(u) == n for u in face.U), f"a face does not have {n} entries")
        square = la.zeros(n, n)
        for weight, u in zip(face.weights, face.U, strict=True):
            square = la.add(square, la.scale(weight, outer(u if face.of_storage else la.apply(port.F, u), u)))
        side, trace = combination(face.Y, face.y)
        require(la.add(square, la.transpose(square)) == side and not trace, "a face is not forced to vanish")
        known += [(face.of_storage, u) for u in face.U]
    require(len(W) == n and la.is_symmetric(W) and la.ldl_pivots(W)[1], "W is not positive semidefinite")
    rest, trace = combination(Y, y)
    product = la.multiply(port.F, W)
    Q = la.add(la.add(product, la.transpose(product)), rest)
    require(la.ldl_pivots(Q)[1], "the left side of the last identity is not positive semidefinite")
    require(trace < 0, "tr(C Y) is not negative")


def face_equation(F: Matrix, of_storage: bool, u: Vector, v: Vector) -> Matrix:
    """The matrix A with tr(P (A + A')) = 0 for every P on the face: -2 v'M u = 0, or 2 v'P u = 0."""
    if of_storage:
        return outer(u, v)
    return la.add(outer(la.apply(F, u), v), outer(u, la.apply(F, v)))


def outer(a: Vector, b: Vector) -> Matrix:
    return tuple(tuple(x * y for y in b) for x in a)


# --- the network (THEORY 2, 6 and 10) ---------------------------------------------------------------------------


def skew_incidence(injection: dict[tuple[str, str], int], drop: dict[tuple[str, str], int]) -> None:
    """Rule `skew-incidence`: the map from outputs to inputs is skew-symmetric, so that sum <z, d> = 0."""
    require({key: -value for key, value in injection.items()} == drop, "the interconnection is not skew-symmetric")


def shortage_with_load(shortage: Fraction, modulus: Fraction, lipschitz: Fraction) -> Fraction:
    """The shortage of a DGU together with its load: eps m / (m - 2 eps Lambda^2), with |z|^2 m / 2 left (THEORY 10)."""
    require(modulus > 2 * shortage * lipschitz**2, "the load is not monotone enough for the shortage of its DGU")
    return shortage * modulus / (modulus - 2 * shortage * lipschitz**2)


MAX_FILL = 100_000  # entries that an elimination may touch


def covered_shortages(edges: Sequence[tuple[Fraction, tuple[str, ...]]], shortage: dict[str, Fraction]) -> Fraction:
    """diag(R) - A' diag(eps) A > 0 for branches (R, their nodes): what DGUs are short of, the branches dissipate.

    First branch by branch, R > sum of eps deg over its ends; then the equivalent node by node, N = 1/eps - A R^-1 A'
    > 0, by elimination. Numbers are kept short by lowering the diagonal, which only makes the test stricter.
    Returns the largest part of an R that is taken branch by branch, 1 if that test was not enough.
    """
    degree = dict.fromkeys(shortage, 0)
    ends = [(R, [node for node in nodes if node in shortage]) for R, nodes in edges]
    for _, nodes in ends:
        for node in nodes:
            degree[node] += 1
    taken = max((sum(shortage[node] * degree[node] for node in nodes) / R for R, nodes in ends), default=Fraction(0))
    if taken < 1:
        return taken
    diagonal = {node: 1 / eps for node, eps in shortage.items()}
    beside: dict[str, dict[str, Fraction]] = {node: {} for node in shortage}

    def couple(a: str, b: str, x: Fraction) -> None:
        """Add x to the entry at (a, b), rounded down: that is made good by lowering both diagonal entries as much."""
        exact = beside[a].get(b, Fraction(0)) + x
        kept = lowered(exact)
        beside[a][b] = beside[b][a] = kept
        for node in (a, b):
            diagonal[node] -= exact - kept

    for R, nodes in ends:
        for node in nodes:
            diagonal[node] = lowered(diagonal[node] - 1 / R)
        if len(nodes) == 2:
            couple(nodes[0], nodes[1], 1 / R)
    work = 0
    heap = [(len(row), node) for node, row in beside.items()]
    heapify(heap)
    while heap:
        count, node = heappop(heap)
        if node not in beside or count != len(beside[node]):
            continue
        row, pivot = beside.pop(node), lowered(diagonal[node])
        require(pivot > 0, f"the lines do not make up for the shortage of the DGUs (at node {node})")
        work += len(row) ** 2
        require(work <= MAX_FILL, "too many lines between DGUs with a shortage to decide whether they make up for it")
        for a, x in row.items():
            del beside[a][node]
            diagonal[a] -= x * x / pivot
            for b, y in row.items():
                if a < b:
                    couple(a, b, -x * y / pivot)
        for a in row:
            heappush(heap, (len(beside[a]), a))
    return la.ONE


def lowered(x: Fraction, bits: int = 96) -> Fraction:
    """x rounded down to about so many bits."""
    shift = bits - x.numerator.bit_length() + x.denominator.bit_length()
    unit = Fraction(2) ** shift
    return Fraction((x * unit).__floor__()) / unit


def observed(rows: Matrix, F: Matrix, B: Matrix | None = None) -> list[list[Fraction]]:
    """Echelon rows r with r x = 0 on the largest invariant subspace inside {rows x = 0}.

    Invariant under F; with B, controlled-invariant for (F, B): only an r with r B = 0 is carried on to r F.
    """
    n = len(F)
    basis, _ = la.row_reduce(rows, n)
    while True:
        exact = tuple(tuple(r) for r in basis)
        carried: Matrix = exact
        if B is not None and exact:
            combinations = la.null_space(la.transpose(la.multiply(exact, B)), len(exact))
            carried = la.multiply(combinations, exact) if combinations else ()
        grown, _ = la.row_reduce((*exact, *(la.multiply(carried, F) if carried else ())), n)
        if len(grown) == len(basis):
            return basis
        basis = grown


def rests(port: LinearPort, M: Matrix) -> None:
    """Condition `rest` of rule `invariant-set`: no motion inside ker M with z = 0 but rest itself."""
    require(len(observed((*M, *port.C), port.F)) == len(port.F), "a motion with z = 0 and no dissipation remains")


def pins(port: LinearPort, M: Matrix, with_load: bool) -> None:
    """Condition `pin` of rule `invariant-set` by a DGU: inside ker M, z = 0 follows (any load current allowed)."""
    rows, n = observed(M, port.F, port.B if with_load else None), len(port.F)
    require(la.rank((*rows, *port.C), n) == len(rows), "a motion with z other than 0 and no dissipation remains")
