"""Random closed loops: the search with the kernel, and floating-point tools on the same loops, against the oracle.

    python tests/campaign_loops.py [--count 2000] [--seed 1] [--jobs 1] [--no-peers] [--report reports/random-loops.md]
    python tests/campaign_loops.py --only 17   # the exact matrices of one loop, and what everyone says

The peers need the optional dependencies `compare`; one that is not installed is left out. Each tool has a time limit
for each loop. Exit code 1 if ours decides a loop wrongly, or fewer than 99 % of those with a definite answer, or if
the oracle disagrees with a construction.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from certify.kernel.model import LinearPort
from certify.search.dgu import propose_dgu

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from tests.accept import accepts
from tests.designs import NOT_PASSIVE, PASSIVE, SEMIDEFINITE, Design
from tests.loops import damping_series, loops
from tests.oracle import Truth, decide

OURS, ISPASSIVE, FF_INDEX, FF_TOLERANT, LMI = (
    "certify",
    "ispassive",
    "input index >= 0",
    "input index >= -1e-9",
    "LMI",
)
PEERS = (ISPASSIVE, FF_INDEX, FF_TOLERANT, LMI)
RIGHT, WRONG, FAILED, NOTHING = "right", "wrong", "failed", "no answer"
SECONDS = 60  # for each tool and loop
EPSILON = 1e-9  # of the LMI: P >= EPSILON I
WANTED_SHARE = 0.99


@dataclass(frozen=True)
class Answer:
    """`says` is PASSIVE, NOT_PASSIVE or None. `note` names the rule, the status or the fault."""

    says: str | None
    seconds: float
    note: str = ""
    failed: bool = False


@dataclass(frozen=True)
class Result:
    """All answers about one loop. `number` finds it again with the seed and the count."""

    number: int
    kind: str
    origin: str
    expected: str | None
    states: int
    channels: int
    truth: Truth
    oracle_seconds: float
    answers: dict[str, Answer] = field(default_factory=dict)

    def mark(self, tool: str) -> str:
        """Right or wrong among loops with a definite answer. A singular storage: only ours is marked (silence)."""
        answer = self.answers[tool]
        if answer.says is None:
            return FAILED if answer.failed else NOTHING
        return RIGHT if answer.says == self.truth.verdict else WRONG

    @property
    def definite(self) -> bool:
        return self.truth.verdict != SEMIDEFINITE


class TooLongError(Exception):
    """The time limit has passed."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise TooLongError after some seconds, between two steps of Python."""

    def stop(*_: object) -> None:
        raise TooLongError(f"more than {seconds} s")

    previous = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


def ask(tool: Callable[[LinearPort], tuple[str | None, str]], port: LinearPort) -> Answer:
    """A fault is an answer too, and the other loops are to be run all the same."""
    start = time.perf_counter()
    try:
        with time_limit(SECONDS), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            says, note = tool(port)
        return Answer(says, time.perf_counter() - start, note)
    except BaseException as fault:  # a panic of a solver written in Rust is no Exception
        if isinstance(fault, (KeyboardInterrupt, SystemExit)):
            raise
        note = f"{type(fault).__name__}: {str(fault).splitlines()[0] if str(fault) else ''}"
        return Answer(None, time.perf_counter() - start, note[:120], failed=True)


# --- the tools ----------------------------------------------------------------------------------------------


def ours(port: LinearPort) -> tuple[str | None, str]:
    """What the kernel accepts first."""
    for proposal in propose_dgu(port):
        if accepts(port, proposal) is not None:
            return {"proved": PASSIVE, "refuted": NOT_PASSIVE}[proposal.status], proposal.rule
    return None, ""


def to_floats(port: LinearPort) -> tuple[Any, Any, Any]:
    return tuple(np.array([[float(x) for x in row] for row in matrix]) for matrix in (port.F, port.B, port.C))  # type: ignore[return-value]


def to_state_space(port: LinearPort) -> Any:
    import control

    F, B, C = to_floats(port)
    return control.ss(F, B, C, np.zeros((len(C), len(C))), remove_useless_states=False)


def control_ispassive(port: LinearPort) -> tuple[str | None, str]:
    import control

    return (PASSIVE if control.ispassive(to_state_space(port)) else NOT_PASSIVE), ""


def input_index(port: LinearPort) -> float:
    from control.passivity import get_input_ff_index

    return float(get_input_ff_index(to_state_space(port)))


def plain_lmi(port: LinearPort) -> tuple[str | None, str]:
    """P >= EPSILON I, P B = C', F'P + P F <= 0, in the units of the loop, with Clarabel's own settings."""
    import cvxpy as cp

    F, B, C = to_floats(port)
    n = len(F)
    P = cp.Variable((n, n), symmetric=True)
    M = F.T @ P + P @ F
    problem = cp.Problem(cp.Minimize(0), [P >> EPSILON * np.eye(n), P @ B == C.T, (M + M.T) / 2 << 0])
    problem.solve(solver=cp.CLARABEL)
    says = {cp.OPTIMAL: PASSIVE, cp.INFEASIBLE: NOT_PASSIVE}.get(problem.status)
    if says is None:
        raise ArithmeticError(problem.status)
    return says, problem.status


def ask_index(port: LinearPort) -> dict[str, Answer]:
    """One run of the index for both readings of it."""
    index: list[float] = []

    def run(port: LinearPort) -> tuple[str | None, str]:
        index.append(input_index(port))
        return (PASSIVE if index[0] >= 0 else NOT_PASSIVE), f"{index[0]:.1e}"

    strict = ask(run, port)
    if strict.failed:
        return {FF_INDEX: strict, FF_TOLERANT: strict}
    tolerant = PASSIVE if index[0] >= -1e-9 else NOT_PASSIVE
    return {FF_INDEX: strict, FF_TOLERANT: Answer(tolerant, strict.seconds, strict.note)}


def installed_peers() -> tuple[str, ...]:
    try:
        import control  # noqa: F401
        import cvxopt  # noqa: F401
    except ImportError:
        return (LMI,)
    return PEERS


def ask_all(port: LinearPort, peers: Iterable[str]) -> dict[str, Answer]:
    answers = {OURS: ask(ours, port)}
    peers = tuple(peers)
    if ISPASSIVE in peers:
        answers |= {ISPASSIVE: ask(control_ispassive, port), **ask_index(port)}
    if LMI in peers:
        answers[LMI] = ask(plain_lmi, port)
    return answers


def compare(number: int, design: Design, peers: Iterable[str] = ()) -> Result:
    """Every tool and the oracle on one loop."""
    start = time.perf_counter()
    truth = decide(design.port)
    seconds = time.perf_counter() - start
    n, m = len(design.port.F), len(design.port.C)
    origin = str(design.numbers.get("origin", design.kind))
    answers = ask_all(design.port, peers)
    return Result(number, design.kind, origin, design.expected, n, m, truth, seconds, answers)


def _compare(task: tuple[int, Design, tuple[str, ...]]) -> Result:
    return compare(*task)


def compare_all(designs: Iterable[Design], peers: tuple[str, ...], jobs: int = 1) -> Iterator[Result]:
    tasks = [(k, design, peers) for k, design in enumerate(designs)]
    if jobs == 1:
        yield from map(_compare, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_compare, tasks, chunksize=4)


# --- the report ---------------------------------------------------------------------------------------------


def percentile(values: list[float], share: float) -> float:
    """The smallest value that at least this share does not exceed.

    >>> percentile([3.0, 1.0, 2.0, 4.0], 0.5)
    2.0
    """
    ordered = sorted(values)
    return ordered[max(0, -(-len(ordered) * round(100 * share) // 100) - 1)]


def to_table(head: list[str], rows: list[list[object]], left: int = 1) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * left + "---:|" * (len(head) - left)]
    for row in rows:
        lines.append("| " + " | ".join(f"{x:.3f}" if isinstance(x, float) else str(x) for x in row) + " |")
    return [*lines, ""]


SUMMARY_HEAD = [
    "tool",
    "right",
    "wrong: passive",
    "wrong: not passive",
    "failed",
    "no answer",
    "semidefinite: passive / not / none",
    "median s",
    "p95 s",
    "max s",
]


def summary_rows(results: list[Result], tools: list[str]) -> list[list[object]]:
    rows: list[list[object]] = []
    for tool in tools:
        asked = [r for r in results if r.definite]
        marks = Counter(r.mark(tool) for r in asked)
        false = Counter(r.answers[tool].says for r in asked if r.mark(tool) == WRONG)
        singular = Counter(r.answers[tool].says for r in results if not r.definite)
        times = [r.answers[tool].seconds for r in results]
        rows.append(
            [
                tool,
                marks[RIGHT],
                false[PASSIVE],
                false[NOT_PASSIVE],
                marks[FAILED],
                marks[NOTHING],
                f"{singular[PASSIVE]} / {singular[NOT_PASSIVE]} / {singular[None]}",
                statistics.median(times),
                percentile(times, 0.95),
                max(times),
            ]
        )
    return rows


def grouped(results: list[Result], key: Callable[[Result], str]) -> dict[str, list[Result]]:
    groups: dict[str, list[Result]] = {}
    for r in results:
        groups.setdefault(key(r), []).append(r)
    return groups


def kind_rows(groups: dict[str, list[Result]], tools: list[str]) -> list[list[object]]:
    rows: list[list[object]] = []
    for name, group in groups.items():
        truths = Counter(r.truth.verdict for r in group)
        row: list[object] = [name, len(group), *(truths[v] for v in (PASSIVE, NOT_PASSIVE, SEMIDEFINITE))]
        times = [r.answers[OURS].seconds for r in group]
        row += [statistics.median(times), percentile(times, 0.95)]
        for tool in tools:
            marks = Counter(r.mark(tool) for r in group if r.definite)
            open_ones = marks[FAILED] + marks[NOTHING]
            row.append(f"{marks[RIGHT]} / {marks[WRONG]} / {open_ones}")
        rows.append(row)
    return rows


def is_fault(r: Result) -> bool:
    """Ours is wrong, or silent by a fault, or speaks where only singular storage functions exist."""
    return r.answers[OURS].failed or r.mark(OURS) == WRONG


def decided_share(results: list[Result]) -> float:
    asked = [r for r in results if r.definite]
    return sum(r.mark(OURS) == RIGHT for r in asked) / max(1, len(asked))


def contradicts(r: Result) -> bool:
    """The oracle and the construction differ."""
    return bool(r.expected and r.expected != r.truth.verdict)


def describe(r: Result) -> str:
    kind = r.kind if r.kind == r.origin else f"{r.kind} ({r.origin})"
    apart = f", {r.truth.uncontrollable} unreached" if r.truth.uncontrollable else ""
    unseen = f", {r.truth.unobservable} unseen" if r.truth.unobservable else ""
    a = r.answers[OURS]
    said = f"; ours: {a.says or 'nothing'} {a.note}".rstrip()
    channels = "1 channel" if r.channels == 1 else f"{r.channels} channels"
    why = "" if r.truth.verdict == PASSIVE else f": {r.truth.reason}"
    text = f"no. {r.number}, {kind}: {r.states} states{apart}{unseen}, {channels}"
    return f"{text}; {r.truth.verdict}{why}{said}; {a.seconds:.2f} s"


def series_rows(peers: tuple[str, ...]) -> tuple[list[str], list[list[object]]]:
    tools = [OURS, *peers]
    rows: list[list[object]] = []
    for k, port in damping_series():
        answers = ask_all(port, peers)
        damping = "0" if k is None else f"-1e-{k:02d}"
        rows.append([damping, decide(port).verdict, *(answers[t].says or "no answer" for t in tools)])
    return ["damping, ohm", "oracle", *tools], rows


def to_report(results: list[Result], peers: tuple[str, ...], seed: int, seconds: float) -> str:
    """Markdown: totals, the kinds, the sizes, the boundary series, and every loop that is open or wrong."""
    tools = [OURS, *peers]
    truths = Counter(r.truth.verdict for r in results)
    oracle = [r.oracle_seconds for r in results]
    faults = [r for r in results if is_fault(r) or contradicts(r)]
    still_open = [r for r in results if r.definite and r.mark(OURS) in (NOTHING, FAILED)]
    lines = [
        "# Random closed loops against the oracle",
        "",
        f"{len(results)} loops, seed {seed}, {seconds:.0f} s. "
        + ", ".join(f"{name}: {truths[name]}" for name in (PASSIVE, NOT_PASSIVE, SEMIDEFINITE))
        + f". The construction decides {sum(bool(r.expected) for r in results)}; the oracle disagrees with "
        f"{sum(map(contradicts, results))} of them.",
        "",
        f"Decided by certify among those with a definite answer: {100 * decided_share(results):.2f} %. "
        f"Wrong: {sum(r.mark(OURS) == WRONG for r in results)}.",
        "",
        "`semidefinite` loops are passive but have no positive definite storage function; certify is to leave them open. "
        "The marks of all tools leave them out.",
        "",
        "Peers: `control.ispassive` and `control.passivity.get_input_ff_index` of python-control (with CVXOPT), and the LMI "
        f"P >= {EPSILON:g} I, P B = C', F'P + PF <= 0 in CVXPY with Clarabel, all with default settings. An exception or "
        f"a time above {SECONDS} s is `failed`, and so is an LMI status other than optimal and infeasible.",
        "",
        *to_table(SUMMARY_HEAD, summary_rows(results, tools)),
        "Without the kinds `error, ...`, whose errors of 10^-3 to 10^-30 are partly lost in double precision:",
        "",
        *to_table(SUMMARY_HEAD, summary_rows([r for r in results if not r.origin.startswith("error")], tools)),
        f"The oracle takes {statistics.median(oracle):.4f} s (median), {max(oracle):.4f} s (max).",
        "",
        "## By kind",
        "",
        "Each tool: right / wrong / failed or no answer, among loops with a definite answer. Times are those of certify.",
        "",
    ]
    head = ["loops", PASSIVE, NOT_PASSIVE, SEMIDEFINITE, "median s", "p95 s", *tools]
    lines += to_table(["kind", *head], kind_rows(grouped(results, lambda r: r.kind), tools))
    by_size = dict(sorted(grouped(results, lambda r: f"{r.states:2d}").items()))
    lines += ["## By number of states", "", *to_table(["states", *head], kind_rows(by_size, tools))]
    rules = Counter(r.answers[OURS].note for r in results if r.answers[OURS].says)
    lines += ["## Rules used", "", *to_table(["rule", "loops"], [[rule, count] for rule, count in rules.most_common()])]
    failures = Counter((t, r.answers[t].note.split(" (")[0]) for r in results for t in tools if r.answers[t].failed)
    rows: list[list[object]] = [[tool, note, count] for (tool, note), count in failures.most_common()]
    lines += ["## Failures", "", *to_table(["tool", "fault", "loops"], rows, left=2)]
    lines += [
        "## Damping that is negative by a hair",
        "",
        "An LC filter with a state feedback whose damping is -10^-k ohm: never passive; passive at zero.",
        "",
        *to_table(*series_rows(peers), left=2 + len(tools)),
    ]
    lines += [f"## Faults: {len(faults)}", "", *(f"- {describe(r)}" for r in faults), ""]
    lines += [f"## Open though decidable: {len(still_open)}", "", *(f"- {describe(r)}" for r in still_open)]
    return "\n".join(lines).rstrip() + "\n"


def show_one(number: int, count: int, seed: int, peers: tuple[str, ...]) -> None:
    design = next(islice(loops(count, seed), number, None))
    result = compare(number, design, peers)
    print(describe(result))
    for name, value in design.numbers.items():
        rows = [" ".join(map(str, row)) for row in value] if isinstance(value, tuple) else [str(value)]
        print(f"{name}:", *rows, sep="\n  ")
    for tool, answer in result.answers.items():
        print(f"{tool}: {answer.says or 'nothing'} {answer.note} {answer.seconds:.3f} s")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--no-peers", action="store_true", help="certify and the oracle only")
    parser.add_argument("--only", type=int, help="the number of one loop")
    parser.add_argument("--report", type=Path, default=Path("reports/random-loops.md"))
    arguments = parser.parse_args()
    peers = () if arguments.no_peers else installed_peers()
    if arguments.only is not None:
        show_one(arguments.only, arguments.count, arguments.seed, peers)
        return 0
    start = time.perf_counter()
    results = []
    for result in compare_all(loops(arguments.count, arguments.seed), peers, arguments.jobs):
        results.append(result)
        if len(results) % 100 == 0:
            print(f"{len(results)} loops, {time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)
    report = to_report(results, peers, arguments.seed, time.perf_counter() - start)
    arguments.report.parent.mkdir(parents=True, exist_ok=True)
    arguments.report.write_text(report)
    sys.stdout.write(report)
    bad = any(is_fault(r) or contradicts(r) for r in results)
    return int(bad or decided_share(results) < WANTED_SHARE)


if __name__ == "__main__":
    sys.exit(main())
