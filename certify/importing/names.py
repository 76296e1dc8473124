"""Names that a spec accepts, unique and as near as possible to those of the foreign network."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from certify.kernel.reader import NAME

_LONGEST = 56  # leaves room for a suffix


def clean(text: str, fallback: str) -> str:
    """A usable name: accents dropped, what else is not allowed replaced by `_`; `fallback` if nothing is left.

    >>> clean("Station Köln/Süd #4", "bus 7")
    'Station Koln_Sud _4'
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9_.:+ -]+", "_", plain)[:_LONGEST].strip(" .:+-")
    return name if NAME.fullmatch(name) and re.search(r"[A-Za-z0-9]", name) else fallback


class Names:
    """Names that have been given away; one that is taken, in whatever case, gets a number."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}

    def take(self, text: str, fallback: str) -> str:
        """A new name, as near as possible to a text."""
        base = name = clean(text, fallback)
        number = self._next.get(base.lower(), 2)
        while name.lower() in self._taken:
            name = f"{base}-{number}"
            number += 1
        self._next[base.lower()] = number
        self._taken.add(name.lower())
        return name


def unique(labels: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """One name for each (text, fallback), in order.

    >>> unique([("a", "bus 0"), ("a", "bus 1"), ("", "bus 2")])
    ('a', 'a-2', 'bus 2')
    """
    names = Names()
    return tuple(names.take(text, fallback) for text, fallback in labels)


def comment(text: str, limit: int = 200) -> str:
    """Foreign text as it may stand in a comment: one line, printable, not too long."""
    plain = "".join(letter if letter.isprintable() else "?" for letter in text)
    return plain if len(plain) <= limit else plain[: limit - 3] + "..."
