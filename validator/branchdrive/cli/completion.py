"""`branchdrive completion`: a script by which a shell completes commands, options and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

SUMMARY = "print a script that completes commands and options in a shell"
ORDER = 200

SHELLS = {
    "bash": "source <(branchdrive completion bash)",
    "zsh": 'branchdrive completion zsh > "${fpath[1]}/_branchdrive"',
    "fish": "branchdrive completion fish > ~/.config/fish/completions/branchdrive.fish",
}
"""Shells, and how each takes its script."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("shell", choices=[*SHELLS], help="; ".join(f"{shell}: {how}" for shell, how in SHELLS.items()))


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Print the script.

    Raises:
        PlatformError: The package that writes such scripts is not installed.
    """
    from branchdrive.cli.main import whole_parser
    from branchdrive.runtime.environment import extra

    with extra("completion", of="`completion`"):
        import shtab

    parser = whole_parser()
    for action in _actions(parser):
        if action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    stdout.write(shtab.complete(parser, shell=args.shell) + "\n")
    return 0


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Arguments of a parser, and of the commands in it."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
