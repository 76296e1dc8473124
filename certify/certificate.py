"""Certificates: built from a spec, checked by the kernel before they are written, renamed into place."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from certify import __version__
from certify.inputs import decode_all
from certify.kernel.check import FORMAT, check
from certify.kernel.claims import Verdict
from certify.search.prove import Progress, find_claims


@dataclass(frozen=True)
class Certificate:
    """A certificate that the kernel has accepted: its bytes, the verdict, and why open claims are open.

    `notes` maps the id of an unknown claim to a code of `certify explain`.
    """

    data: bytes
    verdict: Verdict
    notes: dict[str, str]


def prove(spec: bytes, progress: Progress | None = None, refute: bool = True, method: str | None = None) -> Certificate:
    """Search for proofs of all claims of a spec, write them down and have the kernel check them from the bytes.

    Without `refute` no time is spent on why a DGU with tolerances has no proof. `method`: the only one to prove loads
    by, of `search.methods.METHODS`; without it the cheapest that decides.

    Raises: SpecError if the spec is not well formed; Rejected if the kernel turns the result down, which is a defect
    of the search and never a wrong verdict.
    """
    found = find_claims(decode_all(spec), progress, refute, method)
    notes = found.pop("notes")
    document = {
        "format": FORMAT,
        "spec_sha256": hashlib.sha256(spec).hexdigest(),
        **found,
        "provenance": {
            "certify": __version__,
            "python": platform.python_version(),
            "created": _now(),
            "notes": notes,
        },
    }
    data = to_canonical_json(document)
    return Certificate(data, check(spec, data), notes)


def _now() -> str:
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    moment = datetime.fromtimestamp(int(epoch), UTC) if epoch and epoch.isdecimal() else datetime.now(UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def to_canonical_json(document: dict[str, Any]) -> bytes:
    """The one text of a certificate: keys sorted, one space of indentation, a final newline."""
    return (json.dumps(document, sort_keys=True, indent=1, ensure_ascii=False) + "\n").encode()


def write_atomically(path: Path, data: bytes) -> None:
    """Write beside the target, then rename: a reader never sees half a file. Raises: OSError."""
    with open_atomically(path) as file:
        file.write(data)


@contextmanager
def open_atomically(path: Path) -> Iterator[IO[bytes]]:
    """A file beside the target, renamed to it at the end, removed if anything goes wrong. Raises: OSError."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
