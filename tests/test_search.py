"""The search: its ways agree with each other, and honest `unknown` where there is nothing to find."""

from __future__ import annotations

import random
from fractions import Fraction
from typing import Any

import pytest

from certify.inputs import load
from certify.kernel.claims import Context
from certify.kernel.linalg import Matrix, add, identity, multiply, scale, transpose
from certify.kernel.model import J, LinearPort, dgu_port
from certify.kernel.rules import quadratic_storage
from certify.kernel.spec import Dgu, Filter, LinearLoop, StateFeedback
from certify.search.contradiction import find_contradiction
from certify.search.dgu import find_storage, propose_dgu, reduce_port
from certify.search.exact import from_flint
from certify.search.frequency import Response, Witness, find_coarse_witness, find_witness
from certify.search.proposal import Proposal
from certify.search.storage import find_state_feedback_storage, inverse_2x2
from tests.accept import accepts

W0 = Fraction("314.15926535897932384626433832795028841972")
FILTER = Filter(Fraction(1, 10), Fraction("0.0018"), Fraction("25e-6"))


def passive_design(rng: random.Random) -> LinearPort:
    """A PI design from a triple (X, Bm, H), coupled and not diagonal (THEORY 4)."""

    def entry(scale_: int) -> Fraction:
        return Fraction(rng.randint(-scale_, scale_), rng.randint(1, 7))

    def definite(scale_: int) -> Matrix:
        a = tuple(tuple(entry(scale_) for _ in range(2)) for _ in range(2))
        return add(multiply(a, transpose(a)), identity(2))

    X, Bm = definite(9), definite(2)
    inverse = inverse_2x2(Bm)
    assert inverse
    H = multiply(add(scale(-1, definite(4)), scale(entry(5), J)), inverse)  # H Bm + Bm H' = -2 definite
    L = FILTER.inductance_henry
    K12 = add(H, add(scale(FILTER.resistance_ohm, identity(2)), scale(W0 * L, J)))
    K11 = add(identity(2), scale(-1, add(Bm, scale(L, X))))
    return closed_loop(K11, K12, scale(-1, multiply(H, X)))


def closed_loop(K11: Matrix, K12: Matrix, K13: Matrix | None) -> LinearPort:
    dgu = Dgu(FILTER, StateFeedback(K11, K12, K13), (Fraction(1), Fraction(0)), None)
    return dgu_port(dgu, FILTER.capacitance_farad, W0)


@pytest.mark.parametrize("seed", range(8))
def test_facial_reduction_reproduces_the_closed_form(seed: int) -> None:
    port = passive_design(random.Random(seed))
    part = find_state_feedback_storage(port)
    assert part is not None
    family = reduce_port(port)
    assert family.point is not None
    assert not family.directions  # a single point
    P = from_flint(family.point)
    assert tuple(row[2:] for row in P[2:]) == part
    quadratic_storage(port, P)
    assert witness_of(port) is None


def witness_of(port: LinearPort) -> Witness | None:
    response = Response.of(port)
    return find_coarse_witness(response) or find_witness(response)


def spoiled(port: LinearPort, row: int, column: int, error: Fraction) -> LinearPort:
    F = tuple(tuple(x + error * (i == row and j == column) for j, x in enumerate(r)) for i, r in enumerate(port.F))
    return LinearPort(F, port.B, port.C, port.capacitance_farad)


@pytest.mark.parametrize("error", ["1e-3", "-1e-9", "1e-30"])
@pytest.mark.parametrize(("row", "column"), [(2, 1), (3, 0), (2, 5)])
def test_two_ways_to_refute(error: str, row: int, column: int) -> None:
    """An asymmetric gain: a frequency shows it, and so do the equations for a storage function."""
    port = spoiled(passive_design(random.Random(5)), row, column, Fraction(error))
    assert witness_of(port) is not None
    data = find_contradiction(port)
    assert data
    assert accepts(port, Proposal("refuted", "storage-contradiction", data))


def verdict(port: LinearPort) -> tuple[str, str | None]:
    """What the kernel accepts of the proposals for a port."""
    accepted = (p for p in propose_dgu(port) if accepts(port, p))
    proposal = next(accepted, None)
    return (proposal.status, proposal.rule) if proposal else ("unknown", None)


def multiple(x: Any) -> Matrix:
    return scale(Fraction(x), identity(2))


@pytest.mark.parametrize(
    ("K11", "K12", "K13", "expected"),
    [
        (0, "0.05", None, "proved"),  # no integrator, some of the filter's damping taken away
        (0, "0.1", None, "proved"),  # lossless: boundary
        (0, "0.1000000000000000000000000000001", None, "refuted"),
        (1, -1, None, "refuted"),  # G = 0
        (2, -1, None, "refuted"),  # the voltage feeds the current
        (0, -1, 0, "unknown"),  # an integrator that acts on nothing
    ],
)
def test_without_integrator(K11: Any, K12: Any, K13: Any, expected: str) -> None:
    K12_matrix = add(multiple(K12), scale(W0 * FILTER.inductance_henry, J))
    port = closed_loop(multiple(K11), K12_matrix, None if K13 is None else multiple(K13))
    assert verdict(port)[0] == expected


def rc_ladder(n: int, rng: random.Random, damping: Fraction = Fraction(1)) -> LinearPort:
    """A chain of capacitors and resistors seen from its first node, in other coordinates: passive, P not unique."""
    zero = Fraction(0)
    F = [[zero] * n for _ in range(n)]
    c = [Fraction(rng.randint(1, 20), 7) for _ in range(n)]
    for k in range(n - 1):
        g = Fraction(rng.randint(1, 9), 4)
        for a, b in ((k, k + 1), (k + 1, k)):
            F[a][a] -= g / c[a]
            F[a][b] += g / c[a]
    F[n - 1][n - 1] -= damping / c[n - 1]
    T = tuple(tuple(Fraction(int(i == j) + (rng.randint(-1, 1) if j < i else 0)) for j in range(n)) for i in range(n))
    from certify.kernel.linalg import solve

    B = tuple((1 / c[0] if i == 0 else zero,) for i in range(n))
    C = ((Fraction(1), *[zero] * (n - 1)),)
    matrix = tuple(tuple(row) for row in F)
    return LinearPort(solve(T, multiply(matrix, T)), solve(T, B), multiply(C, T))


@pytest.mark.parametrize("seed", range(4))
def test_free_storage_goes_through_the_solver(seed: int) -> None:
    port = rc_ladder(4, random.Random(seed))
    family = reduce_port(port)
    assert family.directions
    P = find_storage(port, family)
    assert P is not None
    quadratic_storage(port, P)
    assert verdict(port) == ("proved", "quadratic-storage")


@pytest.mark.parametrize("seed", range(4))
def test_an_active_ladder_is_refuted(seed: int) -> None:
    assert verdict(rc_ladder(4, random.Random(seed), Fraction(-3)))[0] == "refuted"


def test_linear_loop_of_a_spec_is_solved_with_small_numbers() -> None:
    context = Context(load("specs/custom-loop.json"))
    port = context.port("inverter")
    assert isinstance(context.nodes["inverter"].dgu.controller, LinearLoop)  # type: ignore[union-attr]
    proposal = next(iter(propose_dgu(port)))
    assert max(len(number) for row in proposal.data["storage"] for number in row.split()) < 120


def test_unknown_solver_status_is_nothing() -> None:
    from certify.search.solvers import USABLE

    assert not USABLE.get("PrimalInfeasible")
    assert not USABLE.get("a status of next year")


@pytest.mark.parametrize(("name", "low", "high"), [("cigre-mv-as-printed", 30, 3000), ("cigre-mv-cross-2w0", 1e-5, 10)])
def test_witnesses_have_small_numbers(name: str, low: float, high: float) -> None:
    port = Context(load(f"specs/{name}.toml")).port("1")
    witness = witness_of(port)
    assert witness is not None
    (sigma, omega), u = witness.s0, witness.u
    assert low / 1e5 < sigma < high
    assert low < omega < high
    assert all(len(str(x)) < 12 for x in (sigma, omega, *(part for pair in u for part in pair)))
