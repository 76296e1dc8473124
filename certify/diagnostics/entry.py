"""One diagnostic: data, so that it can be told in many ways."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Diagnostic:
    """A stable code with its title, the reason behind it, and what to try. `example` is a short good input."""

    code: str
    title: str
    why: str
    remedy: str
    example: str = ""
