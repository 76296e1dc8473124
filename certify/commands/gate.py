"""`certify gate`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

from certify.commands.common import add_method, prove_file
from certify.exits import EXIT_CODES, worst_of
from certify.kernel.claims import BESIDE
from certify.kernel.errors import Rejected, SpecError

SUMMARY = "prove many specs; the exit code is the worst of all: 4, then 2, 1, 3, 0"
EXAMPLE = "certify gate specs/cigre-mv.toml specs/two-inverters.toml"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("specs", metavar="SPEC", nargs="+", help="microgrids, TOML or JSON")
    parser.add_argument(
        "--allow",
        metavar="NAME",
        action="append",
        default=[],
        help="an assumption of the ledger that a verdict may rest on, such as sampled/9 or equilibrium/9; may be "
        "given again",
    )
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    results: list[dict[str, Any]] = []
    for spec in options.specs:
        started = time.perf_counter()
        allowed = False
        entry: dict[str, Any] = {"spec": spec}
        try:
            certificate, _, _ = prove_file(spec, options.method)
        except SpecError as error:
            entry |= {
                "outcome": "bad input",
                "detail": [f"{f.code} {f.path}: {f.message}".replace(" : ", ": ") for f in error.faults],
            }
        except Rejected as error:
            entry |= {"outcome": "rejected", "detail": [str(error)]}
        else:
            claims = (c for c in certificate.verdict.claims if c.kind not in BESIDE)
            open_claims = [c for c in claims if c.status != "proved"]
            detail = [f"{c.status} {c.id} ({c.rule or certificate.notes.get(c.id)})" for c in open_claims]
            names = [name for name, _ in certificate.verdict.assumptions if "/" in name]
            detail += [f"to pass, it needs --allow {name}" for name in names if name not in options.allow]
            entry |= {"outcome": certificate.verdict.outcome, "detail": detail}
            allowed = entry["outcome"] == "conditional" and set(names) <= set(options.allow)
        entry |= {
            "exit_code": 0 if allowed else EXIT_CODES[entry["outcome"]],
            "milliseconds": round(1000 * (time.perf_counter() - started)),
        }
        results.append(entry)
        if not options.json:
            _print_gate_line(entry)
    worst = worst_of(entry["exit_code"] for entry in results)
    if options.json:
        print(json.dumps({"exit_code": worst, "results": results}, indent=1))
    else:
        passed = sum(entry["exit_code"] == 0 for entry in results)
        print(f"{passed} of {len(results)} passed" if options.allow else f"{passed} of {len(results)} certified")
    return worst


def _print_gate_line(entry: dict[str, Any]) -> None:
    from certify.report.text import paint

    word = entry["outcome"]
    print(f"{paint(word, sys.stdout.isatty(), f'{word:10}')} {entry['milliseconds']:>6} ms  {entry['spec']}")
    for text in entry["detail"][:8]:
        print(f"{'':21}{text}")
    if len(entry["detail"]) > 8:
        print(f"{'':21}and {len(entry['detail']) - 8} more")
