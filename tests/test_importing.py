"""The part of imports that no format has to itself: islands, transformers, capacitances, names, the text."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.certificate import prove
from certify.diagnostics import DIAGNOSTICS
from certify.importing import Branch, Bus, ExpRow, Network, Settings, Source, ZipRow, to_spec
from certify.importing.inverters import PLACEHOLDERS
from certify.importing.names import unique
from certify.importing.numbers import decimal, from_float, inductance, quantity, root
from certify.importing.referring import describe
from certify.kernel.errors import SpecError
from certify.kernel.quantity import parse_quantity
from certify.kernel.reader import NAME
from certify.kernel.spec import ZipLoad, angular_frequency
from tests.conftest import ROOT

F = Fraction
LINE: dict[str, Any] = {"resistance_ohm": F("0.1"), "inductance_henry": F("0.0003")}


def line(name: str, start: str, end: str, capacitance: str = "1e-7", **more: Any) -> Branch:
    return Branch(name, start, end, **{**LINE, "capacitance_farad": F(capacitance), "length_metre": F(500), **more})


def trafo(name: str, start: str, end: str, ratio: F | int, **more: Any) -> Branch:
    values = {"resistance_ohm": F("0.01"), "inductance_henry": F("0.0001"), "ratio": F(ratio), "shift_degree": F(150)}
    return Branch(name, start, end, **{**values, "origins": (name,), **more})


def load(bus: str, volt: int = 400) -> ZipRow:
    return ZipRow(bus, F(volt), (F(1000), F(200)), (F(300), F(100)), (F(10), F(5)), origins=(f"load at {bus}",))


def network(buses: dict[str, int], branches: tuple[Branch, ...], **more: Any) -> Network:
    made = tuple(Bus(name, F(volt), (f"bus {name}",)) for name, volt in buses.items())
    parts = {"loads": (load("b"),), "sources": (Source("a", F(20000)),), **more}
    return Network("a network", "a test", F(50), made, branches, **parts)


PLAIN = network({"a": 400, "b": 400}, (line("ab", "a", "b"),))


def faults(given: Network, settings: Settings = Settings()) -> set[tuple[str, str]]:  # noqa: B008
    with pytest.raises(SpecError) as caught:
        to_spec(given, settings)
    assert all(fault.code in DIAGNOSTICS for fault in caught.value.faults)
    return {(fault.code, fault.path) for fault in caught.value.faults}


def test_a_plain_network_becomes_a_spec_that_is_certified() -> None:
    draft = to_spec(PLAIN, Settings())
    assert prove(draft.spec).verdict.outcome == "certified"
    assert draft.counts == {"nodes": 2, "DGUs": 1, "lines": 1, "load rows": 1}
    assert (draft.constant_power, draft.unmapped, draft.notes) == (1, (), ())
    assert draft.spec == to_spec(PLAIN, Settings()).spec


@pytest.mark.parametrize("kind", PLACEHOLDERS)
@pytest.mark.parametrize(("volt", "rating"), [(400, 1000), (400, 250_000), (20_000, 10**6), (110_000, 10**8)])
def test_placeholders_are_passive_and_settle(kind: str, volt: int, rating: int) -> None:
    given = network(
        {"a": volt, "b": volt},
        (line("ab", "a", "b"),),
        loads=(),
        sources=(Source("a", F(rating)), Source("b", F(rating))),
    )
    draft = to_spec(given, Settings(controller=kind))
    assert prove(draft.spec).verdict.outcome == "certified"
    np = pytest.importorskip("numpy")
    from certify.kernel.model import dgu_port, node_capacitances

    for node in draft.microgrid.nodes:
        assert node.dgu
        port = dgu_port(node.dgu, node_capacitances(draft.microgrid)[node.name], draft.microgrid.w0)
        assert np.linalg.eigvals(np.array(port.F, dtype=float)).real.max() < -50


def test_powers_of_a_row_are_those_of_the_row() -> None:
    node = to_spec(PLAIN, Settings()).microgrid.nodes[1]
    (row,) = node.loads
    assert isinstance(row, ZipLoad)
    for share in (F(9, 10), F(1), F(11, 10)):
        v = share * 400
        power = [row.Y[k] * v**2 + row.I[k] * v + row.P[k] for k in (0, 1)]
        assert power == [1000 * share**2 + 300 * share + 10, 200 * share**2 + 100 * share + 5]


def test_a_transformer_is_referred_exactly() -> None:
    """Powers stay, impedances change with the square; the band of the load is that of its own voltage."""
    given = network(
        {"a": 20000, "m": 20000, "b": 400},
        (line("am", "a", "m"), trafo("t", "m", "b", F(20500, 400))),
    )
    stated = Settings(bus_capacitance=F("1e-9"))
    draft = to_spec(given, stated)
    grid = {node.name: node for node in draft.microgrid.nodes}
    n = F(20500, 400)
    (row,) = grid["b"].loads
    assert isinstance(row, ZipLoad)
    assert row.P == (10, 5)
    assert abs(row.I[0] * 400 * n / 300 - 1) < F(1, 10**33)
    assert abs(row.Y[1] * (400 * n) ** 2 / 200 - 1) < F(1, 10**33)
    assert grid["b"].band_volt == (18450, 22550)
    wire = next(x for x in draft.microgrid.lines if x.name == "t")
    assert (wire.branch.resistance_ohm, wire.branch.inductance_henry) == (F("0.01") * n**2, F("0.0001") * n**2)
    assert abs(grid["b"].capacitance_farad * n**2 / F("1e-9") - 1) < F(1, 10**33)
    (told,) = describe(draft.levels)
    assert "V' = n V, n = 51.25, turned by 150 degrees" in told


def test_loops_of_transformers_must_agree() -> None:
    buses = {"a": 20000, "b": 400}
    twice = (trafo("t", "a", "b", 50), trafo("u", "a", "b", 50, shift_degree=F(510)))
    stated = Settings(bus_capacitance=F("1e-9"))
    assert to_spec(network(buses, twice), stated).counts["lines"] == 2
    for change in ({"ratio": F(51)}, {"shift_degree": F(0)}):
        assert faults(network(buses, (twice[0], replace(twice[1], **change))), stated) == {("I023", "u")}


def test_what_no_dgu_feeds_is_left_out() -> None:
    given = network(
        {"a": 400, "b": 400, "c": 400, "d": 400},
        (
            line("ab", "a", "b"),
            line("cd", "c", "d", origins=("line cd",)),
            line("aa", "a", "a", "0", origins=("line aa",)),
        ),
        loads=(load("b"), load("d")),
    )
    draft = to_spec(given, Settings())
    assert {u.element for u in draft.unmapped} == {"bus c", "bus d", "line cd", "line aa", "load at d"}
    assert set(draft.mapped) == {"bus a", "bus b", "load at b"}
    assert "#   bus c, bus d, line cd, load at d: no DGU is connected to it" in draft.spec.decode()


def test_a_branch_that_ends_where_it_starts_keeps_its_capacitance() -> None:
    loop = line("aa", "b", "b", "3e-9", shunt_siemens=(F("1e-5"), F(0)), origins=("line aa",))
    node = to_spec(replace(PLAIN, branches=(*PLAIN.branches, loop)), Settings()).microgrid.nodes[1]
    assert node.capacitance_farad == F("3e-9")
    assert isinstance(node.loads[1], ZipLoad)
    assert (F("1e-5"), 0) == node.loads[1].Y
    twisted = trafo("t", "b", "b", 1)
    assert faults(replace(PLAIN, branches=(*PLAIN.branches, twisted))) == {("I023", "t")}


def test_dead_ends_are_left_out_and_junctions_joined() -> None:
    given = network(
        {"a": 400, "b": 400, "h": 20000, "c": 400, "x": 20000, "y": 400},
        (
            line("ab", "a", "b"),
            trafo("t", "h", "b", 50),
            trafo("u", "h", "c", 50),
            trafo("v", "x", "c", 50),
            trafo("w", "x", "c", 50, shunt_siemens=(F(1), F(2))),
            line("cy", "c", "y", "0", origins=("line cy",)),
        ),
        loads=(load("b"), load("c")),
        sources=(Source("a", F(1000)), Source("c", F(1000))),
    )
    draft = to_spec(given, Settings())
    assert {u.element for u in draft.unmapped} == {"bus x", "v", "w", "bus y", "line cy"}
    wires = {x.name: x for x in draft.microgrid.lines}
    assert set(wires) == {"ab", "t + u"}
    assert wires["t + u"].branch.resistance_ohm == F("0.02")
    assert {"t", "u", "bus h"} <= set(draft.mapped)
    assert prove(draft.spec).verdict.outcome == "certified"


def test_capacitances_are_stated_or_asked_for() -> None:
    bare = network({"a": 400, "b": 400}, (line("ab", "a", "b", "0", origins=("line 7",)),))
    with pytest.raises(SpecError) as caught:
        to_spec(bare, Settings())
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("I022", "bus b")
    assert "line 7" in fault.message
    assert "--line-capacitance" in fault.message
    draft = to_spec(bare, Settings(line_capacitance=F("1e-11")))
    assert draft.microgrid.lines[0].capacitance_farad == F("5e-9")
    assert [note.element for note in draft.notes] == ["line 7"]
    transformer = network({"a": 400, "b": 400}, (trafo("t", "a", "b", 1),))
    assert faults(transformer) == {("I022", "bus b")}
    assert to_spec(transformer, Settings(bus_capacitance=F("1e-9"))).microgrid.nodes[1].capacitance_farad == F("1e-9")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"branches": (line("ab", "a", "b", inductance_henry=F(0)),)}, {("I020", "ab")}),
        ({"branches": (line("ab", "a", "b", resistance_ohm=F(-1)),)}, {("I020", "ab")}),
        ({"branches": (line("ab", "a", "z"),)}, {("I004", "ab")}),
        ({"sources": ()}, {("I021", "")}),
        ({"sources": (Source("a"), Source("a"))}, {("I025", "a")}),
        ({"buses": (Bus("a", F(0)), Bus("b", F(400)))}, {("I003", "a")}),
    ],
)
def test_faults(change: dict[str, Any], expected: set[tuple[str, str]]) -> None:
    assert faults(replace(PLAIN, **change)) == expected


def test_references_and_angles() -> None:
    sources = (Source("a", F(1000), F("1.02"), F(30)), Source("b", F(1000), angle_degree=F(-60)))
    given = replace(PLAIN, sources=sources)
    a, b = (node.dgu for node in to_spec(given, Settings()).microgrid.nodes)
    assert a is not None
    assert b is not None
    assert a.reference_volt == (408, 0)
    assert b.reference_volt == (0, -400)
    a, b = (node.dgu for node in to_spec(given, Settings(references={"": F(1), "a": F("0.95")})).microgrid.nodes)
    assert a is not None
    assert b is not None
    assert (a.reference_volt, b.reference_volt) == ((380, 0), (0, -400))
    assert faults(given, Settings(references={"c": F(1)})) == {("I025", "--reference")}


def test_filters_and_controllers_of_another_spec() -> None:
    from certify.kernel.reader import read_document

    other = read_document((ROOT / "specs" / "cigre-mv.toml").read_bytes())
    taken = Settings(filters=other["filter"], controllers=other["controller"], taken_from="cigre-mv.toml")
    assert faults(PLAIN, taken) == {("I024", "--controller")}
    draft = to_spec(PLAIN, replace(taken, controller="pi"))
    assert prove(draft.spec).verdict.outcome == "certified"
    assert faults(PLAIN, replace(taken, controller="nothing")) == {("I024", "--controller")}
    assert faults(PLAIN, Settings(controller="nothing")) == {("I024", "--controller")}
    in_pu = replace(taken, filters={"lc": {"R": "0.1 pu"}}, controller="pi")
    assert faults(PLAIN, in_pu) == {("I024", "cigre-mv.toml: filter.lc")}
    far = network(
        {"a": 20000, "b": 400}, (trafo("t", "a", "b", 50),), sources=(Source("a"), Source("b", origins=("gen 1",)))
    )
    assert faults(far, replace(taken, controller="pi", bus_capacitance=F("1e-9"))) == {("I024", "gen 1")}


def test_another_frequency_keeps_inductances_and_says_so() -> None:
    draft = to_spec(PLAIN, Settings(frequency=F(60)))
    assert draft.microgrid.w0 == angular_frequency(F(60))
    assert draft.microgrid.lines[0].branch.inductance_henry == F("0.0003")
    assert [note.element for note in draft.notes] == [""]
    assert "another frequency" in draft.spec.decode()


def test_imports_know_nothing_of_reports_and_commands() -> None:
    for path in (ROOT / "certify" / "importing").rglob("*.py"):
        assert not re.search(r"certify\.(report|commands|cli|search|simulator)\b", path.read_text()), path


def test_exponential_rows_bands_and_cut_offs() -> None:
    rows = (
        ExpRow("b", F(400), F(1000), F("1.5"), F(-100), F(2), band_pu=(F("0.8"), F("1.2")), impedance_below=True),
        ExpRow("b", F(400), F(1000), F(2)),
    )
    draft = to_spec(replace(PLAIN, loads=rows), Settings())
    first, second = draft.microgrid.nodes[1].loads
    assert first.cutoff_volt == 320
    assert second.cutoff_volt is None
    assert draft.constant_power == 0


def test_a_second_island_keeps_its_own_side() -> None:
    given = network(
        {"a": 400, "b": 400, "c": 20000, "d": 20000},
        (line("ab", "a", "b"), line("cd", "c", "d")),
        loads=(load("b"), load("d", 20000)),
        sources=(Source("a", F(1000)), Source("c", F(1000))),
    )
    grid = to_spec(given, Settings()).microgrid
    assert [node.band_volt for node in grid.nodes] == [None, (360, 440), None, (18000, 22000)]


@given(st.lists(st.text(max_size=70), max_size=12))
@settings(max_examples=60, deadline=None)
def test_names_are_usable_and_unique(texts: list[str]) -> None:
    names = unique([(text, f"bus {k}") for k, text in enumerate(texts)])
    assert len({name.lower() for name in names}) == len(texts)
    assert all(NAME.fullmatch(name) and name.isascii() for name in names)


@given(st.text(max_size=40), st.text(max_size=300))
@settings(max_examples=60, deadline=None)
def test_foreign_text_stays_in_its_comment(name: str, origin: str) -> None:
    given = replace(
        PLAIN,
        name=name,
        origin=origin,
        buses=(Bus("a", F(400), (origin,)), Bus("b", F(400))),
        branches=(line("ab", "a", "b", kind=origin, origins=(name,)),),
    )
    assert [node.name for node in to_spec(given, Settings()).microgrid.nodes] == ["a", "b"]


@given(st.fractions(max_denominator=10**9), st.integers(-15, 15))
@settings(max_examples=80, deadline=None)
def test_written_quantities_are_read_as_they_were(value: F, power: int) -> None:
    value *= F(10) ** power
    back = parse_quantity(quantity(value, "V"), "V", {})
    assert back == value or abs(back / value - 1) < F(1, 10**33)
    assert abs(F(decimal(value)) - value) <= abs(value) / 10**33
    per_metre = parse_quantity(quantity(abs(value), "F/km"), "F/m", {})
    assert abs(per_metre - abs(value)) <= abs(value) / 10**33


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_become_their_shortest_decimals(value: float) -> None:
    assert float(from_float(value)) == value
    assert from_float(value) == F(repr(value))


def test_roots_and_reactances() -> None:
    for square in (F(2), F(1, 3), F(10) ** 40, F(1, 10**40), F(12345, 678)):
        assert abs(root(square) ** 2 / square - 1) < F(1, 10**32)
    w0 = angular_frequency(F(50))
    assert abs(inductance(F("0.080425"), w0) * w0 / F("0.080425") - 1) < F(1, 10**30)


def test_every_code_of_an_import_is_explained_and_used() -> None:
    text = "".join(path.read_text() for path in (ROOT / "certify" / "importing").rglob("*.py"))
    assert set(re.findall(r'"(I\d{3})"', text)) == {code for code in DIAGNOSTICS if re.fullmatch(r"I\d{3}", code)}
