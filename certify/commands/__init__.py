"""The commands, a module for each.

A module has SUMMARY and EXAMPLE for its help, `declare(parser)` for its options, `run(options)` that returns an exit
code, and EXITS if its exit codes mean something of their own.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from keyword import iskeyword
from types import ModuleType

from certify import __version__

# In the order of the help. What is no name in Python has a module with an underscore.
COMMANDS = (
    "init",
    "prove",
    "check",
    "diff",
    "gate",
    "explain",
    "synth",
    "tolerance",
    "loads",
    "simulate",
    "report",
    "import",
    "completion",
)
EXAMPLES = """example:
  certify prove grid.toml -o grid.cert.json    search for proofs of every claim
  certify check grid.toml grid.cert.json       check them, without any solver
  certify COMMAND --help                       what a command may be told, with an example"""
EXITS = (
    "exit codes: 0 certified, 1 refuted, 2 usage or bad input, 3 unknown or conditional, 4 certificate rejected,\n"
    "70 internal error"
)


def command_module(name: str) -> ModuleType:
    """The module of a command."""
    return import_module(f"certify.commands.{name}{'_' if iskeyword(name) else ''}")


def build_parser(first: str | None = None) -> argparse.ArgumentParser:
    """The parser of all commands; `command` is the name of the one given.

    If `first`, the first word of a command line, is a command, that one alone is read and made ready: a start is quick.
    """
    parser = argparse.ArgumentParser(
        prog="certify",
        description="Exact, checkable proofs of the stability of islanded AC microgrids.",
        epilog=f"{EXAMPLES}\n\n{EXITS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"certify {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in (first,) if first in COMMANDS else COMMANDS:
        module = command_module(name)
        examples = "\n".join(f"  {line}" for line in module.EXAMPLE.splitlines())
        sub = commands.add_parser(
            name,
            help=module.SUMMARY,
            description=module.SUMMARY,
            epilog=f"example:\n{examples}\n\n{getattr(module, 'EXITS', EXITS)}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.add_argument("--json", action="store_true", help="print the result as JSON")
        module.declare(sub)
    return parser
