"""What a verdict says about the network as a whole: where it rests, from where it returns, and what sets the limits."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from certify.kernel.claims import Claim, Verdict

SHOWN = 6  # islands, nodes or DGUs listed one by one


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


def summary(verdict: Verdict, notes: dict[str, str]) -> list[str]:
    """A few lines on equilibria, regions and inverters at their limits, for the end of a verdict."""
    claims = {claim.id: claim for claim in verdict.claims}
    islands = [c.id.split("/", 1)[1] for c in verdict.claims if c.id.startswith("equilibrium/")]
    lines: list[str] = []
    for name in islands[:SHOWN]:
        where = f" of the island of node {name}" if len(islands) > 1 else ""
        if claims[f"equilibrium/{name}"].status == "proved":
            lines.append(f"equilibrium{where}: {tell_rest(read_rest(claims[f'equilibrium/{name}']))}")
        if claims[f"region/{name}"].status in ("proved", "conditional"):
            lines.append(f"region{where}: {tell_region(read_region(claims[f'region/{name}']))}")
        if held := claims.get(f"saturated/{name}"):
            found = held.status == "proved"
            told = tell_rest(read_rest(held)) if found else f"not proved ({notes.get(held.id, 'P214')})"
            lines.append(f"equilibrium{where} with inverters held at their limits: {told}")
    if len(islands) > SHOWN:
        lines.append(f"and {len(islands) - SHOWN} more islands (--json has them all)")
    return lines + tell_modes(verdict.claims)


def tell_rest(rest: Rest) -> str:
    """Where an island rests, in one line."""
    only = "no other one in the bands" if rest.only_one else "others are not excluded"
    text = f"proved to within {rest.radius:.2g} V, {only}"
    sizes = {name: abs(V) for name, V in rest.voltages.items()}
    low, high = min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
    text += f"; |V| from {sizes[low]:.6g} V (node {low}) to {sizes[high]:.6g} V (node {high})"
    if rest.lines:
        line = max(rest.lines, key=lambda name: abs(rest.lines[name]))
        text += f"; up to {abs(rest.lines[line]):.6g} A (line {line})"
    return text


def tell_region(region: Region) -> str:
    """From where motion returns, in one line."""
    if region.level is None:
        return "all motion tends to it (global)"
    text = f"motion from H <= {region.level:.6g} J tends to it; {region.limit} sets this level, {region.margin:.6g} V "
    text += "away from the limit" if "terminal" in region.limit else "away from the end of its band"
    return text


def tell_modes(claims: Iterable[Claim]) -> list[str]:
    """What is known of inverters at their limits: one line for each DGU."""
    found: dict[str, list[str]] = {}
    for claim in claims:
        if claim.id.startswith("mode/"):
            node, held = claim.id.removeprefix("mode/").rsplit("/", 1)
            axes = {"d": "d axis", "q": "q axis", "dq": "both"}[held]
            found.setdefault(node, []).append(f"{axes} {mode_status(claim)}")
    lines = [f"DGU {node} at its limits: {'; '.join(modes)}" for node, modes in list(found.items())[:SHOWN]]
    if len(found) > SHOWN:
        lines.append(f"and {len(found) - SHOWN} more DGUs with limits (--all lists every claim)")
    if found:
        lines.append("Switching between these modes, and integrators that wind up, are not covered.")
    return lines


def mode_status(claim: Claim) -> str:
    """How a DGU with an axis at its limit is: passive, passive but for a shortage, not passive, or unknown."""
    shortages = [value for name, value, _ in claim.facts if name == "shortage eps"]
    if shortages:
        return f"passive but for a shortage of {float(shortages[0]):.4g} ohm"
    return {"proved": "passive", "refuted": "not passive"}.get(claim.status, "unknown")
