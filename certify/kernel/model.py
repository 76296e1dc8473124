"""What a spec means: exact matrices, load laws and incidence. SI units, dq frame at w0 (THEORY 1).

The state of a DGU is (V_d, V_q, I_d, I_q, v_d, v_q), v being the integral of V* - V, in deviations from an
equilibrium. A user's own linear loop keeps its own states. All functions are pure and exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, product

from certify.kernel.currents import CurrentLaw, plus_isotropic
from certify.kernel.errors import RuleFailure, require
from certify.kernel.linalg import Matrix, add, block, identity, multiply, scale, solve, to_matrix, zeros
from certify.kernel.powers import PRECISIONS, power_enclosure
from certify.kernel.quantity import QuantityError
from certify.kernel.reader import Pair
from certify.kernel.spec import (
    ConstantVoltage,
    Dgu,
    ExpLoad,
    Filter,
    IdaPbc,
    LinearLoop,
    Microgrid,
    Node,
    StateFeedback,
    ZipLoad,
)

J = to_matrix([[0, -1], [1, 0]])  # multiplication by j
I2 = identity(2)
ZERO, ONE, TWO = map(Fraction, range(3))


@dataclass(frozen=True)
class LinearPort:
    """x' = F x + B d, z = C x, in deviations from an equilibrium: a subsystem with the port (d, z).

    Shapes: F (n, n), B (n, m), C (m, n). `capacitance_farad` is set if x starts with the node voltage and only
    the node's capacitor sees d: then P B = C' leaves no choice for the first two rows of a storage matrix P.
    """

    F: Matrix
    B: Matrix
    C: Matrix
    capacitance_farad: Fraction | None = None


@dataclass(frozen=True)
class PowerTerm:
    """coefficient (v / base)^exponent, a summand of an active or reactive power; `spread`: how far it may be off.

    A coefficient that is irrational is known to within `blur`: it is one number there, not a box of them.
    """

    coefficient: Fraction
    base_volt: Fraction
    exponent: Fraction
    spread: Fraction = Fraction(0)
    blur: Fraction = Fraction(0)


@dataclass(frozen=True)
class LoadLaw:
    """P(v) and Q(v) of everything static at a node, as sums of power terms; I = (P - jQ) / v^2 * V."""

    active: tuple[PowerTerm, ...]
    reactive: tuple[PowerTerm, ...]


Pieces = tuple[tuple[Pair, LoadLaw], ...]  # parts of a band, from below, and the law on each


# How a corner of a box of tolerances is named: for each quantity "-" or "+" for an end, "0" for the value itself.
SIGNS = {"-": -1, "0": 0, "+": 1}
MAX_SIGNS = 8  # of terms of one load law that may be at either end


def node_capacitances(grid: Microgrid, sign: str = "0") -> dict[str, Fraction]:
    """Farad at each node: its own, half of each attached line's, the filter's; with tolerances at the end `sign`."""
    total = {node.name: node.capacitance_farad for node in grid.nodes}
    with_dgu = {node.name for node in grid.nodes if node.dgu}
    for line in grid.lines:
        for end in (line.start, line.end):
            if grid.line_legs_at_dgus or end not in with_dgu:
                total[end] += line.capacitance_farad / 2 * (1 + SIGNS[sign] * line.capacitance_tolerance)
    for node in grid.nodes:
        if node.dgu and node.dgu.filter:
            own = node.dgu.filter
            total[node.name] += own.capacitance_farad * (1 + SIGNS[sign] * own.tolerance[2])
    return total


def at_corner(filter_: Filter, signs: str) -> Filter:
    """A filter with R and L at the ends of their tolerances that the first two signs name."""
    (r, x), own = (SIGNS[sign] for sign in signs[:2]), filter_.tolerance
    resistance, inductance = filter_.resistance_ohm * (1 + r * own[0]), filter_.inductance_henry * (1 + x * own[1])
    return Filter(resistance, inductance, filter_.capacitance_farad)


def law_corners(law: LoadLaw) -> tuple[str, ...]:
    """The corners of the box of a law's coefficients at which monotonicity fails if it fails anywhere in the box.

    One sign for each term, active ones first. An active term with an exponent of 1 or more adds a positive semidefinite
    part to the Jacobian, so its lower end is the worse one; a reactive term of exponent 2 adds nothing symmetric.
    """
    terms = (*law.active, *law.reactive)
    if not any(t.spread or t.blur for t in terms):
        return ("0" * len(terms),)
    ends = ["-+" if t.exponent < 1 else "-" for t in law.active]
    ends += ["0" if t.exponent == 2 else "-+" for t in law.reactive]
    free = [signs if term.spread or term.blur else "0" for term, signs in zip(terms, ends, strict=True)]
    require(sum(len(signs) > 1 for signs in free) <= MAX_SIGNS, "a box of tolerances with too many corners")
    return tuple("".join(signs) for signs in product(*free))


def law_at(law: LoadLaw, signs: str, outer: bool = True) -> LoadLaw:
    """The law at one corner, or, with the sign "0", at the value itself.

    What holds at all corners of the outer box, which takes in the blur, holds for the load; to refute, the blur stays.
    """
    if not any(term.spread or term.blur for term in (*law.active, *law.reactive)):
        return law
    zero, terms = Fraction(0), []
    for term, sign in zip((*law.active, *law.reactive), signs, strict=True):
        taken_in = term.blur if outer and sign != "0" else zero
        end = term.coefficient + SIGNS[sign] * (term.spread + taken_in)
        terms.append(replace(term, coefficient=end, spread=zero, blur=term.blur - taken_in))
    return LoadLaw(tuple(terms[: len(law.active)]), tuple(terms[len(law.active) :]))


def less_conductance(law: LoadLaw, modulus: Fraction) -> LoadLaw:
    """The law of I - modulus V: monotone iff the load is strongly monotone with this modulus."""
    return LoadLaw((*law.active, PowerTerm(-modulus, Fraction(1), Fraction(2))), law.reactive)


def to_state_feedback(law: IdaPbc | StateFeedback | ConstantVoltage) -> StateFeedback:
    """Any of these laws as u = K11 V + K12 I + K13 v, in deviations (for IDA-PBC v = -xi; THEORY 4).

    Of an IDA-PBC law its own inductance, resistance and w0 enter, not the plant's; its j-term is constant and drops
    out.
    """
    if isinstance(law, StateFeedback):
        return law
    if isinstance(law, ConstantVoltage):
        return StateFeedback(zeros(2, 2), zeros(2, 2), None)

    def diagonal(d: Fraction, q: Fraction) -> Matrix:
        return ((d, Fraction(0)), (Fraction(0), q))

    ratio = tuple(a / n for a, n in zip(law.alpha, law.nu, strict=True))
    inductance, resistance = law.design.inductance_henry, law.design.resistance_ohm
    K11 = diagonal(*(1 - n - k * inductance for n, k in zip(law.nu, law.ki, strict=True)))
    K12 = add(diagonal(*(r + resistance for r in ratio)), scale(law.design_w0 * inductance, J))
    K13 = diagonal(*(-r * k for r, k in zip(ratio, law.ki, strict=True)))
    return StateFeedback(K11, K12, K13)


def feedback(law: IdaPbc | StateFeedback | ConstantVoltage, held: str = "") -> tuple[Matrix, tuple[int, ...]]:
    """K of u~ = K x~, x = (V, I, v), shape (2, 4 + number of integrators), and the axes of these integrators.

    The axes named in `held` ("d", "q", "dq") are at their limits: u~ is zero there, and an integrator that acts on no
    other axis is left out, because it winds up without an effect (THEORY 7).
    """
    gains = to_state_feedback(law)
    parts = (gains.K11, gains.K12, gains.K13 or zeros(2, 0))
    rows = [[ZERO if "dq"[i] in held else x for part in parts for x in part[i]] for i in (0, 1)]
    axes = tuple(k for k in range(len(rows[0]) - 4) if not held or any(row[4 + k] for row in rows))
    return tuple((*row[:4], *(row[4 + k] for k in axes)) for row in rows), axes


def dgu_port(dgu: Dgu, capacitance_farad: Fraction, w0: Fraction, held: str = "") -> LinearPort:
    """The shifted closed loop of a DGU without its load (paper, eq. control:dgu_augemented_shifted, in V, I, v).

    `capacitance_farad` is all the capacitance at the node, as `node_capacitances` gives it; `held`: the axes at their
    limits. Raises: ZeroDivisionError if the legs of the lines make a user's linear loop algebraic.
    """
    law = dgu.controller
    if isinstance(law, LinearLoop):
        legs = capacitance_farad - (dgu.filter.capacitance_farad if dgu.filter else 0)
        # d = d_lines - legs (z' + j w0 z), and z' = C F x + C B d: solve for x'.
        load = add(identity(len(law.F)), scale(legs, multiply(law.B, law.C)))
        inner = add(law.F, scale(-legs * w0, multiply(law.B, multiply(J, law.C))))
        return LinearPort(solve(load, inner), solve(load, law.B), law.C)
    if dgu.filter is None:
        raise ValueError("a DGU without a filter needs a linear loop")
    c, (K, axes) = capacitance_farad, feedback(law, held)
    n, per_c = len(axes), scale(1 / capacitance_farad, I2)
    impedance = add(scale(dgu.filter.resistance_ohm, I2), scale(w0 * dgu.filter.inductance_henry, J))
    branch = add(K, block([[scale(-1, I2), scale(-1, impedance), zeros(2, n)]]))  # L I~' = u~ - V~ - (R + j w0 L) I~
    rest = tuple(tuple(-ONE if j == k else ZERO for j in range(4 + n)) for k in axes)  # v' = -V~
    if axes and held and dgu.anti_windup_second is not None:  # v' = V* - V + K13^-1 (sat(u) - u)/T, and sat(u)~ = 0
        whole, K13 = feedback(law)[0], to_state_feedback(law).K13 or zeros(2, 2)
        back = solve(K13, tuple(row if "dq"[i] in held else (ZERO,) * 6 for i, row in enumerate(whole)))
        kept = tuple(tuple(back[k][j] for j in (*range(4), *(4 + m for m in axes))) for k in axes)
        rest = add(rest, scale(-1 / dgu.anti_windup_second, kept))
    rows = (*block([[scale(-w0, J), per_c, zeros(2, n)]]), *scale(1 / dgu.filter.inductance_henry, branch), *rest)
    return LinearPort(rows, (*per_c, *zeros(2 + n, 2)), block([[I2, zeros(2, 2 + n)]]), c)


def load_pieces(node: Node) -> Pieces:
    """The law of all static loads at a node on each part of its band; a load is an impedance below its cut-off."""
    if node.band_volt is None:
        return ()
    low, high = node.band_volt
    cuts = {x.cutoff_volt for x in node.loads if x.cutoff_volt is not None and low < x.cutoff_volt < high}
    return tuple((band, load_law(node.loads, band[1])) for band in pairwise((low, *sorted(cuts), high)))


def load_current(node: Node) -> CurrentLaw:
    """The current of all static loads at a node with a load given by its current, which the others must suit."""
    if node.current is None:
        raise ValueError("no load of this node is given by its current")
    parts = [{term.exponent: term.coefficient for term in part} for part in vars(load_law(node.loads)).values()]
    Y, P = ((parts[0].get(e, ZERO), parts[1].get(e, ZERO)) for e in (TWO, ZERO))
    try:
        return plus_isotropic(node.current.law, Y, P)
    except QuantityError as error:
        raise RuleFailure(f"the sum of the loads is too large: {error.message}") from None


def load_law(loads: Iterable[ZipLoad | ExpLoad], top_volt: Fraction | None = None) -> LoadLaw:
    """The sum of some static loads (THEORY 1), just below `top_volt` if given; equal powers are added up."""
    sums: tuple[dict[Pair, tuple[Fraction, Fraction, Fraction]], ...] = ({}, {})
    for load in loads:
        cutoff = load.cutoff_volt
        frozen = cutoff if cutoff is not None and top_volt is not None and top_volt <= cutoff else None
        for part, term in _terms(load):
            if frozen is not None:
                term = _as_admittance(term, frozen)
            elif term.exponent.denominator == 1 and term.base_volt != 1:  # a whole power joins the others
                factor = 1 / term.base_volt**term.exponent.numerator
                term = PowerTerm(term.coefficient * factor, Fraction(1), term.exponent, term.spread * factor)
            key, own = (term.base_volt, term.exponent), (term.coefficient, term.spread, term.blur)
            before = sums[part].get(key)
            sums[part][key] = own if before is None else (before[0] + own[0], before[1] + own[1], before[2] + own[2])
    laws = [tuple(PowerTerm(c[0], *key, *c[1:]) for key, c in sorted(part.items()) if any(c)) for part in sums]
    return LoadLaw(laws[0], laws[1])


def _terms(load: ZipLoad | ExpLoad) -> Iterator[tuple[int, PowerTerm]]:
    """The summands of P (part 0) and Q (part 1) of one load."""
    off = load.tolerance
    if isinstance(load, ZipLoad):
        for e, coefficients, share in ((TWO, load.Y, off[0]), (ONE, load.I, off[1]), (ZERO, load.P, off[2])):
            for part, c in enumerate(coefficients):
                yield part, PowerTerm(c, ONE, e, abs(c) * share if share else ZERO)
    else:
        yield 0, PowerTerm(load.P0_watt, load.V0_volt, load.np, abs(load.P0_watt) * off[0])
        yield 1, PowerTerm(load.Q0_var, load.V0_volt, load.nq, abs(load.Q0_var) * off[1])


def _as_admittance(term: PowerTerm, v: Fraction) -> PowerTerm:
    """The constant admittance that draws the same power at voltage v; enclosed where the power is irrational."""
    low, high = power_enclosure(v / term.base_volt, term.exponent, PRECISIONS[2])
    middle, half = (low + high) / 2 / v**2, (high - low) / 2 / v**2
    c, spread = term.coefficient, term.spread
    return PowerTerm(c * middle, Fraction(1), Fraction(2), spread * middle, (abs(c) + spread) * half)


def incidence(grid: Microgrid) -> tuple[dict[tuple[str, str], int], dict[tuple[str, str], int]]:
    """What a node receives from a line, and what a line receives from a node, as {(node, line): sign}.

    Node balance d_k = sum(in) I_l - sum(out) I_l, line input V_start - V_end (THEORY 1); each by its own rule.
    """
    injection: dict[tuple[str, str], int] = {}
    drop: dict[tuple[str, str], int] = {}
    for line in grid.lines:
        injection[line.start, line.name], injection[line.end, line.name] = -1, 1
        drop[line.start, line.name], drop[line.end, line.name] = 1, -1
    return injection, drop
