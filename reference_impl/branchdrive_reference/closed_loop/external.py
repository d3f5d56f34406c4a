"""A selector that is a program of others: a history as JSON on its standard input, a candidate as its answer.

It is started for every decision, without a shell, and writes the action key of a candidate as its one line. What it
says on its standard error is shown as it is. It runs with the rights of who drives: name no program that you do not
trust. What it starts ends with the decision, as long as it stays in the program's process group.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from branchdrive.contract.text import quote
from branchdrive.errors import UsageError
from branchdrive.model.features import HISTORIES
from branchdrive_reference.closed_loop.sight import Sight

__all__ = ["External"]

PATIENCE_S = 60.0
"""How long a decision may take."""

_MOST_BYTES = 4096
"""An answer is one action key."""


@dataclass(frozen=True)
class External:
    """Decides by a program.

    Attributes:
        name: Name of the selector.
        command: Program and arguments.
        candidates: Action keys in the order of the bank.
        patience_s: How long a decision may take.
    """

    name: str
    command: tuple[str, ...]
    candidates: tuple[str, ...]
    patience_s: float = PATIENCE_S
    sees = "sensor history, by a program of others"

    def __call__(self, sight: Sight) -> int:
        """Place of the candidate that the program answers with.

        Raises:
            UsageError: It cannot be started, fails, takes too long, or answers with anything but a candidate.
        """
        answer = self._answer(json.dumps(_question(sight, self.candidates)).encode())
        try:
            key = answer.decode("ascii").strip()
        except UnicodeDecodeError:
            key = ""
        if key not in self.candidates:
            found = quote(answer[:80].decode("utf-8", "replace"))
            raise UsageError(
                f"the selector {self.name!r} answered {found}; expected one of the candidates, such as "
                f"{self.candidates[0]!r}, and nothing else"
            )
        return self.candidates.index(key)

    def _answer(self, question: bytes) -> bytes:
        with tempfile.TemporaryFile() as stream:  # no pipe, on which one process could wait for the other
            stream.write(question)
            stream.seek(0)
            try:
                process = subprocess.Popen(  # noqa: S603  (no shell)
                    self.command, stdin=stream, stdout=subprocess.PIPE, start_new_session=True
                )
            except OSError as error:
                raise UsageError(f"the selector {self.name!r} cannot be started: {error}") from error
        late = threading.Event()

        def end() -> None:
            late.set()
            _kill(process)

        timer = threading.Timer(self.patience_s, end)
        timer.start()
        with process:
            try:
                answer = process.stdout.read(_MOST_BYTES + 1) if process.stdout is not None else b""
                if len(answer) > _MOST_BYTES:
                    raise UsageError(f"the selector {self.name!r} answered more than {_MOST_BYTES} bytes")
                status = process.wait()
            finally:
                timer.cancel()
                _kill(process)
        if late.is_set():
            raise UsageError(f"the selector {self.name!r} gave no answer within {self.patience_s:g} s")
        if status != 0:
            raise UsageError(f"the selector {self.name!r} ended with status {status}")
        return answer


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a program that leads a session, and what it started: that could hold its answer open for ever."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


def _question(sight: Sight, candidates: Sequence[str]) -> dict[str, Any]:
    """What a program is asked: rows of state and controls by the names of their features, physical units."""
    history = sight.history()
    rows = {"state": history["state"], "past_controls": history["controls"]}
    return {
        "decision": sight.number,
        "tick": sight.tick,
        "candidates": list(candidates),
        **{
            table: {
                feature.name: [value if math.isfinite(value) else None for value in values.tolist()]
                for feature, values in zip(HISTORIES[table].features, found.T, strict=True)
            }
            for table, found in rows.items()
        },
    }
