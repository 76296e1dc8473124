"""`certify diff`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from certify.commands.common import add_method, bad_input, progress_bar, rejected
from certify.exits import EXIT_CODES
from certify.kernel.errors import Rejected, SpecError

SUMMARY = "prove two states of a spec, and tell which claims the change touches and what becomes of each"
EXAMPLE = "certify diff specs/cigre-mv.toml specs/cigre-mv-as-printed.toml"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("old", metavar="OLD_SPEC", help="the microgrid before the change")
    parser.add_argument("new", metavar="NEW_SPEC", help="the microgrid after it; the exit code is that of this one")
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    from certify.certificate import prove
    from certify.comparison import compare
    from certify.inputs import decode_all, read
    from certify.report.diff import report
    from certify.search.earlier import Earlier

    file = options.old
    certificates: list[Any] = []
    grids: list[Any] = []
    try:
        for file in (options.old, options.new):
            spec = read(file)
            # What the change does not touch is proved by the same proofs.
            earlier = Earlier(json.loads(certificates[0].data)) if certificates else None
            with progress_bar(f"proving {file}") as progress:
                certificates.append(prove(spec, progress, method=options.method, earlier=earlier))
            grids.append(decode_all(spec))
    except SpecError as error:
        return bad_input(options, error.faults, file)
    except Rejected as rejection:
        options.spec = file
        return rejected(options, rejection)
    before, after = certificates
    comparison = compare((grids[0], grids[1]), (before.verdict, after.verdict))
    return report(options, comparison, before, after, EXIT_CODES[after.verdict.outcome])
