"""What the strategies promise is what the kernel says, and what they shrink to reads like a spec."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st

from certify.inputs import decode_all
from certify.kernel.errors import SpecError
from certify.kernel.linalg import identity, scale
from certify.kernel.quantity import parse_quantity
from certify.kernel.reader import read_document
from certify.kernel.spec import angular_frequency, components
from certify.testing import (
    Controller,
    Document,
    Filter,
    Load,
    assert_certified,
    assert_not_passive,
    assert_passive,
    assert_refuted,
    boundary_controllers,
    controllers,
    decimals,
    dgu_spec,
    filters,
    lines,
    loads,
    network_spec,
    networks,
    non_passive_controllers,
    passive_controllers,
    quantities,
    references,
    specs,
    w0,
)
from tests.designs import NOT_PASSIVE, PASSIVE, expected_two_axes
from tests.designs import Filter as Plant

TIMES = int(os.environ.get("CERTIFY_TEST_TIMES", "1"))  # so many times as many examples, for a long run now and then
FEW = settings(max_examples=15 * TIMES, deadline=None)
SHRUNK = settings(
    phases=[Phase.generate, Phase.shrink], database=None, max_examples=300, derandomize=True, deadline=None
)
LC = Filter(R="0.1 ohm", L="1.8 mH", C="25 uF")
PHS = Controller(kind="ida-pbc", alpha=-5, nu=1, ki=100)


def plant(filter: Filter) -> Plant:
    return Plant(filter.R, filter.L, filter.C, w0())


def gains(law: Controller, filter: Filter) -> tuple[Any, Any, Any]:
    found = law.gains(filter)
    return found.K11, found.K12, found.K13


# --- promises -----------------------------------------------------------------------------------------------------


@FEW
@given(filters(), passive_controllers())
def test_passive_laws_are_certified_and_agree_with_the_closed_form(filter: Filter, law: Controller) -> None:
    assert_passive(filter, law)
    assert expected_two_axes(plant(filter), gains(law, filter)) == PASSIVE


@FEW
@given(filters(), passive_controllers(integral=True))
def test_with_integral_action_the_whole_spec_is_certified(filter: Filter, law: Controller) -> None:
    assert_certified(dgu_spec(filter, law))


@settings(max_examples=8 * TIMES, deadline=None)
@given(filters(), boundary_controllers(), st.sampled_from(("1", "1e-3", "1e-9", "1e-30")))
def test_boundary_laws_have_no_damping_to_spare(filter: Filter, law: Controller, little: str) -> None:
    assert_passive(filter, law)
    (lossless,) = (name for name, value in law["let"].items() if value == 0)
    assert_not_passive(filter, law.with_let(**{lossless: f"-{little}"}))
    assert_passive(filter, law.with_let(**{lossless: little}))
    if "K13" in law:
        assert_not_passive(filter, law.perturbed("K11", little, at=(0, 1)))


@FEW
@given(filters(), non_passive_controllers())
def test_non_passive_laws_have_a_witness(filter: Filter, law: Controller) -> None:
    assert_not_passive(filter, law)
    assert expected_two_axes(plant(filter), gains(law, filter)) == NOT_PASSIVE


@FEW
@given(filters(), non_passive_controllers(unstable=True))
def test_unstable_laws_are_refuted_with_any_load_and_shortage(filter: Filter, law: Controller) -> None:
    F_trace = sum(gains(law, filter)[1][i][i] for i in (0, 1)) - 2 * filter.R
    assert F_trace > 0
    assert_refuted(dgu_spec(filter, law, load={"kind": "rl", "R": "50 ohm", "L": "0.1 H"}), "dgu/a")


@FEW
@given(loads(monotone=True))
def test_monotone_loads(load: Load) -> None:
    assert_certified(dgu_spec(LC, PHS, load=load))


@FEW
@given(loads(monotone=False))
def test_loads_that_are_not_monotone(load: Load) -> None:
    assert_refuted(dgu_spec(LC, PHS, load=load), "load/a")


LOW = {"band": ("0.3 pu", "1.5 pu"), "base_voltage": "400 V", "power": ("10 W", "5 kW")}


@pytest.mark.parametrize("monotone", [True, False])
@settings(max_examples=10 * TIMES, deadline=None)
@given(data=st.data())
def test_loads_of_another_band_and_voltage(monotone: bool, data: st.DataObject) -> None:
    load = data.draw(loads(monotone, ("zip", "exp"), **LOW))  # type: ignore[arg-type]
    spec = dgu_spec(LC, PHS, load=load, base_voltage="400 V", voltage_band=LOW["band"])
    assert_certified(spec) if monotone else assert_refuted(spec, "load")


@settings(max_examples=8 * TIMES, deadline=None)
@given(st.one_of(specs(), specs(max_nodes=10), specs(max_nodes=10, meshed=True)))
def test_whole_specs_are_certified_with_their_equilibrium_and_region(spec: Document) -> None:
    found = assert_certified(spec)
    kinds = {claim.kind: claim.status for claim in found.verdict.claims}
    assert kinds["equilibrium"] == kinds["region"] == kinds["microgrid"] == "proved"


@settings(max_examples=10 * TIMES, deadline=None)
@given(specs("refuted", max_nodes=4))
def test_refuted_specs(spec: Document) -> None:
    refuted = [c.id for c in assert_refuted(spec).verdict.claims if c.status == "refuted"]
    assert refuted in (["dgu/1"], ["load/1"])


@FEW
@given(networks(max_nodes=9, meshed=False), networks(meshed=True))
def test_networks_are_connected(tree: dict[str, Any], mesh: dict[str, Any]) -> None:
    assert len(tree["line"]) == len(tree["node"]) - 1
    assert len(mesh["line"]) >= len(mesh["node"]) >= 3
    for network in (tree, mesh):
        dgu = {"filter": LC, "controller": PHS}
        grid = decode_all(network_spec({n: {"dgu": dgu} for n in network["node"]}, network["line"]).to_bytes())
        assert len(components([node.name for node in grid.nodes], grid.lines)) == 1
        assert len({frozenset((line.start, line.end)) for line in grid.lines}) == len(grid.lines)


# --- how it reads -------------------------------------------------------------------------------------------------

SMALLEST = """format = "certify/microgrid@1"
frequency = "50 Hz"
base_voltage = "20 kV"
voltage_band = ["0.8 pu", "1.2 pu"]

[filter.lc]
R = "0.1 ohm"
L = "1 mH"
C = "10 uF"

[controller.law]
kind = "ida-pbc"
alpha = -1
nu = 1
ki = 100

[node.1]
dgu = { filter = "lc", controller = "law", reference = ["1 pu", "0 pu"] }"""
FEEDBACK = "K11='1 - b - L*x', K12=[['R - h', '-w0*L'], ['w0*L', 'R - h']], K13='h*x'"
MINIMA: list[tuple[str, Callable[[], Any], str]] = [
    ("filters", filters, "Filter(R='0.1 ohm', L='1 mH', C='10 uF')"),
    ("with tolerance", lambda: filters(R=0, tolerance="5 %"), "Filter(R=0, L='1 mH', C='10 uF', tolerance='5 %')"),
    ("passive", passive_controllers, "Controller(kind='ida-pbc', alpha=-1, nu=1, ki=100)"),
    (
        "not passive",
        lambda: controllers(passive=False),
        f"Controller(kind='state-feedback', let={{'x': 100, 'b': 1, 'h': -1}}, {FEEDBACK})",
    ),
    (
        "boundary",
        lambda: controllers("boundary", integral=False),
        "Controller(kind='state-feedback', let={'b': 1, 'h': 0}, K11='1 - b', "
        "K12=[['R - h', '-w0*L'], ['w0*L', 'R - h']])",
    ),
    ("monotone", lambda: loads(True), "Load(kind='zip', Y=['10 uS', '0 S'])"),
    ("not monotone", lambda: loads(False), "Load(kind='zip', P=['10 kW', '0 var'])"),
    ("exponential", lambda: loads(True, ["exp"]), "Load(kind='exp', P0='10 kW', np='1.2')"),
    ("lines", lines, "Line(R='1 ohm', L='1 mH', C='10 nF')"),
    ("networks", networks, "Network(node={'1': {}}, line=[])"),
    ("references", references, "['1 pu', '0 pu']"),
    ("specs", specs, f"\n{SMALLEST}\n"),
]


@pytest.mark.parametrize(("strategy", "expected"), [case[1:] for case in MINIMA], ids=[case[0] for case in MINIMA])
def test_the_simplest_of_all(strategy: Callable[[], st.SearchStrategy[Any]], expected: str) -> None:
    assert repr(find(strategy(), lambda _: True, settings=SHRUNK)) == expected


def test_a_fault_in_a_large_network_shrinks_to_that_fault() -> None:
    def is_large(spec: Document) -> bool:
        return "load" in spec["node"]["1"] and len(spec.get("line", ())) > 1

    spec = find(specs("refuted"), is_large, settings=SHRUNK)
    assert spec["node"]["1"]["load"][0]["P"] == ["10 kW", "0 var"]
    assert [set(node) for node in spec["node"].values()] == [{"dgu", "load"}, set(), set()]
    assert {line["length"] for line in spec["line"]} == {"1 km"}


@FEW
@given(quantities("H", "0.15 mH", "22 mH", digits=2))
def test_quantities_are_short_and_in_range(text: str) -> None:
    assert re.fullmatch(r"[\d.]{1,4} [mu]?H", text)
    assert Fraction(15, 100_000) <= parse_quantity(text, "H", {}) <= Fraction(22, 1000)


@pytest.mark.parametrize("ends", [("1 ohm", "2 ohm"), (0.1, 47), (Fraction(1, 3), 1), ("5 ohm", "5 ohm")])
def test_every_end_of_a_range_is_taken(ends: tuple[Any, Any]) -> None:
    low, high = (parse_quantity(e, "ohm", {}) if isinstance(e, str) else Fraction(str(e)) for e in ends)
    value = find(quantities("ohm", *ends), lambda _: True, settings=SHRUNK)
    assert low <= parse_quantity(value, "ohm", {}) <= high


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: quantities("ohm", 0, 1), "begin above 0"),
        (lambda: quantities("ohm", "2 ohm", "1 ohm"), "not end before"),
        (lambda: quantities("ohm", "1.23 ohm", "1.24 ohm"), "allow more digits"),
        (lambda: quantities("ohm", "1 mH", "2 ohm"), "does not fit"),
        (lambda: decimals(1, "many"), "cannot read"),
        (lambda: filters(L=("10 mH", "1 mH")), "not end before"),
        (lambda: lines(R=("1 ohm",)), "two ends, not 1"),
        (lambda: loads(kinds=["motor"]), "there are zip, exp, rl"),
        (lambda: loads(False, ["rl"]), "name zip or exp"),
        (lambda: loads(band=("1.2 pu", "0.8 pu")), "a band from"),
        (lambda: loads(power=("1 kW", "1 MVA")), "does not fit"),
        (lambda: networks(2, meshed=True), "networks of 3 to 2 nodes"),
        (lambda: controllers("maybe"), '"boundary"'),
        (lambda: specs("unknown"), '"certified" or "refuted"'),
        (lambda: specs(max_nodes=11), "holds up to 10"),
        (lambda: specs(max_nodes=2, meshed=True), "networks of 3 to 2 nodes"),
    ],
)
def test_what_cannot_be_is_said_at_once(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        make()


# --- parts and specs in Python ------------------------------------------------------------------------------------


def test_gains_may_be_formulas_fractions_or_arrays() -> None:
    L, R = LC.L, LC.R
    exact = {"K11": 1 - 1 - L * 1000, "K12": [[R - 5, -w0() * L], [w0() * L, R - 5]], "K13": 5000}
    text = {"K11": "1 - 1 - L*1000", "K12": [["R - 5", "-w0*L"], ["w0*L", "R - 5"]], "K13": "5000"}
    assert dgu_spec(LC, exact)["controller"]["law"]["kind"] == "state-feedback"
    assert gains(Controller(exact, kind="state-feedback"), LC) == gains(Controller(text, kind="state-feedback"), LC)
    floats = {key: np.array(value, dtype=float) for key, value in exact.items()}
    near = decode_all(dgu_spec(LC, floats).to_bytes()).nodes[0].dgu
    assert near is not None
    assert scale(Fraction(5000), identity(2)) == near.controller.K13  # type: ignore[union-attr]
    assert near.controller.K11[0][0] == Fraction("-1.8")  # type: ignore[union-attr]


def test_floats_are_their_shortest_decimals() -> None:
    assert Fraction(18, 10_000) == Filter(R=0.1, L=np.float64(1.8e-3), C=Fraction(1, 40_000)).L
    assert Fraction(1, 10**6) == Filter(R=0.1, L=1, C=1e-6).C
    assert w0(50) == w0("50 Hz") == angular_frequency(Fraction(50))


@pytest.mark.parametrize("value", [float("nan"), np.inf, object(), {1, 2}])
def test_values_that_no_spec_can_hold(value: Any) -> None:
    with pytest.raises(SpecError) as caught:
        dgu_spec({"R": value, "L": 1, "C": 1}, PHS)
    assert caught.value.faults[0].path == "node.a.dgu.filter.R"


def test_equal_parts_are_written_once_and_lines_get_names() -> None:
    dgu = {"filter": LC, "controller": PHS}
    other = {"filter": dict(LC), "controller": PHS.replaced(ki=200), "reference": ["0.99 pu", "0 pu"]}
    ends = [{"from": "a", "to": "b"}, {"from": "a", "to": "b"}, {"name": "c", "from": "b", "to": "c"}]
    spec = network_spec(
        {"a": {"dgu": dgu}, "b": {"dgu": other}, "c": {"load": Load(kind="rl", R="50 ohm", L="0.1 H")}},
        [{**end, "R": "1 ohm", "L": "1 mH", "C": "1 uF"} for end in ends],
        filter={"lc-2": {"R": 1, "L": 1, "C": 1}},
    )
    assert list(spec["filter"]) == ["lc-2", "lc"]
    assert list(spec["controller"]) == ["law", "law-2"]
    assert [line["name"] for line in spec["line"]] == ["a-b", "a-b-2", "c"]
    assert_certified(spec)


@settings(max_examples=8 * TIMES, deadline=None)
@given(specs())
def test_the_toml_of_a_document_says_what_it_says(spec: Document) -> None:
    assert json.loads(json.dumps(tomllib.loads(spec.to_toml()))) == tomllib.loads(spec.to_toml())
    assert decode_all(spec.to_bytes()) == decode_all(json.dumps(spec.to_document()).encode())
    assert read_document(spec.to_bytes()) == read_document(str(spec).encode())


def test_parts_print_as_python_that_makes_them() -> None:
    law = find(boundary_controllers(integral=True), lambda _: True, settings=SHRUNK)
    again = eval(repr(law), {"Controller": Controller})
    assert again == law
    assert type(again) is Controller


@pytest.mark.parametrize(
    ("law", "gain", "at", "expected"),
    [
        (PHS, "ki", None, "100 + 1e-3"),
        (PHS, "alpha", (1, 1), [-5, "-5 + 1e-3"]),
        (PHS, "nu", (0, 0), ["1 + 1e-3", 1]),
        (Controller(kind="ida-pbc", alpha=[-1, -2], nu=1, ki=1), "alpha", None, ["-1 + 1e-3", "-2 + 1e-3"]),
        (Controller(K11=[["a", 0], [0, "b"]]), "K11", (1, 0), [["a", 0], ["1e-3", "b"]]),
        (Controller(K11=[["a", 0], [0, "b"]]), "K11", None, [["a + 1e-3", 0], [0, "b + 1e-3"]]),
    ],
)
def test_perturbed(law: Controller, gain: str, at: Any, expected: Any) -> None:
    assert law.perturbed(gain, "1e-3", at)[gain] == expected


def test_a_filter_without_such_a_value() -> None:
    with pytest.raises(SpecError, match=r"S203 at filter\.L"):
        _ = Filter(R=1, L="1 mV", C=1).L


def test_what_a_law_has_not() -> None:
    with pytest.raises(ValueError, match="are diagonal"):
        PHS.perturbed("alpha", 1, at=(0, 1))
    with pytest.raises(KeyError, match="no 'h'"):
        PHS.with_let(h=1)
