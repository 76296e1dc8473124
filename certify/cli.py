"""The command line: read it, call the command, return its exit code, never a traceback."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from certify.commands import build_parser, command_module
from certify.commands.common import bad_input
from certify.exits import INTERNAL
from certify.kernel.errors import SpecError
from certify.provenance import settle_epoch


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; never a traceback."""
    given = sys.argv[1:] if arguments is None else arguments
    options = build_parser(given[0] if given else None).parse_args(given)
    try:
        with contextlib.redirect_stdout(_Pipe(sys.stdout)), contextlib.redirect_stderr(_Pipe(sys.stderr)):
            code = _run(options)
            sys.stdout.flush()
            sys.stderr.flush()
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if os.environ.get("CERTIFY_DEBUG"):
            raise
        print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
        print("this is a defect of certify; CERTIFY_DEBUG=1 shows where", file=sys.stderr)
        return INTERNAL


def _run(options: argparse.Namespace) -> int:
    try:
        settle_epoch()
    except SpecError as error:
        return bad_input(options, error.faults, "the environment")
    code: int = command_module(options.command).run(options)
    return code


class _Pipe(io.TextIOBase):
    """An output stream that may be closed, full or unable to show a letter: the exit code is still the command's."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    def isatty(self) -> bool:
        try:
            return self.stream is not None and bool(self.stream.isatty())
        except ValueError:  # closed: a library that has seen this stream may ask when the process ends
            return False

    def fileno(self) -> int:
        return int(self.stream.fileno())

    def write(self, text: str) -> int:
        self._attempt(lambda: self.stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._attempt(lambda: self.stream.flush())

    def _attempt(self, action: Callable[[], Any]) -> None:
        if self.stream is None:
            return
        try:
            action()
        except OSError:  # nobody reads, or there is no room: nothing more can be said here
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())


def run() -> NoReturn:
    """Entry point of the `certify` command."""
    sys.exit(main())


if __name__ == "__main__":
    run()
