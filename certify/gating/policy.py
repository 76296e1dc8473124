"""What a gate asks for: data, read from options."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase

_AGE = re.compile(r"(\d{1,6})\s*(m|h|d|w)", re.ASCII)
_SECONDS = {"m": 60, "h": 3600, "d": 86400, "w": 7 * 86400}


@dataclass(frozen=True)
class Policy:
    """How specs are judged.

    `allow`: patterns of names of the ledger, such as sampled/9 or equilibrium/*. `certificates`: the folder of the
    committed certificates, None for beside each spec. `max_age`: as it was given, `max_age_seconds` in seconds.
    `require`: never prove. `method`: the only one by which loads are proved, if anything is. `stamp`: new
    certificates carry the time.
    """

    allow: tuple[str, ...] = ()
    certificates: str | None = None
    max_age: str | None = None
    require: bool = False
    method: str | None = None
    stamp: bool = False

    @property
    def max_age_seconds(self) -> int | None:
        return parse_age(self.max_age) if self.max_age is not None else None

    def allows(self, name: str) -> bool:
        """Whether a verdict may rest on this assumption."""
        return any(fnmatchcase(name, pattern) for pattern in self.allow)


def parse_age(text: str) -> int:
    """An age in seconds: a whole number of minutes, hours, days or weeks. Raises: ValueError.

    >>> parse_age("90d"), parse_age("12 h")
    (7776000, 43200)
    """
    found = _AGE.fullmatch(text.strip())
    if not found:
        raise ValueError(f"expected an age such as 90d, 12h, 30m or 2w, got {text!r}")
    return int(found[1]) * _SECONDS[found[2]]
