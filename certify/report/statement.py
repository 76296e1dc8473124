"""What the gate found as an in-toto statement with a test-result predicate, not signed.

The subjects are the specs, by their SHA-256; `configuration` names what the result rests on: the certificates, and the
kernel by its version. A test is a claim, named SPEC#CLAIM. Specification: https://in-toto.io/attestation/test-result/v0.1.

Whoever believes a statement needs a signature around it. Signers take the predicate and the file that it is about, and
make the statement again; by their documentation (not tried here), for a statement of one spec, with
`jq .predicate a.intoto.json > predicate.json`:

    cosign attest-blob --predicate predicate.json --type https://in-toto.io/attestation/test-result/v0.1 \\
        --key cosign.key --output-attestation a.dsse.json specs/a.toml

and on GitHub the action `actions/attest` with `predicate-type` and `predicate-path`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from certify import __version__
from certify.gating.results import BESIDE, FAILED, PASSED, GateResult, SpecResult
from certify.kernel.check import FORMAT

STATEMENT = "https://in-toto.io/Statement/v1"
PREDICATE = "https://in-toto.io/attestation/test-result/v0.1"
SUFFIX = ".intoto.json"


def to_statement(specs: Sequence[SpecResult]) -> bytes | None:
    """One statement about these specs; None if none of them could be read, so that there is nothing to speak of."""
    known = [spec for spec in specs if spec.decision.sha256 is not None]
    if not known:
        return None
    tests: dict[str, list[str]] = {"passedTests": [], "warnedTests": [], "failedTests": []}
    for spec in specs:
        for test, word in _tests(spec):
            tests[f"{word}Tests"].append(f"{_name(spec)}#{test}")
    if any(not spec.passed for spec in specs):
        found = "FAILED"
    else:
        found = "WARNED" if tests["warnedTests"] else "PASSED"
    statement = {
        "_type": STATEMENT,
        "subject": [{"name": _name(spec), "digest": {"sha256": spec.decision.sha256}} for spec in known],
        "predicateType": PREDICATE,
        "predicate": {"result": found, "configuration": [_kernel(), *_certificates(known)], **tests},
    }
    return (json.dumps(statement, indent=1, ensure_ascii=False) + "\n").encode("utf-8", "replace")


def to_statements(result: GateResult) -> dict[str, bytes]:
    """A statement for each spec that could be read, by the name of a file; names that come twice are numbered."""
    files: dict[str, bytes] = {}
    for spec in result.specs:
        data = to_statement([spec])
        stem, number = Path(spec.decision.spec).stem, 2
        name = f"{stem}{SUFFIX}"
        while name in files:
            name, number = f"{stem}-{number}{SUFFIX}", number + 1
        if data is not None:
            files[name] = data
    return files


def _name(spec: SpecResult) -> str:
    return Path(spec.decision.spec).as_posix()


def _tests(spec: SpecResult) -> list[tuple[str, str]]:
    """Each test of a spec with how it ended: passed, warned or failed."""
    words = {PASSED: "passed", FAILED: "failed"}
    problems = [(f"{problem.fault.code} {problem.fault.path}".rstrip(), "failed") for problem in spec.decision.problems]
    return problems + [
        (entry.claim.id, words.get(entry.standing, "warned"))
        for entry in spec.claims
        if entry.standing != BESIDE  # no test: the verdict does not depend on it
    ]


def _kernel() -> dict[str, Any]:
    return {
        "name": "certify.kernel",
        "uri": f"pkg:pypi/certify-eip@{__version__}",
        "annotations": {"version": __version__, "certificate_format": FORMAT},
    }


def _certificates(specs: Sequence[SpecResult]) -> list[dict[str, Any]]:
    """The certificates that verdicts rest on: committed ones that hold, or those written now."""
    found = []
    for spec in specs:
        decision = spec.decision
        if decision.verdict is None:
            continue
        if decision.proof is not None:
            path = spec.written
            digest: str | None = hashlib.sha256(decision.proof).hexdigest()
        else:
            path, digest = decision.committed.path, decision.committed.sha256
        entry: dict[str, Any] = {
            "name": Path(path).as_posix() if path else f"certificate of {_name(spec)}",
            "digest": {"sha256": digest},
            "mediaType": "application/json",
            "annotations": {"spec": _name(spec), "state": "written" if spec.written else _state(spec)},
        }
        found.append(entry)
    return found


def _state(spec: SpecResult) -> str:
    return "proved in this run, not kept" if spec.decision.proof is not None else spec.decision.committed.state
