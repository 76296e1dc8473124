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
from json.encoder import encode_basestring
from pathlib import Path
from typing import IO, Any

from certify import __version__
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.check import FORMAT, check
from certify.kernel.claims import Verdict
from certify.search.earlier import Earlier
from certify.search.prove import Progress, find_claims

MAX_NESTING = 12  # levels of a certificate that are written without `json`


@dataclass(frozen=True)
class Certificate:
    """A certificate that the kernel has accepted: its bytes, the verdict, and why open claims are open.

    `notes` maps the id of an unknown claim to a code of `certify explain`.
    """

    data: bytes
    verdict: Verdict
    notes: dict[str, str]


def prove(
    spec: SpecSource,
    progress: Progress | None = None,
    refute: bool = True,
    method: str | None = None,
    earlier: Earlier | None = None,
) -> Certificate:
    """Search for proofs of all claims of a spec, write them down and have the kernel check them from the bytes.

    `spec`: its text in bytes, a path, a mapping, or what is built in Python: see `certify.inputs.to_bytes`. Without `refute` no time is spent on why a DGU with tolerances has no proof. `method`: the only one to prove loads
    by, of `search.methods.METHODS`; without it the cheapest that decides. `earlier`: proofs to try first.

    Raises: SpecError if the spec is not well formed; Rejected if the kernel turns the result down, which is a defect
    of the search and never a wrong verdict.
    """
    text = to_bytes(spec)
    found = find_claims(decode_all(text), progress, refute, method, earlier)
    notes = found.pop("notes")
    data = write_certificate(text, found, notes)
    return Certificate(data, check(text, data), notes)


def write_certificate(spec: bytes, found: dict[str, Any], notes: dict[str, str], **more: str) -> bytes:
    """The text of a certificate about this spec: `found` has its claims, proofs, ledger and verdict.

    Nothing is checked here. `more` goes into its provenance.
    """
    document = {
        **found,
        "format": FORMAT,
        "spec_sha256": hashlib.sha256(spec).hexdigest(),
        "provenance": {
            "certify": __version__,
            "python": platform.python_version(),
            "created": _now(),
            "notes": notes,
            **more,
        },
    }
    return to_canonical_json(document)


def _now() -> str:
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    moment = datetime.fromtimestamp(int(epoch), UTC) if epoch and epoch.isdecimal() else datetime.now(UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def to_canonical_json(document: dict[str, Any]) -> bytes:
    """The one text of a certificate: keys sorted, one space of indentation, a final newline.

    That of `json.dumps(document, sort_keys=True, indent=1, ensure_ascii=False)`, in half the time.
    """
    return (_to_json(document, "\n") + "\n").encode()


def _to_json(value: Any, start: str) -> str:
    """The text of a value; `start` is a line break and the indentation of the line that the value stands in.

    Nearly all of a certificate is text, in tables and lists: that is written without a call for each. What is nested
    deeper than any proof is left to `json`, which takes less of the stack.
    """
    if len(start) > MAX_NESTING:
        return json.dumps(value, sort_keys=True, indent=1, ensure_ascii=False).replace("\n", start)
    inner = start + " "
    if isinstance(value, dict) and value:
        entries = [
            f"{encode_basestring(key)}: {encode_basestring(x) if type(x) is str else _to_json(x, inner)}"
            for key, x in sorted(value.items())
        ]
        return f"{{{inner}{f',{inner}'.join(entries)}{start}}}"
    if isinstance(value, list | tuple) and value:
        entries = [encode_basestring(x) if type(x) is str else _to_json(x, inner) for x in value]
        return f"[{inner}{f',{inner}'.join(entries)}{start}]"
    return json.dumps(value, ensure_ascii=False)


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
