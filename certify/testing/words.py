"""The messages of failing tests: the verdict, what is open with its reason and remedy, and the spec, in few lines."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import Any

from certify.building.toml import to_toml
from certify.certificate import Certificate
from certify.kernel.claims import Claim, Verdict
from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import read_document
from certify.report.text import open_claims, render_faults

MOST_LINES = 60  # of a spec in a message


def file_of(spec: Any) -> str:
    """The path of a spec that is in a file, as it was given; empty for one that a test has made."""
    if isinstance(spec, str | os.PathLike):
        return str(spec)
    return str(spec.name) if getattr(spec, "path", None) is not None else ""


def about(spec: Any) -> str:
    """A spec as a message calls it: by its path, or as what is printed below."""
    return file_of(spec) or "the spec below"


def verdict_in_words(found: Certificate, wanted: str, missing: Iterable[str] = (), by: str = "allow") -> str:
    """That a verdict is another than the wanted one, and which claims are the reason."""
    lines = [f"{found.verdict.outcome}, and not {wanted}", *open_claims(found.verdict, found.notes)]
    names = list(missing)
    if names and found.verdict.outcome == "conditional":
        lines += ["", f"to pass, it needs {by} {', '.join(names)}: what its ledger assumes, and what is not proved"]
    return "\n".join(lines)


def claim_in_words(claim: Claim, notes: dict[str, str]) -> str:
    """One claim with its rule, its witness if it is refuted, and what it means; a proved one in a line."""
    if claim.status == "proved":
        return f"proved[{claim.rule}] {claim.id}: {claim.statement}"
    return "\n".join(open_claims(Verdict("unknown", (claim,), ()), notes)[1:])


def faults_in_words(faults: tuple[Fault, ...], file: str) -> str:
    return render_faults(faults, file or "the spec")


def spec_in_words(spec: bytes) -> str:
    """The spec as TOML, not more than its first lines if it is long."""
    try:
        document = read_document(spec)
        text = to_toml(document) if spec.lstrip().startswith(b"{") else spec.decode("utf-8-sig")
    except (SpecError, AttributeError, TypeError, UnicodeDecodeError):
        text = spec[:4000].decode(errors="replace")
    lines = text.rstrip("\n").split("\n")
    if len(lines) > MOST_LINES:
        lines = [*lines[:MOST_LINES], f"# and {len(lines) - MOST_LINES} more lines"]
    return "\n".join(lines)


def json_text(value: Any) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"
