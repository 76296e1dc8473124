"""What a verdict says about the network as a whole: where it rests, from where it returns, and what sets the limits."""

from __future__ import annotations

import math
from collections.abc import Iterable

from certify.kernel.claims import Claim, Verdict
from certify.report.layout import table
from certify.rests import Region, Rest, read_region, read_rest

SHOWN_NODES = 24
ROUNDING = 1e-40  # volt: what the units of the kernel's enclosures leave where no node is free
SHOWN = 6  # islands, nodes or DGUs listed one by one


def summary(verdict: Verdict, notes: dict[str, str]) -> list[str]:
    """A few lines on equilibria, regions and inverters at their limits, for the end of a verdict."""
    claims = {claim.id: claim for claim in verdict.claims}
    islands = [c.id.split("/", 1)[1] for c in verdict.claims if c.id.startswith("equilibrium/")]
    lines: list[str] = []
    for name in islands[:SHOWN]:
        where = f" of the island of node {name}" if len(islands) > 1 else ""
        if claims[f"equilibrium/{name}"].facts and claims[f"equilibrium/{name}"].status == "proved":
            lines.append(f"equilibrium{where}: {tell_rest(read_rest(claims[f'equilibrium/{name}']))}")
        if (region := claims[f"region/{name}"]).facts:
            assumed = ", if what the ledger says holds" if region.status == "conditional" else ""
            lines.append(f"region{where}{assumed}: {tell_region(read_region(region))}")
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
    text = f"proved {_precision(rest)}, {only}"
    sizes = {name: abs(V) for name, V in rest.voltages.items()}
    low, high = min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
    text += f"; |V| {'from ' if low != high else ''}{sizes[low]:.6g} V (node {low})"
    text += f" to {sizes[high]:.6g} V (node {high})" if low != high else ""
    if rest.lines:
        line = max(rest.lines, key=lambda name: abs(rest.lines[name]))
        text += f"; up to {abs(rest.lines[line]):.6g} A (line {line})"
    return text


def _precision(rest: Rest) -> str:
    return f"to within {rest.radius:.2g} V" if rest.radius > ROUNDING else "exactly"


def tell_region(region: Region) -> str:
    """From where motion returns, in one line."""
    if region.level is None:
        return "all motion tends to it (global)"
    text = f"motion from H <= {region.level:.6g} J tends to it; {region.limit} sets this level, {region.margin:.6g} V "
    text += "away from the limit" if region.limit.startswith("the terminal") else "away from the end of its band"
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
        lines.append(
            "The verdict does not depend on these modes; switching between them, and integrators that wind up, are"
        )
        lines.append("not covered.")
    return lines


def mode_status(claim: Claim) -> str:
    """How a DGU with an axis at its limit is: passive, passive but for a shortage, not passive, or unknown."""
    shortages = [value for name, value, _ in claim.facts if name == "shortage eps"]
    if shortages:
        return f"passive but for a shortage of {float(shortages[0]):.4g} ohm"
    return {"proved": "passive", "refuted": "not passive"}.get(claim.status, "unknown")


# --- the story ------------------------------------------------------------------------------------------------------


def story(verdict: Verdict) -> list[str]:
    """The network in words: what holds, where it rests, why it is stable, from where it returns, what limits it."""
    claims = {claim.id: claim for claim in verdict.claims}
    lines = [_parts(verdict.claims), _why(claims)]
    islands = [name.split("/", 1)[1] for name in claims if name.startswith("equilibrium/")]
    for name in islands[:SHOWN]:
        where = f"The island of node {name}" if len(islands) > 1 else "The network"
        lines += ["", *_tell_island(where, claims[f"equilibrium/{name}"], claims[f"region/{name}"])]
    if len(islands) > SHOWN:
        lines += ["", f"And {len(islands) - SHOWN} more islands (--json has them all)."]
    modes = tell_modes(verdict.claims)
    return [*lines, *(["", *modes] if modes else [])]


def _count(claims: Iterable[Claim], kind: str) -> list[Claim]:
    return [claim for claim in claims if claim.kind == kind]


def _parts(claims: tuple[Claim, ...]) -> str:
    """What kind of network it is, and what of its parts does not hold."""
    names = {"dgu": "DGU", "load": "node with static load", "branch": "series R-L load", "line": "line"}
    names |= {"equilibrium": "island"}
    told = []
    for kind, name in names.items():
        found = _count(claims, kind)
        if found:
            plural = name.replace("node ", "nodes ").replace(" load", " loads") if "node" in name else f"{name}s"
            told.append(f"{len(found)} {name if len(found) == 1 else plural}")
    broken = [c for c in claims if c.kind in ("dgu", "load", "branch", "line") and c.status != "proved"]
    rest = "all parts are proved" if not broken else f"not proved: {', '.join(c.id for c in broken[:SHOWN])}"
    return f"A network with {', '.join(told)}; {rest}{' and more' if len(broken) > SHOWN else ''}."


def _why(claims: dict[str, Claim]) -> str:
    """Why it is stable, or why that is not known."""
    short = [c for c in claims.values() if c.rule == "index-storage" and c.id.startswith("dgu/")]
    if claims["microgrid"].status == "unknown":
        return "Whether every equilibrium is stable does not follow from this; the claims below say what is missing."
    text = "Around any equilibrium each part stores energy and gives back no more than it was given"
    if short:
        text += f" (but for {len(short)} DGUs with a shortage, which lines and loads make up for)"
    text += (
        ", the interconnection creates none, and lines dissipate. So the sum H of what is stored never grows, and it "
    )
    return text + "stops falling only at rest: every equilibrium inside the bands is asymptotically stable."


def _tell_island(where: str, equilibrium: Claim, region: Claim) -> list[str]:
    """Where an island rests, and from where it returns to that."""
    if equilibrium.status != "proved":
        if equilibrium.status != "refuted":
            return [f"{where} is not proved to rest."]
        told = "; ".join(f"{name}: {float(value):.6g} {unit}" for name, value, unit in equilibrium.facts[:6])
        return [f"{where} is proved not to rest as it is claimed ({told})."]
    rest = read_rest(equilibrium)
    only = "the only equilibrium with all loads in their bands" if rest.only_one else "an equilibrium, alone near by"
    lines = [f"{where} rests here, {_precision(rest)} ({only}):"]
    reach = read_region(region) if region.status in ("proved", "conditional") else None
    rows: list[tuple[str, ...]] = [("node", "|V|", "angle", "may be off by, alone")]
    for name, V in sorted(rest.voltages.items(), key=lambda entry: abs(entry[1]))[:SHOWN_NODES]:
        back = f"{reach.nodes[name]:.4g} V" if reach and name in reach.nodes else "anywhere" if reach else "?"
        rows.append((name, f"{abs(V):.6g} V", f"{math.degrees(math.atan2(V.imag, V.real)):.3f} deg", back))
    lines.append(table(rows))
    if len(rest.voltages) > SHOWN_NODES:
        lines.append(f"  and {len(rest.voltages) - SHOWN_NODES} more nodes with higher voltages (--json has them all)")
    heavy = sorted(rest.lines.items(), key=lambda entry: -abs(entry[1]))[:3]
    if heavy:
        lines.append(f"The largest currents flow in line {', '.join(f'{name} ({abs(x):.4g} A)' for name, x in heavy)}.")
    strong = sorted(rest.inverters.items(), key=lambda entry: -abs(entry[1]))[:3]
    if strong:
        told = ", ".join(f"{name} ({abs(x):.4g} A at {abs(rest.terminals[name]):.5g} V)" for name, x in strong)
        lines.append(f"Most is asked of the inverter at node {told}.")
    assumed = "If what is assumed below holds: " if region.status == "conditional" else ""
    lines.append(assumed + _tell_return(reach))
    return lines


def _tell_return(reach: Region | None) -> str:
    if reach is None:
        return "From how far it returns there is not known."
    if reach.level is None:
        return "It returns there from everywhere: no load's band and no inverter's limit bounds H."
    text = f"It returns from every state with H <= {reach.level:.6g} J"
    if reach.lines:
        low, high = min(reach.lines.values()), max(reach.lines.values())
        text += f", such as one line's current off by {low:.4g} A" + (f" to {high:.4g} A" if high > low else "")
    return f"{text}. What limits this is {reach.limit}: {reach.margin:.6g} V are left there."
