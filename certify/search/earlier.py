"""The proofs of an older certificate, to be tried before a search: offers like any other, none of them believed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from certify.search.proposal import Proposal

SHARED = 4  # proofs of other claims that are tried for a claim that the older certificate did not have


class Earlier:
    """What the claims of an older certificate were decided by, by their ids.

    `document` is a certificate as it was read, of any spec, by anybody: entries without the shape of a decided claim
    are left out.
    """

    def __init__(self, document: Mapping[str, Any] | None = None) -> None:
        self.ids: set[str] = set()
        self.found: dict[str, Proposal] = {}
        counts: Counter[tuple[str, str, str, str]] = Counter()  # by kind of claim, status, rule and key of the proof
        proofs = document["proofs"] if document and isinstance(document["proofs"], dict) else {}
        for entry in document["claims"] if document and isinstance(document["claims"], list) else ():
            texts = [entry.get(key) for key in ("id", "status", "rule", "proof")] if isinstance(entry, dict) else [None]
            if isinstance(texts[0], str):
                self.ids.add(texts[0])
            if not all(isinstance(text, str) for text in texts) or not isinstance(proofs.get(texts[3]), dict):
                continue
            name, status, rule, key = map(str, texts)
            self.found[name] = Proposal(status, rule, proofs[key])
            counts[_kind(name), status, rule, key] += 1
        self.shared: dict[str, list[Proposal]] = {"dgu": [], "load": []}
        for (kind, status, rule, key), count in counts.most_common():
            if count > 1 and len(self.shared.get(kind, [None] * SHARED)) < SHARED:
                self.shared[kind].append(Proposal(status, rule, proofs[key]))
        self.offers = {id(p): p for listed in (self.found.values(), *self.shared.values()) for p in listed}

    def of(self, name: str, *rules: str) -> list[Proposal]:
        """What decided the claim of this id, or, if there was none of it, what decided most DGUs or loads: by `rules`.

        One proof that several claims shared often fits one more; a proof of one claim alone hardly ever does.
        """
        own = [self.found[name]] if name in self.found else []
        listed = own if name in self.ids else self.shared.get(_kind(name), [])
        return [proposal for proposal in listed if not rules or proposal.rule in rules]

    def short_of(self, name: str) -> list[Proposal]:
        """Proofs of a shortage, each also without its witness, which only says that less would not do."""
        listed = []
        for proposal in self.of(name, "index-storage"):
            data = {key: value for key, value in proposal.data.items() if key != "witness"}
            bare = Proposal(proposal.status, proposal.rule, data)
            self.offers[id(bare)] = bare
            listed += [proposal, bare]
        return listed

    def offered(self, proposal: Proposal | None) -> bool:
        """Whether a proposal is one of these."""
        return id(proposal) in self.offers


def _kind(name: str) -> str:
    return name.split("/", 1)[0]
