"""Passivity but for a shortage: S' <= <z, d> + eps |d|^2, with the smallest eps, or for a whole box (THEORY 10)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import Any

from flint import fmpq_mat

from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix
from certify.kernel.model import LinearPort
from certify.kernel.rules import index_storage, storage_at
from certify.search import exact
from certify.search.dgu import refutation, witness_data
from certify.search.exact import Exact
from certify.search.frequency import (
    Response,
    Witness,
    between,
    crossings,
    find_coarse_witness,
    find_witness,
    is_semidefinite,
    level_riccati,
    power_of,
    worst_frequencies,
)
from certify.search.lmi import LONG_ROUNDINGS, ROUNDINGS, find_solution, round_float, to_float
from certify.search.proposal import Proposal, to_rows
from certify.search.roots import round_to_digits, square_root
from certify.search.solvers import Block, box, largest_margin, minimise, symmetric_units
from certify.search.spectral import Reduced

ABOVE = Fraction(102, 100)  # how far above the shortage found a level is tried
APPROACHES = (3, 6, 12, 24)  # decimal digits by which the witness comes near the imaginary axis


@dataclass(frozen=True)
class Shortage:
    """`level` in ohm is above the true shortage; the witness shows how far it is from it at most."""

    level: Fraction
    witness: Witness


def least_power(form: tuple[Fraction, ...]) -> Fraction:
    """The smallest eigenvalue of (Z + Z*)/2, from below by less than one part in 10^12 of its size."""
    if len(form) == 1:
        return form[0]
    a, c, x, y = form
    return (a + c) / 2 - square_root(((a - c) / 2) ** 2 + x * x + y * y, 12) * (1 + Fraction(1, 10**12))


def find_shortage(response: Response) -> Shortage | None:
    """The shortage of a stable port that is not passive, by level sets; None if there is none, or no finite one."""
    if not response.is_stable():
        return None
    found: tuple[Fraction, Fraction] | None = None  # shortage and frequency

    def look(frequencies: Sequence[Fraction]) -> bool:
        nonlocal found
        before = found
        for omega in frequencies:
            form = response.hermitian((Fraction(0), omega))
            if form is not None:
                power = -least_power(form)
                if power > 0 and (found is None or power > found[0]):
                    found = (power, omega)
        return found != before

    look([Fraction(0), *(round_to_digits(Fraction(omega), 2) for omega in worst_frequencies(response.port)[:3])])
    if found is None:  # too little for floats to see
        found_at = find_witness(response)
        if found_at is None or not look([found_at.s0[1]]) or found is None:
            return None
    for _ in range(20):
        level = round_to_digits(found[0] * ABOVE, 2)
        level = level if level > found[0] else round_to_digits(found[0] * ABOVE, 4)
        frequencies = crossings(level_riccati(response, level).hamiltonian())
        if not frequencies:
            witness = _witness(response, found[1], found[0])
            return Shortage(level, witness) if witness else None
        if not look(list(between(frequencies))):
            return None
    return None


def _witness(response: Response, omega: Fraction, power: Fraction) -> Witness | None:
    """A frequency witness with almost this power for a current of 1 A."""
    best: Witness | None = None
    for digits in APPROACHES:
        size = omega or Fraction(1)
        found = _strongest_at(response, (size / 10**digits, omega))
        if found and (best is None or _per_squared_current(found) > _per_squared_current(best)):
            best = found
        if best and _per_squared_current(best) > power * Fraction(99, 100):
            return best
    return best


def _strongest_at(response: Response, s0: tuple[Fraction, Fraction]) -> Witness | None:
    """A witness at s0 along the eigenvector of the smallest eigenvalue, with few digits."""
    form = response.hermitian(s0)
    if form is None or is_semidefinite(form):
        return None
    one = (Fraction(1), Fraction(0))
    if len(form) == 1:
        return response.witness_at(s0)
    a, c, x, y = form
    value = least_power(form)
    # (a - value) u0 + b u1 = 0
    if a > c:
        directions = [(z, one) for z in _rounded((-x / (a - value), -y / (a - value)))]
    else:
        directions = [(one, z) for z in _rounded((-x / (c - value), y / (c - value)))]
    for u in directions:
        power = power_of(form, u)
        if power < 0:
            return Witness(s0, u, power)
    return None


def _rounded(z: tuple[Fraction, Fraction]) -> Iterator[tuple[Fraction, Fraction]]:
    for digits in (3, 8):
        yield round_to_digits(z[0], digits), round_to_digits(z[1], digits)


def _per_squared_current(witness: Witness) -> Fraction:
    return -witness.power / sum(x * x for entry in witness.u for x in entry)


# --- storage functions ----------------------------------------------------------------------------------------


def propose_index(port: LinearPort, smallest: Fraction | None = None) -> Iterator[Proposal]:
    """The index of a port without tolerances, within a few per cent of the true shortage.

    A stable port that is short of nothing may lack a definite storage function all the same, for a state that its
    output does not show; with the shortage `smallest` it has one.
    """
    response = Response.of(port)
    shortage = find_shortage(response)
    if shortage is None:
        if smallest is not None and response.is_stable():
            P0 = find_index_storage(response, smallest)
            if P0 is not None:
                yield Proposal("proved", "index-storage", {"shortage": str(smallest), "storage": to_rows(P0)})
        return
    for factor in (Fraction(101, 100), Fraction(102, 100), Fraction(3, 2)):
        level = round_to_digits(shortage.level * factor, 3)
        P0 = find_index_storage(response, level)
        if P0 is not None:
            data = {"shortage": str(level), "storage": to_rows(P0), "witness": witness_data(shortage.witness)}
            yield Proposal("proved", "index-storage", data)
            return


def find_index_storage(response: Response, level: Fraction) -> Matrix | None:
    """P0 of the rule `index-storage` for one port and one shortage, or None."""
    n, riccati = response.F.nrows(), level_riccati(response, level)
    nothing = fmpq_mat(n, 0, [])
    empty = fmpq_mat(0, 0, [])
    reduced = Reduced(riccati, nothing, exact.identity(n), empty, fmpq_mat(0, n, []), empty)
    digits = chain(ROUNDINGS, LONG_ROUNDINGS)

    def accept(P0: Matrix) -> bool:
        return holds([response.port], P0, level)

    P0 = find_solution(reduced, lambda X: in_charges(response.port, X), accept)
    if P0 is None:
        return None
    return next((short for short in (_round_entries(P0, count) for count in digits) if accept(short)), P0)


def in_charges(port: LinearPort, P: Exact) -> Matrix:
    """P0 with storage_at(port, P0) = P: the inverse of the kernel's convention."""
    c = port.capacitance_farad
    if c is None:
        return exact.from_flint(P)
    rows = [list(row) for row in exact.from_flint(P)]
    n = len(rows)
    for i in (0, 1):
        rows[i][i] -= c
    size = [c if i < 2 else Fraction(1) for i in range(n)]
    return tuple(tuple(rows[i][j] / size[i] / size[j] for j in range(n)) for i in range(n))


def _round_entries(P0: Matrix, digits: int) -> Matrix:
    return tuple(tuple(round_to_digits(x, digits) for x in row) for row in P0)


def holds(ports: Sequence[LinearPort], P0: Matrix, level: Fraction) -> bool:
    try:
        found = [index_storage(port, storage_at(port, P0), level) for port in ports]
    except RuleFailure:
        return False
    return len(found) == 1 or all(min(storage.dissipation_pivots) > 0 for storage in found)


def refute_corners(ports: dict[str, LinearPort]) -> Iterator[Proposal]:
    """Refutations of passivity at the corners of a box: an unstable corner first, then the largest shortage."""
    found: list[tuple[Fraction, str, Witness]] = []
    for signs, port in ports.items():
        response = Response.of(port)
        unstable = not response.is_stable()
        shortage = None if unstable else find_shortage(response)
        witness = shortage.witness if shortage else find_coarse_witness(response) or find_witness(response)
        if witness:
            power = _per_squared_current(witness)
            found.append((power if not unstable else power + 10**9, signs, witness))
    for _, signs, witness in sorted(found, key=lambda entry: -entry[0]):
        yield refutation(witness, signs)


# --- boxes ----------------------------------------------------------------------------------------------------


def propose_box(ports: Sequence[LinearPort], smallest: Fraction) -> Iterator[Proposal]:
    """One storage for all corners of a box (at least two ports), with a shortage not much above the least one.

    `smallest` in ohm is a shortage that costs nothing: below it, rounding would only make numbers longer.
    """
    try:
        program = BoxProgram(ports)
    except OverflowError:
        return
    least = program.least_shortage()
    if least is None:
        return
    for factor in (Fraction(5, 4), Fraction(2), Fraction(5)):
        level = max(round_to_digits(least * factor, 2), smallest)
        for P0 in program.storages(level):
            if holds(ports, P0, level):
                yield Proposal("proved", "index-storage", {"shortage": str(level), "storage": to_rows(P0)})
                return


class BoxProgram:
    """The inequalities of all corners in the entries of P0, in floats and in coordinates that suit a solver.

    States are the charge c V and the others, x = T y with T from the eigenvectors of the first corner, so that fast and
    slow modes stand apart; Y = T'P0 T is the unknown. Dissipation is measured in units of each mode's own rate, and
    inputs so that C'/kappa - P B is of size one.
    """

    def __init__(self, ports: Sequence[LinearPort]) -> None:
        import numpy

        self.n, self.m = len(ports[0].F), len(ports[0].C)
        charged = [i < 2 and ports[0].capacitance_farad is not None for i in range(self.n)]
        plain = []
        for port in ports:
            c = numpy.array([float(port.capacitance_farad or 1) if x else 1.0 for x in charged])
            F, B, C = (to_float(exact.to_flint(a)) for a in (port.F, port.B, port.C))
            plain.append(
                (
                    c[:, None] * F / c,
                    c[:, None] * B,
                    C / c,
                    numpy.diag([1 / x if y else 0.0 for x, y in zip(c, charged, strict=True)]),
                )
            )
        F, B, C, _ = plain[0]
        self.T, rates = _modal(F, B, C)
        inverse = numpy.linalg.inv(self.T)
        into, out = numpy.abs(inverse @ B).max(), numpy.abs(C @ self.T).max()
        kappa = out / into
        self.scale = kappa
        weight = 1 / numpy.sqrt(2 * rates)
        mu = float(numpy.sqrt(rates).max()) / into
        self.pairs, entries = symmetric_units(self.n)
        self.corners = []
        for F, B, C, E in plain:
            F_y, B_y, C_y = inverse @ F @ self.T, inverse @ B, C @ self.T
            storage = numpy.concatenate([(self.T.T @ E @ self.T / kappa)[None], entries])
            half = storage @ F_y
            gap = -(storage @ B_y)
            gap[0] += C_y.T / kappa
            supply = numpy.zeros((len(storage), self.n + self.m, self.n + self.m))
            supply[:, : self.n, : self.n] = -(half + half.transpose(0, 2, 1)) * weight[:, None] * weight
            gap = gap * weight[:, None] * mu
            supply[:, : self.n, self.n :], supply[:, self.n :, : self.n] = gap, gap.transpose(0, 2, 1)
            self.corners.append((storage, supply))
        self.corner = numpy.diag([0.0] * self.n + [2.0] * self.m)  # what eps' multiplies
        self.impedance = kappa / mu**2  # ohm for one unit of eps'

    def least_shortage(self) -> Fraction | None:
        """Near the smallest shortage of one storage for all corners, in ohm; None if the solver finds none."""
        import numpy

        blocks = []
        for storage, supply in self.corners:
            last = numpy.zeros((1, self.n, self.n))
            blocks.append(Block(storage[0], numpy.concatenate([storage[1:], last])))
            blocks.append(Block(supply[0], numpy.concatenate([supply[1:], self.corner[None]])))
        cost = numpy.zeros(len(self.pairs) + 1)
        cost[-1] = 1.0
        point = minimise(cost, blocks, *box(len(cost), 1e6, 1e9))
        if point is None:
            return None
        return round_float(max(float(point[-1]), 1e-12) * self.impedance, 6)

    def storages(self, level: Fraction) -> Iterator[Matrix]:
        """Candidates for P0 with this shortage in ohm, as far inside as the solver finds them, rounded."""
        size = float(level) / self.impedance
        blocks = []
        for storage, supply in self.corners:
            blocks.append(Block(storage[0], storage[1:]))
            blocks.append(Block(supply[0] + size * self.corner, supply[1:]))
        for point in largest_margin(blocks):
            for digits in (4, 6, 9, 12):
                yield self._matrix(point[:-1], digits)

    def _matrix(self, point: Any, digits: int) -> Matrix:
        """P0 = T'^-1 Y T^-1, its entries rounded relative to their row and column in P."""
        import numpy

        Y = numpy.zeros((self.n, self.n))
        for value, (i, j) in zip(point, self.pairs, strict=True):
            Y[i, j] = Y[j, i] = value
        inverse = numpy.linalg.inv(self.T)
        P0 = inverse.T @ Y @ inverse * self.scale
        whole = inverse.T @ (Y + self.corners[0][0][0]) @ inverse * self.scale
        size = numpy.sqrt(numpy.maximum(numpy.abs(whole.diagonal()), 1e-300))
        rows = [[Fraction(0)] * self.n for _ in range(self.n)]
        for i, j in self.pairs:
            unit = Fraction(10) ** (round(float(numpy.log10(size[i] * size[j]))) - digits)
            rows[i][j] = rows[j][i] = round(Fraction(float((P0[i, j] + P0[j, i]) / 2)) / unit) * unit
        return tuple(tuple(row) for row in rows)


def _modal(F: Any, B: Any, C: Any) -> tuple[Any, Any]:
    """T with T^-1 F T in real modal form, each mode as easily reached as seen, and the rate |lambda| of each column.

    If the eigenvectors are of no use, T is diagonal.
    """
    import numpy

    values, vectors = numpy.linalg.eig(F)
    columns, rates = [], []
    for k, value in enumerate(values):
        if value.imag > 0:
            columns += [vectors[:, k].real, vectors[:, k].imag]
            rates += [abs(value)] * 2
        elif value.imag == 0:
            columns.append(vectors[:, k].real)
            rates.append(max(abs(value), 1e-300))
    T = numpy.array(columns).T
    T = T / numpy.linalg.norm(T / numpy.abs(T).max(axis=1, keepdims=True), axis=0)
    if numpy.linalg.cond(T / numpy.abs(T).max(axis=1, keepdims=True)) > 1e8:
        T, rates = numpy.eye(len(F)), [float(numpy.abs(F).max())] * len(F)
    reached, seen = numpy.abs(numpy.linalg.solve(T, B)).sum(axis=1), numpy.abs(C @ T).sum(axis=0)
    scale = numpy.sqrt(numpy.maximum(reached, 1e-300) / numpy.maximum(seen, 1e-300))
    for k in range(len(rates) - 1):  # both columns of a complex pair alike
        if rates[k] == rates[k + 1]:
            scale[k] = scale[k + 1] = numpy.sqrt(scale[k] * scale[k + 1])
    return T * scale, numpy.array(rates)
