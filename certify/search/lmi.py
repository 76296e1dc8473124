"""What facial reduction leaves of the storage LMI, solved by Clarabel through cvxpy and rounded back to rationals.

The solver only proposes a point of the exact affine family; the kernel's rule decides whether it is a proof.
"""

from __future__ import annotations

from fractions import Fraction

from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix, add, ldl_pivots, scale
from certify.kernel.rules import dissipation, quadratic_storage
from certify.search.facial import Family
from certify.search.solvers import solve_problem

BOUNDS = (1e6, 1e3, 1e10)  # on the coordinates: no single one suits all scales
ROUNDINGS = (2, 4, 8, 16)  # significant decimal digits tried, coarsest first: small numbers make short certificates


def solve_family(family: Family) -> Matrix | None:
    """A storage matrix of the family that the kernel accepts, or None.

    The variables are the coordinates t of P(t) = point + sum t_k direction_k. States are scaled so that the diagonal
    of a typical P is one; both P(t) and M(t), cut to where M is not forced to vanish, get the same margin.
    """
    if family.point is None:
        return None
    if not family.directions:
        return _accepted(family, family.point)
    return _step_exactly(family) or _solve_numerically(family)


def _step_exactly(family: Family) -> Matrix | None:
    """Far along directions that are >= 0 and dissipate nothing, if there are any: M stays, P only grows."""
    if family.point is None:
        return None
    free = [sign_ for D in family.directions for sign_ in (D, scale(-1, D)) if _is_free(family, sign_)]
    for exponent in range(-3, 16, 3) if free else ():
        P = family.point
        for D in free:
            P = add(P, scale(Fraction(10) ** exponent, D))
        if _accepted(family, P):
            return P
    return None


def _is_free(family: Family, D: Matrix) -> bool:
    return ldl_pivots(D)[1] and not any(any(row) for row in dissipation(family.port.F, D))


def _solve_numerically(family: Family) -> Matrix | None:
    if family.point is None:
        return None
    import cvxpy
    import numpy

    F, n = family.port.F, len(family.port.F)
    parts = [family.point, *family.directions]
    size = [max((abs(float(P[i][i])) for P in parts if P[i][i]), default=1.0) or 1.0 for i in range(n)]
    d = numpy.array([1 / numpy.sqrt(s) for s in size])
    P_parts = [_to_float(P) * d[:, None] * d for P in parts]
    rate = max(1.0, float(numpy.abs(_to_float(F) / d[:, None] * d).max()))
    M_parts = [_to_float(dissipation(F, P)) * d[:, None] * d / rate for P in parts]
    stacked = numpy.vstack(M_parts)
    _, values, rows = numpy.linalg.svd(stacked)
    keep = rows[: int((values > 1e-9 * max(values.max(), 1e-300)).sum())]
    M_parts = [keep @ M @ keep.T for M in M_parts]
    k = len(parts) - 1
    unit = [
        max(float(numpy.abs(P).max()), float(numpy.abs(M).max()), 1e-300) if len(keep) else float(numpy.abs(P).max())
        for P, M in zip(P_parts[1:], M_parts[1:], strict=True)
    ]
    t, margin = cvxpy.Variable(k), cvxpy.Variable()
    P_t = P_parts[0] + sum(t[i] * (P_parts[i + 1] / unit[i]) for i in range(k))
    M_t = M_parts[0] + sum(t[i] * (M_parts[i + 1] / unit[i]) for i in range(k))
    bound = cvxpy.Parameter(nonneg=True)
    constraints = [P_t >> margin * numpy.eye(n), margin <= 1, cvxpy.norm_inf(t) <= bound]
    if len(keep):
        constraints.append(M_t >> margin * numpy.eye(len(keep)))
    problem = cvxpy.Problem(cvxpy.Maximize(margin), constraints)
    for bound.value in BOUNDS:
        if solve_problem(problem) is None or t.value is None:
            continue
        for digits in ROUNDINGS:
            P = family.point
            for value, u, direction in zip(t.value, unit, family.directions, strict=True):
                P = add(P, scale(round_float(float(value) / u, digits), direction))
            if _accepted(family, P):
                return P
    return None


def _accepted(family: Family, P: Matrix) -> Matrix | None:
    try:
        quadratic_storage(family.port, P)
    except RuleFailure:
        return None
    return P


def _to_float(a: Matrix):  # type: ignore[no-untyped-def]
    import numpy

    return numpy.array([[float(x) for x in row] for row in a])


def round_float(x: float, digits: int) -> Fraction:
    """A float to a rational of so many significant digits: the one place where precision is lost.

    >>> round_float(0.123456, 2)
    Fraction(3, 25)
    """
    return Fraction(f"{x:.{digits - 1}e}")
