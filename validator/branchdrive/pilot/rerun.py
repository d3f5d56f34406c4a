"""The team's own command, run again in a process of its own: its placeholders, its time limit, and its end.

A command is split into words as a shell would, and no shell runs it. Placeholders may stand anywhere in a word:

* ``{out}``, required: the folder of the dataset. It does not exist, or holds what a killed run has left.
* ``{groups}``: ids of the groups to collect, separated by commas, in the order in which to collect them.
* ``{order}``: ``forward`` or ``reverse``, for a command that cannot take a list of groups.

The command runs in the current folder with the environment of this process and no input, collects the groups of the
pilot, finishes the dataset and exits with 0. It leads a session; see `branchdrive.pilot.supervisor` for what ends with
it, and with this process.

Ids of groups are those of a dataset, and a command may well hand them to a shell: only those that have the form of an
id reach it.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.text import printable, quote
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.pilot import supervisor
from branchdrive.runtime.process import bare_command

__all__ = ["Command", "Run"]

_PLACEHOLDERS = ("out", "groups", "order")
_PLACEHOLDER = re.compile(r"\{([a-z_]+)\}")
_ID = re.compile(PATTERNS["id"].removeprefix("^").removesuffix("$"))
_TAIL_BYTES = 4096
_TAIL_CHARACTERS = 300


@dataclass(frozen=True)
class Run:
    """One run of the command.

    Attributes:
        out: Folder of its dataset.
        seconds: Wall time.
        exit_code: ``None`` where it was killed after its time.
        last_line: The last line that it printed.
    """

    out: Path
    seconds: float
    exit_code: int | None
    last_line: str

    @property
    def dataset(self) -> Folder:
        """What it left."""
        return Folder.at(self.out)

    @property
    def failure(self) -> str | None:
        """Why there is no finished dataset, ``None`` where there should be one."""
        said = f"; it said last: {self.last_line}" if self.last_line else ""
        if self.exit_code is None:
            return f"did not end within {self.seconds:.0f} s and was killed{said}"
        return None if self.exit_code == 0 else f"ended with exit code {self.exit_code}{said}"


@dataclass(frozen=True)
class Command:
    """A command line with placeholders.

    Attributes:
        words: Its words.
    """

    words: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Command:
        """The command that a user gave.

        Raises:
            UsageError: It does not split into words, lacks ``{out}``, or has placeholders that do not go together.
        """
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise UsageError(f"--rerun: {text!r} is no command line: {error}") from error
        named = {name for word in words for name in _PLACEHOLDER.findall(word)}
        unknown = sorted(named - set(_PLACEHOLDERS))
        if unknown:
            raise UsageError(f"--rerun: no placeholder {{{unknown[0]}}}; there are {{out}}, {{groups}} and {{order}}")
        if "out" not in named:
            raise UsageError("--rerun: the command needs {out}, where the folder of the dataset goes")
        if {"groups", "order"} <= named:
            raise UsageError("--rerun: give {groups} or {order}, not both: a list of groups has an order")
        return cls(words)

    def takes(self, name: str) -> bool:
        """Whether the placeholder `name` is there."""
        return any(name in _PLACEHOLDER.findall(word) for word in self.words)

    def line(self, out: Path, group_ids: Sequence[str], *, is_reversed: bool = False) -> list[str]:
        """Words of one run.

        Args:
            out: Folder of the dataset.
            group_ids: Groups to collect, in forward order.
            is_reversed: Whether to collect them in reverse order.

        Raises:
            UsageError: The command takes ids, and one has not the form of an id.
        """
        odd = [group_id for group_id in group_ids if not _ID.fullmatch(group_id)]
        if odd and self.takes("groups"):
            raise UsageError(
                f"--rerun: {quote(odd[0])} is no id of a group, and is not handed to a command; run "
                "`branchdrive-validate`, or leave {groups} out"
            )
        ordered = list(reversed(group_ids)) if is_reversed else list(group_ids)
        values = {"out": str(out), "groups": ",".join(ordered), "order": "reverse" if is_reversed else "forward"}
        return [_PLACEHOLDER.sub(lambda found: values[found[1]], word) for word in self.words]

    def run(self, out: Path, group_ids: Sequence[str], *, limit_s: float, is_reversed: bool = False) -> Run:
        """Run the command; after `limit_s` it is killed, without a warning, with all that it has started.

        Raises:
            UsageError: It cannot be started, or an id cannot be handed to it.
        """
        log = out.with_name(f"{out.name}.log")
        words = self.line(out, group_ids, is_reversed=is_reversed)
        with log.open("ab") as stream, _supervised(words, stream.fileno()) as (process, answers):
            kind, _, detail = answers.readline().partition(" ")
            if kind == "error":
                raise UsageError(f"--rerun: {words[0]!r} cannot be started: {os.strerror(int(detail))}")
            begin_s = time.perf_counter()
            try:
                process.wait(limit_s)
                kind, _, detail = answers.readline().partition(" ")
                exit_code = int(detail) if kind == "exit" else process.returncode
            except subprocess.TimeoutExpired:
                exit_code = None
        return Run(out, time.perf_counter() - begin_s, exit_code, _last_line(log))


@contextmanager
def _supervised(words: list[str], output: int) -> Iterator[tuple[subprocess.Popen[str], IO[str]]]:
    """A supervisor with the command below it, both of which are over in the end, and what it says of the command.

    It has a session of its own, so that signals from the terminal reach this process alone.
    """
    ours, theirs = os.pipe()
    try:
        process = subprocess.Popen(  # noqa: S603  (the user's own command, without a shell)
            bare_command(supervisor.__file__, *words),
            stdin=ours, stdout=subprocess.PIPE, stderr=output, text=True, start_new_session=True,
        )  # fmt: skip
    except BaseException:
        os.close(theirs)
        raise
    finally:
        os.close(ours)
    with cast("IO[str]", process.stdout) as answers:
        try:
            yield process, answers
        finally:
            os.close(theirs)  # which it sees, and ends the command
            process.wait()


def _last_line(log: Path) -> str:
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _TAIL_BYTES))
        lines = [line.strip() for line in stream.read().decode(errors="replace").splitlines()]
    return printable(next((line for line in reversed(lines) if line), ""))[:_TAIL_CHARACTERS]
