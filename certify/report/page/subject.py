"""What a report is about: a spec and its certificate, with what the kernel has made of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from certify.kernel.claims import Claim, Context, Verdict
from certify.kernel.reader import read_document
from certify.kernel.spec import Microgrid
from certify.rests import Region, Rest, read_region, read_rest

HOLDS = ("proved", "conditional")
Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class Subject:
    """A spec and a certificate about it that the kernel has accepted; `verdict` is what it said.

    `spec_name` and `certificate_name` are how the files are called, the second None if it was proved just now. `notes`
    has the codes why open claims are open: hints of the search, no part of the proof.
    """

    grid: Microgrid
    spec: bytes
    certificate: bytes
    verdict: Verdict
    notes: Mapping[str, str]
    spec_name: str
    certificate_name: str | None = None
    anchors: dict[str, str] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        taken: set[str] = set()
        for number, claim in enumerate(self.verdict.claims):
            plain = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in claim.id)
            name = f"claim-{plain}" if f"claim-{plain}" not in taken else f"claim-{plain}-{number}"
            taken.add(name)
            self.anchors[claim.id] = name

    @cached_property
    def claims(self) -> dict[str, Claim]:
        return {claim.id: claim for claim in self.verdict.claims}

    @cached_property
    def context(self) -> Context:
        return Context(self.grid)

    @cached_property
    def document(self) -> dict[str, Any]:
        """The certificate as JSON: its proofs are those that the kernel has accepted."""
        document: dict[str, Any] = json.loads(self.certificate)
        return document

    @cached_property
    def proofs(self) -> dict[str, Any]:
        """What the certificate gives for each claim, by its id; nothing for open ones."""
        shared = self.document["proofs"]
        return {entry["id"]: shared[entry["proof"]] for entry in self.document["claims"] if entry["proof"] is not None}

    @cached_property
    def proof_keys(self) -> dict[str, str]:
        return {entry["id"]: entry["proof"] for entry in self.document["claims"] if entry["proof"] is not None}

    @cached_property
    def rests(self) -> dict[str, Rest]:
        """The proved equilibria, by the first node of their island."""
        return {
            c.id.partition("/")[2]: read_rest(c)
            for c in self.verdict.claims
            if c.kind == "equilibrium" and c.status == "proved" and c.facts
        }

    @cached_property
    def regions(self) -> dict[str, Region]:
        """The proved regions, by the first node of their island."""
        return {
            c.id.partition("/")[2]: read_region(c)
            for c in self.verdict.claims
            if c.kind == "region" and c.status in HOLDS and c.facts
        }

    @cached_property
    def scenarios(self) -> list[str]:
        """The names of the spec's scenarios."""
        raw: Any = read_document(self.spec)
        found = raw.get("scenario")
        return list(found) if isinstance(found, dict) else []

    @property
    def title(self) -> str:
        return self.grid.name or self.spec_name

    @property
    def spec_sha256(self) -> str:
        return hashlib.sha256(self.spec).hexdigest()

    @property
    def certificate_sha256(self) -> str:
        return hashlib.sha256(self.certificate).hexdigest()

    def status(self, claim: str) -> str | None:
        """The status of a claim, None if the spec does not call for it."""
        return self.claims[claim].status if claim in self.claims else None
