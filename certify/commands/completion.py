"""`certify completion`: what lets a shell complete commands, options and files."""

from __future__ import annotations

import argparse
import json

from certify.commands.common import guarded
from certify.kernel.errors import Fault, SpecError

SHELLS = ("bash", "zsh", "fish", "tcsh")
SUMMARY = "print a script that lets a shell complete commands and options"
EXAMPLE = (
    'eval "$(certify completion bash)"                                     in ~/.bashrc\n'
    "certify completion zsh > ~/.zfunc/_certify                            with ~/.zfunc in $fpath\n"
    "certify completion fish > ~/.config/fish/completions/certify.fish"
)


def declare(parser: argparse.ArgumentParser) -> None:
    """What the command line may say."""
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(options: argparse.Namespace) -> int:
    return guarded(options, lambda: _print(options))


def _print(options: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        message = "the package shtab is not installed: pip install shtab"
        raise SpecError((Fault("U001", "shell", message),)) from None

    from certify.commands import build_parser

    script = shtab.complete(_with_files(build_parser(), shtab.FILE), shell=options.shell)
    print(json.dumps({"shell": options.shell, "script": script, "exit_code": 0}) if options.json else script)
    return 0


def _with_files(parser: argparse.ArgumentParser, complete: dict[str, str]) -> argparse.ArgumentParser:
    """The same parser: wherever a command takes a file or a folder, a shell offers those that are there."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                _with_files(sub, complete)
        elif action.metavar in FILES:
            action.complete = complete  # type: ignore[attr-defined]
    return parser


FILES = {"SPEC", "OLD_SPEC", "NEW_SPEC", "OUT_SPEC", "CERT", "OLD_CERT", "CODE|CERT", "TABLE", "FILE", "FOLDER", "DIR"}
