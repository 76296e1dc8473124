"""What a cross-check has found: agreements with their figures, and contradictions with all that shows them."""

from __future__ import annotations

from dataclasses import dataclass, field

from certify.simulator.plant import Array


@dataclass(frozen=True)
class Finding:
    """One comparison: the worst `value` found, the `limit` up to which it counts as agreement, and where that was.

    `kind`: "model", "equilibrium", "storage", "dissipation", "energy balance", "midpoint balance", "region", "return".
    `unit` of both, "" of shares. `state`: the one that shows it, in the order of the plant's states, at that time of
    the motion from `start`, if that was not the start of the simulation.
    """

    kind: str
    where: str
    value: float
    limit: float
    unit: str = ""
    at_second: float | None = None
    state: Array | None = field(default=None, compare=False, repr=False)
    start: Array | None = field(default=None, compare=False, repr=False)

    @property
    def agrees(self) -> bool:
        """False also for what is no number."""
        return self.value <= self.limit


def worst(findings: list[Finding]) -> Finding | None:
    """The one nearest to its limit, or farthest beyond; what is no number counts as that."""
    return max(findings, key=lambda f: f.value / f.limit if f.value == f.value else float("inf"), default=None)
