"""Shortages of passivity: the proved index of 200 stable inverter loops against the exactly bracketed true one.

    python tests/campaign_index.py [--count 200] [--seed 1] [--report reports/shortages.md]

Exit code 1 if a proof is missing, or its shortage is below the true one or more than 5 % above it.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from certify.search.shortage import propose_index
from tests.accept import accepted_facts
from tests.designs import Design
from tests.index_cases import index_cases, shortage_bracket

MOST = Fraction(105, 100)


@dataclass(frozen=True)
class Result:
    """`proved` and `least` in ohm are facts of the accepted proof: eps, and what no shortage below can do."""

    kind: str
    states: int
    true: tuple[Fraction, Fraction]
    proved: Fraction | None
    least: Fraction | None
    seconds: float

    @property
    def is_right(self) -> bool:
        if self.proved is None or self.least is None:
            return False
        return self.least <= self.true[1] and self.true[0] <= self.proved <= MOST * self.true[1]


def measure(design: Design) -> Result:
    true = shortage_bracket(design.port, 10)
    start = time.perf_counter()
    facts = next((f for f in (accepted_facts(design.port, p) for p in propose_index(design.port)) if f), None)
    seconds = time.perf_counter() - start
    named = {name: value for name, value, _ in facts or ()}
    found = (named.get("shortage eps"), named.get("no shortage is enough below"))
    return Result(design.kind, len(design.port.F), true, *found, seconds)


def to_report(results: list[Result], seed: int) -> str:
    ratios = [float(r.proved / r.true[1]) for r in results if r.proved is not None]
    lower = [float(r.least / r.true[1]) for r in results if r.least is not None]
    lines = [
        "# Shortages of passivity",
        "",
        f"{len(results)} stable inverter loops that are not passive, seed {seed}; `true` is bracketed to ten digits by exact",
        "rational decisions (no sweep). `proved` is the shortage of the accepted storage function, `least` what its frequency",
        "witness proves to be too little.",
        "",
        "| kind | loops | states | true shortage, ohm | proved / true | least / true | median ms |",
        "| --- | ---: | --- | --- | --- | --- | ---: |",
    ]
    for kind in dict.fromkeys(r.kind for r in results):
        some = [r for r in results if r.kind == kind]
        sizes = [float(r.true[1]) for r in some]
        above = [float(r.proved / r.true[1]) for r in some if r.proved is not None]
        below = [float(r.least / r.true[1]) for r in some if r.least is not None]
        states = ", ".join(map(str, sorted({r.states for r in some})))
        middle = 1e3 * statistics.median(r.seconds for r in some)
        lines.append(
            f"| {kind} | {len(some)} | {states} | {min(sizes):.1e} to {max(sizes):.1e} | {min(above):.3f} to "
            f"{max(above):.3f} | {min(below):.3f} to {max(below):.3f} | {middle:.0f} |"
        )
    wrong = sum(not r.is_right for r in results)
    lines += [
        "",
        f"Not proved, or not within 5 %: {wrong}. Proved / true: {min(ratios):.4f} to {max(ratios):.4f}; least / true: "
        f"{min(lower):.4f} to {max(lower):.7f}.",
        "",
    ]
    return "\n".join(lines)


def run(designs: Iterable[Design]) -> list[Result]:
    return [measure(design) for design in designs]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report", type=Path, default=Path("reports/shortages.md"))
    arguments = parser.parse_args()
    results = run(index_cases(arguments.count, arguments.seed))
    report = to_report(results, arguments.seed)
    arguments.report.write_text(report)
    sys.stdout.write(report)
    return int(not all(r.is_right for r in results))


if __name__ == "__main__":
    sys.exit(main())
