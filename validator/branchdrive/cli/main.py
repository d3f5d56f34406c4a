"""The commands `branchdrive` and `branchdrive-validate`.

Commands are modules with `SUMMARY`, `ORDER`, `add_arguments(parser)` and `run(args, stdout, stderr) -> int`.
They are found through the entry-point group `branchdrive.commands`, in which other distributions can name theirs; its
names are those of the commands, its values modules. Exit codes are those of `branchdrive.exit_code`: a command fails
for no reason in its input where it has a bug, a library is missing or too old, or a disk is full.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import distributions, entry_points, version
from math import inf
from shutil import get_terminal_size
from textwrap import fill
from typing import NoReturn, Protocol, TextIO

from branchdrive.contract.text import nearest, quote, similar
from branchdrive.errors import BranchDriveError, ToolError, UsageError
from branchdrive.exit_code import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_USAGE
from branchdrive.formats.file_error import file_error_text, is_machine_fault
from branchdrive.runtime.environment import check_environment, extra, import_fault, leave_out_pandas

__all__ = ["main", "run", "run_script", "script_main", "validate_main", "whole_parser"]

_GROUP = "branchdrive.commands"

_WITHOUT_PANDAS = ("validate", "collect", "inspect")
"""Commands that need no pandas, and whose libraries all work where it is not installed."""


class Command(Protocol):
    """A command module.

    Attributes:
        SUMMARY: What it does, as the help says it.
        ORDER: Its place in the help, which follows the work on a dataset; commands without one follow by name.
    """

    SUMMARY: str
    ORDER: int

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""

    def run(self, args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
        """Carry the command out; returns the exit code."""


@cache
def _command_modules() -> dict[str, str]:
    """Module of every command by name; another distribution adds commands and replaces none of this one."""
    ours = (point for found in distributions(name="branchdrive") for point in found.entry_points.select(group=_GROUP))
    return {point.name: point.value for point in (*entry_points(group=_GROUP), *ours)}


def _load(module_name: str) -> Command:
    module: Command = import_module(module_name)
    return module


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line and leave the interpreter running."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; `{self.prog} --help` explains")


class _CommandsParser(_Parser):
    """A parser of commands: its help, and nothing else, loads all of them for their summaries."""

    def format_help(self) -> str:
        """Usage, options, and every command with its summary."""
        listed = {name: _listed(module_name) for name, module_name in _command_modules().items()}
        room = max(map(len, listed)) + 4
        width = max(get_terminal_size().columns - 2, room + 20)
        lines = ["commands:"]
        for name in sorted(listed, key=lambda name: (listed[name][0], name)):
            _, summary = listed[name]
            text = fill(summary, width, initial_indent=" " * room, subsequent_indent=" " * room)
            lines.append(f"  {_on_one_line(name)}".ljust(room) + text[room:])
        ending = f"`{self.prog} COMMAND --help` explains a command."
        return "\n".join([super().format_help(), *lines, "", ending, ""])


def _listed(module_name: str) -> tuple[float, str]:
    """A command's place in the help, and what it does, or why it cannot be loaded: the help is complete in any case."""
    order = inf
    try:
        command = _load(module_name)
        declared = getattr(command, "ORDER", None)
        order = declared if isinstance(declared, int) else inf
        return order, _on_one_line(command.SUMMARY)
    except ImportError as error:
        return order, _on_one_line(str(import_fault(error, "this command")))
    except Exception as error:
        return order, f"this command cannot be loaded: {_on_one_line(repr(error))}"


def _carry_out(prog: str, action: Callable[[], int], stdout: TextIO, stderr: TextIO) -> int:
    """Exit code of `action`, whatever becomes of it; a failure is one line, and a bug has its traceback."""
    try:
        code = action()
        stdout.flush()
    except KeyboardInterrupt as interrupt:
        _say(stderr, f"{prog}: interrupted\n")
        return int(getattr(interrupt, "exit_code", EXIT_INTERRUPTED))
    except BrokenPipeError:
        _discard_output(stdout)
        return EXIT_INTERRUPTED
    except ToolError as error:
        _say(stderr, f"{prog}: {_on_one_line(str(error))}\n")
        return EXIT_FAILED
    except BranchDriveError as error:
        _say(stderr, f"{prog}: {_on_one_line(str(error))}\n")
        return EXIT_USAGE
    except OSError as error:
        _say(stderr, f"{prog}: {_on_one_line(file_error_text(error))}\n")
        _discard_if_full(stdout)
        return EXIT_FAILED if is_machine_fault(error) else EXIT_USAGE
    except ImportError as error:
        _say(stderr, f"{prog}: {_on_one_line(str(import_fault(error, 'this command')))}\n")
        return EXIT_FAILED
    except Exception as error:  # a bug is no verdict on a dataset: it must not end in exit code 1
        from traceback import format_exc

        _say(stderr, f"{format_exc()}{prog}: {type(error).__name__} in the tool itself; please report it\n")
        return EXIT_FAILED
    return code


def _on_one_line(message: str) -> str:
    """The message without control characters: names in it may come from a dataset."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in message)


def _say(stderr: TextIO, text: str) -> None:
    """Write a message; where it cannot be written, the exit code still says what happened."""
    try:
        stderr.write(text)
        stderr.flush()
    except (OSError, ValueError):
        _discard_output(stderr)


def _discard_if_full(stdout: TextIO) -> None:
    try:
        stdout.flush()
    except (OSError, ValueError):
        _discard_output(stdout)


def _discard_output(stream: TextIO) -> None:
    """Let the interpreter's last flush go nowhere, because the reader of the output has left."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def run(argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    """Run `branchdrive` with the given arguments; raises `SystemExit` only for `--help` and `--version`."""
    return _carry_out("branchdrive", lambda: _run_command(argv, stdout, stderr), stdout, stderr)


def whole_parser() -> argparse.ArgumentParser:
    """The parser of `branchdrive` with all commands that can be loaded, and their arguments."""
    parser, subparsers = _commands_parser()
    subparsers.help = "what to do"  # readers of the parser leave out what is suppressed
    for name, module_name in _command_modules().items():
        with suppress(Exception):  # whatever is wrong with the command of another distribution
            _add_command(subparsers, name, _load(module_name))
    return parser


def _commands_parser() -> tuple[_CommandsParser, argparse._SubParsersAction[_Parser]]:
    parser = _CommandsParser(
        "branchdrive",
        usage="%(prog)s [-h] [--version] COMMAND ...",
        description="Branch-structured driving datasets.",
    )
    parser.add_argument("--version", action="version", version=f"branchdrive {version('branchdrive')}")
    subparsers = parser.add_subparsers(
        dest="command",
        metavar="COMMAND",
        required=True,
        help=argparse.SUPPRESS,
        prog=parser.prog,
        parser_class=_Parser,
    )
    return parser, subparsers


def _add_command(subparsers: argparse._SubParsersAction[_Parser], name: str, command: Command) -> _Parser:
    parser = subparsers.add_parser(name, description=command.SUMMARY, help=command.SUMMARY)
    command.add_arguments(parser)
    if "--version" not in parser._option_string_actions:  # of a command that has its own
        parser.add_argument("--version", action="version", version=f"branchdrive {version('branchdrive')}")
    return parser


def _parsed(parser: _Parser, argv: Sequence[str], options_of: argparse.ArgumentParser) -> argparse.Namespace:
    """Parsed arguments; an option that there is not is answered with those that are like it."""
    args, unknown = parser.parse_known_args(argv)
    if not unknown:
        return args
    words = (word.partition("=")[0] for word in unknown if word.startswith("--"))
    near = next((found[0] for word in words if (found := similar(word, options_of._option_string_actions))), None)
    hint = f"; did you mean {near}?" if near else ""
    return parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")


def _run_command(argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    parser, subparsers = _commands_parser()
    modules = _command_modules()
    if argv and not argv[0].startswith("-") and argv[0] not in modules:
        parser.error(f"argument COMMAND: invalid choice: {quote(argv[0])}; {nearest(argv[0], sorted(modules))}")
    wanted = next((argument for argument in argv if argument in modules), None)
    own: argparse.ArgumentParser = parser
    for name, module_name in modules.items():
        if name == wanted:
            with extra(of=f"`{name}`"):
                own = _add_command(subparsers, name, _load(module_name))
        else:
            subparsers.add_parser(name, add_help=False)
    args = _parsed(parser, argv, own)
    check_environment()
    return _load(modules[args.command]).run(args, stdout, stderr)


def run_script(prog: str, module_name: str, argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    """Run a command that has a script of its own, `prog`, with the given arguments."""

    def action() -> int:
        command = _load(module_name)
        parser = _Parser(prog, description=command.SUMMARY)
        parser.add_argument("--version", action="version", version=f"{prog} {version('branchdrive')}")
        command.add_arguments(parser)
        args = _parsed(parser, argv, parser)
        check_environment()
        return command.run(args, stdout, stderr)

    return _carry_out(prog, action, stdout, stderr)


def validate_run(argv: Sequence[str], stdout: TextIO, stderr: TextIO) -> int:
    """Run `branchdrive-validate` with the given arguments."""
    return run_script("branchdrive-validate", "branchdrive.cli.validate", argv, stdout, stderr)


def _open_streams() -> tuple[TextIO, TextIO]:
    """Standard output and error; what the caller closed goes nowhere."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    return sys.stdout, sys.stderr


def main() -> int:
    """Entry point of `branchdrive`."""
    if sys.argv[1:] and sys.argv[1] in _WITHOUT_PANDAS:
        leave_out_pandas()
    return run(sys.argv[1:], *_open_streams())


def script_main(prog: str, module_name: str) -> int:
    """Entry point of a script that is one command."""
    return run_script(prog, module_name, sys.argv[1:], *_open_streams())


def validate_main() -> int:
    """Entry point of `branchdrive-validate`."""
    leave_out_pandas()
    return validate_run(sys.argv[1:], *_open_streams())
