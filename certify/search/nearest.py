"""The nearest passive gains of a DGU that is not passive: what to change, and by how little (THEORY 4).

All passive gains are K12 = H + R I + w0 L J, K11 = I - Bm - L X, K13 = -H X with X > 0, Bm > 0, H Bm + Bm H' <= 0.
The distance is the sum over K11, K12, K13 of |new - old|^2 / |old|^2 (Frobenius). It is minimised over families of
growing generality, each without constraints by a change of variables; a simpler family is preferred if it is nearly
as close, because its gains are short formulas. Floats only propose: the result is rounded to few digits in
(X, Bm, H), from which the gains follow exactly, and the kernel's rule has to accept it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix, Vector, add, block, identity, multiply, scale, zeros
from certify.kernel.model import I2, J, dgu_port, to_state_feedback
from certify.kernel.rules import quadratic_storage
from certify.kernel.spec import ConstantVoltage, Dgu, Filter, IdaPbc, LinearLoop, StateFeedback
from certify.search.lmi import round_float
from certify.search.storage import find_state_feedback_storage
from certify.search.synthesis import to_decimal

PREFERRED = 2.0  # a simpler family may be so many times farther
MARGIN = 0.01  # of Bm (no unit), and of X and the damping relative to their sizes: passive, but not by a hair
DIGITS = (2, 3, 4, 6, 8, 12)
LOSS = 1.05  # by how much rounding may increase the distance
NOTHING = 1e-6  # a distance that no digit is worth
STARTS = 6
NAMES = ("K11", "K12", "K13")


@dataclass(frozen=True)
class Suggestion:
    """Passive gains near those of a DGU. `X` is None without integrator.

    `changes` are |new - old| / |old| of K11, K12 and K13 (Frobenius norms; a matrix that was zero counts by its new
    size), and `fragment` is the TOML of a controller with these gains, its keys under `[controller.NAME]`.
    """

    kind: str
    X: Matrix | None
    Bm: Matrix
    H: Matrix
    gains: StateFeedback
    changes: tuple[float, ...]
    fragment: str

    @property
    def largest_change_percent(self) -> float:
        return 100 * max(self.changes)


def nearest_gains(dgu: Dgu, capacitance_farad: Fraction, w0: Fraction) -> Suggestion | None:
    """The nearest gains that the kernel's rule `quadratic-storage` accepts for the DGU with its filter, or None.

    `capacitance_farad` is all the capacitance at the node, as `node_capacitances` gives it. None for a loop given as
    matrices, or if the numbers are out of the range of floats.
    """
    if dgu.filter is None or isinstance(dgu.controller, LinearLoop | ConstantVoltage):
        return None
    import numpy

    try:
        with numpy.errstate(all="ignore"):
            return _Nearest(dgu, dgu.filter, dgu.controller, capacitance_farad, w0).find()
    except (ArithmeticError, ValueError):
        return None


@dataclass(frozen=True)
class Family:
    """Variables z to (X, Bm, H) as float arrays: `build`; `size` variables; `simple` families have short formulas."""

    name: str
    size: int
    build: Callable[[Any], tuple[Any, Any, Any]]


class _Nearest:
    def __init__(
        self, dgu: Dgu, filter_: Filter, law: IdaPbc | StateFeedback, capacitance_farad: Fraction, w0: Fraction
    ) -> None:
        import numpy

        self.dgu, self.filter, self.law, self.capacitance, self.w0 = dgu, filter_, law, capacitance_farad, w0
        self.old = to_state_feedback(law)
        self.with_integrator = self.old.K13 is not None
        self.R, self.L = float(filter_.resistance_ohm), float(filter_.inductance_henry)
        self.turn = float(w0) * self.L * numpy.array([[0.0, -1.0], [1.0, 0.0]])
        self.targets = [numpy.array([[float(x) for x in row] for row in K]) for K in self._matrices(self.old)]
        sizes = [float(numpy.linalg.norm(K)) for K in self.targets]
        natural = [1.0, self.R + float(w0) * self.L, sizes[1] or 1.0]  # where a gain is zero altogether
        self.sizes = [s or n for s, n in zip(sizes, natural, strict=False)]
        # Sizes of X, Bm and H that such gains stand for.
        self.damping = max(float(numpy.linalg.norm(self._H_old(), 2)), 1e-3 * (self.R + float(w0) * self.L))
        self.stiffness = self.sizes[2] / self.damping if self.with_integrator else 0.0
        self.weight = max(float(numpy.linalg.norm(numpy.eye(2) - self.targets[0], 2)), MARGIN)

    @staticmethod
    def _matrices(law: StateFeedback) -> list[Matrix]:
        return [law.K11, law.K12, *([law.K13] if law.K13 is not None else [])]

    def _H_old(self) -> Any:
        import numpy

        return self.targets[1] - self.R * numpy.eye(2) - self.turn

    def find(self) -> Suggestion | None:
        """The simplest family that is nearly as close as the closest."""
        found = []
        for family in self._families():
            z, distance = self._minimise(family)
            suggestion = self._rounded(family, z, distance)
            if suggestion is not None:
                found.append((distance, suggestion))
        own = self._own_numbers()
        if own is not None:
            found.insert(0, (self._distance(own.gains), own))
        if not found:
            return None
        closest = min(distance for distance, _ in found)
        return next(s for distance, s in found if distance <= PREFERRED * closest + 1e-12)

    def _families(self) -> Iterator[Family]:
        """From gains that treat both axes alike to any passive gains. IDA-PBC laws have diagonal matrices only."""
        import numpy

        eye, J_ = numpy.eye(2), numpy.array([[0.0, -1.0], [1.0, 0.0]])
        low_x, low_b, low_h = MARGIN * self.stiffness, MARGIN, MARGIN * self.damping

        def above(low: float, size: float, z: Any) -> Any:
            return low + size * z * z  # any z gives a value that is not below `low`

        def alike(z: Any) -> tuple[Any, Any, Any]:
            x, b, h = (
                above(low_x, self.stiffness, z[0]),
                above(low_b, self.weight, z[1]),
                above(low_h, self.damping, z[2]),
            )
            return x * eye, b * eye, -h * eye

        def turned(z: Any) -> tuple[Any, Any, Any]:
            X, Bm, H = alike(z)
            return X, Bm, H + self.damping * z[3] * J_

        def diagonal(z: Any) -> tuple[Any, Any, Any]:
            x, b, h = (
                above(low_x, self.stiffness, z[:2]),
                above(low_b, self.weight, z[2:4]),
                above(low_h, self.damping, z[4:]),
            )
            return numpy.diag(x), numpy.diag(b), numpy.diag(-h)

        def definite(low: float, size: float, z: Any) -> Any:
            root = numpy.array([[z[0], 0.0], [z[1], z[2]]])
            return low * eye + size * root @ root.T

        def full(z: Any) -> tuple[Any, Any, Any]:
            X, Bm = definite(low_x, self.stiffness, z[:3]), definite(low_b, self.weight, z[3:6])
            # H Bm + Bm H' = -2 S with S positive definite, the skew part is free
            S = definite(low_h * low_b, self.damping * self.weight, z[6:9])
            return X, Bm, (-S + self.damping * self.weight * z[9] * J_) @ numpy.linalg.inv(Bm)

        yield Family("alike", 3, alike)
        if isinstance(self.law, StateFeedback):
            yield Family("turned", 4, turned)
        yield Family("diagonal", 6, diagonal)
        if isinstance(self.law, StateFeedback):
            yield Family("full", 10, full)

    def _residuals(self, X: Any, Bm: Any, H: Any) -> Any:
        import numpy

        eye = numpy.eye(2)
        K = [eye - Bm - self.L * X, H + self.R * eye + self.turn, -H @ X]
        parts = zip(K, self.targets, self.sizes, strict=False)
        return numpy.concatenate([((new - old) / size).ravel() for new, old, size in parts])

    def _minimise(self, family: Family) -> tuple[Any, float]:
        """The best of several local searches: from the gains themselves, projected, and from seeded random points."""
        import numpy
        from scipy.optimize import least_squares

        rng = numpy.random.default_rng(1)
        starts = [numpy.full(family.size, 0.7), *(rng.normal(0, 1, family.size) for _ in range(STARTS))]
        best, least = starts[0], float("inf")
        for start in starts:
            done = least_squares(
                lambda z: self._residuals(*family.build(z)), start, xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=150
            )
            distance = float(numpy.sqrt(2 * done.cost))
            if distance < least * (1 - 1e-9):
                best, least = done.x, distance
        return best, least

    def _distance(self, law: StateFeedback) -> float:
        return math.hypot(*self._changes(law))

    def _changes(self, law: StateFeedback) -> tuple[float, ...]:
        changes = []
        for new, old, size in zip(self._matrices(law), self._matrices(self.old), self.sizes, strict=False):
            entries = [float(x - y) for r, s in zip(new, old, strict=True) for x, y in zip(r, s, strict=True)]
            changes.append(sum(x * x for x in entries) ** 0.5 / size)
        return tuple(changes)

    def _rounded(self, family: Family, z: Any, distance: float) -> Suggestion | None:
        """As few digits as keep the distance; exactly passive, or None."""
        parts = family.build(z)
        best = None
        for digits in DIGITS:
            X, Bm, H = (self._matrix(part, digits) for part in parts)
            suggestion = self._suggestion(X if self.with_integrator else None, Bm, H)
            if suggestion is None:
                continue
            best = suggestion
            if self._distance(suggestion.gains) <= LOSS * distance + NOTHING:
                break
        return best

    @staticmethod
    def _matrix(a: Any, digits: int) -> Matrix:
        """Rounded relative to each entry; what is nothing beside the largest entry becomes zero."""
        largest = float(abs(a).max())
        rows = [[0.0 if abs(x) < 1e-9 * largest else float(x) for x in row] for row in a]
        return tuple(tuple(round_float(x, digits) if x else Fraction(0) for x in row) for row in rows)

    def _gains(self, X: Matrix | None, Bm: Matrix, H: Matrix) -> StateFeedback:
        """The exact gains of a triple (THEORY 4)."""
        L = self.filter.inductance_henry
        K12 = add(H, add(scale(self.filter.resistance_ohm, I2), scale(self.w0 * L, J)))
        K11 = add(identity(2), scale(-1, add(Bm, scale(L, X or zeros(2, 2)))))
        return StateFeedback(K11, K12, None if X is None else scale(-1, multiply(H, X)))

    def _suggestion(self, X: Matrix | None, Bm: Matrix, H: Matrix) -> Suggestion | None:
        law = self._gains(X, Bm, H)
        port = dgu_port(Dgu(self.filter, law, self.dgu.reference_volt, None), self.capacitance, self.w0)
        part = find_state_feedback_storage(port)
        if part is None:
            return None
        beside = zeros(2, len(part))
        below = zeros(len(part), 2)
        P = block([[scale(self.capacitance, I2), beside], [below, part]])
        try:
            quadratic_storage(port, P)
        except RuleFailure:
            return None
        ida = isinstance(self.law, IdaPbc)
        fragment = _ida_fragment(X or zeros(2, 2), Bm, H) if ida else _feedback_fragment(X, Bm, H)
        return Suggestion("ida-pbc" if ida else "state-feedback", X, Bm, H, law, self._changes(law), fragment)

    def _own_numbers(self) -> Suggestion | None:
        """An IDA-PBC law with the alpha, nu, ki it has, but with the plant's own R, L and w0."""
        law = self.law
        if not isinstance(law, IdaPbc) or not all(a < 0 < n and k > 0 for a, n, k in _columns(law)):
            return None

        def diagonal(d: Fraction, q: Fraction) -> Matrix:
            return ((d, Fraction(0)), (Fraction(0), q))

        ratios = [a / n for a, n in zip(law.alpha, law.nu, strict=True)]
        return self._suggestion(diagonal(*law.ki), diagonal(*law.nu), diagonal(*ratios))


def _columns(law: IdaPbc) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    return zip(law.alpha, law.nu, law.ki, strict=True)


# --- fragments ----------------------------------------------------------------------------------------------------


def _number(x: Fraction) -> str:
    """A rational as a formula: a decimal if it has a short one."""
    text = to_decimal(x)
    return text if Fraction(text) == x else str(x)


def _bare(x: Fraction) -> str:
    """The same as a value of TOML."""
    text = _number(x)
    return f'"{text}"' if "/" in text else text


def _ida_fragment(X: Matrix, Bm: Matrix, H: Matrix) -> str:
    """alpha = H Bm, nu = Bm, ki = X, all diagonal; with the plant's own R, L and w0, so without `design`."""

    def pair(values: Vector) -> str:
        return _bare(values[0]) if values[0] == values[1] else f"[{_bare(values[0])}, {_bare(values[1])}]"

    alpha, nu, ki = ((a[0][0], a[1][1]) for a in (multiply(H, Bm), Bm, X))
    return f'kind = "ida-pbc"\nalpha = {pair(alpha)}\nnu = {pair(nu)}\nki = {pair(ki)}\n'


def _feedback_fragment(X: Matrix | None, Bm: Matrix, H: Matrix) -> str:
    """Formulas of R, L, w0 and named numbers: scalars where both axes are alike, entries otherwise."""
    names: dict[str, Fraction] = {}

    def alike(a: Matrix) -> bool:
        return a[0][0] == a[1][1] and not a[0][1] and not a[1][0]

    turned = H[0][0] == H[1][1] and H[0][1] == -H[1][0]
    if (X is None or alike(X)) and alike(Bm) and turned:
        names |= {"x": X[0][0]} if X is not None else {}
        names |= {"b": Bm[0][0], "h": -H[0][0]} | ({"g": H[1][0]} if H[1][0] else {})
        turn = ("-(w0*L + g)", "w0*L + g") if "g" in names else ("-w0*L", "w0*L")
        gains = {"K11": '"1 - b - L*x"' if X is not None else '"1 - b"'}
        gains["K12"] = f'[["R - h", "{turn[0]}"], ["{turn[1]}", "R - h"]]'
        if X is not None:
            gains["K13"] = '[["h*x", "g*x"], ["-g*x", "h*x"]]' if "g" in names else '"h*x"'
    else:
        diagonal = not any(a[0][1] or a[1][0] for a in (X or Bm, Bm, H))
        places = [(0, 0, "d"), (1, 1, "q")] if diagonal else [(0, 0, "dd"), (0, 1, "dq"), (1, 0, "qd"), (1, 1, "qq")]
        for letter, a in (("x", X), ("b", Bm), ("h", H)):
            if a is not None:
                names |= {f"{letter}_{end}": (-1 if letter == "h" else 1) * a[i][j] for i, j, end in places}
        ends = [["d", ""], ["", "q"]] if diagonal else [["dd", "dq"], ["qd", "qq"]]

        def entries(make: Callable[[int, int, str], str]) -> str:
            return (
                "["
                + ", ".join("[" + ", ".join(f'"{make(i, j, ends[i][j])}"' for j in (0, 1)) + "]" for i in (0, 1))
                + "]"
            )

        def k11(i: int, j: int, end: str) -> str:
            if not end:
                return "0"
            return ("1 - " if i == j else "-") + f"b_{end}" + (f" - L*x_{end}" if X is not None else "")

        def k12(i: int, j: int, end: str) -> str:
            cross = "R" if i == j else "w0*L" if i else "-w0*L"
            return cross + (f" - h_{end}" if end else "")

        def k13(i: int, j: int, end: str) -> str:
            if diagonal:
                return f"h_{end}*x_{end}" if end else "0"
            return " + ".join(f"h_{'dq'[i]}{m}*x_{m}{'dq'[j]}" for m in "dq")

        gains = {"K11": entries(k11), "K12": entries(k12)}
        if X is not None:
            gains["K13"] = entries(k13)
    let = ", ".join(f"{name} = {_bare(value)}" for name, value in names.items())
    return 'kind = "state-feedback"\n' + f"let = {{ {let} }}\n" + "".join(f"{k} = {v}\n" for k, v in gains.items())
