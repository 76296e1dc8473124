"""The commands and their options: what a command line may say. No command is run, and nothing heavy imported."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from certify import __version__
from certify.search.methods import METHODS

EXITS = (
    "exit codes: 0 certified, 1 refuted, 2 usage or bad input, 3 unknown or conditional, 4 certificate rejected,\n"
    "70 internal error"
)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; `command` is the name of the one given."""
    parser = argparse.ArgumentParser(
        prog="certify", description="Exact, checkable proofs of the stability of islanded AC microgrids.", epilog=EXITS
    )
    parser.add_argument("--version", action="version", version=f"certify {__version__}")

    def add_method(sub: argparse.ArgumentParser) -> None:
        text = "how loads are proved; by default the cheapest way that decides. `sampled` is evidence, never a proof"
        sub.add_argument("--method", choices=METHODS, help=text)

    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {example}\n\n{EXITS}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.add_argument("--json", action="store_true", help="print the result as JSON")
        return sub

    prove = command(
        "prove",
        "search for proofs and write a certificate",
        "certify prove specs/cigre-mv.toml -o cigre.cert.json\n"
        "  certify prove specs/cigre-mv.toml --scenario plug-in -o plug-in",
    )
    prove.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    prove.add_argument(
        "-o",
        "--output",
        metavar="CERT",
        help="where to write the certificate; with --scenario a folder for the spec and the certificate of each phase",
    )
    prove.add_argument(
        "--scenario",
        metavar="NAME",
        help="prove what there is between the events of a scenario of the spec, phase by phase; the exit code is the "
        "worst of all: 4, then 2, 1, 3, 0",
    )
    prove.add_argument("--all", action="store_true", help="list every claim")
    prove.add_argument(
        "--reuse",
        metavar="OLD_CERT",
        help="a certificate of an older state of the spec: its proofs are tried first. If this machine has checked it "
        "and only a few filters and controllers have changed, what they do not touch is taken over unchecked",
    )
    prove.add_argument(
        "--simulate",
        action="store_true",
        help="then simulate it, compare with the certificate, and try to break what that claims; 4 is the exit code of "
        "a contradiction (`certify simulate --check` has more to choose)",
    )
    add_method(prove)

    check = command(
        "check",
        "check a certificate with the kernel alone",
        "certify check specs/cigre-mv.toml cigre.cert.json",
    )
    check.add_argument("spec", metavar="SPEC", help="the microgrid that the certificate is about")
    check.add_argument("certificate", metavar="CERT", help="the certificate")
    check.add_argument("--all", action="store_true", help="list every claim")

    diff = command(
        "diff",
        "prove two states of a spec, and tell which claims the change touches and what becomes of each",
        "certify diff specs/cigre-mv.toml specs/cigre-mv-as-printed.toml",
    )
    diff.add_argument("old", metavar="OLD_SPEC", help="the microgrid before the change")
    diff.add_argument("new", metavar="NEW_SPEC", help="the microgrid after it; the exit code is that of this one")
    add_method(diff)

    gate = command(
        "gate",
        "prove many specs; the exit code is the worst of all: 4, then 2, 1, 3, 0",
        "certify gate specs/cigre-mv.toml specs/two-inverters.toml",
    )
    gate.add_argument("specs", metavar="SPEC", nargs="+", help="microgrids, TOML or JSON")
    gate.add_argument(
        "--allow",
        metavar="NAME",
        action="append",
        default=[],
        help="an assumption of the ledger that a verdict may rest on, such as sampled/9 or equilibrium/9; may be "
        "given again",
    )
    add_method(gate)

    explain = command("explain", "explain a code or a rule, or tell a certificate in words", "certify explain S304")
    explain.add_argument("subject", metavar="CODE|CERT", help="a code or rule of a message, or a certificate")
    explain.add_argument("spec", metavar="SPEC", nargs="?", help="the spec of the certificate")

    synth = command(
        "synth",
        "design the gains of one DGU from wishes, and certify the network with them",
        "certify synth specs/cigre-mv.toml --node 1 --settle 50ms -o new.toml --cert new.cert.json",
    )
    synth.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    synth.add_argument("--node", metavar="NODE", required=True, help="the node whose DGU gets new gains")
    synth.add_argument(
        "--settle",
        metavar="T",
        help="2 %% settling time: every closed-loop mode of that DGU alone, with its node's capacitance and without "
        "load, decays at least at rate 4/T; seconds unless a unit is given",
    )
    synth.add_argument("--decay", metavar="RATE", help="that rate itself, in 1/s")
    synth.add_argument(
        "--max-gain",
        metavar="G",
        help="no entry of K11 (no unit), K12 (ohm) and K13 (V per V s) is larger than G in absolute value; alone it "
        "asks for the fastest design. Without it the smallest gains are sought; those below 1 count as 1",
    )
    synth.add_argument(
        "--tolerance", metavar="SHARE", help='certify with such an error of the filter\'s R, L and C, e.g. "5 %%"'
    )
    synth.add_argument("--kind", default="pi", help="pi (state feedback, the default) or ida-pbc")

    tolerance = command(
        "tolerance",
        "find the largest tolerance with which the network is still certified",
        "certify tolerance specs/cigre-mv.toml --of filter -o tolerant.toml",
    )
    tolerance.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    tolerance.add_argument(
        "--of",
        metavar="KINDS",
        help="which parts may be off, all at once and each on its own: some of filter,line,load (default: all); "
        "parts with a tolerance of their own keep it",
    )
    loads = command(
        "loads",
        "decide every load of a table (CSV or JSON), or of a spec",
        "certify loads loads.csv --band 0.9pu 1.1pu -o results.csv --cert loads.cert.jsonl",
    )
    loads.add_argument("table", metavar="TABLE", help="loads, one in each row; `certify explain loads` has the columns")
    loads.add_argument(
        "--band",
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="where loads must be monotone; V0 of a row is 1 pu (default: 0.9 pu to 1.1 pu)",
    )
    loads.add_argument("-o", "--output", metavar="FILE", help="where to write the results, .csv or .json")
    loads.add_argument("--cert", metavar="CERT", help="where to write the certificate, one line for each row")
    loads.add_argument("--keep-going", action="store_true", help="decide the other rows if some cannot be read")
    loads.add_argument("--plot", metavar="FOLDER", help="draw margins over voltage and maps of pass and fail there")
    loads.add_argument("--power-factor", metavar="PF", action="append", help="of a map; may be given again")
    loads.add_argument("--cells", metavar="N", type=int, help="of a map, in each direction (default: 61)")
    loads.add_argument("--jobs", metavar="N", type=int, help="processes (default: all cores for large tables)")
    add_method(loads)
    _add_simulate(command)
    for sub in (synth, tolerance):
        sub.add_argument("-o", "--output", metavar="OUT_SPEC", help="where to write the new spec, if it is certified")
        sub.add_argument("--cert", metavar="CERT", help="where to write the certificate of the new spec; needs -o")
    return parser


def _add_simulate(command: Callable[[str, str, str], argparse.ArgumentParser]) -> None:
    simulate = command(
        "simulate",
        "simulate a microgrid in floats: what it does, without a proof",
        "certify simulate specs/cigre-mv.toml --scenario plug-in -o plug-in.npz --plot pictures\n"
        "  certify simulate specs/cigre-mv.toml --end 0.5s --start plug-in.npz\n\n"
        "exit codes of this command: 0 simulated, 2 usage or bad input, 3 diverged: floats refute nothing, 4 the\n"
        "certificate of --check is rejected, or contradicted by the simulation",
    )
    simulate.add_argument("spec", metavar="SPEC", help="the microgrid, TOML or JSON")
    simulate.add_argument(
        "--scenario", metavar="NAME", help="a scenario of the spec; without one nothing happens to it"
    )
    simulate.add_argument(
        "--end", metavar="T", help='stop at T, seconds or such as "500 ms" (default: the end of the scenario, or 1 s)'
    )
    simulate.add_argument(
        "--start",
        metavar="START",
        help="flat, zero, equilibrium, or a FILE: what -o has written, of which the last sample is taken, or JSON "
        "(`certify explain U006`); default: that of the scenario, or flat",
    )
    simulate.add_argument(
        "--samples", metavar="N", type=int, default=1000, help="of -o and --plot, evenly spaced (default: 1000)"
    )
    simulate.add_argument(
        "--tolerance",
        metavar="X",
        default="1e-8",
        help="what each step may add to the error of a state, as a share of its size (default: 1e-8)",
    )
    simulate.add_argument(
        "--method", choices=("exponential", "collocation"), help="default: exponential for small networks"
    )
    simulate.add_argument(
        "--band",
        metavar="V",
        help='errors of both axes within it count as settled: "2 V", "0.0001 pu", or a share of the base voltage, else '
        'of each reference (default: "0.01 %%")',
    )
    simulate.add_argument(
        "--check",
        metavar="CERT",
        help="compare with a certificate of the spec, or with --scenario with the folder of those of its phases: the "
        "equations, the equilibrium, the storage along the motion; and try to break what it claims",
    )
    simulate.add_argument(
        "--attempts", metavar="N", type=int, default=8, help="of --check to break a region, on each island (default: 8)"
    )
    simulate.add_argument("-o", "--output", metavar="FILE", help="where to write all samples, .npz or .csv")
    simulate.add_argument("--plot", metavar="FOLDER", help="draw voltages and errors there, as SVG and PNG")
