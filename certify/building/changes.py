"""Changes of a document that is a plain one or one of tomlkit: what is new is written in the style of the file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from certify.building.paths import find
from certify.editing import insert
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import NumberText, shorten

Change = Callable[[Any], Any]


def add_part(kind: str, name: str, part: dict[str, Any]) -> Change:
    """A part after the others of its kind, such as a node or a filter."""

    def change(document: Any) -> Any:
        if kind not in document:
            document[kind] = {} if type(document) is dict else _super_table()
        _require(document[kind], dict, kind)
        insert(document[kind], name, _styled(document, part))
        return document

    return change


def add_entry(path: str, key: str, entry: dict[str, Any]) -> Change:
    """A table at the end of a list, such as a line, or a load of a node."""

    def change(document: Any) -> Any:
        holder = document
        if path:
            at, name = find(document, path)
            holder = at[name]
            _require(holder, dict, path)
        if key not in holder:
            holder[key] = [entry] if type(document) is dict else _new_list(holder is document, entry)
            return document
        _require(holder[key], list, f"{path}.{key}" if path else key)
        holder[key].append(entry if type(document) is dict else _in_list(holder[key], entry))
        return document

    return change


def set_value(path: str, value: Any) -> Change:
    """Another value at a place, or a new key of a table that is there."""

    def change(document: Any) -> Any:
        at, key = find(document, path, new=True)
        at[key] = value if type(document) is dict else _inline(value)
        return document

    return change


def remove(path: str) -> Change:
    def change(document: Any) -> Any:
        at, key = find(document, path)
        del at[key]
        return document

    return change


def _require(value: Any, kind: type, path: str) -> None:
    if not isinstance(value, kind):
        expected = "a table" if kind is dict else "a list"
        raise SpecError((Fault("S103", shorten(path, 100), f"expected {expected}, got {shorten(value)}"),))


def _super_table() -> Any:
    from tomlkit import table

    return table(is_super_table=True)


def _styled(document: Any, part: dict[str, Any]) -> Any:
    if type(document) is dict:
        return part
    from tomlkit import table

    styled = table()
    for key, value in part.items():
        styled[key] = _inline(value)
    return styled


def _new_list(top: bool, entry: dict[str, Any]) -> Any:
    from tomlkit import aot

    if not top:
        return _inline([entry])
    tables = aot()
    tables.append(_styled(None, entry))
    return tables


def _in_list(entries: Any, entry: dict[str, Any]) -> Any:
    from tomlkit.items import AoT

    return _styled(None, entry) if isinstance(entries, AoT) else _inline(entry)


def _inline(value: Any) -> Any:
    """A value for tomlkit on one line, numbers as they are written."""
    import tomlkit

    if isinstance(value, NumberText):
        return tomlkit.value(str(value).removeprefix("+"))
    if isinstance(value, dict):
        table = tomlkit.inline_table()
        for key, part in value.items():
            table[key] = _inline(part)
        return table
    if isinstance(value, list):
        array = tomlkit.array()
        for part in value:
            array.append(_inline(part))
        return array
    return value
