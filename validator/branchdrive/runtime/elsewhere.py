"""Work of `run_each` by an executor, on other machines for example: tasks go there with their function, and come back.

A task is worked on to its end, and what it reports comes with its result. It is not asked to stop: who gives it up
ends its process. So it is for functions whose work survives a kill, and goes on where it was.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from branchdrive.errors import BranchDriveError, PlatformError, ToolError
from branchdrive.runtime.executor import Died, Executor, Failed, memory_limit

__all__ = ["run_elsewhere", "unseen_error"]

_Result = TypeVar("_Result")
_Task = TypeVar("_Task")


@dataclass(frozen=True)
class _Errand:
    """A task with its function."""

    function: Callable[[Any, Callable[..., None]], Any]
    task: Any


@dataclass(frozen=True)
class _Answer:
    """What became of a task: its result or its error, and what it reported before."""

    reports: list[tuple[object, ...]]
    result: Any = None
    error: BranchDriveError | None = None


def run_elsewhere(
    executor: Executor,
    function: Callable[[_Task, Callable[..., None]], _Result],
    tasks: Sequence[_Task],
    watch: Callable[..., None],
) -> Generator[_Result, None, None]:
    """What a function returns for each task, as `run_each` gives it, by an executor.

    Raises:
        PlatformError: A machine lacks something.
        ToolError: A process died, or failed.
    """
    errands = [_Errand(function, task) for task in tasks]
    for _, answer in executor(_carry_out, errands):
        if isinstance(answer, Failed):
            raise ToolError(f"a worker process failed ({answer.reason})")
        if isinstance(answer, Died):
            raise ToolError("a worker process died; make room in memory, and run the same command again to go on")
        for report in answer.reports:
            watch(*report)
        if answer.error is not None:
            raise answer.error
        yield answer.result


_functions: dict[bytes, Callable[[Any, Callable[..., None]], Any]] = {}
"""The last function of this process, with what it keeps between tasks, by its pickle."""


def _carry_out(errand: _Errand) -> _Answer:
    """Work on a task in a worker process, in which this package's own data need no limit on memory."""
    key = pickle.dumps(errand.function)
    if key not in _functions:
        _functions.clear()
        _functions[key] = errand.function
    reports: list[tuple[object, ...]] = []
    try:
        with memory_limit(sys.maxsize):
            return _Answer(reports, _functions[key](errand.task, lambda *report: reports.append(report)))
    except BranchDriveError as error:
        return _Answer(reports, error=error)


def unseen_error(what: str) -> PlatformError:
    """Error where a process has finished something which is not here: the folder has one name there, and is another."""
    return PlatformError(
        f"{what} was finished on another machine, and is not seen on this one; all nodes need one folder that they "
        "share, by one name"
    )
