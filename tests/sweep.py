"""A numerical check of the oracle that shares no step with it: eigenvalues of F, and Z(jw) by linear solves, in balls.

    python -m tests.sweep [--count 2000] [--seed 1]

It finds what is clearly so at 100 digits: an observable eigenvalue in Re s > 0, or lambda_min(Z(jw) + Z(jw)*) < 0 at a
frequency, says not passive; eigenvalues in Re s < -margin and lambda_min > 0 at every frequency of a sweep with its
local minima says passive. Anything closer is left to the oracle (None). That lambda_min < 0 is rigorous (ball
arithmetic encloses it), the rest is evidence. F, B, C are real, so w > 0 will do.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from math import log10
from typing import Any

from flint import acb, acb_mat, arb, ctx

from certify.kernel.linalg import Matrix
from certify.kernel.model import LinearPort
from tests.designs import NOT_PASSIVE, PASSIVE
from tests.loops import loops
from tests.oracle import decide, to_flint

DIGITS = 100
POINTS = 120
FAR = 32  # decades
GOLDEN = (3 - 5**0.5) / 2
CLEAR = 1e-18  # relative to |Z|, near the eigenvalues: below, a local minimum may be a touching one


def to_balls(matrix: Matrix) -> Any:
    return acb_mat(to_flint(matrix))


def smallest_eigenvalue(F: Any, B: Any, C: Any, w: Any) -> Any:
    """lambda_min of Z(jw) + Z(jw)* relative to the largest |Z| entry, enclosed; 1 or 2 channels."""
    n, m = F.nrows(), B.ncols()
    s = acb(0, w)
    Z = C * (acb_mat(n, n, [s if i == j else 0 for i in range(n) for j in range(n)]) - F).solve(B)
    size = max((abs(Z[i, j]) for i in range(m) for j in range(m)), key=float)
    if m == 1:
        return 2 * Z[0, 0].real / size
    a, d, b = 2 * Z[0, 0].real, 2 * Z[1, 1].real, abs(Z[0, 1] + Z[1, 0].conjugate())
    return ((a + d) - ((a - d) ** 2 + 4 * b**2).sqrt()) / 2 / size


def largest(matrix: Any) -> float:
    return max(float(abs(x)) for x in matrix.entries())


def check(port: LinearPort) -> str | None:
    """PASSIVE, NOT_PASSIVE, or None if it is too close to tell."""
    with ctx.workdps(DIGITS):
        F, B, C = (to_balls(matrix) for matrix in (port.F, port.B, port.C))
        values, vectors = F.eig(right=True, algorithm="approx")
        size = max(float(abs(x)) for x in values) or 1.0
        margin = size * 1e-8  # Jordan blocks of k states lose all but 1/k of the digits
        for k, s in enumerate(values):
            x = acb_mat(F.nrows(), 1, [vectors[i, k] for i in range(F.nrows())])
            if float(s.real) > margin and largest(C * x) > 1e-50 * largest(C) * largest(x):
                return NOT_PASSIVE  # reached or not: an observable growing mode has no storage function
        marks = [log10(x) for v in values for x in (float(abs(v)), abs(float(v.imag))) if x > size * 1e-20]
        start, end = min(marks, default=0.0) - 2, max(marks, default=0.0) + 2
        grid = [start + (end - start) * k / (POINTS - 1) for k in range(POINTS)]
        grid = sorted([*grid, *(t + shift for t in marks for shift in (-1e-3, 1e-3, -0.1, 0.1))])
        # tiny errors decide at the far ends, where all else fades
        grid = [*(start - k for k in range(FAR, 0, -1)), *grid, *(end + k for k in range(1, FAR + 1))]

        def at(t: float) -> Any:
            try:
                return smallest_eigenvalue(F, B, C, arb(10) ** arb(t))
            except ZeroDivisionError:
                return arb(1)  # at a pole, to the last digit

        levels = [at(t) for t in grid]
        near = [x for t, x in zip(grid, levels, strict=True) if start <= t <= end]
        least = min(near, key=float)
        if any(x < 0 for x in levels):
            return NOT_PASSIVE
        for k in range(FAR, len(grid) - FAR):
            if float(levels[k]) <= min(float(levels[k - 1]), float(levels[k + 1])):
                found = golden_minimum(at, grid[k - 1], grid[k + 1], 60)
                if found < 0:
                    return NOT_PASSIVE
                least = min(least, found, key=float)
        stable = all(float(s.real) < -margin for s in values)
        return PASSIVE if float(least) > CLEAR and stable else None


def golden_minimum(f: Any, low: float, high: float, steps: int) -> Any:
    """The least value met on the way to a local minimum between low and high."""
    a, b = low + GOLDEN * (high - low), high - GOLDEN * (high - low)
    fa, fb = f(a), f(b)
    least = min(fa, fb, key=float)
    for _ in range(steps):
        if float(fa) < float(fb):
            high, b, fb = b, a, fa
            a = low + GOLDEN * (high - low)
            fa = f(a)
        else:
            low, a, fa = a, b, fb
            b = high - GOLDEN * (high - low)
            fb = f(b)
        least = min(least, fa, fb, key=float)
    return least


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    seen: Counter[str] = Counter()
    for k, design in enumerate(loops(arguments.count, arguments.seed)):
        found, truth = check(design.port), decide(design.port)
        wanted = PASSIVE if truth.passive else NOT_PASSIVE
        seen["too close" if found is None else "agree" if found == wanted else "DISAGREE"] += 1
        if found not in (None, wanted):
            print(f"no. {k}, {design.kind}: the sweep says {found}, the oracle {truth}")
    print(dict(seen))
    return int(seen["DISAGREE"] > 0)


if __name__ == "__main__":
    sys.exit(main())
