"""`certify explain`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from certify.commands.common import bad_input, checked, is_about_loads, report_verdict
from certify.exits import EXIT_CODES
from certify.kernel.errors import Fault

SUMMARY = "explain a code or a rule, or tell a certificate in words"
EXAMPLE = "certify explain S304"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("subject", metavar="CODE|CERT", help="a code or rule of a message, or a certificate")
    parser.add_argument("spec", metavar="SPEC", nargs="?", help="the spec of the certificate")


def run(options: argparse.Namespace) -> int:
    from certify.diagnostics import DIAGNOSTICS, explain

    subject = options.subject
    if subject in DIAGNOSTICS:
        print(json.dumps(vars(DIAGNOSTICS[subject]), indent=1) if options.json else explain(subject))
        return 0
    if not Path(subject).exists():
        import difflib

        near = {code for text in (subject, subject.upper()) for code in difflib.get_close_matches(text, DIAGNOSTICS, 3)}
        known = f"did you mean {' or '.join(sorted(near))}?" if near else f"codes and rules: {', '.join(DIAGNOSTICS)}"
        message = f"{subject!r} is neither a file nor a code; {known}"
        return bad_input(options, (Fault("U001", "CODE|CERT", message),), "explain")
    if options.spec is None:
        message = "a certificate is told with its spec, because nothing in it is believed unchecked"
        return bad_input(options, (Fault("U001", "SPEC", message),), "explain")
    if is_about_loads(subject):
        message = "a certificate of a table is told by `certify check TABLE CERT`; `certify loads TABLE` decides again"
        return bad_input(options, (Fault("U001", "CODE|CERT", message),), "explain")
    from certify.report.text import tell

    def told(verdict: Any, notes: dict[str, str]) -> int:
        advice: dict[str, list[str]] = {}
        more: dict[str, Any] = {}
        dgus = (claim for claim in verdict.claims if claim.id.startswith("dgu/"))
        if any(claim.status == "refuted" or claim.rule == "index-storage" for claim in dgus):
            from certify.report.nearest import advise  # numpy and scipy, only for this

            advice, more = advise(options.spec, verdict)
        if options.json:
            return report_verdict(options, verdict, notes, {"certificate": subject, **more})
        title = f"{subject}, checked against {options.spec}: {verdict.outcome}"
        print(tell(verdict, title, advice=advice))
        return EXIT_CODES[verdict.outcome]

    return checked(options, subject, told)
