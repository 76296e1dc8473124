"""Which certificates the kernel of this machine has accepted, remembered between runs.

An entry is a file with the bytes of a spec. Its name is a hash of the checker (its sources and the Python that runs
them), the spec and the certificate, so an entry says: exactly this checker has accepted exactly this certificate of
exactly this spec. Nothing is ever looked up by a path or a time. What is remembered saves `prove --reuse` the work of
checking again what has not changed; `check` never looks here.

The folder is $CERTIFY_CACHE, else $XDG_CACHE_HOME/certify, else ~/.cache/certify; a CERTIFY_CACHE that is empty or no
absolute path turns all of this off. Whoever may write there is believed: the user alone, which is checked. Failing to
remember is no error.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import stat
import sys
from functools import cache
from pathlib import Path

import certify.kernel
from certify.certificate import write_atomically

MIN_BYTES = 100_000  # of a spec: smaller ones are proved in a second anyway
MAX_ENTRIES = 32
MAX_BYTES = 1 << 28  # of all entries
_ENTRY = re.compile(r"[0-9a-f]{64}\.spec|\.[0-9a-f]{64}\.spec\..*")  # the second while one is being written


def remember(spec: bytes, certificate: bytes) -> None:
    """Note that this certificate of this spec was accepted, and forget the oldest entries beyond the limits."""
    folder = _folder()
    if len(spec) < MIN_BYTES or folder is None:
        return
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_private(folder):
            write_atomically(folder / _name(hashlib.sha256(spec).hexdigest(), certificate), spec)
            _forget_oldest(folder)


def recall(spec_sha256: str, certificate: bytes) -> bytes | None:
    """The spec of this hash, if the kernel has accepted this certificate of it on this machine."""
    folder = _folder()
    if folder is None:
        return None
    try:
        if not _is_private(folder):
            return None
        path = folder / _name(spec_sha256, certificate)
        spec = path.read_bytes()
        with contextlib.suppress(OSError):
            os.utime(path)  # what is in use is not the oldest
    except OSError:
        return None
    return spec if hashlib.sha256(spec).hexdigest() == spec_sha256 else None


def _folder() -> Path | None:
    own = os.environ.get("CERTIFY_CACHE")
    if own is not None:
        return Path(own) if os.path.isabs(own) else None  # a relative one may be anybody's, wherever one works
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "certify"
    except RuntimeError:  # there is no home
        return None


def _is_private(folder: Path) -> bool:
    """Whether nobody but the user can have put anything there."""
    status = folder.stat()
    own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
    return own and stat.S_ISDIR(status.st_mode) and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _name(spec_sha256: str, certificate: bytes) -> str:
    parts = (_checker(), spec_sha256, hashlib.sha256(certificate).hexdigest())
    return f"{hashlib.sha256(' '.join(parts).encode()).hexdigest()}.spec"


@cache
def _checker() -> str:
    """What decides that a certificate is accepted, as a hash: the kernel, and what takes over from older certificates.

    Raises: OSError if the sources cannot be read.
    """
    here = Path(__file__).parent
    digest = hashlib.sha256(f"{sys.implementation.name} {sys.version}".encode())
    sources = sorted(Path(certify.kernel.__path__[0]).glob("*.py"))
    if not sources:
        raise FileNotFoundError("the sources of the kernel are not there")
    for path in (*sources, here / "accepted.py", here / "reuse.py", here / "certificate.py"):
        digest.update(f"\n{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}".encode())
    return digest.hexdigest()


def _forget_oldest(folder: Path) -> None:
    entries = sorted(
        (
            (path.stat().st_mtime_ns, path.stat().st_size, path)
            for path in folder.iterdir()
            if _ENTRY.fullmatch(path.name)
        ),
        reverse=True,
    )
    total = 0
    for count, (_, size, path) in enumerate(entries, 1):
        total += size
        if count > MAX_ENTRIES or total > MAX_BYTES:
            path.unlink(missing_ok=True)
