"""A wrong sign in one term of the kernel's model, or of the simulator, is caught by the cross-check."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Iterator

import pytest

from certify.kernel.model import J, dgu_port, incidence
from certify.simulator.plant import Plant
from tests import mutants
from tests.mutants import KERNEL, SIMULATOR, TARGETS, Mutant, case, judge_all, target
from tests.mutation_cases import EXEMPT, SPECS

REASONS = mutants.exempt()


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    """Whatever happens in a test, the model is as it was."""
    before = [(own.function, own.function.__code__) for own in (target(*key) for key in TARGETS) if not own.constant]
    yield
    assert all(function.__code__ is code for function, code in before)


@pytest.mark.parametrize(("module", "function"), TARGETS, ids=[".".join(key) for key in TARGETS])
def test_a_wrong_sign_is_caught(module: str, function: str) -> None:
    """Every fifth of them here, in order; all in `campaign_mutations.py`, whose report says so."""
    fates = judge_all(module, function, every=5)
    assert fates, "no sign was found"
    missed = [fate.mutant.key for fate in fates if not fate.caught and fate.mutant.key not in REASONS]
    assert not missed, "neither caught nor exempt"
    needless = [(fate.mutant.key, fate.what) for fate in fates if fate.caught and fate.mutant.key in REASONS]
    assert not needless, "exempt, but caught"
    of_this = {key for key in REASONS if key.startswith(f"{module}.{function}: ")}
    assert not of_this - {fate.mutant.key for fate in fates}, "exempt, but no mutant"


@pytest.mark.parametrize("name", SPECS)
def test_the_models_as_they_are_agree(name: str) -> None:
    for side in (KERNEL, SIMULATOR):
        with mutants.uncompiled():
            found = list(case(name).findings(side, mutants.checked_again))
        assert found
        assert all(finding.agrees for finding in found), [finding for finding in found if not finding.agrees]


def test_exempt_mutants_are_of_functions_that_are_mutated() -> None:
    known = {".".join(key) for key in TARGETS}
    assert {key.split(": ")[0] for key in REASONS} <= known
    assert sum(map(len, EXEMPT.values())) == len(REASONS)


def signs(source: str) -> list[tuple[str, str]]:
    body = ast.parse(textwrap.dedent(source)).body
    return [(kind, ast.unparse(node)) for kind, node in mutants._Signs(body, set()).found]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = a + b * c", [("flip", "a + b * c"), ("negate", "a")]),
        ("x = -a * b - c", [("flip", "-a * b - c"), ("negate", "-a * b"), ("drop", "-a")]),
        ("x -= 2 * w0", [("flip", "x -= 2 * w0")]),
        ("J = [[0, -1], [1, 0]]", [("drop", "-1"), ("negate", "1")]),
        ("for e, s in ((start, 1), (end, -1)): f(s)", [("negate", "start"), ("negate", "1"), ("negate", "end"), ("drop", "-1"), ("negate", "f(s)"), ("negate", "s")]),
        ("y = scale(-1, K)", [("negate", "scale(-1, K)"), ("drop", "-1")]),
        ("y = v ** (e - 2)", [("negate", "v ** (e - 2)"), ("flip", "e - 2"), ("negate", "e")]),
        ("if u < -limit: raise ValueError(a - b)", [("drop", "-limit")]),
        ("x = a[2 * k + 1]", [("negate", "a[2 * k + 1]")]),
        ("x = zeros(2, n)", []),
    ],
)  # fmt: skip
def test_signs_are_found(source: str, expected: list[tuple[str, str]]) -> None:
    assert signs(source) == expected


def test_a_mutant_is_seen_by_all_and_taken_back() -> None:
    grid = case("open").grid
    before, plant = incidence(grid), Plant(grid)
    dgu, w0 = grid.nodes[0].dgu, grid.w0
    assert dgu
    port = dgu_port(dgu, w0, w0)
    own = target("kernel.model", "incidence")
    for mutant in mutants.mutants("kernel.model", "incidence"):
        with own.swapped(mutant.index):
            assert incidence(grid) != before
    assert incidence(grid) == before
    with target("kernel.model", "J").swapped(0):
        assert dgu_port(dgu, w0, w0) != port
    assert dgu_port(dgu, w0, w0) == port
    assert (J[0][1], J[1][0]) == (-1, 1)
    x = case("open").states[0]
    right, method = plant.voltage(x, "a"), target("simulator.plant", "Plant.voltage")
    with method.swapped(mutants.mutants("simulator.plant", "Plant.voltage")[0].index):
        assert plant.voltage(x, "a") == -right
    assert plant.voltage(x, "a") == right


def test_a_mutant_says_what_it_is() -> None:
    found = {mutant.key for mutant in mutants.mutants("kernel.model", "dgu_port")}
    assert "kernel.model.dgu_port: -w0 -> w0" in found
    assert "kernel.model.dgu_port: -1 -> 1 [2]" in found
    assert all(isinstance(mutant, Mutant) and mutant.side == KERNEL for mutant in mutants.mutants("kernel.model", "J"))
