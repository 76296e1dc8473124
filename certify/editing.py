"""Editing the text of a spec: TOML keeps its comments and order (tomlkit), JSON its indentation and its numbers.

Whatever the editing has done, the new text is parsed again and compared with what it should say.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import NumberText
from certify.kernel.reader import read_document
from certify.values import to_utf8


def parse_toml(text: str) -> Any:
    """A document of tomlkit, which remembers how it was written."""
    import tomlkit

    return tomlkit.parse(text)


def edit_spec(spec: bytes, change: Callable[[Any], Any]) -> bytes:
    """The text after `change`, which edits a document in place and returns it; it is called for each kind of document.

    Raises: SpecError U001 if the file is laid out such that the editor cannot do it.
    """
    text = spec.decode("utf-8-sig")
    expected = change(read_document(spec))
    if text.lstrip().startswith("{"):
        result = to_json(expected, text)
    else:
        import tomlkit
        from tomlkit.exceptions import TOMLKitError

        try:
            result = tomlkit.dumps(change(tomlkit.parse(text)))
        except (TOMLKitError, TypeError, KeyError, IndexError, ValueError, AttributeError):
            result = ""
    data = to_utf8(result)
    try:
        done = bool(data) and same(read_document(data), expected)
    except SpecError:
        done = False
    if not done:
        message = "the layout of this file cannot be edited: give filters, controllers and nodes as tables, [node.NAME]"
        raise SpecError((Fault("U001", "", message),))
    return data


def insert(parts: Any, name: str, part: Any) -> None:
    """A part after the others of its kind, in the style of the table that it goes into."""
    if not isinstance(parts, dict) or type(parts) is dict:
        parts[name] = part
        return
    from tomlkit import inline_table, nl
    from tomlkit.items import InlineTable, Table

    if isinstance(parts, InlineTable) and isinstance(part, Table):
        inner = inline_table()
        inner.update(part.unwrap())
        part = inner
    elif isinstance(part, Table) and not part.as_string().endswith("\n\n"):
        part.add(nl())
    parts[name] = part


def same(a: Any, b: Any) -> bool:
    """Whether two parsed documents say the same: numbers are numbers, text is text, 5 is 5 however it is kept."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, bool) or isinstance(b, bool) or a is None or b is None:
        return a is b
    numbers = isinstance(a, NumberText | int), isinstance(b, NumberText | int)
    return numbers[0] == numbers[1] and (str(a) == str(b) or {str(a), str(b)} <= {"0", "-0"})


def to_json(document: Any, like: str) -> str:
    """JSON with the indentation of `like` and every number as it was written, but for what only TOML can read."""

    def marked(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: marked(part) for key, part in value.items()}
        if isinstance(value, list):
            return [marked(part) for part in value]
        if isinstance(value, NumberText):  # TOML has "+1.5" and "1_000.5", JSON has not
            return f"\ue000{value.replace('_', '').removeprefix('+')}\ue001"
        return value

    indent = re.match(r"\s*\{[^\S\n]*\n([ \t]*)", like)
    text = json.dumps(marked(document), indent=indent[1] if indent else None, ensure_ascii=False)
    return re.sub('"\ue000([^"]*)\ue001"', r"\1", text) + "\n"


def toml_key(name: str, always: bool = False) -> str:
    """A key, in quotes if it needs them, or `always`: then it is any text."""
    if not always and re.fullmatch(r"[A-Za-z0-9_-]+", name):
        return name
    return json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007F")  # which TOML has no other way to write


def toml_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{toml_key(key)} = {toml_value(part)}" for key, part in value.items()) + " }"
    return str(value) if isinstance(value, NumberText | int) else json.dumps(value, ensure_ascii=False)
