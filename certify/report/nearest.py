"""The nearest passive gains for DGUs that are not passive, or only but for a shortage: as text and as JSON."""

from __future__ import annotations

from typing import Any

from certify.inputs import SpecSource, load
from certify.kernel.claims import Context, Verdict
from certify.kernel.model import node_capacitances
from certify.kernel.spec import Microgrid
from certify.search.nearest import NAMES, Suggestion, nearest_gains

MOST = 8  # different DGUs for which gains are sought: a second each


def suggestions(spec: SpecSource, verdict: Verdict) -> dict[str, Suggestion]:
    """Claim ids of DGUs that are refuted, or proved with a shortage, with the nearest gains that are passive.

    Equal DGUs share the search. Raises: SpecError.
    """
    return suggest(load(spec), verdict)


def suggest(grid: Microgrid, verdict: Verdict) -> dict[str, Suggestion]:
    """As `suggestions`, for a microgrid that has been read."""
    context = Context(grid)
    capacitances = node_capacitances(context.grid)
    memo: dict[Any, Suggestion | None] = {}
    found = {}
    for claim in verdict.claims:
        kind, _, name = claim.id.partition("/")
        if kind != "dgu" or (claim.status != "refuted" and claim.rule != "index-storage"):
            continue
        dgu, key = context.nodes[name].dgu, context.key(name)
        if len(context.corners(name)) > 1:
            continue  # its tolerances are the reason, not its gains
        if dgu is None or (key not in memo and len(memo) >= MOST):
            continue
        if key not in memo:
            memo[key] = nearest_gains(dgu, capacitances[name], context.grid.w0)
        suggestion = memo[key]
        if suggestion is not None:
            found[claim.id] = suggestion
    return found


def advise(spec: SpecSource, verdict: Verdict) -> tuple[dict[str, list[str]], dict[str, Any]]:
    """What to say under each such claim, and the same for machines. Raises: SpecError."""
    lines: dict[str, list[str]] = {}
    entries: dict[str, Any] = {}
    for claim, suggestion in suggestions(spec, verdict).items():
        change = max(suggestion.changes)
        where = NAMES[suggestion.changes.index(change)]
        head = f"nearest passive gains (largest relative change {100 * change:.3g} %, in {where}):"
        lines[claim] = [head, *(f"  {line}" for line in suggestion.fragment.splitlines())]
        percent = dict(zip(NAMES, (100 * change for change in suggestion.changes), strict=False))
        entries[claim] = {"kind": suggestion.kind, "change_percent": percent, "fragment": suggestion.fragment}
    return lines, {"nearest_gains": entries}
