"""Random static loads: the search with the kernel against the oracle, constructions and exact arithmetic.

    python tests/campaign_loads.py [--count 20000] [--seed 1] [--jobs 1] [--report reports/random-loads.md]
    python tests/campaign_loads.py --only 17   # one load, and what everyone says

Each load has a time limit. Every refuting pair is verified apart from the kernel. Exit code 1 if a load is decided
wrongly or fails, if a pair does not refute, or if the oracle contradicts itself or a construction.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from mpmath import mp

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from certify.search.proposal import Proposal
from tests.campaign_loops import percentile, time_limit, to_table
from tests.load_cases import Case, load_case, shown
from tests.load_oracle import BOUNDARY, MONOTONE, NOT_MONOTONE, Truth, exact_verdict, judge, product_sign
from tests.test_loads import decide, node

SECONDS = 60  # for each load
SAYS = {"proved": MONOTONE, "refuted": NOT_MONOTONE}
RIGHT, WRONG, UNKNOWN, FAILED, UNSETTLED = "right", "wrong", "unknown", "failed", "unsettled"


@dataclass(frozen=True)
class Answer:
    """`status` is "proved", "refuted", "unknown" or "failed"; `fault`: what is wrong with a refuting pair, or a failure."""

    status: str
    strict: bool
    rule: str
    seconds: float
    fault: str = ""


@dataclass(frozen=True)
class Result:
    """All answers about one load. `exact`: in rational arithmetic, if all exponents are whole."""

    number: int
    kind: str
    error: str
    expected: str | None
    exact: str | None
    truth: Truth
    oracle_seconds: float
    answer: Answer

    @property
    def right_answer(self) -> str | None:
        """Exact arithmetic, the construction and the oracle, in this order of trust; None on an unsettled boundary."""
        known = self.exact or self.expected or self.truth.verdict
        return None if known == BOUNDARY else known

    @property
    def mark(self) -> str:
        if self.answer.status in (UNKNOWN, FAILED):
            return self.answer.status
        if self.answer.fault or (self.answer.strict and not self.truth.strict):
            return WRONG
        if self.right_answer is None:
            return UNSETTLED
        return RIGHT if SAYS[self.answer.status] == self.right_answer else WRONG

    @property
    def quarrel(self) -> str:
        """How the sources of the right answer contradict each other, if they do."""
        said = {"construction": self.expected, "exact arithmetic": self.exact}
        said |= {"oracle": None if self.truth.verdict == BOUNDARY else self.truth.verdict}
        answers = {name: verdict for name, verdict in said.items() if verdict}
        if len(set(answers.values())) > 1:
            return ", ".join(f"{name}: {verdict}" for name, verdict in answers.items())
        if not self.truth.agree:
            return f"one voltage: {mp.nstr(self.truth.least, 5)}, two voltages: {mp.nstr(self.truth.pair, 5)}"
        return ""


# --- asking ---------------------------------------------------------------------------------------------------


def ask(case: Case) -> Answer:
    """What the search finds and the kernel accepts, with the refuting pair verified."""
    start = time.perf_counter()
    try:
        with time_limit(SECONDS):
            status, proposal, strict = decide(node(*case.law), case.band)
    except Exception as fault:
        return Answer(FAILED, False, "", time.perf_counter() - start, f"{type(fault).__name__}: {fault}"[:120])
    seconds = time.perf_counter() - start
    wrong = pair_fault(case, proposal) if status == "refuted" and proposal else ""
    return Answer(status, strict, proposal.rule if proposal else "", seconds, wrong)


def pair_fault(case: Case, proposal: Proposal) -> str:
    """Why the pair of a refutation does not refute, or nothing."""
    v = Fraction(proposal.data["v"])
    pair = tuple(Fraction(x) for x in proposal.data["pair"].split())
    if not all(case.band[0] <= x <= case.band[1] for x in (v, *pair)):
        return "a voltage is outside the band"
    sign = product_sign(case.law, (pair[0], pair[1]), Fraction(proposal.data["t"]))
    return "" if sign < 0 else f"the sign of the product is {sign}"


def compare(case: Case) -> Result:
    answer = ask(case)
    start = time.perf_counter()
    truth = judge(case.law, case.band)
    seconds = time.perf_counter() - start
    exact = exact_verdict(case.law, case.band)
    return Result(case.number, case.kind, case.error, case.expected, exact, truth, seconds, answer)


def compare_number(task: tuple[int, int]) -> Result:
    number, seed = task
    return compare(load_case(number, seed))


def compare_all(count: int, seed: int, jobs: int = 1) -> Iterator[Result]:
    tasks = [(number, seed) for number in range(count)]
    if jobs == 1:
        yield from map(compare_number, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(compare_number, tasks, chunksize=8)


# --- the report -----------------------------------------------------------------------------------------------


def rows_by(results: Iterable[Result], key: Callable[[Result], str]) -> list[list[object]]:
    groups: dict[str, list[Result]] = {}
    for r in results:
        groups.setdefault(key(r), []).append(r)
    rows: list[list[object]] = []
    for name, group in sorted(groups.items()):
        status, marks = Counter(r.answer.status for r in group), Counter(r.mark for r in group)
        times = [1000 * r.answer.seconds for r in group]
        counts = [status["proved"], status["refuted"], status[UNKNOWN], status[FAILED], marks[WRONG], marks[UNSETTLED]]
        milliseconds = [f"{x:.1f}" for x in (statistics.median(times), percentile(times, 0.95), max(times))]
        rows.append([name, len(group), *counts, *milliseconds])
    return rows


HEAD = ["loads", "proved", "refuted", "unknown", "failed", "wrong", "unsettled", "median ms", "p95 ms", "max ms"]


def tables(results: list[Result]) -> list[str]:
    on_edge = [r for r in results if r.error]
    return [
        *to_table(["kind", *HEAD], [*rows_by(results, lambda r: r.kind), *rows_by(results, lambda _: "all")]),
        "## By distance from the edge",
        "",
        "The kinds `edge`, by the error in one coefficient; with 0 they are exactly on the boundary.",
        "",
        *to_table(["error", *HEAD], rows_by(on_edge, lambda r: r.error)),
        "## By rule",
        "",
        *to_table(["rule", *HEAD], rows_by(results, lambda r: r.answer.rule or "none")),
    ]


def describe(r: Result, seed: int) -> str:
    case = load_case(r.number, seed)
    off = f" off by {r.error}" if r.error else ""
    truth = f"construction: {r.expected}, exact: {r.exact}, oracle: {r.truth.verdict} ({mp.nstr(r.truth.least, 5)})"
    said = f"certify: {r.answer.status} {r.answer.rule}{' strictly' * r.answer.strict} {r.answer.fault}".rstrip()
    return f"no. {r.number}, {r.kind}{off}; {truth}; {said}; {r.answer.seconds:.2f} s; `{shown(case)}`"


def is_fault(r: Result) -> bool:
    return r.mark in (WRONG, FAILED) or bool(r.quarrel)


def to_report(results: list[Result], seed: int, seconds: float) -> str:
    """Markdown: the totals, the kinds, the errors, the rules, and every load that is open or wrong."""
    verdicts, oracle = Counter(r.right_answer for r in results), [1000 * r.oracle_seconds for r in results]
    boundary = [r for r in results if r.truth.verdict == BOUNDARY]
    marks = Counter(r.mark for r in results)
    quarrels = [r for r in results if r.quarrel]
    known = [r for r in results if r.expected]
    wrong, still_open = ([r for r in results if r.mark in marks] for marks in ((WRONG, FAILED), (UNKNOWN,)))
    decided = sum(r.answer.status in SAYS for r in results)
    slowest = sorted((r for r in results if r.answer.status in SAYS), key=lambda r: -r.answer.seconds)[:10]
    lines = [
        "# Random loads against the oracle",
        "",
        f"{len(results)} loads, seed {seed}, {seconds:.0f} s. Monotone: {verdicts[MONOTONE]}, not monotone: "
        f"{verdicts[NOT_MONOTONE]}, zero to within 1e-40 and otherwise unknown: {verdicts[None]}.",
        "",
        f"Decided by certify: {100 * decided / max(1, len(results)):.2f} %. Wrong: {marks[WRONG]}. "
        f"Unknown: {marks[UNKNOWN]}. Failed: {marks[FAILED]}.",
        "",
        f"The construction decides {len(known)}, exact arithmetic {sum(bool(r.exact) for r in results)}; "
        f"{len(boundary)} are on the boundary. The oracle, in 60 to 240 digits, minimises both the one-voltage condition and "
        f"the product of two voltages; these disagree in {sum(not r.truth.agree for r in results)} cases, and one of the "
        f"sources contradicts another in {len(quarrels)}. Every refuting pair is verified apart from the kernel: "
        f"{sum(r.answer.status == 'refuted' for r in results)}, of which {sum(bool(r.answer.fault) for r in results if r.answer.status == 'refuted')} fail.",
        "",
        "A load is `wrong` if it is proved and not monotone, or refuted and monotone, or proved strict and not strictly "
        f"monotone, or if its pair does not refute. `failed`: an exception, or more than {SECONDS} s. Times are those of "
        f"certify; the oracle takes {statistics.median(oracle):.0f} ms (median), {max(oracle):.0f} ms (max).",
        "",
        "## By kind",
        "",
        *tables(results),
        f"## Wrong or failed: {len(wrong)}",
        "",
        "In the notation of `tests/load_cases.py`: `Z` (Y, I, P), each active and reactive; `X` (P0 np Q0 nq V0); band `B`.",
        "",
        *(f"- {describe(r, seed)}" for r in wrong),
        "",
        f"## Contradictions among oracle, construction and exact arithmetic: {len(quarrels)}",
        "",
        *(f"- {r.quarrel}: {describe(r, seed)}" for r in quarrels),
        "",
        f"## Unknown: {len(still_open)}",
        "",
        *(f"- {describe(r, seed)}" for r in still_open),
        "",
        "## Slowest of the decided",
        "",
        *(f"- {describe(r, seed)}" for r in slowest),
    ]
    return "\n".join(lines).rstrip() + "\n"


def show_one(number: int, seed: int) -> None:
    result = compare_number((number, seed))
    print(describe(result, seed))
    print(f"least of one voltage {mp.nstr(result.truth.least, 10)} at v1 e^{mp.nstr(result.truth.at, 20)}")
    print(f"least of two voltages {mp.nstr(result.truth.pair, 10)}; mark: {result.mark} {result.quarrel}".rstrip())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--only", type=int, help="the number of one load")
    parser.add_argument("--report", type=Path, default=Path("reports/random-loads.md"))
    arguments = parser.parse_args()
    if arguments.only is not None:
        show_one(arguments.only, arguments.seed)
        return 0
    start = time.perf_counter()
    results: list[Result] = []
    for result in compare_all(arguments.count, arguments.seed, arguments.jobs):
        results.append(result)
        if len(results) % 500 == 0:
            marks = Counter(r.mark for r in results)
            done = f"{len(results)} loads, {time.perf_counter() - start:.0f} s, {marks[WRONG]} wrong"
            print(f"{done}, {marks[UNKNOWN]} unknown, {marks[FAILED]} failed", file=sys.stderr, flush=True)
    report = to_report(results, arguments.seed, time.perf_counter() - start)
    arguments.report.parent.mkdir(parents=True, exist_ok=True)
    arguments.report.write_text(report)
    sys.stdout.write(report)
    return int(any(map(is_fault, results)))


if __name__ == "__main__":
    sys.exit(main())
