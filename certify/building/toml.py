"""A document of a spec as TOML for people: a table for each part, short values on one line, long ones row by row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from certify.editing import same, toml_key
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import NumberText
from certify.kernel.reader import read_document
from certify.values import to_utf8

WIDTH = 100  # characters up to which a list or table stands on one line
PARTS = ("filter", "controller", "line_type", "node", "scenario")  # tables of tables


def to_toml(document: Mapping[str, Any]) -> str:
    """The text. `document` is plain, as `certify.values.to_plain` returns it, without nulls.

    Raises: SpecError if the document has a null or a number that TOML has not; ValueError if the text does not say what
    the document says, which is a defect.

    >>> print(to_toml({"name": "x", "filter": {"lc": {"R": 0, "L": "1 mH"}}}), end="")
    name = "x"
    <BLANKLINE>
    [filter.lc]
    R = 0
    L = "1 mH"
    """
    first = [f"{toml_key(key)} = {_value(part)}" for key, part in document.items() if not _is_apart(key, part)]
    blocks = ["\n".join(first)] if first else []
    for key, part in document.items():
        if _is_apart(key, part):
            blocks += _parts(key, part)
    text = "\n\n".join(blocks) + "\n"
    if not same(read_document(to_utf8(text)), document):
        raise ValueError("the TOML that was written does not say what the document says")
    return text


def _is_apart(key: str, part: Any) -> bool:
    """Whether it is written as tables of its own, after the values that are not."""
    if key == "line" and isinstance(part, list):
        return bool(part) and all(isinstance(entry, dict) for entry in part)
    return key in PARTS and isinstance(part, dict) and all(isinstance(entry, dict) for entry in part.values())


def _parts(key: str, part: Any) -> Iterator[str]:
    if isinstance(part, list):
        for entry in part:
            yield "\n".join(_table(f"[[{key}]]", entry, key))
    elif not part:
        yield f"[{key}]"
    else:
        for name, entry in part.items():
            path = f"{key}.{toml_key(name)}"
            yield "\n".join(_table(f"[{path}]", entry, path))


def _table(head: str, entry: Mapping[str, Any], path: str) -> Iterator[str]:
    """A table: its values, and then its tables that are too long for one line."""
    yield head
    long = {key: part for key, part in entry.items() if isinstance(part, dict) and part and len(_inline(part)) > WIDTH}
    for key, part in entry.items():
        if key not in long:
            yield f"{toml_key(key)} = {_value(part)}"
    for key, part in long.items():
        below = f"{path}.{toml_key(key)}"
        yield from _table(f"[{below}]", part, below)


def _value(value: Any, indent: str = "") -> str:
    """On one line if it is short; else a list with a row for each of its parts."""
    text = _inline(value)
    nested = isinstance(value, list) and len(value) > 1 and all(isinstance(part, dict) for part in value)
    if not isinstance(value, list) or not value or (len(text) <= WIDTH and not nested):
        return text
    inner = f"{indent}  "
    rows = "".join(f"{inner}{_value(part, inner)},\n" for part in value)
    return f"[\n{rows}{indent}]"


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{toml_key(k)} = {_inline(part)}" for k, part in value.items()) + " }" if value else "{}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if value is None:
        raise SpecError((Fault("S103", "", "null is no value; leave the key out"),))
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value) if isinstance(value, NumberText | int) else toml_key(str(value), always=True)
