"""`certify import`: networks of other programs as specs."""

from __future__ import annotations

import argparse

from certify.commands.common import guarded

SUMMARY = "make a spec from a network of another program"
EXAMPLE = """certify import pandapower net.json -o net.toml --dgu 3,7
certify import pandapower net.json -o net.toml --dgus-at static-generators,storage --filter-from mine.toml
certify import simbench 1-LV-rural1--0-sw -o rural.toml --dgus-at static-generators
certify import opendss Master.dss -o feeder.toml --dgu 650,671 --leave-out pvsystem"""
EXITS = "exit codes of this command: 0 imported, 2 usage or bad input (nothing is written then)"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    from certify.report.importing import FORMATS

    listed = "; ".join(f"{name}: {form.what}" for name, form in FORMATS.items())
    parser.add_argument("format", metavar="FORMAT", choices=tuple(FORMATS), help=listed)
    parser.add_argument("file", metavar="FILE", help="the network (`certify explain pandapower`: what becomes of it)")
    parser.add_argument("-o", "--output", metavar="SPEC", help="where to write the spec (default: only report)")
    parser.add_argument("--dgu", metavar="BUS[,BUS..]", action="append", help="buses with a DGU, by index or name")
    parser.add_argument(
        "--dgus-at",
        metavar="KINDS",
        action="append",
        help="a DGU at each of these: some of generators,storage,static-generators,ext-grid. Sources at a bus with a "
        "DGU are that DGU",
    )
    parser.add_argument(
        "--leave-out",
        metavar="TABLE[,TABLE..]",
        action="append",
        help="elements of the source to do without; of OpenDSS classes and elements, such as pvsystem,load.a",
    )
    parser.add_argument(
        "--filter-from",
        metavar="SPEC",
        help="take filter and controller of all DGUs from this spec (default: placeholders, scaled to each DGU)",
    )
    parser.add_argument("--filter", metavar="NAME", help="which filter of that spec, if it has more than one")
    parser.add_argument(
        "--controller", metavar="NAME", help="which controller of that spec; or of the placeholders: ida-pbc or pi"
    )
    parser.add_argument(
        "--reference",
        metavar="[BUS=]PU",
        action="append",
        help="|V| that DGUs keep, of all or of one, such as 1.02pu or 7=0.98pu (default: of the source, or 1 pu)",
    )
    parser.add_argument(
        "--band", nargs=2, metavar=("LOW", "HIGH"), help="where load claims must hold (default: 0.9pu 1.1pu)"
    )
    parser.add_argument(
        "--line-capacitance", metavar="C", help='of lines for which the source says none, such as "10 nF/km"'
    )
    parser.add_argument(
        "--bus-capacitance",
        metavar="C",
        help='of buses that are left without any, such as "1 nF" behind transformers; dead ends are then kept',
    )
    parser.add_argument("--frequency", metavar="F", help='of the spec (default: that of the source), such as "60 Hz"')


def run(options: argparse.Namespace) -> int:
    from certify.report import importing

    return guarded(options, lambda: importing.run(options))
