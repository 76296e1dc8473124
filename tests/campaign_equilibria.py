"""Random networks: what certify says about their equilibria against the oracle, island by island.

    python tests/campaign_equilibria.py [--count 300] [--seed 1] [--report reports/random-networks.md]
    python tests/campaign_equilibria.py --only 17   # one network, and what everyone says
    python tests/campaign_equilibria.py --oracle    # the oracle alone, against constructions and its closed form

A claim `equilibrium/NODE` that is proved is right if an equilibrium of the oracle lies within the radius of the stated
voltages, with every load inside its band, every terminal voltage within its limits and every stated current where it
belongs; and, if it says so, if no other equilibrium known to the oracle has every load inside its band. One that is
refuted is right if the oracle knows no equilibrium inside bands and limits. Exit code 1 if a claim is wrong, certify
fails, or the oracle contradicts a construction. Without any such claim there is nothing to judge, and the exit code is 0.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path

from mpmath import mp, mpc, mpf

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from certify.certificate import prove
from certify.kernel.claims import Claim
from certify.kernel.errors import SpecError
from tests.campaign_loops import percentile, time_limit, to_table
from tests.equilibrium_oracle import (
    DIGITS,
    Equilibria,
    Network,
    Rational,
    Solution,
    closed_form,
    find_equilibria,
    find_near,
    impedance,
    in_bands,
    in_limits,
    read_network,
    solution_at,
    to_mpc,
    to_mpf,
)
from tests.network_cases import RANDOM, Case, network_case

SECONDS = 300  # for each network
UNIQUE, LOCAL, UNKNOWN, REFUTED, WRONG = "proved, the only one", "proved, only locally", "unknown", "refuted", "false"
ABSENT, FAILED, UNREAD = "no claim", "failed", "spec not read"
MARKS = (UNIQUE, LOCAL, UNKNOWN, REFUTED, WRONG, FAILED, UNREAD, ABSENT)
SEVERAL, ONE, OUTSIDE, NOTHING = "several inside", "one inside", "none inside", "none at all"
RADIUS, STRONG = "radius of the proof", "strong-monotonicity"
SMALL = mpf("1e-6")  # the error of a stated current that may be due to rounding, relative to the largest
EXACT = mpf("1e-30")  # two equilibria closer than this, relative to their size, are one


@dataclass(frozen=True)
class Result:
    """One island. `share`: its loads relative to the nose that the oracle met; `truth`: equilibria inside bands and limits."""

    number: int
    kind: str
    island: str
    nodes: int
    ratios: tuple[float, ...]
    share: float | None
    truth: str
    mark: str
    note: str
    quarrel: str
    certify_seconds: float
    oracle_seconds: float


# --- judging --------------------------------------------------------------------------------------------------


def stated(network: Network, claim: Claim) -> tuple[Fraction, bool, dict[str, Rational]]:
    """The radius, whether there is no other one, and all pairs (d, q) of a proved claim by what they are.

    Raises: ValueError if a fact is missing, has another unit, or the first is not the radius.
    """
    if claim.facts[0][0] != RADIUS:
        raise ValueError(f"the first fact is {claim.facts[0][0]}")
    facts = {name: (value, unit) for name, value, unit in claim.facts}
    names = [(f"voltage at node {node.name}", "V") for node in network.nodes]
    names += [(f"current in line {line.name}", "A") for line in network.lines]
    for node in network.nodes:
        if node.dgu:
            names += [(f"current of the DGU at node {node.name}", "A")]
            names += [(f"terminal voltage of the DGU at node {node.name}", "V")]
    pairs = {}
    for name, unit in names:
        both = [facts.get(f"{name}, {axis}") for axis in "dq"]
        if any(x is None or x[1] != unit for x in both):
            raise ValueError(f"no {name} in {unit}")
        pairs[name] = (both[0][0], both[1][0])  # type: ignore[index]
    return facts[RADIUS][0], claim.rule == STRONG, pairs


def distance(a: dict[str, mpc], b: dict[str, mpc]) -> mpf:
    """The largest at a node, in volt."""
    with mp.workdps(DIGITS):
        return mpf(max(abs(a[name] - b[name]) for name in a))


def judge_proved(network: Network, claim: Claim, found: Equilibria) -> tuple[str, str]:
    """The mark of a proved claim, and what is wrong with it."""
    try:
        rho, only, pairs = stated(network, claim)
    except ValueError as fault:
        return WRONG, f"facts: {fault}"
    with mp.workdps(DIGITS):
        here = {node.name: to_mpc(pairs[f"voltage at node {node.name}"]) for node in network.nodes}
        near = find_near(network, here)
        candidates = [*found.solutions(), *([near] if near else [])]
        if not candidates:
            return WRONG, "the oracle finds no equilibrium at all"
        truth = min(candidates, key=lambda solution: distance(solution.voltages, here))
        off = distance(truth.voltages, here)
        if off > to_mpf(rho) + EXACT * max(map(abs, here.values())):
            return WRONG, f"the nearest equilibrium is {mp.nstr(off, 5)} V away, not {float(rho):.5g} V"
        if not in_bands(network, truth.voltages):
            return WRONG, "the equilibrium has a load outside its band"
        if not in_limits(network, truth):
            return WRONG, "the equilibrium needs a terminal voltage beyond its limits"
        size = mp.sqrt(mp.fsum(abs(V) ** 2 for V in here.values()))
        for other in islice(found.voltages(only_in_bands=True), 8) if only else ():
            apart = distance(other, truth.voltages)
            if apart > EXACT * size:
                return WRONG, f"another equilibrium inside the bands is {mp.nstr(apart, 5)} V away"
        wrong = figures_fault(network, truth, pairs, to_mpf(rho))
    return (WRONG, wrong) if wrong else (UNIQUE if only else LOCAL, "")


def figures_fault(network: Network, truth: Solution, pairs: dict[str, Rational], rho: mpf) -> str:
    """Which stated current or terminal voltage is further off than voltages within rho and some rounding explain."""
    inner = {node.name: mpf(0) for node in network.nodes}  # the admittances at each node: how fast its current changes
    for line in network.lines:
        y = 1 / abs(impedance(network.w0, line.resistance, line.inductance))
        name = f"current in line {line.name}"
        off = abs(to_mpc(pairs[name]) - truth.line_currents[line.name])
        size = y * (abs(truth.voltages[line.start]) + abs(truth.voltages[line.end]))
        if off > 2 * y * rho + SMALL * size:
            return f"{name} is off by {mp.nstr(off, 5)} A"
        for end in (line.start, line.end):
            inner[end] += y
    for node in network.nodes:
        if node.dgu:
            Z = abs(impedance(network.w0, node.dgu.resistance, node.dgu.inductance))
            slope = 1 / Z if node.dgu.held else inner[node.name]
            off = abs(to_mpc(pairs[f"current of the DGU at node {node.name}"]) - truth.dgu_currents[node.name])
            size = slope * abs(truth.voltages[node.name])
            if off > 2 * slope * rho + SMALL * (size + abs(truth.dgu_currents[node.name])):
                return f"the current of the DGU at node {node.name} is off by {mp.nstr(off, 5)} A"
            u = truth.terminal_voltages[node.name]
            off = abs(to_mpc(pairs[f"terminal voltage of the DGU at node {node.name}"]) - u)
            if off > 2 * (1 + slope * Z) * rho + SMALL * (abs(u) + size * Z):
                return f"the terminal voltage of the DGU at node {node.name} is off by {mp.nstr(off, 5)} V"
    return ""


def truth_about(network: Network, found: Equilibria) -> str:
    inside = [s for s in found.solutions(16, only_in_bands=True) if in_limits(network, s)]
    if inside:
        return SEVERAL if len(inside) > 1 else ONE
    return OUTSIDE if found.count else NOTHING


def judge(network: Network, claim: Claim | None, found: Equilibria, truth: str) -> tuple[str, str]:
    """The mark of the claim about an island, and why."""
    if claim is None:
        return ABSENT, ""
    if claim.status == "proved":
        return judge_proved(network, claim, found)
    if claim.status == "refuted":
        wrong = truth in (SEVERAL, ONE)
        return (WRONG, "refuted, but the oracle has one inside bands and limits") if wrong else (REFUTED, "")
    return UNKNOWN, ""


def quarrel_with(case: Case, network: Network, found: Equilibria) -> str:
    """How the oracle contradicts the construction of a planted case, or its own closed form."""
    if case.closed:
        exact = closed_form(network)
        if len(exact) != case.solutions:
            return f"closed form: {len(exact)} equilibria, construction: {case.solutions}"
        if found.count != len(exact):
            return f"closed form: {len(exact)} equilibria, search: {found.count}"
        lone = next(node.name for node in network.nodes if not node.fixed)
        for V, solution in zip(exact, found.solutions(2), strict=False):
            if abs(V - solution.voltages[lone]) > EXACT * abs(V):
                return "the closed form and the search differ"
    if case.voltages is not None:
        planted = {node.name: to_mpc(case.voltages[node.name]) for node in network.nodes}
        with mp.workdps(DIGITS):
            if solution_at(network, planted).residual > EXACT:
                return "what was planted is no equilibrium"
            size = mp.sqrt(mp.fsum(abs(V) ** 2 for V in planted.values()))
            if all(distance(V, planted) > EXACT * size for V in islice(found.voltages(), 256)):
                return "what was planted is not found"
    share = case.share
    if case.kind == RANDOM and share and share < 1 and found.high is None:
        return "no equilibrium of high voltage below the nose"
    if any(solution.residual > mpf("1e-35") for solution in found.solutions(4)):
        return "a residual above 1e-35"
    return ""


# --- asking ---------------------------------------------------------------------------------------------------


def ask(case: Case) -> tuple[dict[str, Claim], str, str, float]:
    """The claims about equilibria by their node; or FAILED or UNREAD, and why; and the time in seconds."""
    start = time.perf_counter()
    try:
        with time_limit(SECONDS):
            verdict = prove(case.data).verdict
    except SpecError as fault:
        return {}, UNREAD, str(fault).splitlines()[0][:120], time.perf_counter() - start
    except Exception as fault:
        return {}, FAILED, f"{type(fault).__name__}: {fault}"[:120], time.perf_counter() - start
    prefix = "equilibrium/"
    claims = {claim.id.removeprefix(prefix): claim for claim in verdict.claims if claim.id.startswith(prefix)}
    return claims, "", "", time.perf_counter() - start


def compare(case: Case, seed: int, oracle_only: bool = False) -> Iterator[Result]:
    """The islands of a network, one by one."""
    claims, trouble, why, seconds = ({}, "", "", 0.0) if oracle_only else ask(case)
    for island in read_network(case.document).islands():
        start = time.perf_counter()
        found = find_equilibria(island, seed)
        truth = truth_about(island, found)
        name = island.nodes[0].name
        mark, note = (trouble, why) if trouble else judge(island, claims.get(name), found, truth)
        quarrel = quarrel_with(case, island, found)
        taken = time.perf_counter() - start
        ratios = tuple(float(x.resistance / (island.w0 * x.inductance)) for x in island.lines)
        share, size = found.share, len(island.nodes)
        yield Result(case.number, case.kind, name, size, ratios, share, truth, mark, note, quarrel, seconds, taken)


# --- the report -----------------------------------------------------------------------------------------------


def share_bin(r: Result) -> str:
    """How near the nose.

    >>> share_bin(Result(0, "", "", 2, (), 0.95, "", "", "", "", 0, 0))
    '0.9 to 0.97'
    """
    if r.share is None:
        return "far off, or no nose"
    ends = (0.3, 0.7, 0.9, 0.97, 0.99, 0.997, 1)
    for low, high in zip((0, *ends), ends, strict=False):
        if r.share <= high:
            return f"{low} to {high}"
    return "beyond 1"


def ratio_bin(r: Result) -> str:
    """R/X of the lines."""
    if not r.ratios:
        return "no lines"
    if max(r.ratios) > 3 * min(r.ratios):
        return "mixed"
    middle = statistics.geometric_mean(r.ratios)
    return next((f"{low} to {high}" for low, high in ((0.1, 0.3), (0.3, 1), (1, 3)) if middle <= high), "3 to 10")


def size_bin(r: Result) -> str:
    ends = ((1, 2), (3, 6), (7, 30), (31, 120))
    return next((f"{low:03} to {high:03} nodes" for low, high in ends if r.nodes <= high), "121 to 500 nodes")


def rows_by(results: Iterable[Result], key: Callable[[Result], str]) -> list[list[object]]:
    """A row for each group: of those with an equilibrium inside bands and limits, how many are proved."""
    groups: dict[str, list[Result]] = {}
    for r in results:
        groups.setdefault(key(r), []).append(r)
    rows: list[list[object]] = []
    for name, group in sorted(groups.items()):
        inside = [r for r in group if r.truth in (ONE, SEVERAL)]
        proved = sum(r.mark in (UNIQUE, LOCAL) for r in inside)
        share = f"{100 * proved / len(inside):.1f} %" if inside else ""
        marks = Counter(r.mark for r in group)
        rows.append([name, len(group), len(inside), *(marks[mark] for mark in MARKS), share])
    return rows


HEAD = ["islands", "one inside", *MARKS, "share proved"]


def describe(r: Result) -> str:
    share = "no nose met" if r.share is None else f"share {r.share:.6g}"
    said = f"{r.mark}{': ' * bool(r.note)}{r.note}"
    return f"no. {r.number}, {r.kind}, island of {r.island}, {r.nodes} nodes, {share}, {r.truth}; {said}"


def to_report(results: list[Result], seed: int, seconds: float) -> str:
    """Markdown: the totals, the bins, and every claim that is wrong, failed or open."""
    marks = Counter(r.mark for r in results)
    times = [r.certify_seconds for r in {r.number: r for r in results}.values()]
    oracle = [r.oracle_seconds for r in results]
    inside = [r for r in results if r.truth in (ONE, SEVERAL)]
    proved = sum(r.mark in (UNIQUE, LOCAL) for r in inside)
    quarrels = [r for r in results if r.quarrel]
    wrong = [r for r in results if r.mark in (WRONG, FAILED, UNREAD)]
    still_open = [r for r in inside if r.mark == UNKNOWN]
    everything = rows_by(results, lambda _: "all")
    lines = [
        "# Equilibria of random networks against the oracle",
        "",
        f"{len({r.number for r in results})} networks with {len(results)} islands, seed {seed}, {seconds:.0f} s.",
        "",
        f"The oracle, in {DIGITS} digits, has an equilibrium inside all bands and limits for {len(inside)} islands, more than "
        f"one for {sum(r.truth == SEVERAL for r in results)}, only such outside them for "
        f"{sum(r.truth == OUTSIDE for r in results)}, and none for {sum(r.truth == NOTHING for r in results)}. It contradicts "
        f"a construction or its own closed form in {len(quarrels)} cases.",
        "",
        f"Proved: {proved} of {len(inside)} ({100 * proved / max(1, len(inside)):.1f} %), {marks[UNIQUE]} as the only one in "
        f"the bands. Refuted: {marks[REFUTED]}. Unknown: {marks[UNKNOWN]}. False: {marks[WRONG]}. Failed: {marks[FAILED]}.",
        "",
        f"certify takes {statistics.median(times):.2f} s for a network (median), {percentile(times, 0.95):.2f} s (p95), "
        f"{max(times):.2f} s (max), all its claims together; the oracle {statistics.median(oracle):.2f} s, {max(oracle):.2f} s "
        "(max) for an island.",
        "",
        "`one inside`: islands with an equilibrium inside bands and limits; the share proved is that of those.",
        "",
        *to_table(["kind", *HEAD], [*rows_by(results, lambda r: r.kind), *everything]),
        "## By nearness to the nose",
        "",
        "The static loads as a share of the level at which the equilibrium that they reach when growing from nothing ends.",
        "",
        *to_table(["share", *HEAD], rows_by(results, share_bin)),
        "## By R/X of the lines",
        "",
        *to_table(["R/X", *HEAD], rows_by(results, ratio_bin)),
        "## By size",
        "",
        *to_table(["size", *HEAD], rows_by(results, size_bin)),
        "## By what the oracle knows",
        "",
        *to_table(["equilibria", *HEAD], rows_by(results, lambda r: r.truth)),
        f"## False, failed or not read: {len(wrong)}",
        "",
        *(f"- {describe(r)}" for r in wrong),
        "",
        f"## Contradictions of the oracle: {len(quarrels)}",
        "",
        *(f"- {r.quarrel}: {describe(r)}" for r in quarrels),
        "",
        f"## Unknown though there is one inside: {len(still_open)}",
        "",
        *(f"- {describe(r)}" for r in still_open),
    ]
    return "\n".join(lines).rstrip() + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="the number of one network")
    parser.add_argument("--oracle", action="store_true", help="do not ask certify")
    parser.add_argument("--report", type=Path, help="write the report to this file")
    arguments = parser.parse_args()
    start = time.perf_counter()
    numbers = range(arguments.count) if arguments.only is None else [arguments.only]
    results: list[Result] = []
    for done, number in enumerate(numbers, 1):
        results += compare(network_case(number, arguments.seed), arguments.seed, arguments.oracle)
        if done % 20 == 0:
            wrong = sum(r.mark in (WRONG, FAILED) or bool(r.quarrel) for r in results)
            print(f"{done} networks, {time.perf_counter() - start:.0f} s, {wrong} faults", file=sys.stderr, flush=True)
    if arguments.only is not None:
        print(*(describe(r) + (f"; {r.quarrel}" if r.quarrel else "") for r in results), sep="\n")
    asked = any(r.mark in (UNIQUE, LOCAL, UNKNOWN, REFUTED, WRONG) for r in results)
    if not asked:
        marks = Counter(r.mark for r in results)
        listed = ", ".join(f"{mark}: {count}" for mark, count in marks.items())
        print(f"no claim equilibrium/.. among {len(results)} islands ({listed}): nothing to judge")
        print(*(f"contradiction: {r.quarrel}: {describe(r)}" for r in results if r.quarrel), sep="\n")
        return int(any(r.quarrel or r.mark == FAILED for r in results))
    report = to_report(results, arguments.seed, time.perf_counter() - start)
    if arguments.report:
        arguments.report.parent.mkdir(parents=True, exist_ok=True)
        arguments.report.write_text(report)
    if arguments.only is None:
        sys.stdout.write(report)
    return int(any(r.mark in (WRONG, FAILED, UNREAD, ABSENT) or r.quarrel for r in results))


if __name__ == "__main__":
    sys.exit(main())
