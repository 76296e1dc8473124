"""What can go wrong, as data: a bad spec, a rule that does not apply, a rejected certificate."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing wrong with an input: a stable code, the path inside the file, and which rule it breaks.

    What to try is kept with the code, in `certify.diagnostics`.
    """

    code: str
    path: str
    message: str


class CertifyError(Exception):
    """Base of every error that this package raises on purpose."""


class SpecError(CertifyError):
    """The spec is not well formed. Carries every fault found, not only the first."""

    def __init__(self, faults: tuple[Fault, ...]) -> None:
        super().__init__("; ".join(f"{f.code} at {f.path or 'top level'}: {f.message}" for f in faults))
        self.faults = faults


class RuleFailure(CertifyError):
    """A proof rule does not accept what it was given: a side condition fails."""


def require(condition: bool, reason: str) -> None:
    if not condition:
        raise RuleFailure(reason)


class Rejected(CertifyError):
    """The certificate does not prove what it says. `where` is the claim or key at fault."""

    def __init__(self, code: str, where: str, reason: str) -> None:
        super().__init__(f"{code} at {where}: {reason}")
        self.code, self.where, self.reason = code, where, reason
