"""The files that the gate writes besides its report: checked before the work, each written whole."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from certify.atomic import write_atomically
from certify.gating.committed import certificate_path
from certify.gating.results import GateResult
from certify.kernel.errors import Fault, SpecError


def check_targets(options: argparse.Namespace, specs: Sequence[str]) -> None:
    """Faults of the options for files, all at once, that can be told before any work is done. Raises: SpecError."""
    faults: list[Fault] = []
    taken = {os.path.realpath(spec): "it is a spec" for spec in specs}
    for spec in specs:
        path = os.path.realpath(certificate_path(spec, options.certificates))
        if options.write and taken.get(path) == "the certificate of a spec is there":
            message = f"{spec} and another spec share the certificate {certificate_path(spec, options.certificates)}"
            faults.append(Fault("U001", "--write", f"{message}: rename one"))
        taken.setdefault(path, "the certificate of a spec is there")
    if options.baseline is not None:
        taken.setdefault(os.path.realpath(options.baseline), "it is the baseline")
    for option, path in _targets(options):
        real = os.path.realpath(path)
        if reason := taken.get(real) or _why_not(path, option == "--statement"):
            faults.append(Fault("U001", option, f"cannot write {path}: {reason}"))
        taken[real] = "another output goes there"
    if options.write:
        faults += [
            Fault("U001", "--write", f"cannot write {path}: {reason}")
            for path in dict.fromkeys(str(certificate_path(spec, options.certificates)) for spec in specs)
            if (reason := _why_not(path, False))
        ]
    if faults:
        raise SpecError(tuple(faults))


def _targets(options: argparse.Namespace) -> list[tuple[str, str]]:
    given = [("--junit", options.junit), ("--sarif", options.sarif), ("--statement", options.statement)]
    return [(option, path) for option, path in given if path is not None]


def is_folder(path: str) -> bool:
    """Whether a path means a folder: it is one, or is written as one."""
    return os.path.isdir(path) or path.endswith(("/", os.sep))


def _why_not(path: str, may_be_folder: bool) -> str:
    """Why a file cannot be written there, as far as can be told without trying; empty if it seems that it can."""
    if not path:
        return "it has no name"
    if may_be_folder and is_folder(path):
        folder = Path(path) if os.path.exists(path) else Path(os.path.normpath(path)).parent
    elif os.path.isdir(path) or path.endswith(("/", os.sep)):
        return "it is a folder"
    else:
        folder = Path(path).parent
    if not os.path.isdir(folder):
        return f"there is no folder {folder}"
    return "" if os.access(folder, os.W_OK | os.X_OK) else f"the folder {folder} cannot be written to"


def write_files(options: argparse.Namespace, result: GateResult) -> list[str]:
    """Write what the options ask for; what there is to say about it. Raises: SpecError if a file cannot be written."""
    told: list[str] = []
    if options.junit is not None:
        from certify.report.junit import to_junit

        _write("--junit", options.junit, to_junit(result, options.times))
    if options.sarif is not None:
        from certify.report.sarif import to_sarif

        _write("--sarif", options.sarif, to_sarif(result, options.sarif_kinds))
    if options.statement is not None:
        from certify.report.statement import to_statement, to_statements

        if is_folder(options.statement):
            from certify.report.files import write_folder

            write_folder(os.path.normpath(options.statement), to_statements(result), "--statement")
            told += [
                f"{options.statement} gets no statement about {spec.decision.spec}, which could not be read"
                for spec in result.specs
                if spec.decision.sha256 is None
            ]
        elif data := to_statement(result.specs):
            _write("--statement", options.statement, data)
        else:
            told.append(f"{options.statement} is not written: none of the specs could be read")
    return told


def write_certificate(path: Path, data: bytes) -> None:
    """Write a certificate beside its spec. Raises: SpecError."""
    _write("--write", str(path), data)


def _write(option: str, path: str, data: bytes) -> None:
    try:
        write_atomically(Path(path), data)
    except OSError as error:
        raise SpecError((Fault("U001", option, f"cannot write {path}: {error.strerror}"),)) from None


def parse_kinds(text: str, known: Iterable[str]) -> tuple[str, ...]:
    """The kinds of results that a SARIF log has. Raises: ValueError."""
    kinds = tuple(word.strip() for word in text.split(","))
    if not set(kinds) <= set(known):
        raise ValueError(f"expected some of {','.join(known)}, got {text!r}")
    return kinds
