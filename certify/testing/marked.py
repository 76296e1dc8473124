"""The specs that a marker names: found, read, and proved or checked once for all tests of a module."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import pytest

from certify.certificate import Certificate, prove
from certify.gating.committed import certificate_path, check_committed
from certify.inputs import decode_all, read, to_bytes
from certify.kernel.claims import Verdict
from certify.kernel.errors import Rejected, SpecError
from certify.kernel.reader import read_document
from certify.kernel.spec import Microgrid
from certify.testing.records import Record, note
from certify.testing.words import faults_in_words
from certify.verdicts import read_notes

Result = TypeVar("Result")


def certify_file(path: Path, spec: bytes, shown: str) -> tuple[Certificate, str]:
    """The certificate of a spec that was read from there, and how it was come by; noted for reports.

    The certificate beside it is checked as `certify gate` does; one about an earlier state of the spec is none.
    Raises: SpecError; Rejected if what lies beside it does not prove what it says.
    """
    beside = certificate_path(str(path))
    data = read(beside) if beside.exists() else None
    verdict = None if data is None else check_committed(spec, data)
    if data is None or verdict is None:
        found, how = prove(spec), "proved"
    else:
        found, how = Certificate(data, verdict, read_notes(data), spec), f"checked: {beside.name}"
    note(spec, found.verdict, how, shown)
    return found, how


class ToldVerdict(Verdict):
    """A verdict that does not pass for true: `assert certify_verdict` would hold for a refuted spec as well."""

    def __bool__(self) -> bool:
        raise TypeError('a verdict is more than true or false; write assert certify_verdict.outcome == "certified"')


@dataclass
class MarkedSpec:
    """A spec for a test. `path` is None if it was made in Python; its bytes are there once it is read."""

    name: str
    path: Path | None
    given: Any = field(default=None, repr=False)
    tried: tuple[Path, ...] = ()
    data: bytes = field(default=b"", repr=False)
    _found: tuple[Certificate, str] | None = field(default=None, repr=False)

    def read(self) -> MarkedSpec:
        """With its bytes; a failure of the test, with its reason, if that cannot be."""
        if self.path is None and self.given is None:
            places = " or ".join(dict.fromkeys(str(place) for place in self.tried))
            pytest.fail(f"no spec {self.name!r}: there is no file {places}", pytrace=False)
        self.data = self.data or _or_fail(self.name, lambda: read(self.path) if self.path else to_bytes(self.given))
        return self

    def to_bytes(self) -> bytes:
        return self.data

    @property
    def document(self) -> dict[str, Any]:
        """The parsed spec, with decimals as text: free to be changed."""
        return read_document(self.data)  # type: ignore[no-any-return]

    @property
    def microgrid(self) -> Microgrid:
        """The decoded spec."""
        return decode_all(self.data)

    def certified(self) -> Certificate:
        """Its certificate, proved or checked when first asked for; a failure of the test if the spec is faulty."""
        if self._found is None:
            path = self.path
            self._found = _or_fail(
                self.name, lambda: certify_file(path, self.data, self.name) if path else (prove(self.data), "proved")
            )
        return self._found[0]

    def records(self) -> list[Record]:
        """What was proved of it, for a report."""
        if self._found is None:
            return []
        certificate, how = self._found
        return [Record(hashlib.sha256(self.data).hexdigest(), self.name, how, certificate.verdict)]


def _or_fail(spec: str, action: Callable[[], Result]) -> Result:
    """What it returns; what is wrong with the spec or with its certificate becomes the reason why the test fails."""
    try:
        return action()
    except SpecError as error:
        reason = faults_in_words(error.faults, spec)
    except Rejected as error:
        reason = rejected_in_words(error, spec)
    except TypeError as error:  # no spec at all
        reason = f"{spec}: {error}"
    return pytest.fail(reason, pytrace=False)


def rejected_in_words(error: Rejected, spec: str) -> str:
    from certify.diagnostics import DIAGNOSTICS

    help_ = f"\n  = help: {DIAGNOSTICS[error.code].remedy}" if error.code in DIAGNOSTICS else ""
    place = f"the certificate beside {spec} does not prove what it says"
    return f"rejected[{error.code}]: {place}\n --> {error.where}: {error.reason}{help_}"


def marked_specs(given: Iterable[Any], test_file: Path, config: pytest.Config) -> list[MarkedSpec]:
    """The specs that a marker's arguments name, in order; a pattern names all files that match, by name."""
    specs: list[MarkedSpec] = []
    for spec in given:
        if not isinstance(spec, str | os.PathLike):
            own = spec.get("name") if isinstance(spec, dict) else getattr(spec, "name", None)
            name = own if isinstance(own, str) and own else f"spec{len(specs)}"
            specs.append(MarkedSpec(name, None, spec))
            continue
        text = os.fspath(spec)
        places = tuple(folder / text for folder in (test_file.parent, config.rootpath))
        found: list[Path] = []
        for place in places:
            is_pattern = glob.has_magic(text) and not place.exists()
            found = [Path(p) for p in sorted(glob.glob(str(place), recursive=True))] if is_pattern else [place]
            found = [path for path in found if path.is_file()]
            if found:
                folder = place.parents[len(Path(text).parts) - 1] if not Path(text).is_absolute() else place.parent
                names = [os.path.relpath(path, folder) if len(found) > 1 or is_pattern else text for path in found]
                specs += [MarkedSpec(Path(n).as_posix(), p) for n, p in zip(names, found, strict=True)]
                break
        if not found:
            specs.append(MarkedSpec(text, None, tried=places))
    return specs
