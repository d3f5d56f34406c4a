"""A leakage audit in a process of its own, whose linear algebra runs in one thread.

Sums of a linear algebra library depend on its number of threads in their last bits, so the audit has a fresh
process. Parts that are known and progress go through a pipe, and files are the parent's alone. It is no worker of
an executor, because workers import the script that starts them.

Source: spec/10-layers.md#layers.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, Pipe
from typing import Any, Protocol

from branchdrive.engine.spool import Spool
from branchdrive.errors import ToolError
from branchdrive.leakage.audit import Progress, SeenInputs, audit_key, audit_of
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable
from branchdrive.leakage.draw import drawn_here
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.protocol import AuditProtocol
from branchdrive.release.spread_draw import SpreadDraw
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.process import ARRAY_WORK, child_environment, exit_after, python_command
from branchdrive.runtime.standing import standing

__all__ = ["AuditTask", "KnownParts", "PartsOf", "audit_here", "audit_in_own_process"]


class KnownParts(Protocol):
    """Finished parts of an audit by name."""

    def get(self, name: str) -> dict[str, Any] | None:
        """The part, if it is known."""

    def put(self, name: str, part: dict[str, Any]) -> None:
        """Keep the part."""


@dataclass(frozen=True)
class AuditTask:
    """All that an audit is a function of.

    Attributes:
        inputs: Gives what is seen; called in the process of the audit.
        seed: Of everything random.
        protocol: Numbers of the audit; None is the default.
        classifier: Of the recurrent tests, or why there is none.
        jobs: Processes that compute; 1 is that of the audit.
        executor: What computes instead of these; its processes have one thread and see the folder of temporary files.
    """

    inputs: Callable[[], ReplayInputs]
    seed: int
    protocol: AuditProtocol | None
    classifier: SequenceClassifier | Unavailable
    jobs: int = 1
    executor: Executor | None = None


PartsOf = Callable[[str], KnownParts]
"""Gives the finished parts of the audit with a key."""


def audit_here(task: AuditTask, parts_of: PartsOf, progress: Progress | None = None) -> dict[str, Any]:
    """The audit as JSON, in this process and with as many threads as it has.

    With more jobs than one, other processes of one thread each hold what is seen, and this one a few numbers a group.
    """
    with Spool.temporary() as spool:
        return _audited(task, spool, parts_of, progress)


def _audited(task: AuditTask, spool: Spool, parts_of: PartsOf, progress: Progress | None) -> dict[str, Any]:
    with ExitStack() as stack:
        executor = task.executor
        if executor is None and task.jobs > 1:
            executor = stack.enter_context(standing(task.jobs))
        draw = drawn_here if executor is None else SpreadDraw(spool, executor)
        inputs, seen = draw.keep(_collected, task.inputs)
        key = audit_key(
            seen.described["digest"], seed=task.seed, protocol=task.protocol, sequence_classifier=task.classifier
        )
        parts = parts_of(key)

        def remember(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
            part = parts.get(name)
            if part is None:
                part = compute()
                parts.put(name, part)
            return part

        return audit_of(
            inputs,
            seen,
            seed=task.seed,
            protocol=task.protocol,
            sequence_classifier=task.classifier,
            remember=remember,
            progress=progress,
            draw=draw,
        )


def _collected(inputs: Callable[[], ReplayInputs]) -> tuple[ReplayInputs, SeenInputs]:
    found = inputs()
    return found, SeenInputs.of(found)


def audit_in_own_process(task: AuditTask, parts_of: PartsOf, progress: Progress | None = None) -> dict[str, Any]:
    """The audit as JSON, from a process of its own; it ends when this call does, however it ends, with what it wrote.

    Raises:
        ToolError: The process died, of a lack of memory for example.
    """
    here, there = Pipe()
    with Spool.temporary() as spool, here:  # a process that is killed removes nothing
        with there:
            process = subprocess.Popen(  # noqa: S603  (this interpreter and this module)
                python_command("-m", __name__, str(there.fileno())),
                env={**child_environment(), **ARRAY_WORK},
                pass_fds=(there.fileno(),),
                stdin=subprocess.PIPE,  # closes with this process, however that ends
                start_new_session=True,  # an interrupt from the keyboard is the parent's to tell of
            )
        try:
            here.send((task, spool))
            return _serve(here, parts_of, progress)
        except (EOFError, ConnectionError) as error:
            raise ToolError(
                "the process of the leakage audit died; give it more memory, or leave the audit out"
            ) from error
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def _serve(connection: Connection, parts_of: PartsOf, progress: Progress | None) -> dict[str, Any]:
    """Answer what the process asks until it has the whole audit."""
    match connection.recv():
        case "key", key:
            parts = parts_of(key)
        case "failed", error:
            raise error
    while True:
        match connection.recv():
            case "progress", done, total, name:
                if progress:
                    progress(done, total, name)
            case "get", name:
                connection.send(parts.get(name))
            case "put", name, part:
                parts.put(name, part)
            case "failed", error:
                raise error
            case "done", document:
                found: dict[str, Any] = document
                return found


@dataclass(frozen=True)
class _AskedParts:
    """Parts that the parent process knows."""

    connection: Connection

    @classmethod
    def of(cls, connection: Connection, key: str) -> _AskedParts:
        connection.send(("key", key))
        return cls(connection)

    def get(self, name: str) -> dict[str, Any] | None:
        self.connection.send(("get", name))
        part: dict[str, Any] | None = self.connection.recv()
        return part

    def put(self, name: str, part: dict[str, Any]) -> None:
        self.connection.send(("put", name, part))


def _work(connection: Connection) -> None:
    """Carry out the task that comes through `connection`."""
    try:
        task, spool = connection.recv()
        tempfile.tempdir = str(spool.folder)  # whose content the parent removes, also where this process is killed
        try:
            parts_of = partial(_AskedParts.of, connection)
            document = _audited(task, spool, parts_of, lambda *step: connection.send(("progress", *step)))
        except (EOFError, ConnectionError):
            raise
        except Exception as error:  # it is the parent's
            connection.send(("failed", error))
        else:
            connection.send(("done", document))
    except (EOFError, ConnectionError):
        return  # the result is not waited for any more


if __name__ == "__main__":
    from branchdrive.release.audit_process import _work as _work_by_name  # so that others find its functions

    exit_after(lambda: os.read(sys.stdin.fileno(), 1))  # nothing is ever written
    with Connection(int(sys.argv[1])) as _connection:
        _work_by_name(_connection)
