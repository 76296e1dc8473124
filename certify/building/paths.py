"""Places in a document, named as messages name them: filter.lc.L, node.a.load[0].P, line.a-b.R."""

from __future__ import annotations

import re
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten

_INDEX = re.compile(r"\[(\d{1,9})\]")


def find(document: Any, path: str, new: bool = False) -> tuple[Any, Any]:
    """The table or list that holds a value, and its key or index there; names may have dots of their own.

    With `new` the last key need not be there yet. Raises: SpecError U035 if nothing stands at the path.

    >>> find({"node": {"bus 1.a": {"load": [{"P": 5}]}}}, "node.bus 1.a.load[0].P")
    ({'P': 5}, 'P')
    """
    at, rest = document, path
    while rest:
        found = _step(at, rest)
        if found is None:
            if new and isinstance(at, dict) and "." not in rest and "[" not in rest:
                return at, rest
            break
        key, rest = found
        if not rest:
            return at, key
        at = at[key]
    there: list[str] = []
    if isinstance(at, dict):
        there = list(at)[:8]
    elif _is_list(at):
        there = [str(x["name"]) if isinstance(x, dict) and "name" in x else f"[{k}]" for k, x in enumerate(at[:8])]
    known = f"there are {', '.join(map(str, there))}" if there else "nothing is there"
    raise SpecError((Fault("U035", shorten(path, 100), f"nothing stands at {shorten(rest or path)}; {known}"),))


def _step(at: Any, rest: str) -> tuple[Any, str] | None:
    """The key or index with which a path begins, and what is left of it; of several names the longest."""
    if isinstance(at, dict):
        keys = [key for key in at if rest == key or (rest.startswith(key) and rest[len(key)] in ".[")]
        key = max(keys, key=len, default=None)
        return None if key is None else (key, _without_dot(rest[len(key) :]))
    if not _is_list(at):
        return None
    index = _INDEX.match(rest)
    if index:
        return (int(index[1]), _without_dot(rest[index.end() :])) if int(index[1]) < len(at) else None
    names = {str(part.get("name")): k for k, part in enumerate(at) if isinstance(part, dict)}  # lines go by their names
    name = max((n for n in names if rest == n or rest.startswith(f"{n}.")), key=len, default=None)
    return None if name is None else (names[name], _without_dot(rest[len(name) :]))


def _without_dot(rest: str) -> str:
    return rest.removeprefix(".")


def _is_list(value: Any) -> bool:
    return isinstance(value, list)
