"""Committed certificates: which file belongs to a spec, and what it says of it as long as it still is about it."""

from __future__ import annotations

import hashlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from certify.exits import EXIT_CODES, USAGE
from certify.gating.policy import Policy
from certify.gating.results import Problem
from certify.inputs import decode_all
from certify.kernel.check import check
from certify.kernel.claims import Verdict
from certify.kernel.errors import Fault, Rejected
from certify.provenance import TIME_FORMAT

SUFFIX = ".cert.json"
ENDINGS = (".toml", ".json")  # of specs
OTHER_SPEC = "K103"  # how the kernel refuses a certificate that is about another text
CLOCKS = 300  # seconds that clocks of different machines may differ by


def certificate_path(spec: str, folder: str | None = None) -> Path:
    """Where the certificate of a spec is: beside it, or in a folder; NAME.cert.json for NAME.toml or NAME.json.

    In a folder the path of the spec may be there too: for grids/a.toml it is DIR/grids/a.cert.json if there is a folder
    DIR/grids, else DIR/a.cert.json.

    >>> certificate_path("grids/a.toml").as_posix()
    'grids/a.cert.json'
    """
    path = Path(spec)
    beside = path.parent / (stem(path.name) + SUFFIX)
    return beside if folder is None else inside(folder, beside)


def inside(folder: str, path: Path) -> Path:
    """The file of this path in a folder if that has the folders of the path, else that of its name alone."""
    relative = os.path.relpath(path)
    whole = Path(folder) / relative
    return whole if not relative.startswith("..") and os.path.isdir(whole.parent) else Path(folder) / path.name


def is_but_for_line_ends(spec: bytes, sha256: Any) -> bool:
    """Whether a certificate is about this spec with the line ends of another system: as git may check it out."""
    lines = spec.replace(b"\r\n", b"\n")
    return sha256 in [hashlib.sha256(text).hexdigest() for text in (lines, lines.replace(b"\n", b"\r\n"))]


def check_committed(spec: bytes, certificate: bytes) -> Verdict | None:
    """What the kernel says by a committed certificate; None if it is about another state of the spec.

    A spec that nothing would be proved of is not passed either: its scenarios count, which the kernel does not read.
    Raises: SpecError with every fault of the spec; Rejected if the certificate does not prove what it says.
    """
    decode_all(spec)
    try:
        return check(spec, certificate)
    except Rejected as rejection:
        if rejection.code != OTHER_SPEC:
            raise
        return None


def stem(name: str) -> str:
    """The name of a spec without its ending, if it has a usual one."""
    for ending in ENDINGS:
        if name.endswith(ending) and name != ending:
            return name.removesuffix(ending)
    return name


def too_old(created: str | None, file: str, policy: Policy, now: datetime | None = None) -> Problem | None:
    """What is wrong with the time that a certificate carries, if the policy asks for one. Nothing proves that time."""
    seconds = policy.max_age_seconds
    if seconds is None:
        return None

    def problem(code: str, message: str) -> Problem:
        exit_code = USAGE if code == "U013" else EXIT_CODES["unknown"]
        kind = "bad input" if code == "U013" else "certificate"
        return Problem(kind, file, Fault(code, "provenance.created", message), exit_code)

    if created is None:
        return problem("U012", "the certificate does not say when it was made, so it may be of any age")
    try:
        made = datetime.strptime(created, TIME_FORMAT).replace(tzinfo=UTC)
    except ValueError:
        return problem("U013", f"not a time such as 2026-01-31T12:00:00Z: {ascii(created)[:60]}")
    age = ((now or datetime.now(UTC)) - made).total_seconds()
    if age < -CLOCKS:
        return problem("U013", f"made in the future: {created}")
    if age > seconds:
        return problem("U012", f"made at {created}, more than {policy.max_age} ago")
    return None
