"""Where a network rests and from where it returns, read from the facts of a verdict's claims, in floats."""

from __future__ import annotations

import math
from dataclasses import dataclass

from certify.kernel.claims import Claim


@dataclass(frozen=True)
class Rest:
    """A proved equilibrium in floats: phasors by name, in V and A, and the radius of the proof in V."""

    radius: float
    only_one: bool
    voltages: dict[str, complex]
    lines: dict[str, complex]
    inverters: dict[str, complex]
    terminals: dict[str, complex]


@dataclass(frozen=True)
class Region:
    """A proved region in floats: the level in J (None: everything), what sets it, and the reach in V and A by name."""

    level: float | None
    limit: str
    margin: float
    nodes: dict[str, float]
    lines: dict[str, float]


def read_rest(claim: Claim) -> Rest:
    """The facts of a proved claim `equilibrium/..` or `saturated/..` by what they are about."""
    values = {name: value for name, value, _ in claim.facts}

    def phasors(what: str) -> dict[str, complex]:
        found = {}
        for name, value in values.items():
            if name.startswith(what) and name.endswith(", d"):
                found[name[len(what) : -3]] = complex(float(value), float(values[f"{name[:-1]}q"]))
        return found

    return Rest(
        float(values["radius of the proof"]),
        claim.rule == "strong-monotonicity",
        phasors("voltage at node "),
        phasors("current in line "),
        phasors("current of the DGU at node "),
        phasors("terminal voltage of the DGU at node "),
    )


def read_region(claim: Claim) -> Region:
    """The facts of a claim `region/..` that holds."""
    values = {name: float(value) for name, value, _ in claim.facts}
    if "global" in values:
        return Region(None, "", math.inf, {}, {})
    limit, margin = next((name, value) for name, value in values.items() if name.startswith("limited by "))
    reach = [
        {name[len(what) :]: value for name, value in values.items() if name.startswith(what)}
        for what in ("reach at node ", "reach in line ")
    ]
    return Region(values["level c of the storage"], limit.removeprefix("limited by "), margin, *reach)
