"""What the gate found as SARIF 2.1.0, for code scanning and editors: each claim and fault with its file and line.

| in the gate                                              | kind          | level   |
| -------------------------------------------------------- | ------------- | ------- |
| a proved claim                                           | pass          | none    |
| a refuted claim that counts against the spec             | fail          | error   |
| a refuted claim that does not                            | fail          | note    |
| an unknown claim                                         | open          | none    |
| a conditional claim                                      | review        | none    |
| a claim beside the verdict that is not proved            | informational | none    |
| bad input, a rejected certificate                        | fail          | error   |
| a certificate that is missing, stale or too old          | fail          | error   |
| a claim of the baseline that is made no more             | notApplicable | none    |

GitHub's code scanning makes an alert of every result, whatever its kind: there `kinds` should be fail, open and review.
Of a result it uses `message`, the first of `locations` and the fingerprint `primaryLocationLineHash`. It takes 25,000
results of a run and shows 5,000: of more, those that fail are kept.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from certify import __version__
from certify.diagnostics import DIAGNOSTICS, explain
from certify.gating.results import BESIDE, FAILED, GateResult, JudgedClaim, SpecResult
from certify.locations import TOP, Locations, Position, locate
from certify.report.places import path_of, used_by
from certify.report.text import claim_lines

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
KINDS = ("fail", "open", "review", "pass", "informational", "notApplicable")
ROOT = "%SRCROOT%"
MOST = 25_000  # results of a run that code scanning takes
LONGEST = 1000  # characters of a description: 1,024 are taken
UNEXPLAINED = "P205"
Result = dict[str, Any]


def to_sarif(result: GateResult, kinds: Collection[str] = KINDS, root: Path | None = None) -> bytes:
    """The log, the same again on every run. `root`: what paths are relative to, by default that of the repository."""
    base = (root or source_root()).resolve()
    _uri.cache_clear()  # another folder may be the current one now
    results: list[Result] = []
    for spec in result.specs:
        locations = _locations(spec)
        found = [*_problems(spec, locations, base), *_claims(spec, locations, base), *_absent(spec, base)]
        if result.baseline is None:
            for entry in found:
                entry.pop("baselineState")
        results += [entry for entry in found if entry["kind"] in kinds]
    left_out = max(0, len(results) - MOST)
    if left_out:  # what fails comes first
        order = sorted(range(len(results)), key=lambda k: KINDS.index(results[k]["kind"]))
        results = [results[k] for k in sorted(order[:MOST])]
    codes = list(dict.fromkeys(entry["ruleId"] for entry in results))
    for entry in results:
        entry["ruleIndex"] = codes.index(entry["ruleId"])
    driver = {"name": "certify", "semanticVersion": __version__, "version": __version__}
    run = {
        "tool": {"driver": {**driver, "rules": [_rule(code) for code in codes]}},
        "automationDetails": {"id": "certify/gate/"},
        "invocations": [_invocation(result.exit_code, left_out)],
        "originalUriBaseIds": {ROOT: {"description": {"text": "the root of the repository"}}},
        "columnKind": "unicodeCodePoints",
        "artifacts": _artifacts(result, base),
        "results": results,
    }
    log = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return (json.dumps(log, indent=1, ensure_ascii=False) + "\n").encode("utf-8", "replace")


def _invocation(exit_code: int, left_out: int) -> Result:
    invocation: Result = {"executionSuccessful": exit_code not in (2, 4), "exitCode": exit_code}
    if left_out:
        text = f"{left_out} results are left out: a run has at most {MOST}."
        invocation["toolExecutionNotifications"] = [{"level": "warning", "message": {"text": text}}]
    return invocation


def source_root() -> Path:
    """The nearest folder around this one that has a .git; without one this folder itself."""
    here = Path.cwd()
    return next((folder for folder in (here, *here.parents) if (folder / ".git").exists()), here)


def _locations(spec: SpecResult) -> Locations | None:
    """The places of a spec, if its file still is what was judged."""
    try:
        data = Path(spec.decision.spec).read_bytes()
    except (OSError, ValueError):
        return None
    return Locations(data) if hashlib.sha256(data).hexdigest() == spec.decision.sha256 else None


def _problems(spec: SpecResult, locations: Locations | None, base: Path) -> Iterator[Result]:
    for problem in spec.decision.problems:
        fault = problem.fault
        where = TOP
        if locations is not None and problem.file == spec.decision.spec and problem.kind == "bad input":
            where = locate(locations, fault) or TOP
        text = f"{fault.path}: {fault.message}" if fault.path else fault.message
        message = (
            f"{text}{'' if text.endswith(('.', '?', '!')) else '.'}\nWhat to try: {DIAGNOSTICS[fault.code].remedy}."
        )
        place = _location(problem.file, where, base)
        yield _result(fault.code, "fail", "error", message, place, (_uri(problem.file, base)[0], fault.path), "new")


def _claims(spec: SpecResult, locations: Locations | None, base: Path) -> Iterator[Result]:
    file = spec.decision.spec
    for entry in spec.claims:
        claim = entry.claim
        path = path_of(claim.id, locations) if locations else ""
        where = locations.of(path) if locations and path else TOP
        kind, level = _kind(entry)
        code = claim.rule or entry.reason or UNEXPLAINED
        result = _result(
            code if code in DIAGNOSTICS else UNEXPLAINED,
            kind,
            level,
            _message(entry, spec.decision.reasons),
            _location(file, where, base, claim.id),
            (_uri(file, base)[0], claim.id),
            _state(entry),
        )
        if locations and kind != "pass" and (used := used_by(claim.id, locations)):
            result["relatedLocations"] = [
                {"id": number, **_location(file, locations.of(path), base), "message": {"text": what}}
                for number, (path, what) in enumerate(used, 1)
            ]
        result["properties"] = {"status": claim.status, "standing": entry.standing}
        yield result


def _absent(spec: SpecResult, base: Path) -> Iterator[Result]:
    file = spec.decision.spec
    for name, status in spec.absent:
        message = f"{name}, which was {status} in the baseline, is claimed no more."
        place = _location(file, TOP, base, name)
        yield _result(UNEXPLAINED, "notApplicable", "none", message, place, (_uri(file, base)[0], name), "absent")


def _kind(entry: JudgedClaim) -> tuple[str, str]:
    status = entry.claim.status
    if status == "proved":
        return "pass", "none"
    if entry.standing == BESIDE:
        return "informational", "none"
    if status == "refuted":
        return "fail", "error" if entry.standing == FAILED else "note"
    return ("review" if status == "conditional" else "open"), "none"


def _message(entry: JudgedClaim, reasons: dict[str, str]) -> str:
    claim = entry.claim
    if claim.status == "proved":
        return f"{claim.id} is proved: {claim.statement}."
    lines = claim_lines(claim, reasons)[1:]
    standing = "" if entry.standing == FAILED else f" It does not count against the spec: {entry.standing}."
    return "\n".join([f"{claim.id} is {claim.status}: {claim.statement}.{standing}", *lines])


def _state(entry: JudgedClaim) -> str:
    if entry.before is None:
        return "new"
    return "unchanged" if entry.before == entry.claim.status else "updated"


def _result(
    code: str, kind: str, level: str, message: str, location: Result, identity: tuple[str, str], state: str
) -> Result:
    # Of what does not change when lines move, other parts are renamed or numbers are mended.
    digest = hashlib.sha256("\n".join((code, *identity)).encode("utf-8", "replace")).hexdigest()[:32]
    return {
        "ruleId": code,
        "kind": kind,
        "level": level,
        "message": {"text": message},
        "locations": [location],
        "partialFingerprints": {"primaryLocationLineHash": f"{digest}:1", "claim/v1": digest},
        "baselineState": state,
    }


def _location(file: str, where: Position, base: Path, claim: str | None = None) -> Result:
    uri, inside = _uri(file, base)
    artifact = {"uri": uri, "uriBaseId": ROOT} if inside else {"uri": uri}
    region = {
        "startLine": where.line,
        "startColumn": where.column,
        "endLine": where.line,
        "endColumn": max(where.end_column, where.column + 1),
    }
    logical = {"logicalLocations": [{"fullyQualifiedName": claim}]} if claim else {}
    return {"physicalLocation": {"artifactLocation": artifact, "region": region}, **logical}


@lru_cache(maxsize=256)
def _uri(file: str, base: Path) -> tuple[str, bool]:
    """A file relative to the root, links followed, or its whole URI if it is not in there."""
    path = Path(os.path.realpath(file))
    inside = path.is_relative_to(base)
    relative = path.relative_to(base).as_posix() if inside else path.as_posix()
    text = quote(os.fsencode(relative))
    return (text if inside else f"file://{text}"), inside


def _artifacts(result: GateResult, base: Path) -> list[Result]:
    """The files that were read, with their hashes."""
    files: dict[str, str | None] = {}
    for spec in result.specs:
        decision = spec.decision
        files.setdefault(decision.spec, decision.sha256)
        if decision.committed.path is not None:
            files.setdefault(decision.committed.path, decision.committed.sha256)
    artifacts = []
    for file, digest in files.items():
        uri, inside = _uri(file, base)
        location = {"uri": uri, "uriBaseId": ROOT} if inside else {"uri": uri}
        artifacts.append({"location": location, **({"hashes": {"sha-256": digest}} if digest else {})})
    return artifacts


def _rule(code: str) -> Result:
    entry = DIAGNOSTICS[code]
    failing = code[0] in "SUKT" and code[1:].isdecimal()
    return {
        "id": code,
        "name": "".join(word.capitalize() for word in entry.title.replace("-", " ").split() if word.isalnum()),
        "shortDescription": {"text": entry.title[:LONGEST]},
        "fullDescription": {"text": entry.why[:LONGEST]},
        "help": {"text": explain(code)},
        "defaultConfiguration": {"level": "error" if failing else "warning"},
        "properties": {"tags": ["stability", "microgrid"], "precision": "very-high"},
    }
