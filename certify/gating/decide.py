"""Deciding one spec: by its committed certificate if the kernel accepts that, else by proving it.

1. The certificate claims to be about these bytes and the kernel accepts it: that verdict counts, whatever it is. An
   open claim is not searched for again: the same search would find the same.
2. It claims to be about these bytes, and the kernel rejects it: so it stays. To prove anew in silence would hide that
   somebody has committed a false certificate. The same for one that cannot be read, or is of another format.
3. It is about another state of the spec, or there is none: the spec is proved, unless a certificate is required.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from certify.exits import EXIT_CODES, USAGE
from certify.gating.committed import certificate_path, check_committed, is_but_for_line_ends, too_old
from certify.gating.policy import Policy
from certify.gating.results import Committed, Decision, Problem
from certify.inputs import decode_all, read
from certify.kernel.errors import Fault, Rejected, SpecError
from certify.provenance import read_created
from certify.verdicts import read_notes


def decide(spec: str, policy: Policy, progress: Any = None) -> Decision:
    """What is known of the spec in a file. `progress(done, total)` is called while it is proved. Never raises."""
    started = time.perf_counter()

    def decision(digest: str | None, committed: Committed, problems: tuple[Problem, ...], **found: Any) -> Decision:
        given: dict[str, Any] = {"verdict": None, "reasons": {}, "proof": None, **found}
        return Decision(spec, digest, committed, problems=problems, seconds=time.perf_counter() - started, **given)

    try:
        data = read(spec)
    except SpecError as error:
        message = error.faults[0].message
        if os.path.isdir(spec):
            message += "; name the specs in it"
        elif glob.has_magic(spec) and not os.path.lexists(spec):
            message = "no file is called like this pattern"
        return decision(None, Committed(), _bad((Fault("S000", "", message),), spec))
    digest = hashlib.sha256(data).hexdigest()
    committed = Committed()
    path = certificate_path(spec, policy.certificates)
    if os.path.exists(path):
        try:
            certificate = read(path)
        except SpecError as error:
            return decision(digest, Committed("none", str(path)), _bad(error.faults, str(path)))
        committed = Committed("stale", str(path), hashlib.sha256(certificate).hexdigest())
        try:
            verdict = check_committed(data, certificate)
        except SpecError as error:
            return decision(digest, committed, _bad(error.faults, spec))
        except Rejected as rejection:
            committed = replace(committed, state="rejected")
            return decision(digest, committed, (_rejected(rejection, str(path)),))
        document = json.loads(certificate)
        if verdict is not None:
            aged = too_old(read_created(document), str(path), policy)
            committed = replace(committed, state="fresh")
            return decision(
                digest, committed, (aged,) if aged else (), verdict=verdict, reasons=read_notes(certificate)
            )
        said = document["verdict"]
        committed = replace(
            committed,
            said=said if isinstance(said, str) and said in EXIT_CODES else None,
            but_for_line_ends=is_but_for_line_ends(data, document["spec_sha256"]),
        )
    if policy.require:
        missing = _missing(spec, committed, path)
        faults = _all_faults(data)
        return decision(digest, committed, _bad(faults, spec) if faults else (missing,))
    from certify.certificate import prove  # the search, only where something has to be proved

    try:
        proved = prove(data, progress, method=policy.method, stamp=policy.stamp)
    except SpecError as error:
        return decision(digest, committed, _bad(error.faults, spec))
    except Rejected as rejection:  # a defect of the search, stopped by the kernel
        return decision(digest, committed, (_rejected(rejection, spec),))
    return decision(digest, committed, (), verdict=proved.verdict, reasons=proved.notes, proof=proved.data)


def _all_faults(data: bytes) -> tuple[Fault, ...]:
    """Every fault of a spec, those of its scenarios too."""
    try:
        decode_all(data)
    except SpecError as error:
        return error.faults
    return ()


def _bad(faults: tuple[Fault, ...], file: str) -> tuple[Problem, ...]:
    return tuple(Problem("bad input", file, fault, USAGE) for fault in faults)


def _rejected(rejection: Rejected, file: str) -> Problem:
    fault = Fault(rejection.code, rejection.where, rejection.reason)
    return Problem("rejected", file, fault, EXIT_CODES["rejected"])


def _missing(spec: str, committed: Committed, path: Path) -> Problem:
    if committed.state == "stale":
        state = "this spec with other line ends" if committed.but_for_line_ends else "another state of this spec"
        fault = Fault("U011", "spec_sha256", f"{path} is about {state}, and a certificate is required")
    else:
        fault = Fault("U010", "", f"there is no {path}, and a certificate is required")
    return Problem("certificate", spec, fault, EXIT_CODES["unknown"])
