"""Semidefinite programs behind one door: blocks in, a point out, every solver status mapped in one table.

The data go to the solvers as they are, without a modelling layer: these programs are small and many, and building
them would take longer than solving them. No answer of a solver is ever a proof, and "infeasible" refutes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

# What a solver says -> whether its point is worth rounding and checking. Anything else is "nothing".
USABLE = {
    "Solved": True,
    "AlmostSolved": True,
    "MaxIterations": True,
    "MaxTime": False,
    "InsufficientProgress": True,
    "PrimalInfeasible": False,
    "AlmostPrimalInfeasible": False,
    "DualInfeasible": False,
    "AlmostDualInfeasible": False,
    "NumericalError": False,
    "solved": True,
    "solved_inaccurate": True,
    "infeasible": False,
    "infeasible_inaccurate": False,
    "unbounded": False,
    "unbounded_inaccurate": False,
}


@dataclass(frozen=True)
class Block:
    """constant + sum_k x_k coefficients[k] >= 0. Arrays of shape (n, n) and (variables, n, n)."""

    constant: Any
    coefficients: Any


BOUNDS = (1e3, 1e6, 1e9)  # on scaled unknowns; no single one suits all


def largest_margin(
    blocks: Sequence[Block], bounds: Sequence[float] = BOUNDS, second_opinion: bool = False
) -> Iterator[Any]:
    """Points x with |x_k| <= a bound and a large common margin <= 1: from Clarabel, or, on request, from SCS.

    Shape: (variables + 1,), the margin last.
    """
    import numpy

    variables = len(blocks[0].coefficients)
    cost = -numpy.eye(variables + 1)[-1]
    widened = [_with_margin(block) for block in blocks]
    for bound in bounds:
        point = minimise(cost, widened, *box(variables + 1, bound, 1.0), second_opinion)
        if point is not None and point[-1] > 0:
            yield point


def minimise(
    cost: Any, blocks: Sequence[Block], constants: Any, slopes: Any, second_opinion: bool = False
) -> Any | None:
    """A point that minimises cost'x over the blocks and constants + slopes x >= 0; None if a solver has none.

    Shapes: cost (variables,), constants (rows,), slopes (rows, variables).
    """
    return (_scs if second_opinion else _clarabel)(cost, blocks, constants, slopes)


def symmetric_units(n: int) -> tuple[list[tuple[int, int]], Any]:
    """The entries (i, j) on and above the diagonal, and the symmetric matrix of ones for each. Shape (.., n, n)."""
    import numpy

    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    units = numpy.zeros((len(pairs), n, n))
    for k, (i, j) in enumerate(pairs):
        units[k, i, j] = units[k, j, i] = 1.0
    return pairs, units


def box(variables: int, bound: float, last: float) -> tuple[Any, Any]:
    """Constants and slopes of |x_k| <= bound for all but the last variable, which has only an upper end."""
    import numpy

    inner, end = numpy.eye(variables - 1, variables), numpy.eye(1, variables, variables - 1)
    return numpy.array([*[bound] * (2 * variables - 2), last]), numpy.vstack([inner, -inner, -end])


def _with_margin(block: Block) -> Block:
    """The same with a last variable, the margin, that times the identity is taken off."""
    import numpy

    return Block(block.constant, numpy.concatenate([block.coefficients, -numpy.eye(len(block.constant))[None]]))


def _stacked(blocks: Sequence[Block], constants: Any, slopes: Any, upper: bool) -> tuple[Any, Any]:
    """A and b of s = b - A x in the cones, each symmetric matrix as a scaled triangle, column by column."""
    import numpy
    from scipy import sparse

    parts, sides = [sparse.csc_matrix(-slopes)], [constants]
    for block in blocks:
        n = len(block.constant)
        i, j = numpy.tril_indices(n) if upper else numpy.triu_indices(n)  # transposed: column by column
        scale = numpy.where(i == j, 1.0, numpy.sqrt(2.0))
        sides.append(block.constant[i, j] * scale)
        parts.append(sparse.csc_matrix(-(block.coefficients[:, i, j] * scale).T))
    return sparse.vstack(parts).tocsc(), numpy.concatenate(sides)


def _clarabel(cost: Any, blocks: Sequence[Block], constants: Any, slopes: Any) -> Any | None:
    import clarabel
    import numpy
    from scipy import sparse

    A, b = _stacked(blocks, constants, slopes, upper=True)
    if not (numpy.isfinite(A.data).all() and numpy.isfinite(b).all()):
        return None  # the solver would panic
    variables = len(cost)
    cones = [clarabel.NonnegativeConeT(len(constants))]
    cones += [clarabel.PSDTriangleConeT(len(block.constant)) for block in blocks]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    nothing = sparse.csc_matrix((variables, variables))
    try:
        solution = clarabel.DefaultSolver(nothing, cost, A, b, cones, settings).solve()
    except BaseException as error:  # a panic of the solver is no Exception
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            raise
        return None
    point = numpy.array(solution.x)
    return point if USABLE.get(str(solution.status), False) and numpy.isfinite(point).all() else None


def _scs(cost: Any, blocks: Sequence[Block], constants: Any, slopes: Any) -> Any | None:
    import numpy
    import scs

    A, b = _stacked(blocks, constants, slopes, upper=False)
    cone = {"l": len(constants), "s": [len(block.constant) for block in blocks]}
    solver = scs.SCS({"A": A, "b": b, "c": cost}, cone, verbose=False, eps_abs=1e-9, eps_rel=1e-9, max_iters=20_000)
    solution = solver.solve()
    status = str(solution["info"]["status"]).split(" ")[0]
    usable = USABLE.get(status, False) and solution["x"] is not None and numpy.isfinite(solution["x"]).all()
    return solution["x"] if usable else None
