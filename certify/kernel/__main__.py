"""`python -m certify.kernel SPEC CERT`: check a certificate with nothing but the Python standard library.

SPEC may be a table of loads, if CERT is about one.
"""

import contextlib
import io
import json
import sys
from pathlib import Path

from certify.kernel import check_loads
from certify.kernel.check import check
from certify.kernel.errors import Rejected, SpecError

EXIT_CODES = {"certified": 0, "refuted": 1, "unknown": 3, "conditional": 3}


def main(arguments: list[str]) -> int:
    """Exit code: 0 certified, 1 refuted, 2 bad input, 3 unknown, 4 certificate rejected."""
    if len(arguments) != 2:
        print("usage: python -m certify.kernel SPEC CERT", file=sys.stderr)
        return 2
    try:
        spec, certificate = (Path(name).read_bytes() for name in arguments)
        if certificate.startswith(b"{") and check_loads.FORMAT.encode() in certificate.split(b"\n", 1)[0]:
            return _check_table(spec, certificate)
        verdict = check(spec, certificate)
    except OSError as error:
        print(f"cannot read {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except SpecError as error:
        for fault in error.faults:
            print(f"error[{fault.code}]: {arguments[0]}: {fault.path}: {fault.message}", file=sys.stderr)
        return 2
    except Rejected as error:
        print(f"rejected[{error.code}]: {error.where}: {error.reason}", file=sys.stderr)
        return 4
    for claim in verdict.claims:
        print(f"{claim.status:8} {claim.id}: {claim.statement}" + (f" [{claim.rule}]" if claim.rule else ""))
    print(verdict.outcome)
    return EXIT_CODES[verdict.outcome]


def _check_table(table: bytes, certificate: bytes) -> int:
    """All rows, the worst of which makes the exit code."""
    codes = {"proved": 0, "refuted": 1, "unknown": 3, "conditional": 3}
    found = {0}
    for result in check_loads.check_table(table, certificate):
        status = result.verdict.status if result.verdict else "bad input"
        found.add(codes.get(status, 2))
        print(f"{status:8} row {result.number}" + (f" ({result.row.name})" if result.row and result.row.name else ""))
    print("from {} to {}, where a row has no band of its own".format(*json.loads(certificate.splitlines()[0])["band"]))
    return next(code for code in (2, 1, 3, 0) if code in found)


if __name__ == "__main__":
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        code = main(sys.argv[1:])
        sys.stdout.flush()
    except Exception as error:  # never a code that means a verdict
        code = 70
        with contextlib.suppress(Exception):
            print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
    sys.exit(code)
