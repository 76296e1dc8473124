"""`certify simulate`."""

from __future__ import annotations

import argparse

from certify.commands.common import guarded, progress_bar

SUMMARY = "simulate a microgrid in floats: what it does, without a proof"
EXAMPLE = (
    "certify simulate specs/cigre-mv.toml --scenario plug-in -o plug-in.npz --plot pictures\n"
    "certify simulate specs/cigre-mv.toml --end 0.5s --start plug-in.npz"
)
EXITS = (
    "exit codes of this command: 0 simulated, 2 usage or bad input, 3 diverged: floats refute nothing, 4 the\n"
    "certificate of --check is rejected, or contradicted by the simulation"
)


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    parser.add_argument("--scenario", metavar="NAME", help="a scenario of the spec; without one nothing happens to it")
    parser.add_argument(
        "--end", metavar="T", help='stop at T, seconds or such as "500 ms" (default: the end of the scenario, or 1 s)'
    )
    parser.add_argument(
        "--start",
        metavar="START",
        help="flat, zero, equilibrium, or a FILE: what -o has written, of which the last sample is taken, or JSON "
        "(`certify explain U006`); default: that of the scenario, or flat",
    )
    parser.add_argument(
        "--samples", metavar="N", type=int, default=1000, help="of -o and --plot, evenly spaced (default: 1000)"
    )
    parser.add_argument(
        "--tolerance",
        metavar="X",
        default="1e-8",
        help="what each step may add to the error of a state, as a share of its size (default: 1e-8)",
    )
    parser.add_argument(
        "--method", choices=("exponential", "collocation"), help="default: exponential for small networks"
    )
    parser.add_argument(
        "--band",
        metavar="V",
        help='errors of both axes within it count as settled: "2 V", "0.0001 pu", or a share of the base voltage, else '
        'of each reference (default: "0.01 %%")',
    )
    parser.add_argument(
        "--check",
        metavar="CERT",
        help="compare with a certificate of the spec, or with --scenario with the folder of those of its phases: the "
        "equations, the equilibrium, the storage along the motion; and try to break what it claims",
    )
    parser.add_argument(
        "--attempts", metavar="N", type=int, default=8, help="of --check to break a region, on each island (default: 8)"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="where to write all samples, .npz or .csv")
    parser.add_argument("--plot", metavar="FOLDER", help="draw voltages and errors there, as SVG and PNG")


def run(options: argparse.Namespace) -> int:
    from certify.report import simulation

    return guarded(options, lambda: simulation.run(options, progress_bar))
