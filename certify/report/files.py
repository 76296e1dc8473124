"""The files that a command writes beside its report: checked before the work, written whole."""

from __future__ import annotations

import argparse
from pathlib import Path

from certify.certificate import write_atomically
from certify.kernel.errors import Fault, SpecError


def check_targets(options: argparse.Namespace) -> None:
    """Faults of -o and --cert that can be told before any work is done. Raises: SpecError."""
    faults = []
    taken = {Path(options.spec).resolve(): "it is the spec itself"}
    for option, path in (("-o", options.output), ("--cert", options.cert)):
        if path is None:
            continue
        target = Path(path)
        reason = taken.get(target.resolve())
        if target.is_dir() or not target.parent.is_dir():
            reason = "there is no such folder, or it is a folder itself"
        if reason:
            faults.append(Fault("U001", option, f"cannot write {path}: {reason}"))
        taken[target.resolve()] = "the new spec goes there"
    if options.cert is not None and options.output is None:
        faults.append(Fault("U001", "--cert", "a certificate is about the new spec, so it needs -o too"))
    if faults:
        raise SpecError(tuple(faults))


def write_results(options: argparse.Namespace, spec: bytes, certificate: bytes) -> None:
    """Write the new spec and its certificate where they were asked for. Raises: SpecError."""
    for option, path, data in (("-o", options.output, spec), ("--cert", options.cert, certificate)):
        if path is not None:
            try:
                write_atomically(Path(path), data)
            except OSError as error:
                raise SpecError((Fault("U001", option, f"cannot write {path}: {error.strerror}"),)) from None
