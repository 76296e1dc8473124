"""Where a key of a spec stands: from the path of a fault, such as `node.1.load[0].P[1]`, to its line and column.

`tomllib` and `json` give no positions, and tomlkit keeps none. So the text is scanned here a second time, for positions
only and only where a message or a report needs one: nothing is ever decided by it. It reads TOML and JSON with one
scanner, in linear time, never raises, and of malformed text keeps what came before and after the lines at fault.
"""

from __future__ import annotations

import contextlib
import json
import re
import tomllib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from certify.kernel.errors import Fault
from certify.kernel.reader import shown

MAX_DEPTH = 60  # of tables and lists in each other: a spec needs six
MAX_CHARACTERS = 1 << 22  # of a text that is scanned: two seconds
LONGEST = 2_000  # characters of a path in which names are looked for

_SPACE = re.compile(r"[ \t\r]*")
_GAP = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")  # between the entries of lists and tables, where lines may end
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^\s,\]}#][^,\]}#\n]*")
_STRINGS = (
    ('"""', re.compile(r'"""(?:[^"\\]|\\.|"{1,2}(?!"))*"""(?:"{0,2})', re.DOTALL)),
    ("'''", re.compile(r"'''(?:[^']|'{1,2}(?!'))*'''(?:'{0,2})")),
    ('"', re.compile(r'"(?:[^"\\\n]|\\[^\n])*"')),
    ("'", re.compile(r"'[^'\n]*'")),
)
_LINE_IN_MESSAGE = re.compile(r"line (\d+)(?:,? column (\d+))?")
_BYTE_IN_MESSAGE = re.compile(r"byte (\d+) cannot be decoded")


@dataclass(frozen=True)
class Position:
    """Where something stands: line and columns from 1 on, in characters; `end_column` is that after the last one.

    >>> str(Position(12, 1, 2))
    '12'
    """

    line: int
    column: int
    end_column: int

    def __str__(self) -> str:
        return str(self.line)


TOP = Position(1, 1, 1)


class Place:
    """A key or an entry of a list: where it is written, and what stands in it. Offsets are in characters."""

    __slots__ = ("end", "items", "keys", "start", "value")

    def __init__(self, start: int, end: int) -> None:
        self.start, self.end = start, end
        self.keys: dict[str, Place] | None = None
        self.items: list[Place] | None = None
        self.value: tuple[int, int] | None = None  # of a string, number or date

    def key(self, name: str, start: int, end: int) -> Place:
        """The place of a key of this table, made if it is not there."""
        if self.keys is None:
            self.keys = {}
        if name not in self.keys:
            self.keys[name] = Place(start, end)
        return self.keys[name]

    def item(self, start: int, end: int) -> Place:
        """A new entry of this list."""
        if self.items is None:
            self.items = []
        self.items.append(Place(start, end))
        return self.items[-1]


class Locations:
    """The places of a spec.

    >>> where = Locations(b'[filter.lc]\\nR = "0.1 ohm"\\nL = "-1.8 mH"\\n')
    >>> where.of("filter.lc.L")
    Position(line=3, column=1, end_column=2)
    >>> where.of("filter.lc.C")  # a key that is missing: its table
    Position(line=1, column=9, end_column=11)
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.text = data.decode("utf-8", errors="replace").removeprefix("\ufeff")
        self.root = Place(0, 0)
        if len(self.text) <= MAX_CHARACTERS:
            _Scanner(self.text, self.root).document()
        self._names: dict[int, dict[str, Place]] = {}  # by the `id` of a place, which lives as long as this does
        self._lines = [0, *(match.end() for match in re.finditer("\n", self.text))]

    def of(self, path: str) -> Position:
        """The position of the key that a path names, or of the nearest table around it that is there."""
        return self.position(self._deepest(path)[0])

    def find(self, path: str) -> Place | None:
        """The place that a path names, None if there is none."""
        place, rest = self._deepest(path)
        return None if rest else place

    def position(self, place: Place) -> Position:
        """Line and columns of a place."""
        line = bisect_right(self._lines, place.start)
        column = place.start - self._lines[line - 1] + 1
        return Position(line, column, column + place.end - place.start)

    def words(self, path: str) -> str | None:
        """The text or number at a path, without quotes; None if there is none, or something else."""
        place = self.find(path)
        return self._words(place) if place else None

    def _words(self, place: Place | None) -> str | None:
        if place is None or place.value is None:
            return None
        token = self.text[slice(*place.value)]
        return _unquoted(token) if token[:1] in ('"', "'") else token.rstrip()

    def _deepest(self, path: str) -> tuple[Place, str]:
        """The deepest place on the way of a path, and what of the path is left. Names may have dots in them."""
        best, least = self.root, path
        stack = [(self.root, path)]
        while stack:
            place, rest = stack.pop()
            if len(rest) < len(least):
                best, least = place, rest
            if rest:
                stack += self._steps(place, rest)
        return best, least

    def _steps(self, place: Place, rest: str) -> Iterator[tuple[Place, str]]:
        """Each place that is one step further on a path, and what is left of that."""
        if place.items is not None and (found := re.match(r"\[(\d{1,9})\]\.?", rest)):
            if int(found[1]) < len(place.items):
                yield place.items[int(found[1])], rest[found.end() :]
            return
        named = self._named(place)
        for end in [match.start() for match in re.finditer(r"[.\[]", rest[:LONGEST])] + [len(rest)]:
            if rest[:end] in named:
                yield named[rest[:end]], rest[end:].removeprefix(".")

    def _named(self, place: Place) -> dict[str, Place]:
        """What stands in a place, by its name as paths have it. Lines are named by what stands in them as `name`."""
        if id(place) not in self._names:
            found = dict(place.keys or {})
            for item in place.items or ():  # of two of one name the later one is at fault
                name = self._words((item.keys or {}).get("name"))
                found |= {name: item} if name is not None else {}
            self._names[id(place)] = {shown(name): x for name, x in found.items()}
        return self._names[id(place)]


def locate(where: Locations, fault: Fault) -> Position | None:
    """Where in a spec a fault is: its key, or the line that its message names; None if neither says."""
    if fault.path:
        return where.of(fault.path)
    if fault.code in ("S002", "S003") and (found := _LINE_IN_MESSAGE.search(fault.message)):
        column = int(found[2] or 1)
        return Position(int(found[1]), column, column)
    if fault.code == "S001" and (found := _BYTE_IN_MESSAGE.search(fault.message)):
        before = where.data[: int(found[1])].decode("utf-8", errors="replace").split("\n")
        return Position(len(before), len(before[-1]) + 1, len(before[-1]) + 2)
    return None


def _unquoted(token: str) -> str | None:
    """The text that a quoted key or string stands for; None if it cannot be told."""
    if "\\" not in token and not token.startswith(('"""', "'''")):
        return token[1:-1]
    try:
        return str(tomllib.loads(f"x = {token}")["x"])
    except ValueError:
        try:  # escapes that JSON has and TOML has not: \/ and surrogate pairs
            return str(json.loads(token))
        except ValueError:
            return None


class _Malformed(Exception):
    """What stands here is not as it should be; the rest of the statement is left out."""


class _Scanner:
    """One pass over a text, noting where keys and entries begin and end."""

    def __init__(self, text: str, root: Place) -> None:
        self.text, self.at, self.root = text, 0, root
        self.separator = "="

    def document(self) -> None:
        self.skip(_GAP)
        if self.text.startswith("{", self.at):
            self.separator = ":"
            with contextlib.suppress(_Malformed):
                self.value(self.root, 0)
            return
        table = self.root
        while self.at < len(self.text):
            try:
                table = self.statement(table)
            except _Malformed:
                end = self.text.find("\n", self.at)
                self.at = len(self.text) if end < 0 else end
            self.skip(_GAP)

    def statement(self, table: Place) -> Place:
        """One header or one key with its value; the table that the keys after it belong to."""
        if not self.text.startswith("[", self.at):
            self.entry(table, 0)
            return table
        brackets = "[[" if self.text.startswith("[[", self.at) else "["
        self.at += len(brackets)
        self.skip(_SPACE)
        names = list(self.dotted())
        self.expect(brackets.replace("[", "]"))
        place = self.root
        for name, start, end in names[:-1]:
            place = place.key(name, start, end)
            place = place.items[-1] if place.items else place
        name, start, end = names[-1]
        new = place.keys is None or name not in place.keys
        place = place.key(name, start, end)
        if brackets == "[[":
            return place.item(start, end)
        if not new and place.items is None:
            place.start, place.end = start, end  # written now; so far only keys in it were
        return place

    def entry(self, table: Place, depth: int) -> None:
        """A key, dotted or not, and its value."""
        for name, start, end in self.dotted():
            table = table.key(name, start, end)
        self.expect(self.separator)
        self.skip(_SPACE if self.separator == "=" else _GAP)
        self.value(table, depth)

    def dotted(self) -> Iterator[tuple[str, int, int]]:
        """The names of a key, with where each begins and ends; the spaces after it are passed."""
        for _ in range(MAX_DEPTH):
            start = self.at
            if self.text[start : start + 1] in ('"', "'"):
                name = _unquoted(self.string())
                if name is None:
                    raise _Malformed
            elif self.separator == "=" and (found := _BARE.match(self.text, start)):
                name, self.at = found[0], found.end()
            else:
                raise _Malformed
            yield name, start, self.at
            self.skip(_SPACE if self.separator == "=" else _GAP)
            if self.separator != "=" or not self.text.startswith(".", self.at):
                return
            self.at += 1
            self.skip(_SPACE)
        raise _Malformed

    def value(self, place: Place, depth: int) -> None:
        first = self.text[self.at : self.at + 1]
        if first in ("[", "{") and depth >= MAX_DEPTH:
            self.at = len(self.text)
            raise _Malformed
        if first == "[":
            place.items = []
            for _ in self.entries("]"):
                item = place.item(self.at, self.at + 1)
                self.value(item, depth + 1)
                if item.value:
                    item.end = item.value[1]
        elif first == "{":
            place.keys = {}
            for _ in self.entries("}"):
                self.entry(place, depth + 1)
        else:
            start = self.at
            if first in ('"', "'"):
                self.string()
            elif found := _SCALAR.match(self.text, self.at):
                self.at = start + len(found[0].rstrip())
            else:
                raise _Malformed
            place.value = (start, self.at)

    def entries(self, closing: str) -> Iterator[None]:
        """Once for each entry of a list or table in brackets, at its beginning."""
        self.at += 1
        while True:
            self.skip(_GAP)
            if self.text.startswith(closing, self.at):
                self.at += 1
                return
            if self.at >= len(self.text):
                raise _Malformed
            yield
            self.skip(_GAP)
            if self.text.startswith(",", self.at):
                self.at += 1
            elif not self.text.startswith(closing, self.at):
                raise _Malformed

    def string(self) -> str:
        """A quoted text, with its quotes."""
        for quotes, pattern in _STRINGS:
            if self.text.startswith(quotes, self.at):
                start, found = self.at, pattern.match(self.text, self.at)
                if found is None:
                    if len(quotes) == 3:
                        self.at = len(self.text)  # it has no end, so nothing comes after it
                    raise _Malformed
                self.at = found.end()
                return self.text[start : self.at]
        raise _Malformed

    def expect(self, what: str) -> None:
        if not self.text.startswith(what, self.at):
            raise _Malformed
        self.at += len(what)

    def skip(self, pattern: re.Pattern[str]) -> None:
        found = pattern.match(self.text, self.at)
        self.at = found.end() if found else self.at
