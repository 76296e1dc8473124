"""`certify synth`."""

from __future__ import annotations

import argparse

from certify.commands.common import add_outputs, designed

SUMMARY = "design the gains of one DGU from wishes, and certify the network with them"
EXAMPLE = "certify synth specs/cigre-mv.toml --node 1 --settle 50ms -o new.toml --cert new.cert.json"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    parser.add_argument("--node", metavar="NODE", required=True, help="the node whose DGU gets new gains")
    parser.add_argument(
        "--settle",
        metavar="T",
        help="2 %% settling time: every closed-loop mode of that DGU alone, with its node's capacitance and without "
        "load, decays at least at rate 4/T; seconds unless a unit is given",
    )
    parser.add_argument("--decay", metavar="RATE", help="that rate itself, in 1/s")
    parser.add_argument(
        "--max-gain",
        metavar="G",
        help="no entry of K11 (no unit), K12 (ohm) and K13 (V per V s) is larger than G in absolute value; alone it "
        "asks for the fastest design. Without it the smallest gains are sought; those below 1 count as 1",
    )
    parser.add_argument(
        "--tolerance", metavar="SHARE", help='certify with such an error of the filter\'s R, L and C, e.g. "5 %%"'
    )
    parser.add_argument("--kind", default="pi", help="pi (state feedback, the default) or ida-pbc")
    add_outputs(parser)


def run(options: argparse.Namespace) -> int:
    from certify.report import synthesis

    return designed(options, synthesis.run)
