"""Numerical solvers behind one door: every status maps to "solution" or "nothing" in one table."""

from __future__ import annotations

import warnings
from typing import Any

# What a solver says -> whether its point is worth rounding and checking. Anything else is "nothing". No status is
# ever a proof, and "infeasible" never refutes a claim.
USABLE = {"optimal": True, "optimal_inaccurate": True, "user_limit": True}


def solve_problem(problem: Any) -> str | None:
    """Solve a cvxpy problem with Clarabel; the status if its point is usable, else None."""
    import cvxpy

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cvxpy warns of inaccurate solutions; the kernel is the judge of those
        try:
            problem.solve(solver=cvxpy.CLARABEL)
        except cvxpy.error.SolverError:
            return None
    return problem.status if USABLE.get(problem.status) else None
