"""Certificates, codes and rules in words, for use from Python."""

from __future__ import annotations

import difflib

from certify.certificate import Certificate
from certify.diagnostics import DIAGNOSTICS
from certify.diagnostics import explain as explain_code
from certify.kernel.errors import Fault, SpecError


def explain(subject: Certificate | str, limit: int = 200) -> str:
    """A certificate in words, claim by claim with rule, margins and assumptions; or what a code or rule means.

    `subject`: what `prove` or `check` returned, or a code such as "S203" or "frequency-witness". `limit`: claims told.
    Where the gains of a DGU are not passive, the nearest ones that are, and what in them would have to change.
    Raises: SpecError U034 if there is no such code.

    >>> print(explain("S302").splitlines()[0])
    S302: self-loop
    >>> import certify
    >>> print(explain(certify.prove("specs/two-inverters.toml")).splitlines()[0])
    certified
    """
    if isinstance(subject, Certificate):
        from certify.report.text import tell

        claims = subject.verdict.claims
        lost = [c for c in claims if c.kind == "dgu" and (c.status == "refuted" or c.rule == "index-storage")]
        advice: dict[str, list[str]] = {}
        if lost:
            from certify.report.nearest import advise

            advice, _ = advise(subject.spec, subject.verdict)
        return tell(subject.verdict, subject.outcome, limit, advice)
    if not isinstance(subject, str):
        raise TypeError(f"what is explained is a certificate or a code, not a value of type {type(subject).__name__}")
    if subject not in DIAGNOSTICS:
        near = difflib.get_close_matches(subject, DIAGNOSTICS, 3) or difflib.get_close_matches(
            subject.upper(), DIAGNOSTICS, 3
        )
        known = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(DIAGNOSTICS)}"
        raise SpecError((Fault("U034", "", f"{subject[:60]!r} is no code or rule; {known}"),))
    return explain_code(subject)
