"""What a search offers to the kernel: a status by a rule with its data. Only the kernel accepts it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from certify.kernel.linalg import Matrix, Vector


@dataclass(frozen=True)
class Proposal:
    """`status` is "proved" or "refuted"; `data` holds strings and lists only, as the certificate does."""

    status: str
    rule: str
    data: dict[str, Any] = field(default_factory=dict)


def to_text(vector: Vector) -> str:
    """A vector in the notation of a certificate.

    >>> from fractions import Fraction
    >>> to_text((Fraction(1, 2), Fraction(3)))
    '1/2 3'
    """
    return " ".join(map(str, vector))


def to_rows(matrix: Matrix) -> list[str]:
    return [to_text(row) for row in matrix]
