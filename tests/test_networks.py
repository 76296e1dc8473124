"""Whole networks: verdicts against eigenvalues of an independent linearisation, LaSalle cases, relabelling, units."""

from __future__ import annotations

import json
import random
from typing import Any

import numpy
import pytest

from certify.certificate import prove
from certify.kernel.claims import Context
from certify.kernel.spec import decode
from tests.bench.networks import microgrid
from tests.conftest import ROOT

BASE: dict[str, Any] = {
    "format": "certify/microgrid@1",
    "frequency": 50,
    "voltage_band": [300, 500],
    "filter": {"f": {"R": "0.1", "L": "1.8 mH", "C": "25 uF"}, "lossless": {"R": 0, "L": "1.8 mH", "C": "25 uF"}},
    "controller": {
        "phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100},
        "none": {"kind": "state-feedback", "K11": 0, "K12": 0},
        "proportional": {"kind": "state-feedback", "K11": 0, "K12": -1},
    },
}


def with_oscillator(damping: str, coupling: str) -> dict[str, Any]:
    """A damped filter as a linear loop, and an oscillator that drives its current by `coupling` and is not seen itself."""
    F: list[list[Any]] = [["0"] * 6 for _ in range(6)]
    for i, j in ((0, 0), (1, 1)):
        F[i][j + 2], F[i + 2][j], F[i + 2][j + 2] = "1/C", "-1/L", "-2/L"
    for i in (0, 2):
        F[i][i + 1], F[i + 1][i] = "w0", "-w0"
    F[4][4] = F[5][5] = f"-{damping}"
    F[4][5], F[5][4], F[2][4] = "50", "-50", coupling
    B, C = [["0", "0"] for _ in range(6)], [["0"] * 6, ["0"] * 6]
    B[0][0] = B[1][1] = "1/C"
    C[0][0] = C[1][1] = "1"
    return {"kind": "linear", "F": F, "B": B, "C": C}


BASE["controller"] |= {
    "held": {"kind": "constant"},
    "hidden oscillator": with_oscillator("0", "0"),
    "hidden damped mode": with_oscillator("3", "0"),
    "oscillator that is seen": with_oscillator("0", "1"),
    "wrong inductance": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100, "design": {"L": "1.802 mH"}},
}
STRICT = {"kind": "zip", "Y": ["10 mS", "2 mS"]}
CONSTANT_CURRENT = {"kind": "zip", "I": ["2 A", "0 A"]}
REACTIVE = {"kind": "zip", "Y": ["0 S", "5 mS"]}
BRANCH = {"kind": "rl", "R": "20", "L": "10 mH"}


def dgu(controller: str = "phs", filter_: str = "f") -> dict[str, Any]:
    return {"filter": filter_, "controller": controller, "reference": [400, 0]}


def network(nodes: dict[str, Any], *pairs: str) -> dict[str, Any]:
    lines = [{"name": pair, "from": pair[0], "to": pair[1], "R": "0.2", "L": "0.5 mH", "C": "20 nF"} for pair in pairs]
    return {**BASE, "node": nodes, "line": lines}


def statuses(spec: dict[str, Any]) -> tuple[str, dict[str, str]]:
    verdict = prove(json.dumps(spec).encode()).verdict
    return verdict.outcome, {claim.id: claim.status for claim in verdict.claims}


CASES: dict[str, tuple[dict[str, Any], str]] = {
    "a DGU alone": (network({"a": {"dgu": dgu()}}), "certified"),
    "a DGU with a load": (network({"a": {"dgu": dgu(), "load": [STRICT]}}), "certified"),
    "a DGU with a branch": (network({"a": {"dgu": dgu(), "load": [BRANCH]}}), "certified"),
    "a junction without load": (network({"a": {"dgu": dgu()}, "j": {}, "b": {"dgu": dgu()}}, "aj", "jb"), "certified"),
    "a load of constant current": (network({"a": {"dgu": dgu()}, "b": {"load": [CONSTANT_CURRENT]}}, "ab"), "certified"),
    "a pure reactance": (network({"a": {"dgu": dgu()}, "b": {"load": [REACTIVE]}}, "ab"), "certified"),
    "two lines in parallel": (network({"a": {"dgu": dgu()}, "b": {"load": [STRICT]}}, "ab", "ab")
        | {"line": [{"name": n, "from": "a", "to": "b", "R": 1, "L": "1 mH", "C": "9 nF"} for n in ("x", "y")]}, "certified"),
    "a ring": (network({k: {"dgu": dgu(), "load": [STRICT]} for k in "abc"}, "ab", "bc", "ca"), "certified"),
    "two islands": (network({"a": {"dgu": dgu()}, "b": {"load": [STRICT]}, "c": {"dgu": dgu()}}, "ab"), "certified"),
    "no controller at all": (network({"a": {"dgu": dgu("none")}}), "conditional"),
    "proportional": (network({"a": {"dgu": dgu("proportional")}, "b": {"load": [STRICT]}}, "ab"), "conditional"),
    "lossless alone": (network({"a": {"dgu": dgu("none", "lossless")}}), "unknown"),
    "lossless with a strict load": (network({"a": {"dgu": dgu("none", "lossless"), "load": [STRICT]}}), "conditional"),
    "lossless with a branch": (network({"a": {"dgu": dgu("none", "lossless"), "load": [BRANCH]}}), "conditional"),
    "lossless with a reactance": (network({"a": {"dgu": dgu("none", "lossless"), "load": [REACTIVE]}}), "unknown"),
    "lossless with a damped neighbour": (
        network({"a": {"dgu": dgu("none", "lossless")}, "b": {"dgu": dgu()}}, "ab"), "conditional"),
    "held at a constant voltage": (network({"a": {"dgu": dgu("held")}, "b": {"load": [STRICT]}}, "ab"), "certified"),
    "held, lossless, only a reactance": (network({"a": {"dgu": dgu("held", "lossless"), "load": [REACTIVE]}}), "unknown"),
    "a hidden oscillation": (
        network({"a": {"dgu": dgu("hidden oscillator")}, "b": {"dgu": dgu(), "load": [STRICT]}}, "ab"), "unknown"),
    "a hidden mode that decays": (
        network({"a": {"dgu": dgu("hidden damped mode")}, "b": {"dgu": dgu(), "load": [STRICT]}}, "ab"), "certified"),
    "all controllers, an index, all loads, a junction": (network({
        "a": {"dgu": dgu(), "load": [REACTIVE]}, "b": {"dgu": dgu("wrong inductance")}, "c": {"dgu": dgu("held")},
        "d": {"load": [CONSTANT_CURRENT]}, "e": {}, "f": {"dgu": dgu("phs", "lossless"), "load": [BRANCH]},
        "g": {"load": [STRICT, BRANCH]}}, "ab", "bc", "cd", "de", "ea", "ef", "eg"), "certified"),
    "one island of two is lossless": (
        network({"a": {"dgu": dgu("none", "lossless")}, "b": {"dgu": dgu(), "load": [STRICT]}}), "unknown"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=str)
def test_case(case: str) -> None:
    spec, expected = CASES[case]
    assert statuses(spec)[0] == expected


def jacobian(spec: dict[str, Any]) -> numpy.ndarray:
    """The linearisation at voltages of 400 V everywhere, assembled from Kirchhoff's laws in complex floats.

    Loads are isotropic, so their Jacobian at another angle of the voltage is the same up to a rotation.
    """
    grid = decode(json.dumps(spec).encode())
    context, w = Context(grid), 2 * numpy.pi * 50
    size: dict[str, int] = {}
    offset = 0
    for node in grid.nodes:
        size[node.name] = offset
        offset += len(context.port(node.name).F) if node.dgu else 2
        offset += 2 * len(node.branches)
    total = offset + 2 * len(grid.lines)
    A = numpy.zeros((total, total))
    turn = numpy.array([[0, 1], [-1, 0]])
    for node in grid.nodes:
        i, c = size[node.name], float(context.capacitances["0"][node.name])
        width = 2
        if node.dgu:
            F = numpy.array([[float(x) for x in row] for row in context.port(node.name).F])
            width = len(F)
            A[i : i + width, i : i + width] = F
        else:
            A[i : i + 2, i : i + 2] = w * turn
        for load in node.loads:
            (yp, yq), (ip, iq) = ((float(x) for x in pair) for pair in (load.Y, load.I))  # type: ignore[union-attr]
            v = 400.0
            G, B = yp + ip / v, -(yq + iq / v)
            A[i : i + 2, i : i + 2] -= numpy.array([[yp, -B], [-yq, G]]) / c
        for k, branch in enumerate(node.branches):
            j = i + width + 2 * k
            _branch(A, j, branch, w, turn)
            _couple(A, j, i, c, float(branch.inductance_henry), 1)
    for k, line in enumerate(grid.lines):
        j = offset + 2 * k
        _branch(A, j, line.branch, w, turn)
        for name, sign in ((line.start, 1), (line.end, -1)):
            _couple(A, j, size[name], float(context.capacitances["0"][name]), float(line.branch.inductance_henry), sign)
    return A


def _branch(A: numpy.ndarray, j: int, branch: Any, w: float, turn: numpy.ndarray) -> None:
    A[j : j + 2, j : j + 2] = -float(branch.resistance_ohm / branch.inductance_henry) * numpy.eye(2) + w * turn


def _couple(A: numpy.ndarray, j: int, i: int, c: float, inductance: float, sign: int) -> None:
    A[j : j + 2, i : i + 2] += sign * numpy.eye(2) / inductance
    A[i : i + 2, j : j + 2] -= sign * numpy.eye(2) / c


def growth(spec: dict[str, Any]) -> float:
    """The largest real part of an eigenvalue, relative to the largest eigenvalue."""
    values = numpy.linalg.eigvals(jacobian(spec))
    return float(values.real.max() / abs(values).max())


@pytest.mark.parametrize("case", CASES, ids=str)
def test_verdict_against_eigenvalues(case: str) -> None:
    spec, expected = CASES[case]
    if expected in ("certified", "conditional"):  # the latter where nothing proves an equilibrium
        assert growth(spec) < -1e-9
    else:
        assert growth(spec) > -1e-12  # the tool is right not to claim it


def random_network(rng: random.Random) -> dict[str, Any]:
    names = "abcdefg"[: rng.randint(1, 7)]
    controllers = {
        f"c{k}": rng.choice(
            [
                {
                    "kind": "ida-pbc",
                    "alpha": [-rng.uniform(0.1, 9), -rng.uniform(0.1, 9)],
                    "nu": rng.uniform(0.1, 3),
                    "ki": rng.uniform(1, 500),
                },
                {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100, "design": {"L": rng.choice(["1.8 mH", "1.9 mH"])}},
                {"kind": "state-feedback", "K11": f"{rng.uniform(-2, 0.9):.3f}", "K12": f"{rng.uniform(-2, 0.2):.3f}"},
                {
                    "kind": "state-feedback",
                    "K11": "1 - 900*L",
                    "K12": [["R - 700", "-w0*L"], ["w0*L", "R - 700"]],
                    "K13": 600,
                },
            ]
        )
        for k in range(2)
    }
    text = json.dumps(controllers, default=str)
    controllers = json.loads(text, parse_float=lambda x: f"{float(x):.4f}")
    nodes: dict[str, Any] = {}
    for name in names:
        node: dict[str, Any] = {}
        if name == "a" or rng.random() < 0.5:
            node["dgu"] = dgu(rng.choice(["phs", "none", *controllers]), rng.choice(["f", "lossless"]))
        choices = [
            STRICT,
            CONSTANT_CURRENT,
            REACTIVE,
            BRANCH,
            {"kind": "zip", "Y": ["1 mS", "1 mS"], "I": ["-0.1 A", "0.3 A"]},
        ]
        node["load"] = rng.sample(choices, rng.randint(0, 2))
        nodes[name] = node
    tree = [f"{rng.choice(names[:k])}{names[k]}" for k in range(1, len(names))]
    return {**network(nodes, *tree), "controller": {**BASE["controller"], **controllers}}


@pytest.mark.parametrize("seed", range(60))
def test_certified_random_networks_are_stable(seed: int) -> None:
    spec = random_network(random.Random(seed))
    outcome, _ = statuses(spec)
    if outcome in ("certified", "conditional"):
        assert growth(spec) < 1e-13


def test_some_random_networks_are_certified_and_some_are_not() -> None:
    outcomes = [statuses(random_network(random.Random(seed)))[0] for seed in range(25)]
    assert 3 < outcomes.count("certified") < 24


@pytest.mark.parametrize("mesh", [False, True])
def test_generated_networks_are_certified(mesh: bool) -> None:
    verdict = prove(microgrid(40, mesh)).verdict
    assert verdict.outcome == "certified"
    assert len(verdict.claims) > 90


def test_relabelling_and_units_change_nothing() -> None:
    """The same network under other names and in other units has the same proofs."""
    one = network({"a": {"dgu": dgu()}, "b": {"load": [STRICT]}}, "ab")
    other = json.loads(
        json.dumps(one).replace('"a"', '"north"').replace('"b"', '"south"').replace('"10 mS"', '"10000 uS"')
    )
    other["filter"]["f"] = {"R": "100 mohm", "L": "1800 uH", "C": "0.025 mF"}
    results = [json.loads(prove(json.dumps(spec).encode()).data) for spec in (one, other)]
    assert [c["proof"] for c in results[0]["claims"][:4]] == [c["proof"] for c in results[1]["claims"][:4]]


def test_per_unit_is_the_same_as_si() -> None:
    si = network({"a": {"dgu": dgu()}})
    pu = json.loads(json.dumps(si))
    pu |= {"base_voltage": "400 V", "base_power": "100 kVA"}
    pu["filter"]["f"]["R"] = "0.0625 pu"  # of 1.6 ohm
    pu["node"]["a"]["dgu"]["reference"] = ["1 pu", "0 pu"]
    grids = [decode(json.dumps(spec).encode()) for spec in (si, pu)]
    assert grids[0].nodes[0].dgu == grids[1].nodes[0].dgu


def test_equal_subsystems_are_proved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from certify.search import prove as module

    calls = []
    original = module.propose_dgu
    monkeypatch.setattr(module, "propose_dgu", lambda port: calls.append(port) or original(port))
    spec = network({k: {"dgu": dgu(), "load": [STRICT]} for k in "abcdef"})
    document = json.loads(prove(json.dumps(spec).encode()).data)
    assert len(calls) == 1
    assert len({c["proof"] for c in document["claims"] if c["id"].startswith("dgu/")}) == 1


def test_dgus_that_differ_only_in_their_lines_share_a_proof() -> None:
    document = json.loads(prove((ROOT / "specs/cigre-mv.toml").read_bytes()).data)
    assert len({c["proof"] for c in document["claims"] if c["id"].startswith("dgu/")}) == 2
