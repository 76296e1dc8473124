"""What each code means, why it matters and what to try: data for `certify explain` and for the help of messages."""

from __future__ import annotations

from certify.diagnostics import certificates, imports, proofs, rules, specs, tables, usage
from certify.diagnostics.entry import Diagnostic as Diagnostic

# The name of a note that is evidence for people, beside the code why a claim is open.
IN_FLOATS = "in floats"

_FAMILIES = (specs, usage, certificates, tables, imports, proofs, rules)
DIAGNOSTICS: dict[str, Diagnostic] = {entry.code: entry for family in _FAMILIES for entry in family.ENTRIES}


def explain(code: str) -> str:
    """What / Why / What to try for one code, as text. Raises: KeyError for an unknown code.

    >>> explain("S302").splitlines()[0]
    'S302: self-loop'
    """
    entry = DIAGNOSTICS[code]
    lines = [f"{entry.code}: {entry.title}", "", entry.why, "", f"What to try: {entry.remedy}."]
    if entry.example:
        lines += ["", "Example:", *(f"    {line}" for line in entry.example.splitlines())]
    return "\n".join(lines)
