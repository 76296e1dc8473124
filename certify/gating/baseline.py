"""What was so before: certificates of an earlier state, or what the gate has printed then.

It is believed only so far as it excuses: nothing in it can make a claim proved. Still, whoever may write it decides
what is excused, so it has to come from where changes have been accepted already, such as the base branch.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from certify.gating.committed import OTHER_SPEC, certificate_path, inside
from certify.gating.judge import RANK
from certify.inputs import read
from certify.kernel.check import FORMAT, check, read_certificate
from certify.kernel.errors import Fault, Rejected, SpecError


class Baseline:
    """The statuses of claims before, looked up by the path of a spec."""

    def __init__(self, source: str) -> None:
        """`source`: a folder of certificates, or a file that `certify gate --json` has printed. Raises: SpecError."""
        self.source = source
        self.results: dict[str, Mapping[str, str]] | None = None
        self.taken: dict[str, str] = {}  # which spec a certificate has been taken for
        if not os.path.isdir(source):
            self.results = _read_results(source)

    def of(self, spec: str, committed: str | None) -> Mapping[str, str] | None:
        """The status of each claim of a spec, None if the baseline does not have it.

        `committed`: the certificate by which the spec is judged now, which cannot excuse itself. A certificate beside
        the spec that it is about is checked by the kernel. Raises: SpecError U014.
        """
        if self.results is not None:
            return self.results.get(Path(spec).as_posix())
        path = certificate_path(spec, self.source)
        if not os.path.exists(path):
            return None
        if committed is not None and os.path.realpath(path) == os.path.realpath(committed):
            raise _unusable(f"{path} is the certificate that is judged; take the baseline from the base branch")
        other = self.taken.setdefault(os.path.realpath(path), spec)
        if other != spec:
            raise _unusable(
                f"{path} is found for {other} and for {spec}; put each where its spec is: {self.source}/PATH"
            )
        try:
            certificate = read(path)
            document = read_certificate(certificate)
        except (SpecError, Rejected) as error:
            raise _unusable(f"{path}: {error}") from None
        if document["format"] != FORMAT:
            raise _unusable(f"{path}: not of the format {FORMAT}")
        _check_if_possible(inside(self.source, Path(spec)), certificate, path)
        return _statuses(document["claims"], str(path))


def _check_if_possible(spec: Path, certificate: bytes, path: Path) -> None:
    """Have the kernel check a certificate of the baseline, if what it is about is there too. Raises: SpecError."""
    if not os.path.isfile(spec):
        return
    try:
        check(read(spec), certificate)
    except Rejected as rejection:
        if rejection.code != OTHER_SPEC:  # another state of that spec
            raise _unusable(f"{path} is rejected: {rejection}") from None
    except SpecError:
        return


def _read_results(source: str) -> dict[str, Mapping[str, str]]:
    """The claims of each spec in what the gate has printed as JSON."""
    try:
        document: Any = json.loads(read(source))
        entries = document["results"]
        return {
            Path(entry["spec"]).as_posix(): _statuses(entry["claims"], source) for entry in entries if entry["claims"]
        }
    except SpecError as error:
        raise _unusable(f"{source}: {error.faults[0].message}") from None
    except (ValueError, RecursionError, KeyError, TypeError):
        raise _unusable(f"{source}: neither a folder of certificates nor what `certify gate --json` prints") from None


def _statuses(claims: Any, where: str) -> Mapping[str, str]:
    listed = claims if isinstance(claims, list) else [None]
    found: dict[str, str] = {}
    for entry in listed:
        name, status = (entry.get("id"), entry.get("status")) if isinstance(entry, dict) else (None, None)
        if not isinstance(name, str) or not isinstance(status, str) or status not in RANK or name in found:
            raise _unusable(f"{where}: its claims cannot be read")
        found[name] = status
    return found


def _unusable(message: str) -> SpecError:
    return SpecError((Fault("U014", "--baseline", message),))
