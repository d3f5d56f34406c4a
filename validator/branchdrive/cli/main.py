"""The commands `branchdrive` and `branchdrive-validate`.

Commands are modules with `SUMMARY`, `add_arguments(parser)` and `run(args, stdout, stderr) -> int`.
Extras add theirs through the entry-point group `branchdrive.commands`. Exit codes: 0, 1, 3, 4 as the
verdict says; 2 wrong usage; 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import entry_points, version
from typing import Protocol, TextIO

from branchdrive.errors import BranchDriveError

__all__ = ["main", "run", "validate_main"]

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130

_BUILT_IN = {"validate": "branchdrive.cli.validate", "rules": "branchdrive.cli.rules"}


class Command(Protocol):
    """A command module."""

    SUMMARY: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""

    def run(self, args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
        """Carry the command out; returns the exit code."""


def _command_modules() -> dict[str, str]:
    """Module of every command: the built-in ones and those of installed extras."""
    added = {point.name: point.value for point in entry_points(group="branchdrive.commands")}
    return {**_BUILT_IN, **added}


def _load(module_name: str) -> Command:
    module: Command = import_module(module_name)
    return module


def _execute(
    parser: argparse.ArgumentParser, command: Command, args: argparse.Namespace, out: TextIO, err: TextIO
) -> int:
    try:
        return command.run(args, out, err)
    except KeyboardInterrupt:
        err.write(f"{parser.prog}: interrupted\n")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        return EXIT_INTERRUPTED
    except (BranchDriveError, OSError) as error:
        err.write(f"{parser.prog}: {error}\n")
        return EXIT_USAGE


def run(argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    """Run `branchdrive` with the given arguments; raises `SystemExit` only for `--help` and `--version`."""
    parser = argparse.ArgumentParser("branchdrive", description="Branch-structured driving datasets.")
    parser.add_argument("--version", action="version", version=f"branchdrive {version('branchdrive')}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    modules = _command_modules()
    wanted = next((argument for argument in argv if argument in modules), None)
    for name, module_name in modules.items():
        if name == wanted:
            command = _load_or_explain(name, module_name)
            command.add_arguments(subparsers.add_parser(name, help=command.SUMMARY, description=command.SUMMARY))
        else:
            subparsers.add_parser(name, help=_SUMMARIES.get(name, "added by an installed extra"), add_help=False)
    args = _parse(parser, argv)
    if isinstance(args, int):
        return args
    return _execute(parser, _load(modules[args.command]), args, stdout, stderr)


_SUMMARIES = {
    "validate": "check a dataset against the specification",
    "rules": "list the rules, or explain one",
    "collect": "collect a dataset in the reference world",
}


def _load_or_explain(name: str, module_name: str) -> Command:
    try:
        return _load(module_name)
    except ModuleNotFoundError as error:
        hint = "pip install 'branchdrive[sim]'" if module_name.startswith("branchdrive_reference") else "reinstall it"
        raise BranchDriveError(f"`{name}` needs the package {error.name!r}: {hint}") from error


def _parse(parser: argparse.ArgumentParser, argv: Sequence[str]) -> argparse.Namespace | int:
    try:
        return parser.parse_args(argv)
    except SystemExit as stop:
        if stop.code:
            return EXIT_USAGE
        raise


def validate_run(argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    """Run `branchdrive-validate` with the given arguments."""
    command = _load(_BUILT_IN["validate"])
    parser = argparse.ArgumentParser("branchdrive-validate", description=command.SUMMARY)
    command.add_arguments(parser)
    args = _parse(parser, argv)
    return args if isinstance(args, int) else _execute(parser, command, args, stdout, stderr)


def main() -> int:
    """Entry point of `branchdrive`."""
    try:
        return run(sys.argv[1:], sys.stdout, sys.stderr)
    except BranchDriveError as error:
        sys.stderr.write(f"branchdrive: {error}\n")
        return EXIT_USAGE


def validate_main() -> int:
    """Entry point of `branchdrive-validate`."""
    return validate_run(sys.argv[1:], sys.stdout, sys.stderr)
