"""`certify check`."""

from __future__ import annotations

import argparse
import json

from certify.commands.common import bad_input, checked, is_about_loads, progress_bar, rejected, report_verdict
from certify.exits import EXIT_CODES, worst_of
from certify.kernel.errors import Rejected, SpecError

SUMMARY = "check a certificate with the kernel alone"
EXAMPLE = "certify check specs/cigre-mv.toml cigre.cert.json"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid that the certificate is about")
    parser.add_argument("certificate", metavar="CERT", help="the certificate")
    parser.add_argument("--all", action="store_true", help="list every claim")


def run(options: argparse.Namespace) -> int:
    if is_about_loads(options.certificate):
        return _check_table(options)
    return checked(
        options, options.certificate, lambda verdict, notes: report_verdict(options, verdict, notes, {}), True
    )


def _check_table(options: argparse.Namespace) -> int:
    from collections import Counter

    from certify.inputs import read
    from certify.kernel.check_loads import check_table
    from certify.kernel.table import MAX_TABLE_BYTES

    counts: Counter[str] = Counter()
    try:
        table, certificate = read(options.spec, MAX_TABLE_BYTES), read(options.certificate, 4 * MAX_TABLE_BYTES)
        with progress_bar(f"checking {options.certificate}") as progress:
            total = max(table.count(b"\n"), 1)
            for row in check_table(table, certificate):
                counts[row.verdict.status if row.verdict else "bad input"] += 1
                if progress:
                    progress(min(sum(counts.values()), total), total)
    except SpecError as error:
        return bad_input(options, error.faults)
    except Rejected as rejection:
        return rejected(options, rejection)
    code = worst_of(EXIT_CODES["certified" if verdict == "proved" else verdict] for verdict in counts)
    band = json.loads(certificate.split(b"\n", 1)[0])["band"]  # part of what is proved, and in no other file
    if options.json:
        print(json.dumps({"table": options.spec, "band": band, "counts": counts, "exit_code": code}, indent=1))
    else:
        told = ", ".join(f"{count:,} {verdict}" for verdict, count in counts.items())
        where = f"from {band[0]} to {band[1]}, where a row has no band of its own"
        print(f"accepted: {options.certificate} about {options.spec}, {where}: {told}")
    return code
