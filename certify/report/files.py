"""The files that a command writes beside its report: checked before the work, written whole."""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
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


def check_folder(path: str, names: Iterable[str], spec: str, option: str = "-o") -> None:
    """Faults of an option that can be told before any work is done: a folder is there or can be made, for these files.

    Raises: SpecError.
    """
    folder, reason = Path(path), ""
    if os.path.lexists(folder) and not folder.is_dir():
        reason = "it is there, and no folder"
    elif not folder.parent.is_dir():
        reason = "there is no folder to make it in"
    else:
        for name in names:
            target = folder / name
            if target.is_dir():
                reason = f"{name} is a folder there"
            elif target.exists() and target.resolve() == Path(spec).resolve():
                reason = f"{name} is the spec itself"
    if reason:
        raise SpecError((Fault("U001", option, f"cannot write to the folder {path}: {reason}"),))


def write_folder(path: str, files: Mapping[str, bytes], option: str = "-o") -> None:
    """Write files into a folder, which is made if it is not there: all of them, or none.

    They are written whole into a folder of their own, which is then renamed, or from which they are moved.
    Raises: SpecError.
    """
    folder = Path(path)
    new = not folder.exists()
    staging = None
    try:
        staging = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent if new else folder))
        for name, data in files.items():
            (staging / name).write_bytes(data)
        if new:
            mask = os.umask(0)
            os.umask(mask)
            staging.chmod(0o777 & ~mask)
            staging.rename(folder)
        else:
            for name in files:
                (staging / name).replace(folder / name)
    except OSError as error:
        raise SpecError((Fault("U001", option, f"cannot write to the folder {path}: {error.strerror}"),)) from None
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
