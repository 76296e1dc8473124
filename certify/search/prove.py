"""From a microgrid to the claims and proofs of a certificate: propose, let the kernel's rules accept, go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import chain
from typing import Any

from certify.diagnostics import IN_FLOATS
from certify.kernel.check import proof_key
from certify.kernel.claims import (
    Context,
    Mode,
    assumptions,
    but_for_a_shortage,
    but_for_others,
    overall,
    split,
    statements,
)
from certify.kernel.data import Data
from certify.kernel.errors import RuleFailure
from certify.kernel.load_proofs import lipschitz
from certify.kernel.proofs import HOLDS, RULES, least_resistance
from certify.kernel.spec import Microgrid
from certify.search.dgu import propose_dgu
from certify.search.earlier import Earlier
from certify.search.equilibrium import EquilibriumSearch
from certify.search.loads import propose_disk, propose_load
from certify.search.proposal import Proposal
from certify.search.roots import magnitude

# Why a claim of this kind stays open, as a code of `certify explain`.
REASONS = {
    "dgu": "P201",
    "load": "P202",
    "current": "P211",
    "island": "P203",
    "microgrid": "P204",
    "region": "P216",
    "branch": "P205",
    "interconnection": "P205",
}
Progress = Callable[[int, int], None]


def find_claims(
    grid: Microgrid,
    progress: Progress | None = None,
    refute: bool = True,
    method: str | None = None,
    earlier: Earlier | None = None,
) -> dict[str, Any]:
    """The claims, proofs, ledger and verdict for a microgrid, as a certificate holds them; and notes on open claims.

    Without `refute` no time is spent on why a DGU with tolerances has no proof. `method`: the only one for loads.
    `earlier`: proofs of an older certificate, to be tried first. The result is not worse for them: where they may be
    why an island is not proved, all is searched without them.
    """
    search = Search(grid, refute, method, earlier)
    for count, name in enumerate(search.expected):
        search.decide(name)
        if progress:
            progress(count + 1, len(search.expected))
    if search.may_owe_to_borrowed():
        return find_claims(grid, progress, refute, method)
    return search.result()


class Search:
    """Decides claim by claim, in the order of the certificate.

    A DGU that is not passive may still do: with a shortage that lines make up for. Such a proof stands only if the
    claim about its island follows from it; otherwise the refutation of its passivity is what one should know.
    """

    def __init__(
        self, grid: Microgrid, refute: bool = True, method: str | None = None, earlier: Earlier | None = None
    ) -> None:
        self.refute, self.method = refute, method
        self.earlier = earlier or Earlier()
        self.given_up: set[str] = set()  # the nodes where a proof of the older certificate was of no use in the end
        self.context = Context(grid)
        self.expected = statements(self.context)
        self.known: dict[Any, Proposal | None] = {}
        self.boxes: dict[Any, Proposal] = {}  # by filter and controller
        self.accepted: dict[str, Proposal | None] = {}
        self.notes: dict[str, str] = {}
        self.reasons: dict[str, str] = {}  # why there is no equilibrium, as far as one can tell
        self.details: dict[str, str] = {}  # and where it shows, in floats

    def result(self) -> dict[str, Any]:
        claims, proofs = [], {}
        for name, (_, text) in self.expected.items():
            found = self.accepted[name]
            entry: dict[str, Any] = {"id": name, "statement": text, "status": "unknown", "rule": None, "proof": None}
            if found:
                key = proof_key(found.data)
                proofs[key] = found.data
                entry |= {"status": found.status, "rule": found.rule, "proof": key}
                if found.rule == "index-storage":
                    entry["statement"] = but_for_a_shortage(text, Fraction(found.data["shortage"]))
                elif found.rule == "local-monotonicity":
                    entry["statement"] = but_for_others(text)
            claims.append(entry)
        return {
            "claims": claims,
            "proofs": proofs,
            "assumptions": assumptions(self.context),
            "verdict": overall(self.context.status),
            "notes": self.notes,
        }

    def decide(self, name: str) -> None:
        (kind, what), _ = self.expected[name]
        if kind == "dgu":
            found = self._dgu(what)
        elif kind == "load":
            pieces = self.context.pieces(what)
            strongly = what in self.context.shortages
            found = self._first(
                "load",
                what,
                (pieces, strongly),
                lambda: propose_load(pieces, strongly, self.method),
                self._earlier_load(name, strongly),
            )
        elif kind == "current":
            strongly, node = what in self.context.shortages, self.context.nodes[what]
            content = (node.current, node.loads, strongly)
            found = self._first(
                "current",
                what,
                content,
                lambda: propose_disk(self.context, what, strongly, self.method),
                self._earlier_load(name, strongly),
            )
        elif kind == "island":
            found = self._first("island", what, None, lambda: self._pins(what), self.earlier.of(name))
            if found is None:
                self._give_up_shortages(what)
        elif kind in ("equilibrium", "saturated"):
            search = EquilibriumSearch(self.context, what, kind == "saturated")
            found = self._first(kind, what, None, search.proposals)
            self.reasons[name], self.details[name] = search.reason, search.detail
        elif kind == "region":
            status = self.context.status[f"invariant-set/{what[0]}"]
            found = self._first(
                kind, what, None, lambda: iter([Proposal(status, "sublevel-set")] if status in HOLDS else [])
            )
        else:
            rule = {"branch": "series-branch", "interconnection": "skew-incidence"}.get(kind, "passive-interconnection")
            status = "conditional" if kind == "microgrid" and self.context.sampled else "proved"
            found = self._first(kind, what, None, lambda: iter([Proposal(status, rule)]))
        self._settle(name, found)

    def _settle(self, name: str, found: Proposal | None) -> None:
        self.accepted[name] = found
        self.context.status[name] = found.status if found else "unknown"
        self.notes.pop(name, None)
        if found is None:
            self.notes[name] = self.reasons.get(name) or self._reason(self.expected[name][0])
            if self.details.get(name):
                self.notes[f"{name} {IN_FLOATS}"] = self.details[name]

    def _first(
        self,
        kind: str,
        what: Any,
        content: Any,
        propose: Callable[[], Iterator[Proposal]],
        earlier: Sequence[Proposal] = (),
    ) -> Proposal | None:
        """The first proposal that the kernel's rule accepts, `earlier` ones before those that a search makes.

        Subjects of equal content share the search.
        """
        key = (kind, content)
        if content is not None and key in self.known:
            again = self.known[key]
            proposals = iter([again] if again else [])
        else:
            proposals = chain(earlier, _until_exhausted(propose()))
        result = next((proposal for proposal in proposals if self._accepts(kind, what, proposal)), None)
        if content is not None:
            self.known[key] = result
        return result

    def _accepts(self, kind: str, what: Any, proposal: Proposal) -> bool:
        """Whether the kernel's rule does; a proof that was read from a file may name any rule, and be nested deeply."""
        rule = RULES.get((kind, proposal.status, proposal.rule))
        try:
            if rule is None:
                return False
            rule(self.context, what, Data(proposal.data))
        except (RuleFailure, RecursionError):
            self._forget(kind, what)
            return False
        return True

    def _forget(self, kind: str, what: Any) -> None:
        """What a rule has noted about its subject before a condition failed: a proof from a file may end half-way."""
        context = self.context
        if kind == "dgu":
            for noted in (context.storages, context.shortages):
                noted.pop(what, None)
        elif kind in ("load", "current"):
            for names in (context.strict_loads, context.sampled):
                names.discard(what)
            for numbers in (context.margins, context.moduli):
                numbers.pop(what, None)

    def _earlier_load(self, name: str, strongly: bool) -> list[Proposal]:
        """What an older certificate knows of a load: proofs and refutations, but no mere evidence.

        With a method that was asked for, only that one counts; if a modulus is of use, only proofs with one.
        """
        if self.method:
            return []
        found = [proposal for proposal in self.earlier.of(name) if proposal.status in ("proved", "refuted")]
        return [p for p in found if not strongly or p.status == "refuted" or "modulus" in p.data]

    def may_owe_to_borrowed(self) -> bool:
        """Whether an island may lack a proof only because older proofs of its parts say less than new ones might.

        A smaller shortage, a larger modulus, a strict load or another storage matrix make up for more, and the older
        certificate, which anybody may have written, need not have the best. To find an equilibrium, modulus and margin
        of loads given by their currents are used.
        """
        for name, (subject, _) in self.expected.items():
            if subject[0] in ("equilibrium", "saturated") and self.context.status[name] == "unknown":
                disks = (f"load/{node}" for node in subject[1] if self.context.nodes[node].current is not None)
                if any(self.earlier.offered(self.accepted[load]) for load in disks):
                    return True
            if subject[0] != "island" or self.context.status[name] in HOLDS:
                continue
            parts = [part for node in subject[1] for part in (f"dgu/{node}", f"load/{node}") if part in self.expected]
            borrowed = any(self.earlier.offered(self.accepted[part]) for part in parts)
            if self.given_up.intersection(subject[1]) or (
                borrowed and all(self.context.status[part] in HOLDS for part in parts)
            ):
                return True
        return False

    def _dgu(self, node: Mode) -> Proposal | None:
        """Passivity; failing that, passivity but for a shortage; with tolerances, the latter at once."""
        try:
            self.context.port(node)
        except RuleFailure:
            return None
        found = None if len(self.context.corners(node)) > 1 else self.passivity(node)
        if found and found.status == "proved":
            return found
        return self._index(node) or found or (self.passivity(node) if self.refute else None)

    def passivity(self, node: Mode) -> Proposal | None:
        """EIP, or why not: with tolerances, at the corner where most is missing."""
        content = self.context.key(node)
        corners = self.context.corners(node)
        if len(corners) == 1:
            return self._first(
                "dgu", node, content, lambda: propose_dgu(self.context.port(node)), self._earlier_passivity(node)
            )

        def refutations() -> Iterator[Proposal]:
            from certify.search.shortage import refute_corners

            yield from refute_corners({signs: self.context.port(node, signs) for signs in corners})

        return self._first("dgu", node, (content, "corners"), refutations, self._earlier_passivity(node))

    def _earlier_passivity(self, mode: Mode) -> list[Proposal]:
        """What an older certificate knows of it, and why a DGU that was passive but for a shortage is no more."""
        name = _claim_about(mode)
        found = self.earlier.of(name, "quadratic-storage", "frequency-witness", "storage-contradiction")
        short = [proposal.data.get("witness") for proposal in self.earlier.of(name, "index-storage")]
        return found + [Proposal("refuted", "frequency-witness", data) for data in short if isinstance(data, dict)]

    def _index(self, node: Mode) -> Proposal | None:
        """Passivity but for a shortage, as small as can be; with tolerances, for the whole box."""
        corners = self.context.corners(node)
        smallest = self._small_shortage(node)
        name, held = split(node)
        dgu = self.context.nodes[name].dgu
        design = (dgu.filter, dgu.controller, held) if dgu else None

        def proposals() -> Iterator[Proposal]:
            from certify.search.shortage import propose_box, propose_index

            if len(corners) == 1:
                yield from propose_index(self.context.port(node), smallest)
            elif self.context.port(node).capacitance_farad is not None:
                again = self.boxes.get(design)  # often the storage of a DGU that differs in its lines only
                yield from [again] if again else []
                yield from propose_box([self.context.port(node, signs) for signs in corners], smallest)

        older = self.earlier.short_of(_claim_about(node))
        found = self._first("dgu", node, (self.context.key(node), "index", smallest), proposals, older)
        if found and len(corners) > 1:
            self.boxes[design] = found
        return found

    def _small_shortage(self, node: Mode) -> Fraction:
        """A shortage in ohm that is small beside the resistances of the lines and branches there; a power of ten."""
        name, _ = split(node)
        branches = [b.resistance_ohm for b in self.context.nodes[name].branches]
        branches += [line.branch.resistance_ohm for line in self.context.lines_at[name]]
        share = min(branches, default=Fraction(1)) / (100 * max(len(branches), 1))
        return Fraction(10) ** magnitude(share)

    def _give_up_shortages(self, island: tuple[str, ...]) -> None:
        """Of DGUs whose shortage is of no use, say that they are not passive - where that is refuted."""
        context, status = self.context, self.context.status
        short = [node for node in island if node in context.shortages]
        useless = [node for node in short if self._is_large(node)]
        others = (f"load/{node}" for node in island if context.nodes[node].has_static_load)
        dgus = (f"dgu/{node}" for node in island if context.nodes[node].dgu)
        if not useless and all(status[claim] in HOLDS for claim in (*others, *dgus)):
            useless = short  # what remains is that the lines do not make up for all of them together
        for node in useless if self.refute else ():
            shortage, storage = self.context.shortages.pop(node), self.context.storages.pop(node)
            if any(self.earlier.offered(self.accepted.get(f"{part}/{node}")) for part in ("dgu", "load")):
                self.given_up.add(node)
            found = self.passivity(node)
            if found is None:
                self.context.shortages[node], self.context.storages[node] = shortage, storage
            else:
                self._settle(f"dgu/{node}", found)
                self.notes[f"dgu/{node}"] = "P207"

    def _is_large(self, node: str) -> bool:
        """Whether the shortage of this DGU is too much for the load there, or for its half of some line."""
        context = self.context
        shortage = context.shortages[node]
        branches = [line.branch for line in context.lines_at[node]] + list(context.nodes[node].branches)
        least = min((least_resistance(branch) for branch in branches), default=None)
        if least is not None and 2 * shortage * len(branches) >= least:
            return True
        if not context.nodes[node].has_static_load or context.status[f"load/{node}"] != "proved":
            return False
        try:
            return context.moduli.get(node, 0) <= 2 * shortage * lipschitz(context, node) ** 2
        except RuleFailure:  # no constant is known
            return True

    def _pins(self, island: tuple[str, ...]) -> Iterator[Proposal]:
        """Where V~ = 0 may follow: a strictly monotone load, a series branch, then the DGUs."""
        context = self.context
        status = "conditional" if context.sampled.intersection(island) else "proved"
        by_kind = (
            ("load", (name for name in island if name in context.strict_loads)),
            ("branch", (name for name in island if context.nodes[name].branches)),
            ("dgu", (name for name in island if name in context.storages)),
        )
        for by, names in by_kind:
            for name in names:
                yield Proposal(status, "invariant-set", {"by": by, "at": name})
                if by != "dgu":
                    break  # the other conditions do not depend on the pin

    def _reason(self, subject: tuple[str, Any]) -> str:
        """Why a claim stays open, as far as one can tell."""
        if subject[0] == "dgu":
            try:
                self.context.port(subject[1])
            except RuleFailure:
                return "P206"
            if len(self.context.corners(subject[1])) > 1:
                return "P208" if self.context.port(subject[1]).capacitance_farad is not None else "P209"
        if subject[0] in ("load", "current") and self.method:
            return "P210"
        return REASONS[subject[0]]


def _claim_about(mode: Mode) -> str:
    """The id of the claim about a DGU, or about a mode of it."""
    node, held = split(mode)
    return f"mode/{node}/{held}" if held else f"dgu/{node}"


def _until_exhausted(proposals: Iterator[Proposal]) -> Iterator[Proposal]:
    """The proposals up to the first that numbers out of the range of floats prevent: the claim stays open then."""
    try:
        yield from proposals
    except (ArithmeticError, ValueError):
        return
