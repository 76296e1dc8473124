"""Wrong signs planted in the kernel's model and in the simulator: how the cross-check catches each of them.

    python tests/campaign_mutations.py [--report reports/mutations.md]
    python tests/campaign_mutations.py --only dgu_port   # functions whose names contain this: each mutant and its fate

Exit code 1 if a mutant is neither caught nor exempt, or exempt and caught.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from tests.mutants import REJECTED, STOPPED, TARGETS, Fate, exempt, judge_all
from tests.mutation_cases import EXEMPT, SPECS

KINDS = ("model", "equilibrium", "storage", "dissipation", "energy balance", REJECTED, STOPPED)


def table(rows: Iterable[Iterable[object]]) -> Iterator[str]:
    head, *body = ([str(cell) for cell in row] for row in rows)
    yield f"| {' | '.join(head)} |"
    yield f"|---|{'---:|' * (len(head) - 1)}"
    yield from (f"| {' | '.join(row)} |" for row in body)


def count(fates: list[Fate], seen: bool) -> list[int]:
    """By kind: of those that were caught by it first, or of those that it sees at all."""
    found = Counter(kind for fate in fates for kind in (fate.seen if seen else [fate.caught]))
    return [found[kind] for kind in KINDS]


def lines(fates: list[Fate], seconds: float) -> Iterator[str]:
    reasons, caught = exempt(), [fate for fate in fates if fate.caught]
    missed = [fate for fate in fates if not fate.caught and fate.mutant.key not in reasons]
    yield "# Wrong signs against the cross-check"
    yield ""
    yield (
        f"{len(fates)} mutants of {len(TARGETS)} functions and constants on {len(SPECS)} small microgrids, {seconds:.0f} s. "
        f"Caught: {len(caught)}. Exempt, with a reason: {len(reasons)}. Missed: {len(missed)}."
    )
    yield ""
    yield (
        "A mutant has one wrong sign: `a + b` for `a - b`, a minus dropped, or one before a factor, an entry, an argument "
        "or an exponent. Certificates are proved beforehand, and the verdict stays; only of what the kernel says of "
        f"equilibria and limits it is asked again, and `{REJECTED}` is where it turns its own certificate down. `{STOPPED}`: "
        "the cross-check ends in an error, such as the logarithm of a negative voltage."
    )
    for title, seen in (("Caught first by", False), ("Seen by", True)):
        yield from ("", f"## {title}", "")
        if seen:
            yield (
                "All comparisons that disagree on the microgrid that catches a mutant. A motion (storage, dissipation, energy "
                "balance) is only looked at where nothing disagrees without one."
            )
            yield ""
        rows: list[list[object]] = [["file", "mutants", *KINDS, "exempt"]]
        for module in dict.fromkeys(fate.mutant.module for fate in fates):
            own = [fate for fate in fates if fate.mutant.module == module]
            left = sum(not fate.caught for fate in own)
            rows.append([f"`{module.replace('.', '/')}.py`", len(own), *count(own, seen), left])
        rows.append(["all", len(fates), *count(fates, seen), sum(not fate.caught for fate in fates)])
        yield from table(rows)
    yield from ("", "## Exempt", "")
    for reason, keys in EXEMPT.items():
        yield f"{reason[0].upper()}{reason[1:]}."
        yield ""
        yield from (f"- `{key}`" for key in keys)
        yield ""
    if missed:
        yield from ("## Missed", "")
        yield from (f"- `{fate.mutant.key}`, line {fate.mutant.line}" for fate in missed)
        yield ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", default="", help="functions whose names contain this")
    parser.add_argument("--report", type=Path, help="write the tables to this file")
    arguments = parser.parse_args()
    start, fates = time.perf_counter(), list[Fate]()
    chosen = [key for key in TARGETS if arguments.only in ".".join(key)]
    for module, name in chosen:
        own = judge_all(module, name, thorough=True)
        fates += own
        print(f"{module}.{name}: {len(own)} mutants, {sum(fate.caught is None for fate in own)} not caught", flush=True)
        if arguments.only:
            for fate in own:
                print(f"  {fate.mutant.line}: {fate.mutant.key}: {fate.caught}, {fate.spec}, {fate.what}")
    reasons = exempt()
    bad = [fate for fate in fates if (fate.caught is None) != (fate.mutant.key in reasons)]
    if not arguments.only:
        text = "\n".join(lines(fates, time.perf_counter() - start))
        print(text)
        if arguments.report:
            arguments.report.write_text(text.rstrip() + "\n")
    for fate in bad:
        print(f"{'missed' if fate.caught is None else 'exempt, but caught'}: {fate.mutant.key}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
