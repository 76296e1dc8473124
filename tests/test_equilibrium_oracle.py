"""The oracle for equilibria: closed forms, planted answers, Kirchhoff's laws anew, and the judge that uses it."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest
from mpmath import mp, mpf

from certify.kernel.claims import Claim
from certify.kernel.spec import decode
from tests import campaign_equilibria as campaign
from tests.conftest import ROOT
from tests.equilibrium_oracle import (
    DIGITS,
    Network,
    closed_form,
    find_equilibria,
    find_near,
    in_bands,
    largest_level,
    read_network,
    solution_at,
    to_mpc,
)
from tests.network_cases import EXACT, NONE, NOSE, TWO, exact_case, network_case, two_node_case

RESIDUAL = mpf("1e-40")
PLANTED = [(number, kind) for number in range(3) for kind in (TWO, NONE, NOSE)]


def random_of(seed: str) -> Any:
    import random

    return random.Random(seed)


def two_nodes(load: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A DGU, a line of 0.3 + j0.4 ohm or so, and a load."""
    return {
        "format": "certify/microgrid@1",
        "frequency": "50 Hz",
        "base_voltage": "400 V",
        "voltage_band": ["0.1 pu", "1.2 pu"],
        "filter": {"lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}},
        "controller": {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}, "held": {"kind": "constant"}},
        "node": {
            "a": {"dgu": {"filter": "lc", "controller": "phs", "reference": ["1 pu", "0.02 pu"]}},
            "b": {"load": [load]},
        },
        "line": [{"name": "ab", "from": "a", "to": "b", "R": "0.3 ohm", "L": "1.27 mH", "C": "40 nF"}],
        **more,
    }


def held(document: dict[str, Any]) -> dict[str, Any]:
    document["node"]["a"]["dgu"]["controller"] = "held"
    return document


CONSTANT_POWER = {"kind": "zip", "P": ["60 kW", "10 kvar"]}


def test_two_nodes_by_hand() -> None:
    """v^4 |Y|^2 + ... with round numbers: 1 ohm, no capacitance, 100 V: V (100 - V) = P is 50 +- sqrt(2500 - P)."""
    document = two_nodes({"kind": "zip", "P": ["900 W", "0 var"]}, base_voltage="100 V")
    document["node"]["a"]["dgu"]["reference"] = ["100 V", "0 V"]
    document["line"][0] |= {"R": "1 ohm", "L": 0, "C": 0}
    network = read_network(document)
    assert [complex(V) for V in closed_form(network)] == [90, 10]
    assert [complex(s.voltages["b"]) for s in find_equilibria(network).solutions()] == [90, 10]
    (high, _) = find_equilibria(network).solutions()
    assert abs(high.line_currents["ab"] - 10) < 1e-40
    # The filter's 25 uF are fed too: I = 10 A + j w0 C 100 V.
    charging = complex(0, 100 * 25e-6 * float(network.w0))
    assert complex(high.dgu_currents["a"]) == pytest.approx(10 + charging)
    assert complex(high.terminal_voltages["a"]) == pytest.approx(
        100 + (0.1 + 1j * float(network.w0) * 1.8e-3) * (10 + charging)
    )


@pytest.mark.parametrize(("number", "kind"), PLANTED)
def test_closed_form_against_construction_and_search(number: int, kind: str) -> None:
    case = two_node_case(number, random_of(f"closed {number} {kind}"), kind)
    network = read_network(case.document)
    exact, found = closed_form(network), find_equilibria(network)
    assert len(exact) == case.solutions == found.count
    for V, solution in zip(exact, found.solutions(), strict=True):
        assert abs(V - solution.voltages["n1"]) < mpf("1e-35") * abs(V)
        assert solution.residual < RESIDUAL


@pytest.mark.parametrize(
    "shunt", [[], [{"kind": "rl", "R": "9 ohm", "L": "3 mH"}], [{"kind": "zip", "Y": ["1 mS", "2 mS"]}]]
)
def test_closed_form_of_an_inverter_at_constant_voltage(shunt: list[dict[str, Any]]) -> None:
    document = held(two_nodes(CONSTANT_POWER))
    document["node"] = {"a": {**document["node"]["a"], "load": [{"kind": "zip", "P": ["20 kW", "0 var"]}, *shunt]}}
    network = read_network({**document, "line": []})
    exact, found = closed_form(network), find_equilibria(network)
    assert len(exact) == found.count == 2
    for V, solution in zip(exact, found.solutions(), strict=True):
        assert abs(V - solution.voltages["a"]) < mpf("1e-35") * abs(V)


def test_cut_off_leaves_one_equilibrium() -> None:
    """Below its band the load is an impedance: the low equilibrium of the constant power is gone."""
    assert find_equilibria(read_network(two_nodes(CONSTANT_POWER))).count == 2
    cut = two_nodes({**CONSTANT_POWER, "band": ["0.6 pu", "1.2 pu"], "below": "constant-impedance"})
    found = find_equilibria(read_network(cut))
    assert found.count == 1
    assert in_bands(found.network, found.solutions()[0].voltages)


@pytest.mark.parametrize("number", range(4))
def test_planted_voltages_are_an_equilibrium_and_found(number: int) -> None:
    case = exact_case(number, random_of(f"planted {number}"))
    network = read_network(case.document)
    assert case.voltages
    with mp.workdps(DIGITS):
        planted = {name: to_mpc(V) for name, V in case.voltages.items()}
        assert solution_at(network, planted).residual < mpf("1e-55")
        near = find_near(network, {name: V * mpf("1.0001") for name, V in planted.items()})
        assert near
        assert campaign.distance(near.voltages, planted) < mpf("1e-30")
    assert any(campaign.distance(V, planted) < mpf("1e-30") for V in find_equilibria(network).voltages())


@pytest.mark.parametrize("number", range(8))
def test_random_networks(number: int) -> None:
    """The same spec for the same seed; residuals; an equilibrium below the nose, none beyond it."""
    case = network_case(number, 12)
    assert case.data == network_case(number, 12).data
    for island in read_network(case.document).islands():
        if len(island.nodes) > 30:
            continue
        found = find_equilibria(island, thorough=False)
        assert not campaign.quarrel_with(case, island, found) or case.kind == EXACT
        assert all(solution.residual < RESIDUAL for solution in found.solutions(3))
        if found.share and found.share > 1.0001:
            assert found.high is None


def test_500_nodes_are_quick() -> None:
    """The whole: loads are scaled along the curve, and one equilibrium in many digits."""
    from tests.bench.networks import microgrid

    network = read_network(json.loads(microgrid(500, mesh=True)))
    high = find_equilibria(network, thorough=False).high
    assert high
    assert high.residual < RESIDUAL


def test_generated_specs_are_read_by_the_kernel() -> None:
    """Documents without inverters at constant voltage are specs that the kernel reads, with the same w0."""
    for number in range(8):
        case = network_case(number, 3)
        if "held" not in case.document["controller"]:
            grid = decode(case.data)
            network = read_network(case.document)
            assert grid.w0 == network.w0
            assert [node.name for node in grid.nodes] == [node.name for node in network.nodes]


def test_clusters_multiply() -> None:
    """Two loads at one DGU know nothing of each other: two times two equilibria."""
    document = two_nodes(CONSTANT_POWER)
    document["node"]["c"] = document["node"]["b"]
    document["line"].append({**document["line"][0], "name": "ac", "to": "c"})
    found = find_equilibria(read_network(document))
    assert found.count == 4
    assert all(solution.residual < RESIDUAL for solution in found.solutions())


def test_largest_level_is_where_the_closed_form_ends() -> None:
    document = two_nodes({"kind": "zip", "P": ["1 kW", "0.5 kvar"]})
    level, nose = largest_level(read_network(document), lowest=0.1)
    assert nose
    for factor, count in ((1 - 1e-6, 2), (1 + 1e-6, 0)):
        power = [f"{level * factor * p:.12g} kW".replace("kW", unit) for p, unit in ((1, "kW"), (0.5, "kvar"))]
        assert len(closed_form(read_network(two_nodes({"kind": "zip", "P": power})))) == count


def test_cigre_is_as_the_paper_says() -> None:
    """Voltages near 1.05 pu; 0.3 to 11.9 kA at DGU nodes against loads of a few ampere."""
    document = tomllib.loads((ROOT / "specs" / "cigre-mv.toml").read_text(), parse_float=Fraction)
    network = read_network(document)
    high = find_equilibria(network).high
    assert high
    assert high.residual < RESIDUAL
    assert in_bands(network, high.voltages)
    assert all(1.02 < abs(V) / 20_000 < 1.06 for V in high.voltages.values())
    assert 11_500 < max(map(abs, high.dgu_currents.values())) < 12_000
    # Node 11 hangs between 5 and 6, nearly at a mean weighted by the lengths of its lines: its load draws 4 A.
    mean = (high.voltages["5"] * 0.2 + high.voltages["6"] * 1.7) / 1.9
    assert 0.1 < abs(high.voltages["11"] - mean) < 10


# --- the judge ------------------------------------------------------------------------------------------------


def claim_of(network: Network, which: int = 0, rho: str = "1e-6", rule: str = "local-monotonicity") -> Claim:
    """What a prover would state about one of the equilibria, rounded to 1e-12 V."""
    solution = find_equilibria(network).solutions()[which]
    facts = [("radius of the proof", Fraction(rho), "V")]
    texts = [(f"voltage at node {name}", x, "V") for name, x in solution.voltages.items()]
    texts += [(f"current in line {name}", x, "A") for name, x in solution.line_currents.items()]
    for name in solution.dgu_currents:
        texts.append((f"current of the DGU at node {name}", solution.dgu_currents[name], "A"))
        texts.append((f"terminal voltage of the DGU at node {name}", solution.terminal_voltages[name], "V"))
    for name, x, unit in texts:
        for axis, part in (("d", x.real), ("q", x.imag)):
            facts.append((f"{name}, {axis}", Fraction(round(part * 10**12), 10**12), unit))
    return Claim("equilibrium/a", "", "proved", rule, tuple(facts))


def moved(claim: Claim, name: str, by: str) -> Claim:
    facts = tuple((n, x + Fraction(by) if n == name else x, unit) for n, x, unit in claim.facts)
    return replace(claim, facts=facts)


def mark_of(document: dict[str, Any], claim: Claim) -> str:
    network = read_network(document)
    found = find_equilibria(network)
    return campaign.judge(network, claim, found, campaign.truth_about(network, found))[0]


def test_judge_accepts_what_is_true() -> None:
    document = two_nodes(CONSTANT_POWER)
    claim = claim_of(read_network(document))
    assert mark_of(document, claim) == campaign.LOCAL
    assert mark_of(document, claim_of(read_network(document), which=1)) == campaign.LOCAL
    narrow = {**document, "voltage_band": ["0.6 pu", "1.2 pu"]}
    assert mark_of(narrow, claim_of(read_network(narrow), rule=campaign.STRONG)) == campaign.UNIQUE
    assert mark_of(document, replace(claim, status="unknown")) == campaign.UNKNOWN
    none = two_nodes({"kind": "zip", "P": ["600 kW", "10 kvar"]})
    assert mark_of(none, replace(claim, status="refuted")) == campaign.REFUTED


FALSE = {
    "voltage": ("voltage at node b, d", "2e-6"),
    "fixed voltage": ("voltage at node a, q", "-2e-6"),
    "line current": ("current in line ab, d", "1"),
    "DGU current": ("current of the DGU at node a, q", "1"),
    "terminal voltage": ("terminal voltage of the DGU at node a, d", "-1"),
}


@pytest.mark.parametrize("which", FALSE)
def test_judge_sees_wrong_figures(which: str) -> None:
    document = two_nodes(CONSTANT_POWER)
    assert mark_of(document, moved(claim_of(read_network(document)), *FALSE[which])) == campaign.WRONG


def test_judge_sees_false_claims() -> None:
    document = two_nodes(CONSTANT_POWER)
    claim = claim_of(read_network(document))
    assert mark_of(document, replace(claim, rule=campaign.STRONG)) == campaign.WRONG  # there are two
    assert mark_of(document, replace(claim, status="refuted")) == campaign.WRONG
    assert mark_of(document, replace(claim, facts=claim.facts[1:])) == campaign.WRONG
    assert mark_of(document, replace(claim, facts=claim.facts[:-1])) == campaign.WRONG
    assert mark_of({**document, "voltage_band": ["0.99 pu", "1.2 pu"]}, claim) == campaign.WRONG
    assert mark_of(two_nodes({"kind": "zip", "P": ["600 kW", "10 kvar"]}), claim) == campaign.WRONG  # none at all
    limited = two_nodes(CONSTANT_POWER)
    limited["node"]["a"]["dgu"]["limits"] = ["0.9 pu", "0.9 pu"]
    assert mark_of(limited, claim) == campaign.WRONG
    assert mark_of(limited, replace(claim, status="refuted")) == campaign.REFUTED
