"""`certify loads`."""

from __future__ import annotations

import argparse

from certify.commands.common import add_method, bad_input, progress_bar, rejected
from certify.kernel.errors import Fault, Rejected, SpecError

SUMMARY = "decide every load of a table (CSV or JSON), or of a spec"
EXAMPLE = "certify loads loads.csv --band 0.9pu 1.1pu -o results.csv --cert loads.cert.jsonl"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("table", metavar="TABLE", help="loads, one a row; `certify explain loads` has the columns")
    parser.add_argument(
        "--band",
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="where loads must be monotone; V0 of a row is 1 pu (default: 0.9 pu to 1.1 pu)",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="where to write the results, .csv or .json")
    parser.add_argument("--cert", metavar="CERT", help="where to write the certificate, one line for each row")
    parser.add_argument("--keep-going", action="store_true", help="decide the other rows if some cannot be read")
    parser.add_argument("--plot", metavar="FOLDER", help="draw margins over voltage and maps of pass and fail there")
    parser.add_argument("--power-factor", metavar="PF", action="append", help="of a map; may be given again")
    parser.add_argument("--cells", metavar="N", type=int, help="of a map, in each direction (default: 61)")
    parser.add_argument("--jobs", metavar="N", type=int, help="processes (default: all cores for large tables)")
    add_method(parser)


def run(options: argparse.Namespace) -> int:
    from certify.report import loads

    options.band = tuple(options.band) if options.band else None
    try:
        with progress_bar(f"deciding {options.table}") as progress:
            return loads.run(options, progress)
    except SpecError as error:
        return bad_input(options, error.faults, options.table)
    except Rejected as rejection:
        return rejected(options, rejection)
    except OSError as error:
        return bad_input(options, (Fault("U001", "-o", f"cannot write: {error.strerror}"),), options.table)
