"""Spec files as test items: one for each file, which says what it should be; a failure tells which claim, and why."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from certify.gating.judge import may_pass, missing_names
from certify.inputs import read
from certify.kernel.errors import Rejected, SpecError
from certify.testing.assertions import allowing
from certify.testing.marked import certify_file, rejected_in_words
from certify.testing.plugin import allowed
from certify.testing.words import faults_in_words, verdict_in_words

REFUTED = ".refuted.microgrid."


class OtherVerdict(Exception):
    """The verdict of a spec is not the one that its file name says."""


class MicrogridFile(pytest.File):
    """A file *.microgrid.toml or .json. Its one item is called after what it should be, so that ids stay the same."""

    def collect(self) -> Iterator[MicrogridItem]:
        item: MicrogridItem = MicrogridItem.from_parent(
            self, name="refuted" if REFUTED in self.path.name.lower() else "certified"
        )
        yield item


class MicrogridItem(pytest.Item):
    """Passes if the spec is certified, or refuted if its file is called *.refuted.microgrid.toml; never if unknown."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.add_marker("certify")

    @property
    def shown(self) -> str:
        """The path of the spec as it is told: from rootdir."""
        return Path(os.path.relpath(self.path, self.config.rootpath)).as_posix()

    def runtest(self) -> None:
        certificate, _ = certify_file(self.path, read(self.path), self.shown)
        verdict, policy = certificate.verdict, allowing(allowed(self.config))
        wants_proof = self.name == "certified"
        if not (may_pass(verdict, policy) if wants_proof else verdict.outcome == self.name):
            missing = missing_names(verdict, policy) if wants_proof else ()
            raise OtherVerdict(verdict_in_words(certificate, f"{self.name}: {self.shown}", missing, "--certify-allow"))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        error = excinfo.value
        if isinstance(error, OtherVerdict):
            return str(error)
        if isinstance(error, SpecError):
            return faults_in_words(error.faults, self.shown)
        if isinstance(error, Rejected):
            return rejected_in_words(error, self.shown)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, f"{self.shown} is {self.name}"
