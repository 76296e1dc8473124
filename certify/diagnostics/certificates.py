"""Why a certificate is rejected."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
    Diagnostic(
        "K101",
        "not a certificate",
        "The file is not JSON of the certificate's shape.",
        "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    Diagnostic(
        "K102",
        "another format",
        "A certificate of another version says other things.",
        "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    Diagnostic(
        "K103",
        "about another spec",
        "A certificate names its spec or table by a hash of all its bytes.",
        "prove the changed file again: `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    *(
        Diagnostic(
            code,
            title,
            "The certificate is not as the format has it, so nothing in it is believed.",
            "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
        )
        for code, title in (
            ("K104", "proof does not match its key"),
            ("K105", "claims are not those of the spec"),
            ("K106", "unknown claim with a proof"),
            ("K107", "rule does not fit the claim"),
            ("K108", "proof missing"),
            ("K109", "proof of nothing"),
            ("K110", "ledger is not that of the spec"),
            ("K111", "verdict does not follow"),
        )
    ),
    Diagnostic(
        "K201",
        "proof does not hold",
        "The kernel rebuilt the claim from the spec, and a side condition of the rule fails.",
        "do not use this certificate; write it again with `certify prove`, or `certify loads --cert`",
    ),
)
