"""What the gate found, as lines for a terminal and as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from certify.diagnostics import DIAGNOSTICS
from certify.gating.judge import missing_names
from certify.gating.policy import Policy
from certify.gating.results import ALLOWED, FAILED, UNCHANGED, GateResult, Problem, SpecResult
from certify.report.machine import verdict_to_dict
from certify.report.text import paint

SHOWN = 8  # lines about one spec
INDENT = " " * 21
Placed = Callable[[Problem], str]


def render_spec(result: SpecResult, policy: Policy, placed: Placed, colour: bool = False) -> str:
    """One line for a spec, and below it what there is to say about it. `placed`: where in a file a problem is."""
    decision = result.decision
    word = decision.outcome if result.passed or decision.outcome != "certified" else "failed"
    how = {"fresh": "checked", "stale": "proved anew", "none": "proved", "rejected": ""}[decision.committed.state]
    told = f"  ({how})" if decision.verdict and how else ""
    head = f"{paint(word, colour, f'{word:10}')} {round(1000 * decision.seconds):>6} ms  {decision.spec}{told}"
    details = [*_problems(result, placed), *_claims(result, policy), *_aside(result)]
    lines = [_visible(head, colour), *(INDENT + _visible(text) for text in details[:SHOWN])]
    if len(details) > SHOWN:
        lines.append(f"{INDENT}and {len(details) - SHOWN} more (--json has them all)")
    return "\n".join(lines)


def _visible(text: str, colour: bool = False) -> str:
    """A line without what a file's name could do to a terminal; what paints it stays."""
    return "".join(c if c.isprintable() or (colour and c == "\033") else ascii(c)[1:-1] for c in text)


def _problems(result: SpecResult, placed: Placed) -> list[str]:
    lines: list[str] = []
    for problem in result.decision.problems:
        what = f"{problem.fault.code} {problem.fault.path}".rstrip()
        lines.append(f"{placed(problem)}: {what}: {problem.fault.message}")
        if problem.kind != "bad input" or len(result.decision.problems) == 1:
            lines.append(f"= help: {DIAGNOSTICS[problem.fault.code].remedy}")
    return lines


def _claims(result: SpecResult, policy: Policy) -> list[str]:
    lines = []
    for entry in result.of(FAILED):
        was = f", was {entry.before}" if entry.before else ", not in the baseline" if result.compared else ""
        lines.append(f"{entry.claim.status} {entry.claim.id} ({entry.claim.rule or entry.reason}){was}")
    verdict = result.decision.verdict
    if verdict is not None and result.of(FAILED):
        lines += [f"to pass, it needs --allow {name}" for name in missing_names(verdict, policy)]
        if result.decision.committed.state == "fresh" and any(x.claim.status == "unknown" for x in result.of(FAILED)):
            lines.append("by its certificate, which is not searched again; `certify prove SPEC -o CERT` does")
    return lines


def _aside(result: SpecResult) -> list[str]:
    lines = []
    for standing, why in ((UNCHANGED, "excused, no worse than before"), (ALLOWED, "allowed")):
        if entries := result.of(standing):
            listed = ", ".join(f"{entry.claim.status} {entry.claim.id}" for entry in entries[:4])
            more = f" and {len(entries) - 4} more" if len(entries) > 4 else ""
            lines.append(f"{why}: {listed}{more}")
    if result.absent:
        listed = ", ".join(name for name, _ in result.absent[:4])
        lines.append(f"in the baseline, and not any more: {listed}{', ...' if len(result.absent) > 4 else ''}")
    committed = result.decision.committed
    if result.written:
        said = f"; that of an earlier state said {committed.said}" if committed.said else ""
        lines.append(f"wrote {result.written}{said}")
    elif committed.state == "stale" and result.decision.proof is not None:
        if committed.but_for_line_ends:
            lines.append(f"{committed.path} is about this spec with other line ends; `*.toml -text` in .gitattributes")
            lines.append("keeps git from changing them")
        else:
            lines.append(f"{committed.path} is about another state of this spec (stale); --write replaces it")
    return lines


def render_sum(result: GateResult, policy: Policy) -> str:
    """How many passed."""
    passed = sum(entry.passed for entry in result.specs)
    word = "passed" if policy.allow or result.baseline or policy.require else "certified"
    return f"{passed} of {len(result.specs)} {word}"


def to_dict(result: GateResult, policy: Policy, placed: Callable[[Problem], dict[str, int]], times: bool) -> Any:
    """All of it for machines, the same again on every run, but for the `times` if they are asked for."""
    return {
        "exit_code": result.exit_code,
        "baseline": result.baseline,
        "allow": list(policy.allow),
        "warnings": list(result.warnings),
        "results": [_spec_to_dict(entry, policy, placed, times) for entry in result.specs],
    }


def _spec_to_dict(
    result: SpecResult, policy: Policy, placed: Callable[[Problem], dict[str, int]], times: bool
) -> dict[str, Any]:
    decision = result.decision
    found = verdict_to_dict(decision.verdict, decision.reasons) if decision.verdict else {"claims": []}
    for entry, judged in zip(found["claims"], result.claims, strict=True):
        entry["standing"] = judged.standing
        if result.compared:
            entry["before"] = judged.before
    committed = decision.committed
    problems = [
        {
            "kind": problem.kind,
            "code": problem.fault.code,
            "file": problem.file,
            "path": problem.fault.path,
            "message": problem.fault.message,
            **placed(problem),
        }
        for problem in decision.problems
    ]
    lines = [f"{p['code']} {p['path']}: {p['message']}".replace(" : ", ": ") for p in problems]
    return {
        "spec": decision.spec,
        "spec_sha256": decision.sha256,
        "outcome": decision.outcome,
        "exit_code": result.exit_code,
        "detail": [*lines, *_claims(result, policy)],
        "certificate": {
            "path": committed.path,
            "state": committed.state,
            "sha256": committed.sha256,
            "written": result.written,
        },
        "in_baseline": result.compared,
        "absent": [{"id": name, "status": status} for name, status in result.absent],
        "problems": problems,
        "claims": found["claims"],
        "assumptions": found.get("assumptions", []),
        **({"milliseconds": round(1000 * decision.seconds)} if times else {}),
    }
