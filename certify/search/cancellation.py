"""Growing modes of a user's own loop that cancel in its transfer function: no claim at the port can speak of them."""

from __future__ import annotations

from certify.kernel.spec import LinearLoop
from certify.search import exact
from certify.search.exact import Exact


def unstable_cancellation(loop: LinearLoop) -> str | None:
    """What is wrong, or None: an eigenvalue of F with positive real part that B does not reach or C does not show.

    Exact: Kalman's decomposition over the rationals, and the roots of the polynomial that it splits off.
    """
    F, B, C = (exact.to_flint(a) for a in (loop.F, loop.B, loop.C))
    for matrix, start, what in ((F, B, "B does not reach"), (F.transpose(), C.transpose(), "C does not show")):
        reached = exact.spanned(matrix, start)
        if reached.ncols() == matrix.nrows():
            continue
        found = _largest_real_part(exact.quotient(matrix, reached))
        if found is not None:
            return f"F has a growing mode that {what}: an eigenvalue with real part {found:.6g} 1/s"
    return None


def _largest_real_part(matrix: Exact) -> float | None:
    """The largest positive real part of an eigenvalue, if there is one."""
    growing = [float(root.real.mid()) for root, _ in matrix.charpoly().numer().complex_roots() if root.real > 0]
    return max(growing, default=None)
