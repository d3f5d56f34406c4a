"""The one way in which child processes start and end: they import nothing from the current folder, and outlive nobody.

`multiprocessing` starts its workers and its resource tracker by ``python -c``, and Python puts the current folder
first on the path of such a process: a ``re.py`` in a dataset would run before any code of ours. So children start
with ``PYTHONSAFEPATH`` (or ``-P``) and without relative entries of ``PYTHONPATH``. This process has that environment
for the moment of a start only; children keep it for processes of their own.

Source: spec/09-security.md#serialisation.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import MappingProxyType
from typing import Any

from branchdrive.errors import PlatformError

__all__ = [
    "ARRAY_WORK", "ONE_THREAD", "bare_command", "child_environment", "exit_after", "python_command", "spawn_context",
]  # fmt: skip

_SAFE, _PATH = "PYTHONSAFEPATH", "PYTHONPATH"

ONE_THREAD: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(
        (
            "BLIS_NUM_THREADS",
            "MKL_NUM_THREADS",
            "NUMEXPR_NUM_THREADS",
            "OMP_NUM_THREADS",
            "OPENBLAS_NUM_THREADS",
            "VECLIB_MAXIMUM_THREADS",
        ),
        "1",
    )
)
"""Environment in which libraries of linear algebra compute in one thread; they read it when they are loaded.

Their sums depend on the number of threads in their last bits, and threads of several workers wait for each other.
"""

ARRAY_WORK: Mapping[str, str] = MappingProxyType(
    {
        **ONE_THREAD,
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        "MALLOC_MMAP_THRESHOLD_": str(32 << 20),  # the largest that every glibc takes
        "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    }
)
"""Environment of processes that compute with arrays: in one thread, with memory that stays with the process.

Arrays of a few MB come and go by the thousand. Where the system gives new pages for each of them, these can cost as
much as the arithmetic; so what numpy frees is kept for Arrow, and the other way round.
"""

_starting = threading.RLock()


def python_command(*arguments: str) -> list[str]:
    """Command line of this interpreter with `arguments`; see `child_environment`."""
    return [sys.executable, "-P", *arguments]


def bare_command(script: str, *arguments: str) -> list[str]:
    """Command line of this interpreter for a script that needs the standard library alone, whatever is set or near."""
    return [sys.executable, "-I", "-S", script, *arguments]


def child_environment() -> dict[str, str]:
    """Environment of a child that `python_command` starts: it finds what this process finds, by absolute paths."""
    with _starting:  # another thread may have the environment of a start
        return {**os.environ, _SAFE: "1", _PATH: os.pathsep.join(filter(os.path.isabs, sys.path))}


def spawn_context(*, for_arrays: bool = False) -> SpawnContext:
    """Context of `multiprocessing` for processes, pools, queues and events.

    Args:
        for_arrays: Whether its processes compute with arrays; see `ARRAY_WORK`.

    Raises:
        PlatformError: The interpreter was started so that its children ignore the environment.
    """
    if sys.flags.ignore_environment and not sys.flags.safe_path:
        raise PlatformError(
            "worker processes of `python -E` would import from the current folder; start Python with -P or -I as well"
        )
    with _safe_start():
        resource_tracker.ensure_running()
    return _ArrayContext() if for_arrays else _Context()


def exit_after(wait: Callable[[], object]) -> None:
    """End this process once `wait` returns, whatever it is doing: a killed parent cannot tell its children to stop.

    Args:
        wait: Called in a thread of its own; returns when nobody is left to take a result.
    """

    def watch() -> None:
        wait()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _Process(SpawnProcess):
    """A process whose interpreter starts safely."""

    variables: Mapping[str, str] = MappingProxyType({})

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  (the name is multiprocessing's)
        with _safe_start(process_obj.variables):
            return SpawnProcess._Popen(process_obj)


class _ArrayProcess(_Process):
    variables = ARRAY_WORK


class _Context(SpawnContext):
    Process = _Process


class _ArrayContext(SpawnContext):
    Process = _ArrayProcess


@contextmanager
def _safe_start(variables: Mapping[str, str] = MappingProxyType({})) -> Iterator[None]:
    """Let interpreters start with further variables, and nothing on their path that depends on the current folder.

    A worker then gets the path of this process: what a script imports, its workers find.
    """
    with _starting:
        before = {name: os.environ.get(name) for name in (_SAFE, _PATH, *variables)}
        try:
            os.environ.update(variables)
            _set_environment(_SAFE, "1")
            _set_environment(_PATH, os.pathsep.join(filter(os.path.isabs, (before[_PATH] or "").split(os.pathsep))))
            yield
        finally:
            for name, value in before.items():
                _set_environment(name, value)


def _set_environment(name: str, value: str | None) -> None:
    if value:
        os.environ[name] = value
    else:
        os.environ.pop(name, None)
