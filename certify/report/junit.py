"""What the gate found as JUnit XML, for the views of test results that CI services have.

A suite for each spec, a case for each claim. A view is red exactly when the gate fails:

| in the gate                                                                         | in JUnit |
| ----------------------------------------------------------------------------------- | -------- |
| a proved claim                                                                      | passed   |
| a claim that counts against the spec: refuted, unknown, or conditional and not allowed | failure |
| a claim that does not: allowed, no worse than in the baseline, or beside the verdict | skipped |
| bad input, one case for each fault; a rejected certificate                          | error    |
| a certificate that is missing, stale or too old where it is asked for               | failure  |

`skipped` would not do for an unknown claim: views show it in yellow or grey, and the job as passed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from certify.diagnostics import DIAGNOSTICS
from certify.gating.results import ALLOWED, BESIDE, FAILED, PASSED, UNCHANGED, GateResult, JudgedClaim, SpecResult
from certify.report.text import claim_lines

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # in XML 1.0
_WHY_SKIPPED = {
    ALLOWED: "rests on an assumption that is allowed",
    UNCHANGED: "no worse than in the baseline",
    BESIDE: "beside the verdict, which does not depend on it",
}


class _Case(NamedTuple):
    name: str
    outcome: str  # "passed", "failure", "error" or "skipped"
    kind: str = ""
    message: str = ""
    text: str = ""


def to_junit(result: GateResult, times: bool = False) -> bytes:
    """The XML, the same again on every run but for the `times` that each spec took, if they are asked for."""
    root = Element("testsuites", name="certify gate")
    totals = {"tests": 0, "failures": 0, "errors": 0}
    for spec in result.specs:
        cases = list(_cases(spec))
        counts = {
            "tests": len(cases),
            "failures": sum(case.outcome == "failure" for case in cases),
            "errors": sum(case.outcome == "error" for case in cases),
        }
        suite = SubElement(root, "testsuite", name=_legal(spec.decision.spec))
        for key, count in counts.items():
            suite.set(key, str(count))
            totals[key] += count
        suite.set("skipped", str(sum(case.outcome == "skipped" for case in cases)))
        if times:
            suite.set("time", f"{spec.decision.seconds:.3f}")
        _add_properties(suite, spec)
        for case in cases:
            _add_case(suite, spec.decision.spec, case)
    for key, count in totals.items():
        root.set(key, str(count))
    indent(root, " ")
    text: str = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _cases(result: SpecResult) -> Iterator[_Case]:
    names: dict[str, int] = {}
    for problem in result.decision.problems:
        fault = problem.fault
        outcome = "failure" if problem.kind == "certificate" else "error"
        help_ = DIAGNOSTICS[fault.code].remedy
        where = f"{problem.file}: {fault.path}" if fault.path else problem.file
        name = f"{fault.code} {fault.path}".rstrip()
        names[name] = names.get(name, 0) + 1
        name += f" ({names[name]})" if names[name] > 1 else ""
        yield _Case(name, outcome, fault.code, fault.message, f"{fault.message}\n --> {where}\n = help: {help_}")
    for entry in result.claims:
        yield _case(entry, result.decision.reasons)


def _case(entry: JudgedClaim, reasons: dict[str, str]) -> _Case:
    claim = entry.claim
    if entry.standing == PASSED:
        return _Case(claim.id, "passed")
    was = f" (was {entry.before})" if entry.before else ""
    kind = claim.rule or entry.reason or claim.status
    text = "\n".join(claim_lines(claim, reasons))
    if entry.standing == FAILED:
        return _Case(claim.id, "failure", kind, f"{claim.status}{was}: {claim.statement}", text)
    return _Case(claim.id, "skipped", kind, f"{claim.status}{was}, {_WHY_SKIPPED[entry.standing]}", text)


def _add_case(suite: Element, spec: str, case: _Case) -> None:
    element = SubElement(suite, "testcase", classname=_legal(spec), name=_legal(case.name))
    if case.outcome != "passed":
        told = SubElement(element, case.outcome, type=_legal(case.kind), message=_legal(case.message))
        told.text = _legal(case.text)


def _add_properties(suite: Element, spec: SpecResult) -> None:
    decision = spec.decision
    known = {
        "outcome": decision.outcome,
        "spec_sha256": decision.sha256,
        "certificate": decision.committed.path,
        "certificate_state": decision.committed.state,
        "certificate_sha256": decision.committed.sha256,
    }
    properties = SubElement(suite, "properties")
    for name, value in known.items():
        if value is not None:
            SubElement(properties, "property", name=name, value=_legal(value))


def _legal(text: str) -> str:
    """Without what XML cannot hold: control characters, and halves of characters that a file name may have."""
    return _ILLEGAL.sub("?", text)
