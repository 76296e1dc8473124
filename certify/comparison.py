"""Two states of a spec side by side: which claims a change touches, what becomes of each, and how equilibria move."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from certify.kernel.claims import Claim, Context, Verdict, statements
from certify.kernel.equilibrium import regulates
from certify.kernel.model import incidence
from certify.kernel.proofs import HOLDS
from certify.kernel.spec import Microgrid, Node

# What may become of a claim; "holds" is proved, or proved under an assumption of the ledger.
CHANGES = {
    "kept": "about the same content, and holds as before",
    "proved again": "about another content, and holds as before",
    "new": "there was no such claim",
    "gone": "there is no such claim any more",
    "lost": "held before, and does no more",
    "gained": "did not hold before, and does now",
    "open": "does not hold, as before",
}
NOISE = 1e-9  # of the largest voltage or current there is: what changes less has not moved, equilibria are enclosures
_FACT = re.compile(r"(voltage at node|current in line) (.+), ([dq])", re.DOTALL)


@dataclass(frozen=True)
class Change:
    """What became of one claim, a key of CHANGES; `before` or `after` is None if the spec does not call for it."""

    what: str
    before: Claim | None
    after: Claim | None

    @property
    def id(self) -> str:
        claim = self.after or self.before
        return claim.id if claim else ""


@dataclass(frozen=True)
class Moved:
    """A voltage in volt or a current in ampere at the equilibrium, in the dq frame, d + j q."""

    name: str
    before: complex
    after: complex

    @property
    def size(self) -> float:
        """How far it has moved in the plane."""
        return abs(self.after - self.before)

    @property
    def change(self) -> float:
        """Of the amplitude."""
        return abs(self.after) - abs(self.before)

    @property
    def degrees(self) -> float:
        """Of the angle, between -180 and 180; 0 if there is no angle before or after."""
        return math.degrees(cmath.phase(self.after / self.before)) if self.before and self.after else 0.0


@dataclass(frozen=True)
class Comparison:
    """`voltages` and `currents`: where they move most, the farthest first, if both verdicts tell of equilibria."""

    changes: tuple[Change, ...]
    voltages: tuple[Moved, ...]
    currents: tuple[Moved, ...]


def compare(grids: tuple[Microgrid, Microgrid], verdicts: tuple[Verdict, Verdict], most: int = 5) -> Comparison:
    """What became of each claim, in the order of the new spec and then of the old one."""
    was, now = (contents(grid) for grid in grids)
    before, after = ({claim.id: claim for claim in verdict.claims} for verdict in verdicts)
    changes = [_change(before.get(name), claim, was.get(name) == now[name]) for name, claim in after.items()]
    changes += [Change("gone", claim, None) for name, claim in before.items() if name not in after]
    old, new = (_equilibrium(verdict) for verdict in verdicts)
    moved = [Moved(name, old[kind, name], x) for (kind, name), x in new.items() if (kind, name) in old]
    kinds = [kind for kind, name in new if (kind, name) in old]

    def farthest(kind: str) -> tuple[Moved, ...]:
        there = [x for x, of in zip(moved, kinds, strict=True) if of == kind]
        least = NOISE * max((abs(side) for x in there for side in (x.before, x.after)), default=0.0)
        found = [x for x in there if x.size > least]
        return tuple(sorted(found, key=lambda x: -x.size)[:most])

    return Comparison(tuple(changes), farthest("voltage at node"), farthest("current in line"))


def contents(grid: Microgrid) -> dict[str, Hashable]:
    """For each claim all that its subject depends on, so that equal content means that the same is claimed."""
    context = Context(grid)
    found: dict[str, Hashable] = {}
    limits = tuple((node.name, node.dgu.limits_volt) for node in grid.nodes if node.dgu and node.dgu.limits_volt)
    for name, (subject, text) in statements(context).items():
        # That of the microgrid is about everything before it, and which equilibria are meant is set by limits too.
        found[name] = (text, limits, *found.items()) if subject[0] == "microgrid" else _content(context, *subject)
    return found


def _content(context: Context, kind: str, what: Any) -> Hashable:
    grid = context.grid
    if kind == "branch":
        return what  # type: ignore[no-any-return]
    if kind == "dgu":
        return (grid.w0, context.key(what))
    if kind in ("load", "current"):
        node = context.nodes[what]
        return (node.loads, node.band_volt, node.current)
    if kind == "interconnection":
        return tuple(frozenset(side.items()) for side in incidence(grid))
    if kind == "equilibrium":
        return (grid.w0, tuple(_at_rest(context, name) for name in what), _lines(context, what))
    if kind == "island":
        parts = [(name, context.key(name), replace(context.nodes[name], dgu=None)) for name in what]
        return (grid.w0, tuple(parts), _lines(context, what))
    if isinstance(what, tuple) and set(what) <= context.nodes.keys():  # of an island, and maybe of its references too
        nodes = tuple(_without_anti_windup(context.nodes[name]) for name in what)
        return (grid.w0, grid.line_legs_at_dgus, nodes, _lines(context, what))
    return replace(grid, name="")


def _without_anti_windup(node: Node) -> Node:
    """It acts in the modes of a DGU only: inside its limits, and at rest on all of them, it changes nothing."""
    return replace(node, dgu=node.dgu and replace(node.dgu, anti_windup_second=None))


def _at_rest(context: Context, name: str) -> Hashable:
    """What of a node enters an equilibrium: of a DGU that keeps its reference, without limits, only the reference."""
    node = context.nodes[name]
    dgu, bare = node.dgu, replace(node, dgu=None)
    if dgu is None:
        return (bare, context.capacitances["-"][name], context.capacitances["+"][name])
    if regulates(context, name) and dgu.limits_volt is None:
        return (bare, dgu.reference_volt)
    return (bare, dgu.reference_volt, dgu.limits_volt, context.key(name))


def _lines(context: Context, names: Iterable[str]) -> Hashable:
    return tuple(dict.fromkeys(line for name in names for line in context.lines_at[name]))


def _change(before: Claim | None, after: Claim, same: bool) -> Change:
    """`same`: whether both are about the same content; what is said of it may still be more or less than before."""
    if before is None:
        return Change("new", None, after)
    same = same and before.statement == after.statement
    held, holds = before.status in HOLDS, after.status in HOLDS
    if held and holds:
        return Change("kept" if same else "proved again", before, after)
    return Change("lost" if held else "gained" if holds else "open", before, after)


def _equilibrium(verdict: Verdict) -> dict[tuple[str, str], complex]:
    """Voltages and currents by kind and name, of the claims about equilibria."""
    parts: dict[tuple[str, str], dict[str, float]] = {}
    for claim in verdict.claims:
        for what, value, _ in claim.facts if claim.id.startswith("equilibrium/") else ():
            match = _FACT.fullmatch(what)
            if match:
                parts.setdefault((match[1], match[2]), {})[match[3]] = float(value)
    return {key: complex(dq["d"], dq["q"]) for key, dq in parts.items() if len(dq) == 2}
