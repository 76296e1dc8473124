"""What the gate finds out: typed and frozen, to be rendered as text, JSON, JUnit, SARIF and a statement."""

from __future__ import annotations

from dataclasses import dataclass

from certify.exits import EXIT_CODES, worst_of
from certify.kernel.claims import Claim, Verdict
from certify.kernel.errors import Fault

# How a claim stands in the gate. Only "failed" keeps a spec from passing.
PASSED, FAILED, ALLOWED, UNCHANGED, BESIDE = "passed", "failed", "allowed", "no worse", "beside"


@dataclass(frozen=True)
class Problem:
    """What is wrong with a file, apart from claims: `kind` is "bad input", "rejected" or "certificate"."""

    kind: str
    file: str
    fault: Fault
    exit_code: int


@dataclass(frozen=True)
class Committed:
    """The committed certificate of a spec.

    `state`: "fresh" is about this spec and accepted by the kernel, "stale" about another state of it, "rejected", or
    "none". `path` is None if there is none. `said`: the verdict that a stale one has, which nobody has checked;
    `but_for_line_ends`: it is about the spec with other ones.
    """

    state: str = "none"
    path: str | None = None
    sha256: str | None = None
    said: str | None = None
    but_for_line_ends: bool = False


@dataclass(frozen=True)
class Decision:
    """What is known of one spec, before it is judged.

    `verdict`: by the committed certificate, or proved now; then `proof` is the new certificate. `reasons`: why claims
    are open, as codes, by their ids. `seconds`: that it took.
    """

    spec: str
    sha256: str | None
    committed: Committed
    verdict: Verdict | None
    reasons: dict[str, str]
    problems: tuple[Problem, ...]
    proof: bytes | None
    seconds: float

    @property
    def outcome(self) -> str:
        kinds = {problem.kind for problem in self.problems}
        for kind in ("rejected", "bad input"):
            if kind in kinds:
                return kind
        return self.verdict.outcome if self.verdict else "unknown"


@dataclass(frozen=True)
class JudgedClaim:
    """A claim and how it stands. `before`: its status in the baseline, None if it has none there."""

    claim: Claim
    standing: str
    reason: str | None = None
    before: str | None = None


@dataclass(frozen=True)
class SpecResult:
    """One spec, judged. `compared`: the baseline has this spec; `absent`: claims of it that are made no more."""

    decision: Decision
    claims: tuple[JudgedClaim, ...]
    compared: bool = False
    absent: tuple[tuple[str, str], ...] = ()
    written: str | None = None

    @property
    def exit_code(self) -> int:
        failed = [entry.claim.status for entry in self.claims if entry.standing == FAILED]
        codes = {problem.exit_code for problem in self.decision.problems}
        return worst_of(codes | {EXIT_CODES["refuted" if status == "refuted" else "unknown"] for status in failed})

    @property
    def passed(self) -> bool:
        return self.exit_code == 0

    def of(self, standing: str) -> tuple[JudgedClaim, ...]:
        """The claims that stand so."""
        return tuple(entry for entry in self.claims if entry.standing == standing)


@dataclass(frozen=True)
class GateResult:
    """All specs, judged, and what there is to say about the run as a whole. `baseline`: what was compared with."""

    specs: tuple[SpecResult, ...]
    warnings: tuple[str, ...] = ()
    baseline: str | None = None

    @property
    def exit_code(self) -> int:
        return worst_of(result.exit_code for result in self.specs)
