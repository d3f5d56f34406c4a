"""The team's own command, run again in a process of its own: its placeholders, its time limit, and its end.

A command is split into words as a shell would, and no shell runs it. Placeholders may stand anywhere in a word:

* ``{out}``, required: the folder of the dataset. It does not exist, or holds what a killed run has left.
* ``{groups}``: ids of the groups to collect, separated by commas, in the order in which to collect them.
* ``{order}``: ``forward`` or ``reverse``, for a command that cannot take a list of groups.

The command runs in the current folder with the environment of this process and no input, collects the groups of the
pilot, finishes the dataset and exits with 0. It leads a process group, all of which ends with it.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from branchdrive.contract.text import printable
from branchdrive.errors import UsageError

__all__ = ["Command", "Run"]

_PLACEHOLDERS = ("out", "groups", "order")
_PLACEHOLDER = re.compile(r"\{([a-z_]+)\}")
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
        """
        ordered = list(reversed(group_ids)) if is_reversed else list(group_ids)
        values = {"out": str(out), "groups": ",".join(ordered), "order": "reverse" if is_reversed else "forward"}
        return [_PLACEHOLDER.sub(lambda found: values[found[1]], word) for word in self.words]

    def run(self, out: Path, group_ids: Sequence[str], *, limit_s: float, is_reversed: bool = False) -> Run:
        """Run the command; after `limit_s` its process group is killed, without a warning.

        Raises:
            UsageError: It cannot be started.
        """
        log = out.with_name(f"{out.name}.log")
        begin_s = time.perf_counter()
        with log.open("ab") as stream:
            process = self._start(self.line(out, group_ids, is_reversed=is_reversed), stream.fileno())
            try:
                exit_code: int | None = process.wait(limit_s)
            except subprocess.TimeoutExpired:
                exit_code = None
            finally:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return Run(out, time.perf_counter() - begin_s, exit_code, _last_line(log))

    @staticmethod
    def _start(words: list[str], output: int) -> subprocess.Popen[bytes]:
        try:
            return subprocess.Popen(  # noqa: S603  (the user's own command, without a shell)
                words, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        except OSError as error:
            raise UsageError(f"--rerun: {words[0]!r} cannot be started: {error.strerror}") from error


def _last_line(log: Path) -> str:
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _TAIL_BYTES))
        lines = [line.strip() for line in stream.read().decode(errors="replace").splitlines()]
    return printable(next((line for line in reversed(lines) if line), ""))[:_TAIL_CHARACTERS]
