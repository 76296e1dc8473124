"""`certify tolerance`."""

from __future__ import annotations

import argparse

from certify.commands.common import add_outputs, designed

SUMMARY = "find the largest tolerance with which the network is still certified"
EXAMPLE = "certify tolerance specs/cigre-mv.toml --of filter -o tolerant.toml"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    parser.add_argument(
        "--of",
        metavar="KINDS",
        help="which parts may be off, all at once and each on its own: some of filter,line,load (default: all); "
        "parts with a tolerance of their own keep it",
    )
    add_outputs(parser)


def run(options: argparse.Namespace) -> int:
    from certify.report import tolerance

    return designed(options, tolerance.run)
