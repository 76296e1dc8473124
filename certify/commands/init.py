"""`certify init`: a commented spec to begin with."""

from __future__ import annotations

import argparse
import json
import os
import shlex
from importlib.resources import files
from pathlib import Path

from certify.certificate import write_atomically
from certify.commands.common import guarded
from certify.kernel.errors import Fault, SpecError

SUMMARY = "write a commented spec to begin with; it is certified as it is"
EXAMPLE = "certify init microgrid.toml && certify prove microgrid.toml"


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("spec", metavar="SPEC", nargs="?", default="microgrid.toml", help="default: microgrid.toml")
    parser.add_argument("--force", action="store_true", help="even if there is such a file already")


def run(options: argparse.Namespace) -> int:
    return guarded(options, lambda: _write(options))


def _write(options: argparse.Namespace) -> int:
    path = Path(options.spec)
    reason = ""
    if path.suffix != ".toml":
        reason = "its name does not end in .toml"
    elif path.is_dir() or not path.parent.is_dir():
        reason = "there is no such folder, or it is a folder itself"
    elif os.path.lexists(path) and not options.force:
        reason = "it is there already; --force writes over it"
    if not reason:
        try:
            write_atomically(path, starter(options.spec).encode())
        except OSError as error:
            reason = str(error.strerror)
    if reason:
        raise SpecError((Fault("U001", "SPEC", f"cannot write {options.spec}: {reason}"),))
    if options.json:
        print(json.dumps({"written": options.spec, "exit_code": 0}, indent=1))
    else:
        print(f"written: {options.spec}; try: certify prove {shlex.quote(options.spec)}")
    return 0


def starter(name: str) -> str:
    """The text of the spec, with the name that its comments call it by.

    >>> "certify prove grid.toml" in starter("grid.toml")
    True
    """
    text = files("certify").joinpath("templates/starter.toml").read_text(encoding="utf-8")
    shown = shlex.quote(name)
    return text.replace("THIS_FILE", shown if shown.isprintable() and len(shown) < 80 else "SPEC")
