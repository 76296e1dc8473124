"""Specs built in Python say what they were given, in every text they can be written as."""

from __future__ import annotations

import math
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import certify
from certify import Spec, SpecError
from certify.building.toml import to_toml
from certify.editing import same
from certify.inputs import to_bytes
from certify.kernel.reader import read_document
from certify.kernel.spec import IdaPbc, StateFeedback, ZipLoad, decode
from certify.testing import Load
from certify.values import to_plain

TWO = "specs/two-inverters.toml"


class Shown(float):
    """A number that is shown as another one."""

    def __str__(self) -> str:
        return "7"


class Word(str, Enum):  # noqa: UP042  # a StrEnum is shown as what it holds
    """A text that is shown as its name."""

    R = "0.1 ohm"


def start(**more: Any) -> Spec:
    values = {"frequency": 50, "base_voltage": "400 V", "voltage_band": ("0.8 pu", "1.2 pu")}
    return Spec(**{**values, **more})


def small() -> Spec:
    return (
        start(name="small")
        .filter("lc", R=0.1, L="1.8 mH", C=Decimal("25e-6"))
        .controller("phs", alpha=(-5, -4), nu=1, ki=100)
        .node("a", filter="lc", controller="phs", reference=400)
        .load("a", R="30 ohm", L=0.1)
    )


# --- numbers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given_as", "exact"),
    [
        (0.1, Fraction(1, 10)),
        (1.8e-3, Fraction(18, 10000)),
        (1e-05, Fraction(1, 100_000)),
        (3, Fraction(3)),
        (Decimal("0.10"), Fraction(1, 10)),
        (Decimal("1E+1"), Fraction(10)),
        (Fraction(1, 8), Fraction(1, 8)),
        (numpy.float64(0.1), Fraction(1, 10)),
        (numpy.float32(0.1), Fraction(1, 10)),  # the shortest that names it among its own kind
        (numpy.int64(7), Fraction(7)),
        (numpy.array(0.25), Fraction(1, 4)),
        ("100 mohm", Fraction(1, 10)),
        (mpmath.mpf("0.125"), Fraction(1, 8)),
        (Shown(0.1), Fraction(1, 10)),
        (Word.R, Fraction(1, 10)),
    ],
)
def test_a_number_is_taken_for_what_was_typed(given_as: Any, exact: Fraction) -> None:
    grid = small().filter("x", R=given_as, L=1, C=1).node("b", filter="x", controller="phs", reference=400)
    found = decode(grid.to_bytes()).nodes[1].dgu
    assert found is not None
    assert found.filter is not None
    assert found.filter.resistance_ohm == exact


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        (math.nan, "S201"),
        (-math.inf, "S201"),
        (numpy.float64("nan"), "S201"),
        (Decimal("sNaN"), "S201"),
        (object(), "U030"),
        (b"1", "U030"),
        (Fraction(1, 3), "U030"),
        ("1 H", "S203"),
        ("\ud800", "U030"),
        (True, "S201"),
        ([1, 2], "S201"),
        (1 + 1j, "S201"),
        (10**200, "S202"),
        pytest.param(10**5000, "S202", id="too long to be shown"),
        (Decimal("NaN123"), "S201"),  # has digits, and is no number
        (numpy.timedelta64(3, "s"), "U030"),
        (numpy.datetime64("2020"), "U030"),
        (numpy.ma.masked, "U030"),
        (mpmath.mpf(1) / 3, "U030"),  # shown to 15 digits, of the 16 that it has
        (numpy.bool_(True), "S201"),
    ],
)
def test_what_is_no_resistance_is_refused_at_once(bad: Any, code: str) -> None:
    with pytest.raises(SpecError) as refused:
        small().filter("x", R=bad, L=1, C=1)
    assert [(f.code, f.path[:10]) for f in refused.value.faults] == [(code, "filter.x.R")]


def test_every_fault_of_a_part_is_told_at_once() -> None:
    with pytest.raises(SpecError) as refused:
        small().filter("x", R="1 H", L=-1, C="0 F")
    assert [f.path for f in refused.value.faults] == ["filter.x.R", "filter.x.L", "filter.x.C"]


def test_arrays_fractions_and_phasors() -> None:
    grid = (
        small()
        .controller("k", K11=numpy.eye(2) / 4, K12=[[Fraction(1, 3), 0], [0, -2]], K13=numpy.float32(100))
        .node(7, filter="lc", controller="k", reference=numpy.complex128(390 - 8j))
        .load(7, P=numpy.complex64(300 + 20j), Y=numpy.array([0.02, 0]))
    )
    node = decode(grid.to_bytes()).nodes[1]
    assert node.name == "7"
    assert node.dgu is not None
    law = node.dgu.controller
    assert isinstance(law, StateFeedback)
    assert ((Fraction(1, 4), 0), (0, Fraction(1, 4))) == law.K11
    assert law.K12[0][0] == Fraction(1, 3)
    assert node.dgu.reference_volt == (390, -8)
    load = node.loads[0]
    assert isinstance(load, ZipLoad)
    assert ((300, 20), (Fraction(1, 50), 0)) == (load.P, load.Y)


@pytest.mark.parametrize("Y", [0.02 + 0.01j, numpy.complex64(0.02 + 0.01j), numpy.array(0.02 + 0.01j), mpmath.mpc(1)])
def test_a_complex_admittance_has_two_meanings_and_is_refused(Y: Any) -> None:
    """Wherever it is given: taken for [active, reactive] it would have the other sign."""
    with pytest.raises(SpecError, match=r"U030 at node\.a\.load\[1\]\.Y"):
        small().load("a", Y=Y)
    with pytest.raises(SpecError, match=r"U030 at node\.b\.load\[0\]\.Y"):
        small().node("b", load=[{"kind": "zip", "Y": Y}])
    with pytest.raises(SpecError, match=r"U030 at node\.a\.load\[0\]\.I"):
        small().replace({"node.a.load[0].I": Y})
    with pytest.raises(SpecError, match="U030 at Y"):
        Load(kind="zip", Y=Y)


@pytest.mark.parametrize("kind", [numpy.float16, numpy.float32, numpy.float64, numpy.longdouble])
def test_how_numpy_shows_numbers_changes_none(kind: Any) -> None:
    x = kind(1) / kind(3)
    plain = to_plain(x)
    assert kind(str(plain)) == x
    numpy.set_printoptions(legacy="1.13")
    try:
        shown = to_plain(x)
    finally:
        numpy.set_printoptions(legacy=False)
    assert Fraction(str(shown)) == Fraction(str(plain))


def test_half_a_letter_that_json_can_say_is_an_error_of_the_spec() -> None:
    """As an escape in a file that is read; no file can hold the letter itself."""
    grid = Spec.read(b'{"format": "certify/microgrid@1", "name": "a\\ud800", "node": {}}')
    for action in (grid.to_toml, lambda: grid.node("b")):
        with pytest.raises(SpecError, match="half a letter"):
            action()


def test_a_kind_that_is_no_word_is_refused() -> None:
    for add in (lambda: small().load("a", kind=numpy.eye(2)), lambda: small().controller("x", kind=numpy.eye(2))):
        with pytest.raises(SpecError, match=r"\.kind"):
            add()


# --- kinds, names, places -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gains", "kind"),
    [
        ({"alpha": -5, "nu": 1, "ki": 100}, "ida-pbc"),
        ({"K11": 0, "K12": -1}, "state-feedback"),
        ({"F": [[-1, 0], [0, -1]], "B": numpy.eye(2), "C": numpy.eye(2)}, "linear"),
        ({}, "constant"),
    ],
)
def test_the_kind_of_a_controller_follows_from_its_gains(gains: dict[str, Any], kind: str) -> None:
    assert small().controller("x", **gains)["controller.x.kind"] == kind


@pytest.mark.parametrize(
    ("fields", "kind"),
    [
        ({"Y": (1, 0)}, "zip"),
        ({"I": (1, 0), "P": 3 + 1j}, "zip"),
        ({"P0": 3, "np": 2}, "exp"),
        ({"R": 1, "L": 1}, "rl"),
        ({"I": ("Vd/1000", "Vq/1000"), "centre": 400 + 0j, "radius": 40}, "current"),
    ],
)
def test_the_kind_of_a_load_follows_from_its_fields(fields: dict[str, Any], kind: str) -> None:
    assert small().load("a", **fields)["node.a.load[1].kind"] == kind


@pytest.mark.parametrize(
    ("step", "code", "path"),
    [
        (lambda g: g.filter("lc", R=1, L=1, C=1), "U036", "filter.lc"),
        (lambda g: g.node("a"), "U036", "node.a"),
        (lambda g: g.line("l", "a", "b", R=1, L=1, C=1).line("l", "b", "a", R=1, L=1, C=1), "U036", "line.l"),
        (lambda g: g.node("a/b"), "S105", "node.'a/b'"),
        (lambda g: g.load("z", R=1, L=1), "U035", "'node.z'"),
        (lambda g: g.load("a", flow=1), "S107", "node.a.load[1].kind"),
        (lambda g: g.load("a", P=(1, 2), flow=1), "S101", "node.a.load[1].flow"),
        (lambda g: g.controller("x", gain=1), "S107", "controller.x.kind"),
        (lambda g: g.controller("x", K11="kp", K12=0), "S206", "controller.x.K11"),
        (lambda g: g.replace({"filter.lc.x.y": 1}), "U035", "'filter.lc.x.y'"),
        (lambda g: g.without("node.a.load[1]"), "U035", "'node.a.load[1]'"),
        (lambda g: g["line.a-b"], "U035", "'line.a-b'"),
        (lambda g: g.line_type("t", R="1 ohm", L=1, C=0), "S203", "line_type.t.R"),
        (lambda g: certify.load(g.node("b", controller="no", reference=1)), "S306", "node.b.dgu.controller"),
        (lambda g: certify.load(g.line("l", "a", "z", R=1, L=1, C=1)), "S301", "line.l.to"),
        (lambda g: certify.load(g.scenario("s", end="1 m")), "S203", "scenario.s.end"),
        (lambda _: Spec(frequency="50 V"), "S203", "frequency"),
        (lambda _: start(voltage_band=(2, 1)), "S307", "voltage_band"),
        (lambda _: start(tolerance={"filtre": "5 %"}), "S101", "tolerance.filtre"),
    ],
)
def test_faults_have_a_code_and_a_place(step: Any, code: str, path: str) -> None:
    with pytest.raises(SpecError) as refused:
        step(small())
    assert (refused.value.faults[0].code, refused.value.faults[0].path) == (code, path)


def test_a_spec_never_changes() -> None:
    first = small()
    text = first.to_bytes()
    first.node("b").load("b", R=1, L=1).line("l", "a", "b", R=1, L=1, C=1).replace({"node.a.load[0].R": 5})
    first["node.a"]["load"].clear()
    first.to_document()["node"].clear()
    assert first.to_bytes() == text == small().to_bytes()
    assert first == small()
    assert hash(first) == hash(small())
    with pytest.raises(AttributeError):
        first.name = "x"  # type: ignore[attr-defined]


# --- texts ----------------------------------------------------------------------------------------------------------

NAMES = st.sampled_from(["a", "7", "bus 1", "n.2", "Knoten:ä", "x-y+z", "1.load"])
NUMBERS = st.one_of(
    st.integers(1, 10**6),
    st.floats(1e-9, 1e9),
    st.floats(2**-20, 2**20, width=32).map(numpy.float32),
    st.decimals("0.001", "1000", places=5),
    st.integers(1, 999).map(lambda n: Fraction(n, 2**7 * 5**3)),
)
ANY = st.one_of(NUMBERS, NUMBERS.map(lambda x: -x), st.just(0), st.just(-0.0))
GAINS = st.one_of(ANY, st.sampled_from(["1 - L", "R/(L + 1)", Fraction(-1, 3)]))
SQUARE = st.one_of(GAINS, st.lists(st.lists(GAINS, min_size=2, max_size=2), min_size=2, max_size=2))
PAIR = st.one_of(
    st.tuples(ANY, ANY), st.builds(lambda d, q: complex(d / 100, q / 8), *[st.integers(-(10**7), 10**7)] * 2)
)
LOADS = st.one_of(
    st.fixed_dictionaries({"P": PAIR, "Y": st.tuples(ANY, ANY)}),
    st.fixed_dictionaries(
        {"P0": ANY, "np": st.integers(-30, 30).map(lambda n: n / 10), "Q0": ANY, "nq": st.integers(-2, 3)}
    ),
    st.fixed_dictionaries({"R": NUMBERS, "L": NUMBERS, "tolerance": st.just("5 %")}),
)


@st.composite
def specs(draw: st.DrawFn) -> Spec:
    grid = start(name=draw(st.none() | st.text(st.characters(categories=["L", "P", "S"]), max_size=9)))
    grid = grid.filter("lc", R=draw(NUMBERS), L=draw(NUMBERS), C=draw(NUMBERS))
    grid = grid.controller("k", K11=draw(SQUARE), K12=draw(SQUARE), K13=draw(SQUARE), let={"x": draw(GAINS)})
    grid = grid.controller("p", alpha=draw(PAIR), nu=2, ki=draw(GAINS), design={"L": draw(NUMBERS)})
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    for k, name in enumerate(names):
        reference = draw(PAIR.filter(lambda v: v != 0 and v != (0, 0)))
        grid = grid.node(name, filter="lc", controller=draw(st.sampled_from("kp")), reference=reference)
        for load in draw(st.lists(LOADS, max_size=2)):
            grid = grid.load(name, **load)
        if k:
            grid = grid.line(f"l {k}", names[0], name, R=draw(NUMBERS), L=draw(NUMBERS), C=draw(NUMBERS))
    return grid


def outcome(text: bytes) -> Any:
    try:
        return decode(text)
    except SpecError as error:
        return error.faults


@settings(max_examples=60, deadline=None)
@given(specs())
def test_toml_json_and_the_document_say_the_same(grid: Spec) -> None:
    decoded = outcome(grid.to_bytes())
    assert outcome(grid.to_toml().encode()) == outcome(grid.to_json().encode()) == decoded
    assert outcome(to_bytes(grid.to_document())) == decoded
    again = Spec.read(grid)
    assert (again.to_bytes(), again) == (grid.to_bytes(), Spec.read(grid.to_bytes()))
    if not isinstance(decoded, tuple):
        law = decoded.nodes[0].dgu.controller
        assert isinstance(law, StateFeedback | IdaPbc)


JSON = st.recursive(
    st.one_of(st.text(st.characters(codec="utf-8"), max_size=5), st.integers(), st.booleans(), st.floats(-1e9, 1e9)),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(st.characters(codec="utf-8")), inner, max_size=4)
    ),
    max_leaves=12,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(["name", "filter", "node", "line", "scenario", "x.y"]), JSON))
def test_any_document_is_written_as_toml_that_says_it(document: dict[str, Any]) -> None:
    plain = to_plain({"format": "x", **document})
    assert same(read_document(to_toml(plain).encode()), plain)  # control characters, empty keys and tables as well


def test_long_matrices_and_tables_are_written_row_by_row() -> None:
    F = numpy.diag(-numpy.arange(1.0, 21.0)) + 1e-3
    eye = numpy.eye(20)[:, :2]
    grid = (
        small()
        .controller("big", F=F, B=eye, C=eye.T)
        .controller("let", let={f"name{k}": f"{k}/7" for k in range(40)}, K11="name3", K12=0)
    )
    text = grid.to_toml()
    assert max(map(len, text.splitlines())) < 200
    assert "[controller.let.let]" in text
    assert decode(text.encode()) == decode(grid.to_json().encode())


def test_nulls_of_a_file_are_told_and_not_written() -> None:
    grid = Spec.read(b'{"name": null}')
    with pytest.raises(SpecError, match="S103"):
        grid.to_toml()


def test_many_nodes_take_time_in_proportion() -> None:
    grid = small()
    for k in range(300):
        grid = grid.node(k, capacitance="1 uF").load(k, R=30, L=0.1).line(k, "a", k, R=1, L=1e-3, C=0)
    assert len(decode(grid.to_bytes()).nodes) == 301


# --- files ----------------------------------------------------------------------------------------------------------


def test_an_edited_file_keeps_its_comments_and_is_what_it_should_be() -> None:
    before = Path(TWO).read_text()
    grid = (
        Spec.read(TWO)
        .replace({"filter.lc.L": 2e-3, "node.b.load[0].np": Fraction(3, 2), "line.a-b.tolerance": {"R": "5 %"}})
        .node("c", capacitance=1e-6)
        .load("c", R=40, L=0.1)
        .load("a", P0=100, np=2)
        .line("b-c", "b", "c", R=0.2, L=4e-4, C=0)
        .without("node.b.load[1]")
    )
    text = grid.to_toml()
    assert set(before.splitlines()) - set(text.splitlines()) == {
        'L = "1.8 mH"',
        '  { kind = "exp", P0 = "1.2 kW", np = 1.6, Q0 = "0.4 kvar", nq = 2.4 },',
        '  { kind = "zip", P = ["-200 W", "0 var"] }, # a roof feeding constant power in; the sum is still monotone',
        'load = [{ kind = "zip", Y = ["20 mS", "5 mS"], I = ["2 A", "0 A"] }]',
    }
    assert decode(text.encode()) == decode(to_bytes(grid.to_document()))
    found = certify.load(grid)
    assert [node.name for node in found.nodes] == ["a", "b", "c"]
    assert found.lines[0].branch.tolerance == (Fraction(1, 20), 0)
    assert certify.prove(grid).outcome == "certified"


def test_a_json_file_stays_json() -> None:
    grid = Spec.read("specs/custom-loop.json").replace({"frequency": 60})
    assert grid.to_bytes().startswith(b"{")
    assert Spec.read(grid.to_toml().encode())["frequency"] == 60
    assert decode(grid.to_bytes()) == decode(grid.to_toml().encode())


def test_saved_files_are_what_is_proved(tmp_path: Path) -> None:
    grid = small()
    grid.save(tmp_path / "x.toml")
    grid.save(tmp_path / "x.json")
    assert (tmp_path / "x.toml").read_bytes() == grid.to_bytes()
    assert decode((tmp_path / "x.json").read_bytes()) == decode(grid.to_bytes())
    certify.prove(grid).save(tmp_path / "x.cert")
    assert certify.check(tmp_path / "x.toml", tmp_path / "x.cert").outcome == "certified"
    with pytest.raises(certify.Rejected):
        certify.check(tmp_path / "x.json", tmp_path / "x.cert")
    with pytest.raises(SpecError, match="U032"):
        grid.save(tmp_path / "none" / "x.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.cert", "x.json", "x.toml"]


@pytest.mark.parametrize(
    ("text", "step", "code"),
    [
        (b"node = 5\n", lambda g: g.node("a"), "S103"),
        (b'{"node": [1]}', lambda g: g.node("a"), "S103"),
        (b"node = 5\n", lambda g: g.load("a", R=1, L=1), "U035"),
        (b"line = 5\n", lambda g: g.line("l", "a", "b", R=1, L=1, C=1), "S103"),
        (b"[node.a]\nload = 5\n", lambda g: g.load("a", R=1, L=1), "S103"),
        (b"[node.a]\n", lambda g: g.replace({"node.a.capacitance": None}), "U030"),
        (b"[node.a]\n", lambda g: g.replace({"": 1}), "U035"),
    ],
)
def test_files_that_are_no_specs_can_be_read_but_not_built_on(text: bytes, step: Any, code: str) -> None:
    with pytest.raises(SpecError) as refused:
        step(Spec.read(text))
    assert refused.value.faults[0].code == code
    assert repr(Spec.read(text)).startswith("<Spec")


@pytest.mark.parametrize(
    "text",
    [
        b"[node]\na = { load = [] }\n",
        b"node = { a = { capacitance = 1 } }\n",
        b"[node.a]\n[[node.a.load]]\nkind = 'rl'\nR = 1\nL = 1\n",
        b'{"node": {"a": {"load": []}}}',
    ],
)
def test_every_layout_can_be_edited(text: bytes) -> None:
    grown = Spec.read(text).load("a", R=Decimal("0.5"), L="1 mH").node("b", capacitance=1e-6)
    found = read_document(grown.to_bytes())["node"]
    assert same(found["a"]["load"][-1], to_plain({"kind": "rl", "R": 0.5, "L": "1 mH"}))
    assert same(found["b"], to_plain({"capacitance": 1e-6}))


def test_a_layout_that_the_editor_spoils_is_refused_and_not_spoilt() -> None:
    grid = Spec.read(b'node.a.dgu.filter = "x"\n')  # tomlkit would put [node.b] where it is read as another thing
    with pytest.raises(SpecError, match=r"U001.*give filters, controllers and nodes as tables"):
        grid.load("a", R=1, L=1).node("b", capacitance=1e-6)


def test_a_line_that_is_not_there_is_told_from_those_that_are() -> None:
    with pytest.raises(SpecError, match=r"there are a-b"):
        Spec.read(TWO).without("line.b-a")
