"""Judging a decided spec: which claims count against it, given what may be assumed and what was so before.

Without a baseline every claim counts that is not proved, but for those about what inverters do at their limits, and
for those that rest on assumptions which are allowed. With one only what got worse counts: proved is better than
conditional or unknown, and these are better than refuted. A claim that the baseline does not have counts as if there
were none. A baseline only ever excuses; what it says is never shown as found.
"""

from __future__ import annotations

from collections.abc import Mapping

from certify.gating.policy import Policy
from certify.gating.results import ALLOWED, BESIDE, FAILED, PASSED, UNCHANGED, Decision, JudgedClaim, SpecResult
from certify.kernel.claims import BESIDE as BESIDE_KINDS
from certify.kernel.claims import RESTS, Claim, Verdict

RANK = {"refuted": 0, "unknown": 1, "conditional": 1, "proved": 2}


def judge(decision: Decision, policy: Policy, before: Mapping[str, str] | None = None) -> SpecResult:
    """A spec, judged. `before`: the status of each claim in the baseline, by its id; None if there is no baseline."""
    if decision.verdict is None:
        return SpecResult(decision, (), before is not None)
    known = before or {}
    claims = tuple(
        JudgedClaim(
            claim,
            _standing(claim, decision.verdict, policy, known),
            decision.reasons.get(claim.id),
            known.get(claim.id),
        )
        for claim in decision.verdict.claims
    )
    here = {claim.id for claim in decision.verdict.claims}
    absent = tuple((name, status) for name, status in known.items() if name not in here)
    return SpecResult(decision, claims, before is not None, absent)


def open_names(verdict: Verdict) -> list[str]:
    """The assumptions that are about this spec and not about models in general: those that have to be allowed."""
    return [name for name, _ in verdict.assumptions if "/" in name]


def may_pass(verdict: Verdict, policy: Policy) -> bool:
    """Whether a spec is certified, or conditional on nothing but what is allowed: the same as no claim that counts."""
    if verdict.outcome == "conditional":
        names = open_names(verdict)
        return bool(names) and all(policy.allows(name) for name in names)
    return verdict.outcome == "certified"


def missing_names(verdict: Verdict, policy: Policy) -> list[str]:
    """The assumptions that a verdict rests on and that are not allowed."""
    return [name for name in open_names(verdict) if not policy.allows(name)]


def _standing(claim: Claim, verdict: Verdict, policy: Policy, before: Mapping[str, str]) -> str:
    if claim.status == "proved":
        return PASSED
    if claim.kind in BESIDE_KINDS:
        return BESIDE
    if _is_allowed(claim, verdict, policy):
        return ALLOWED
    was = before.get(claim.id)
    return UNCHANGED if was is not None and RANK[claim.status] >= RANK[was] else FAILED


def _is_allowed(claim: Claim, verdict: Verdict, policy: Policy) -> bool:
    """Whether all that a claim lacks is in the ledger, by names that are allowed."""
    names = open_names(verdict)
    needed: list[str] = []
    if verdict.outcome == "conditional":
        needed = names
    elif claim.status == "conditional":
        sampled = [name for name in names if name.startswith("sampled/")]
        own = f"sampled/{claim.id.partition('/')[2]}"
        needed = [own] if own in sampled else sampled
    elif claim.kind in RESTS and claim.status == "unknown":
        island = claim.id.partition("/")[2]
        needed = [name for name in names if name in (f"equilibrium/{island}", f"region/{island}")]
    # What lacks something that has no name in the ledger cannot be allowed.
    return bool(needed) and all(policy.allows(name) for name in needed)
