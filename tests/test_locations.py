"""Where keys stand: against tomllib and json, which know what is there, on all kinds of text."""

from __future__ import annotations

import json
import time
import tomllib
from collections import Counter
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.inputs import decode_all
from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import shown
from certify.locations import Locations, locate
from certify.report.places import path_of, used_by
from tests.conftest import ROOT

SPECS = sorted(
    [*(ROOT / "specs").glob("*.toml"), *(ROOT / "specs").glob("*.json"), *(ROOT / "specs" / "negative").glob("*")]
)


def paths(value: Any, path: str = "") -> list[tuple[str, str | None]]:
    """Each path of a document as the kernel writes it, with the key that it ends with; None for an entry of a list."""
    found: list[tuple[str, str | None]] = []
    if isinstance(value, dict):
        for key, x in value.items():
            where = f"{path}.{shown(key)}" if path else shown(key)
            found += [(where, key), *paths(x, where)]
    elif isinstance(value, list):
        for k, x in enumerate(value):
            found += [(f"{path}[{k}]", None), *paths(x, f"{path}[{k}]")]
    return found


def token(text: str, where: Locations, path: str) -> str:
    """What is written at the position of a path."""
    position = where.of(path)
    line = text.removeprefix("\ufeff").split("\n")[position.line - 1]
    return line[position.column - 1 : position.end_column - 1]


def plain(document: Any) -> list[tuple[str, str | None]]:
    """The paths that mean one thing: `a.b` is both a key "a.b" and a key b of a table a, and names are shortened."""
    found = paths(document)
    counts = Counter(path for path, _ in found)
    return [(path, key) for path, key in found if counts[path] == 1]


def check(data: bytes, document: Any) -> None:
    text, where = data.decode(), Locations(data)
    for path, key in plain(document):
        assert where.find(path) is not None, path
        if key is not None:
            found = token(text, where, path)
            quoted = found[:1] in ('"', "'")
            assert (tomllib.loads(f"x = {found}")["x"] if quoted else found) == key, path


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.name)
def test_every_key_of_every_spec(path: Any) -> None:
    data = path.read_bytes()
    text = data.decode()
    check(data, json.loads(text) if text.startswith("{") else tomllib.loads(text))


SPACES = st.sampled_from(["", " ", "  ", "\t"])
GAPS = st.sampled_from(["", " ", "\n", " # [x] = {\n", "\r\n  ", "\n\n"])
BARE = st.from_regex(r"[A-Za-z0-9_-]{1,4}", fullmatch=True)
ANY = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=6)
NAMES = st.one_of(BARE, BARE, ANY, st.sampled_from(["a.b", "a", "b", "a b", 'q"', "[0]", "x#y", "ä µ"]))
PLAIN = ["1", "-2.5e3", "true", "0x1F", "1979-05-27 07:32:00", "'it'", '"6 kW"', '""', '"# no = comment"', '"\\" ] }"']
LONG = ['"""a\n[b]\n""" ', "'''x\n''y'''", '"""q"""""', '"\\u00e4"', '"""\\"""x"""']
SCALARS = st.sampled_from([*PLAIN, *LONG])


@st.composite
def key(draw: st.DrawFn, name: str) -> str:
    if draw(st.booleans()) and name and name.isascii() and all(c.isalnum() or c in "-_" for c in name):
        return name
    return json.dumps(name, ensure_ascii=draw(st.booleans()))


@st.composite
def value(draw: st.DrawFn, depth: int = 2) -> str:
    kind = draw(st.integers(0, 3)) if depth else 0
    if kind == 1:
        entries = [f"{draw(GAPS)}{draw(value(depth - 1))}{draw(GAPS)}" for _ in range(draw(st.integers(0, 3)))]
        return f"[{','.join(entries)}{draw(GAPS)}]"
    if kind == 2:
        names = draw(st.lists(NAMES, unique=True, max_size=3))
        entries = [f"{draw(SPACES)}{draw(key(n))}{draw(SPACES)}={draw(SPACES)}{draw(value(0))}" for n in names]
        return f"{{{','.join(entries)}{draw(SPACES)}}}"
    return draw(SCALARS)


@st.composite
def document(draw: st.DrawFn) -> str:
    """Statements at random; those that make no valid TOML are sorted out by the reader."""
    lines = []
    for _ in range(draw(st.integers(0, 8))):
        names = draw(st.lists(NAMES, min_size=1, max_size=3))
        dotted = f"{draw(SPACES)}.{draw(SPACES)}".join(draw(key(name)) for name in names)
        kind = draw(st.integers(0, 5))
        if kind < 2:
            brackets = "[[", "]]"
            start, end = brackets if kind else ("[", "]")
            lines.append(f"{start}{draw(SPACES)}{dotted}{draw(SPACES)}{end}")
        else:
            lines.append(f"{draw(SPACES)}{dotted}{draw(SPACES)}={draw(SPACES)}{draw(value())}")
        lines[-1] += draw(st.sampled_from(["", " # a = 1", "\t"]))
    return draw(st.sampled_from(["", "\ufeff"])) + draw(st.sampled_from(["\n", "\r\n"])).join([*lines, ""])


@given(document())
@settings(max_examples=120, deadline=None)
def test_random_toml_against_tomllib(text: str) -> None:
    data = text.encode()
    try:
        found = tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError:
        Locations(data).of("a.b[0]")  # it says something, and does not fail
        return
    check(data, found)


JSONS = st.recursive(
    st.none() | st.booleans() | st.integers() | ANY,
    lambda x: st.lists(x, max_size=3) | st.dictionaries(ANY, x, max_size=4),
)


@given(st.dictionaries(ANY, JSONS, max_size=4), st.sampled_from([None, 0, 2, "\t"]), st.booleans())
@settings(max_examples=80, deadline=None)
def test_random_json_against_json(found: Any, indent: Any, ascii_only: bool) -> None:
    data = json.dumps(found, indent=indent, ensure_ascii=ascii_only).encode()
    where = Locations(data)
    for path, name in plain(found):
        assert where.find(path) is not None, path
        if name is not None:
            assert json.loads(token(data.decode(), where, path)) == name


@given(
    st.binary(max_size=80) | st.text("[]{}\"'=.,#ab\n\\:", max_size=60).map(str.encode), st.text("ab.[]0'", max_size=12)
)
@settings(max_examples=300, deadline=None)
def test_nothing_makes_it_fail(data: bytes, path: str) -> None:
    where = Locations(data)
    assert where.of(path).line >= 1
    locate(where, Fault("S101", path, ""))
    where.words(path)


@pytest.mark.parametrize(
    "data",
    [
        b"[" * 200_000,
        b"a = " + b"[" * 200_000,
        b'{"a":' * 60_000,
        b'"""\n' * 60_000,
        b'a = "\n' * 60_000,
        b"a." * 100_000,
        b"a = [\n" * 50_000,
        b'x = "' + b"\\" * 200_001,
        b"[[a]]\n" * 30_000,
        b"#" * 300_000,
        b" " * 300_000,
        b"\n" * 200_000,
        b'x="""' + b'""a' * 60_000,
    ],
    ids=lambda data: repr(data[:8]),
)
def test_time_is_linear(data: bytes) -> None:
    started = time.perf_counter()
    Locations(data).of("a[0].b")
    assert time.perf_counter() - started < 3  # generous; quadratic ones would take minutes


def test_many_lookups_are_quick() -> None:
    names = range(20_000)
    lines = "".join(f'[[line]]\nname = "l{k}"\nfrom = "a"\n' for k in names)
    where = Locations(lines.encode())
    started = time.perf_counter()
    assert [where.of(f"line.l{k}.from").line for k in names] == [3 * k + 3 for k in names]
    assert time.perf_counter() - started < 10  # generous; looking through all lines each time would take minutes


def test_a_path_leads_to_its_key_or_the_nearest_table() -> None:
    text = """\
\ufefftop = 1
[node."a.b"]
load = [
  { kind = "rl" }, # [node.x]
  { kind = "zip", P = ["6 kW",
     "6 kvar"] }]
[node.a]
b.dgu.filter = 'µ'
[[line]]
name = "12"
from = "a"
[[line]]
"name" = "x.y"
[[line]]
name = "12"
to = "b"
["odd\\u0020 name!"]
z = 1
"""
    where = Locations(text.replace("\n", "\r\n").encode())
    assert [str(where.of(path)) for path in ("top", "node.a.b.load[1].P[1]", "node.a.b.load[0].kind")] == [
        "1",
        "6",
        "4",
    ]
    assert str(where.of("node.a.b.dgu.filter")) == "8"
    assert where.words("node.a.b.dgu.filter") == "µ"
    assert str(where.of("line.12.to")) == "16"  # of two of one name the later one is at fault
    assert str(where.of("line.12.length")) == "14"
    assert (str(where.of("line[0].from")), str(where.of("line.x.y"))) == ("11", "12")
    assert str(where.of("node.a.b.load[1].Y")) == "5"
    assert str(where.of("node.nowhere.dgu")) == "2"
    assert str(where.of(f"{shown('odd  name!')}.z")) == "18"
    assert str(where.of("line[7].x")) == "9"


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"a = 1\nb = \nc = 3\n", 2),
        (b'{\n"a": 1,\n"b" 2}', 3),
        (b'a = 1\nb = "\xff"\n', 2),
        (b'{"a": 1, "a": 2}', None),
    ],
)
def test_faults_of_the_text_itself(data: bytes, line: int | None) -> None:
    with pytest.raises(SpecError) as caught:
        decode_all(data)
    found = locate(Locations(data), caught.value.faults[0])
    assert (found.line if found else None) == line


def test_of_two_meanings_of_a_path_one_is_shown() -> None:
    where = Locations(b'["a.b"]\n[x]\n[a.b]\n')
    assert where.of("a.b").line in (1, 3)


def test_claims_come_from_their_parts() -> None:
    where = Locations((ROOT / "specs" / "cigre-mv.toml").read_bytes())
    lines = {
        name: where.of(path_of(name, where)).line
        for name in ("dgu/1", "load/9", "line/12", "equilibrium/1", "microgrid")
    }
    text = (ROOT / "specs" / "cigre-mv.toml").read_text().splitlines()
    assert text[lines["dgu/1"] - 1].startswith('dgu = { filter = "lc", controller = "pi"')
    assert text[lines["load/9"] - 2] == "[node.9]"
    assert text[lines["line/12"] - 1 : lines["line/12"] + 1] == ["[[line]]", 'name = "12"']
    assert text[lines["equilibrium/1"] - 1] == "[node.1]"
    assert lines["microgrid"] == 1
    assert used_by("dgu/1", where) == [("controller.pi", "the controller pi"), ("filter.lc", "the filter lc")]
    assert used_by("line/12", where) == [("line_type.overhead", "the line type overhead")]
    where = Locations(b'[node.a]\nload = [{ kind = "zip" }, { kind = "rl" }, { kind = "exp" },\n { kind = "rl" }]')
    assert path_of("branch/a/1", where) == "node.a.load[3]"
    assert where.of("node.a.load[3]").line == 3
    assert path_of("mode/a/dq", where) == "node.a.dgu"
