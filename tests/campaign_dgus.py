"""Random inverter loops: what the search proves, as the kernel accepts it, against the oracle.

    python tests/campaign_dgus.py [--single 1000] [--dq 300] [--seed 1] [--report reports/random-dgus.md]

Exit code 1 if a design is decided wrongly, or left open although the oracle decides it.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from certify.kernel.model import LinearPort
from certify.search.dgu import propose_dgu
from certify.search.proposal import Proposal

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from tests.accept import accepts
from tests.designs import NOT_PASSIVE, PASSIVE, SEMIDEFINITE, Design, dq_designs, single_designs
from tests.oracle import decide

AGREE, OPEN, WRONG, ORACLE = "agree", "undecided", "disagree", "oracle disagrees with the construction"


@dataclass(frozen=True)
class Result:
    """What both sides say about one design. `status` is "proved", "refuted" or None."""

    design: Design
    status: str | None
    rule: str | None
    verdict: str
    reason: str
    outcome: str
    seconds: float
    oracle_seconds: float
    error: str | None = None


def is_accepted(port: LinearPort, proposal: Proposal) -> bool:
    """Whether the kernel's rule accepts a proposal, read as the checker reads it."""
    return accepts(port, proposal) is not None


def compare(design: Design) -> Result:
    """Run the search and the oracle on one design.

    A passive port without a definite storage function is to stay open: the claim asks for one, and no rule refutes
    that alone.
    """
    start = time.perf_counter()
    status = rule = error = None
    try:
        for proposal in propose_dgu(design.port):
            if is_accepted(design.port, proposal):
                status, rule = proposal.status, proposal.rule
                break
    except Exception as fault:  # a crash is a finding, and the others are to be run all the same
        error = f"{type(fault).__name__}: {fault}"
    middle = time.perf_counter()
    truth = decide(design.port)
    end = time.perf_counter()
    wanted = {PASSIVE: "proved", NOT_PASSIVE: "refuted", SEMIDEFINITE: None}[truth.verdict]
    outcome = AGREE if status == wanted and not error else OPEN if status is None else WRONG
    if design.expected and design.expected != truth.verdict:
        outcome = ORACLE
    return Result(design, status, rule, truth.verdict, truth.reason, outcome, middle - start, end - middle, error)


def to_text(value: object) -> str:
    """Exact numbers for the report, matrices by rows.

    >>> to_text(((1, 2), (3, 4)))
    '[[1, 2], [3, 4]]'
    """
    if isinstance(value, tuple):
        return "[" + ", ".join(map(to_text, value)) + "]"
    return str(value)


def to_report(results: list[Result], seed: int, seconds: float) -> str:
    """Markdown: counts for each kind, the rules used, times, and every case that needs attention."""
    outcomes = Counter(r.outcome for r in results)
    lines = [
        "# Random inverter loops against the oracle",
        "",
        f"{len(results)} designs, seed {seed}, {seconds:.0f} s. "
        + ", ".join(f"{name}: {outcomes[name]}" for name in (AGREE, OPEN, WRONG, ORACLE))
        + ".",
        "",
        "`semidefinite` ports are passive but have no positive definite storage function; they are to stay open.",
        "",
        "| channels | kind | designs | proved | refuted | open | passive | semidefinite | not passive | agree "
        "| undecided | disagree | median s | max s |",
        "|---|---|" + "---:|" * 12,
    ]
    groups: dict[tuple[int, str], list[Result]] = {}
    for r in results:
        groups.setdefault((len(r.design.port.C), r.design.kind), []).append(r)
    for (channels, kind), group in groups.items():
        statuses, verdicts = Counter(r.status for r in group), Counter(r.verdict for r in group)
        wrong = sum(r.outcome in (WRONG, ORACLE) for r in group)
        counts = [
            len(group),
            *(statuses[key] for key in ("proved", "refuted", None)),
            *(verdicts[key] for key in (PASSIVE, SEMIDEFINITE, NOT_PASSIVE)),
            sum(r.outcome == AGREE for r in group),
            sum(r.outcome == OPEN for r in group),
            wrong,
        ]
        times = [r.seconds for r in group]
        cells = [str(channels), kind, *map(str, counts), f"{statistics.median(times):.3f}", f"{max(times):.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", "| channels | rule | designs | median s | max s |", "|---|---|---:|---:|---:|"]
    by_rule: dict[tuple[int, str], list[float]] = {}
    for r in results:
        by_rule.setdefault((len(r.design.port.C), r.rule or "none"), []).append(r.seconds)
    for (channels, rule), times in sorted(by_rule.items()):
        lines.append(f"| {channels} | {rule} | {len(times)} | {statistics.median(times):.3f} | {max(times):.3f} |")
    oracle = [r.oracle_seconds for r in results]
    lines += ["", f"The oracle takes {statistics.median(oracle):.4f} s (median), {max(oracle):.4f} s (max)."]
    attention = [r for r in results if r.outcome != AGREE]
    lines += ["", f"## Cases that need attention: {len(attention)}", ""]
    for r in attention:
        says = f"{r.status or 'nothing'}{f' by {r.rule}' if r.rule else ''}{f' ({r.error})' if r.error else ''}"
        lines.append(
            f"- {r.outcome}, {r.design.kind}: search {says}; oracle {r.verdict} ({r.reason}); {r.seconds:.2f} s"
        )
        lines += [f"  - {name} = {to_text(value)}" for name, value in r.design.numbers.items()]
    return "\n".join(lines) + "\n"


def compare_all(designs: Iterable[Design], jobs: int = 1) -> list[Result]:
    if jobs == 1:
        return [compare(design) for design in designs]
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(compare, designs, chunksize=4))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--single", type=int, default=1000, help="number of single-axis designs")
    parser.add_argument("--dq", type=int, default=300, help="number of two-axis designs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--report", type=Path, default=Path("reports/random-dgus.md"))
    arguments = parser.parse_args()
    start = time.perf_counter()
    designs = [*single_designs(arguments.single, arguments.seed), *dq_designs(arguments.dq, arguments.seed)]
    results = compare_all(designs, arguments.jobs)
    report = to_report(results, arguments.seed, time.perf_counter() - start)
    arguments.report.parent.mkdir(parents=True, exist_ok=True)
    arguments.report.write_text(report)
    sys.stdout.write(report)
    return int(any(r.outcome != AGREE for r in results))


if __name__ == "__main__":
    sys.exit(main())
