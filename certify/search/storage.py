"""Storage functions of state-feedback DGUs in closed form (THEORY 4): X, then the weight of w = I~ - X v~."""

from __future__ import annotations

from fractions import Fraction

from certify.kernel.linalg import Matrix, add, block, identity, multiply, scale, transpose
from certify.kernel.model import LinearPort


def inverse_2x2(a: Matrix) -> Matrix | None:
    (p, q), (r, s) = a
    determinant = p * s - q * r
    if not determinant:
        return None
    return ((s / determinant, -q / determinant), (-r / determinant, p / determinant))


def find_state_feedback_storage(port: LinearPort) -> Matrix | None:
    """The only candidate for the storage matrix below the node's capacitor, or None if the formula needs an inverse.

    With integrator and K13 nonsingular, or without integrator: if this candidate fails, no other exists.
    Shapes: the result is (4, 4) on (I, v), or (2, 2) on I.
    Source: THEORY section 4, with everything divided by L, which then drops out.
    """
    n, c = len(port.F), port.capacitance_farad
    if c is None or n not in (4, 6) or len(port.C) != 2 or not _is_state_feedback(port, c):
        return None
    G, H = (scale(sign, _part(port.F, 2, column)) for sign, column in ((-1, 0), (1, 2)))
    if n == 4:
        return inverse_2x2(G)
    K13, H_inverse = _part(port.F, 2, 4), inverse_2x2(H)
    if H_inverse is None:
        return None
    X = scale(-1, multiply(H_inverse, K13))
    weight = inverse_2x2(add(G, scale(-1, X)))
    if weight is None:
        return None
    coupling = scale(-1, multiply(weight, X))
    corner = add(X, scale(-1, multiply(transpose(X), coupling)))
    return block([[weight, coupling], [transpose(coupling), corner]])


def _is_state_feedback(port: LinearPort, c: Fraction) -> bool:
    """Whether the states are (V, I) or (V, I, v) of `dgu_port`, and nothing else happens to V and v."""
    n, unit = len(port.F), identity(len(port.F))
    voltage_rows = all(port.F[i][2:4] == scale(1 / c, identity(2))[i] and not any(port.F[i][4:]) for i in (0, 1))
    integrator_rows = all(port.F[4 + i] == tuple(-x for x in unit[i]) for i in range(n - 4))
    return voltage_rows and integrator_rows and unit[:2] == port.C


def _part(F: Matrix, row: int, column: int) -> Matrix:
    rows: tuple[tuple[Fraction, ...], ...] = tuple(F[i][column : column + 2] for i in (row, row + 1))
    return rows
