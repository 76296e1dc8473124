"""`python -m certify.kernel SPEC CERT`: check a certificate with nothing but the Python standard library."""

import contextlib
import io
import sys
from pathlib import Path

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
