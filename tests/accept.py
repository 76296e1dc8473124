"""Whether the kernel accepts a proposal about one port or one load, outside of any network."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from certify.kernel.data import Data
from certify.kernel.errors import RuleFailure
from certify.kernel.model import LinearPort, LoadLaw
from certify.kernel.proofs import RULES
from certify.search.proposal import Proposal


class OnePart:
    """Just enough of the kernel's context for the handlers of one DGU or one load."""

    def __init__(self, part: Any) -> None:
        self.part = part
        self.strict_loads: set[str] = set()
        self.storages: dict[str, Any] = {}
        self.shortages: dict[str, Fraction] = {}
        self.moduli: dict[str, Fraction] = {}
        self.sampled: set[str] = set()

    def port(self, _: str, signs: str = "000") -> Any:
        assert signs == "000"
        return self.part

    def pieces(self, _: str) -> Any:
        law, band = self.part
        return ((band, law),)

    def corners(self, _: str) -> tuple[str, ...]:
        return ("000",)

    def key(self, _: str) -> None:
        return None

    def once(self, _: Any, compute: Any) -> Any:
        return compute()


def accepted_facts(part: Any, proposal: Proposal) -> tuple[Any, ...] | None:
    """What the rule tells about a proposal that it accepts, or None."""
    context: Any = OnePart(part)
    try:
        return RULES["dgu", proposal.status, proposal.rule](context, "x", Data(proposal.data))
    except RuleFailure:
        return None


def accepts(part: LinearPort | tuple[LoadLaw, tuple[Fraction, Fraction]], proposal: Proposal) -> OnePart | None:
    """The context after the rule has accepted the proposal, or None."""
    context: Any = OnePart(part)
    kind = "dgu" if isinstance(part, LinearPort) else "load"
    try:
        RULES[kind, proposal.status, proposal.rule](context, "x", Data(proposal.data))
    except RuleFailure:
        return None
    return context  # type: ignore[no-any-return]
