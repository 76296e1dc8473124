"""The checker: rebuilds every claim from the spec and accepts a certificate only if each proof holds.

Nothing that the spec determines is read from the certificate: it states claims, and for each one a rule with the
numbers that the rule needs. Provenance is ignored. FORMAT.md has the grammar and the theorems.
"""

from __future__ import annotations

import hashlib
import json
from fractions import Fraction
from typing import Any

from certify.kernel.claims import (
    Claim,
    Context,
    Fact,
    Verdict,
    assumptions,
    but_for_a_shortage,
    but_for_others,
    overall,
    statements,
)
from certify.kernel.data import Data
from certify.kernel.errors import Rejected, RuleFailure
from certify.kernel.proofs import RULES
from certify.kernel.quantity import shorten
from certify.kernel.reader import unique
from certify.kernel.spec import Microgrid, decode

FORMAT = "certify/certificate@1"


def proof_key(data: object) -> str:
    """The name of a shared proof: a hash of its canonical text."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def check(spec: bytes, certificate: bytes) -> Verdict:
    """Check a certificate against the spec that it is about.

    Raises: SpecError if the spec is not well formed; Rejected if the certificate does not prove what it says.
    """
    grid = decode(spec)
    document = read_certificate(certificate)
    if document["format"] != FORMAT:
        raise Rejected("K102", "format", f"this checker reads {FORMAT}")
    if document["spec_sha256"] != hashlib.sha256(spec).hexdigest():
        raise Rejected("K103", "spec_sha256", "the certificate is about another spec, or the spec has changed")
    try:
        return _check_claims(grid, document)
    except RecursionError:
        raise Rejected("K101", "file", "nested too deeply") from None


def _check_claims(grid: Microgrid, document: dict[str, Any]) -> Verdict:
    context = Context(grid)
    expected, proofs = statements(context), document["proofs"]
    listed = document["claims"]
    if not isinstance(proofs, dict) or not isinstance(listed, list):
        raise Rejected("K101", "file", "expected a table of proofs and a list of claims")
    for key, data in proofs.items():
        if proof_key(data) != key:
            raise Rejected("K104", f"proofs.{shorten(key)}", "the proof does not have the content that its key names")
    results, used = [], set()
    for (name, (subject, text)), entry in zip(expected.items(), listed, strict=False):
        _keys(entry, {"id", "statement", "status", "rule", "proof"}, name)
        if entry["rule"] == "index-storage":
            text = but_for_a_shortage(text, _shortage(proofs, entry["proof"], name))
        elif entry["rule"] == "local-monotonicity":
            text = but_for_others(text)
        if (entry["id"], entry["statement"]) != (name, text):
            raise Rejected("K105", name, f"the spec calls for another claim here than {shorten(entry['id'])}")
        rule, key = entry["rule"], entry["proof"]
        if entry["status"] == "unknown":
            if (rule, key) != (None, None):
                raise Rejected("K106", name, "an unknown claim has neither rule nor proof")
            facts: tuple[Fact, ...] = ()
        else:
            texts = isinstance(rule, str) and isinstance(entry["status"], str)
            handler = RULES.get((subject[0], entry["status"], rule)) if texts else None
            if handler is None:
                shown = f"{shorten(entry['status'])} by {shorten(rule)}"
                raise Rejected("K107", name, f"a claim about this kind of thing cannot be {shown}")
            if not isinstance(key, str) or key not in proofs:
                raise Rejected("K108", name, "its proof is missing")
            used.add(key)
            try:
                facts = handler(context, subject[1], Data(proofs[key]))
            except RuleFailure as failure:
                raise Rejected("K201", name, f"rule {rule}: {failure}") from None
        context.status[name] = entry["status"]
        results.append(Claim(name, text, entry["status"], rule, facts))
    if len(listed) != len(expected):
        raise Rejected("K105", "claims", f"{len(listed)} claims, but the spec calls for {len(expected)}")
    if used != set(proofs):
        raise Rejected("K109", "proofs", "there is a proof that no claim uses")
    ledger = assumptions(context)
    if document["assumptions"] != ledger:
        raise Rejected("K110", "assumptions", "the ledger is not the one that this spec calls for")
    outcome = overall(context.status)
    if document["verdict"] != outcome:
        raise Rejected("K111", "verdict", f"the claims make it {outcome}")
    return Verdict(outcome, tuple(results), tuple((entry["name"], entry["statement"]) for entry in ledger))


def read_certificate(certificate: bytes) -> dict[str, Any]:
    """The document of a certificate, nothing of which is checked yet but its keys. Raises: Rejected K101."""

    def no_number(text: str) -> object:
        raise ValueError(f"a bare number {shorten(text)}; rationals are written as text")

    try:
        document = json.loads(
            certificate.decode(), parse_float=no_number, parse_constant=no_number, object_pairs_hook=unique
        )
    except (ValueError, RecursionError) as error:
        raise Rejected("K101", "file", f"not a certificate: {error}") from None
    _keys(document, {"format", "spec_sha256", "claims", "proofs", "assumptions", "verdict", "provenance"}, "file")
    return document  # type: ignore[no-any-return]


def _shortage(proofs: dict[str, Any], key: object, name: str) -> Fraction:
    """The eps of a proof by `index-storage`: part of what its claim says."""
    data = proofs.get(key) if isinstance(key, str) else None
    try:
        return Data(data.get("shortage") if isinstance(data, dict) else None).scalar()
    except RuleFailure as failure:
        raise Rejected("K201", name, f"rule index-storage: {failure}") from None


def _keys(value: object, keys: set[str], where: str) -> None:
    if not isinstance(value, dict) or set(value) != keys:
        raise Rejected("K101", where, f"expected a table with exactly the keys {', '.join(sorted(keys))}")
