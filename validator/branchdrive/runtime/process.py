"""How all child processes start and end: they import nothing from the current folder and outlive no parent.

`multiprocessing` starts its workers and its resource tracker by ``python -c``, and Python puts the current folder
first on the path of such a process: a ``re.py`` in a dataset would run before any code of ours. So children start
with ``PYTHONSAFEPATH`` (or ``-P``) and without relative entries of ``PYTHONPATH``. This process has that environment
for the moment of a start only; children keep it for processes of their own.

Processes that compute with arrays are forked, where that is safe, by a server that has imported what they need.

Source: spec/09-security.md#serialisation.
"""

from __future__ import annotations

import os
import sys
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from multiprocessing import process, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import MappingProxyType
from typing import Any

from branchdrive.errors import PlatformError
from branchdrive.runtime.fork_server import ForkedPopen, ForkServer, NoServerError

__all__ = [
    "ARRAY_WORK", "ONE_THREAD", "ArrayContexts", "array_context", "bare_command", "child_environment", "exit_after",
    "python_command", "spawn_context",
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
        "JE_ARROW_MALLOC_CONF": "background_thread:false",  # of Arrow's own pool, which then goes unused
        "MALLOC_MMAP_THRESHOLD_": str(32 << 20),  # the largest that every glibc takes
        "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    }
)
"""Environment of processes that compute with arrays: in one thread, with memory that stays with the process.

Arrays of a few MB come and go by the thousand. Where the system gives new pages for each of them, these can cost as
much as the arithmetic; so what numpy frees is kept for Arrow, and the other way round.
"""

_MAY_FORK = sys.platform == "linux"
"""Whether a process may fork that has loaded libraries; elsewhere those of the system start threads, or may not."""

_starting = threading.RLock()


def python_command(*arguments: str) -> list[str]:
    """Command line of this interpreter with `arguments`; see `child_environment`."""
    return [sys.executable, "-P", *arguments]


def bare_command(script: str, *arguments: str) -> list[str]:
    """Command line of this interpreter for a script that needs the standard library alone, whatever is set or near."""
    return [sys.executable, "-I", "-S", script, *arguments]


def child_environment() -> dict[str, str]:
    """Environment of a child that `python_command` starts: it finds what this process finds, by absolute paths."""
    return _environment(sys.path)


def _environment(path: Iterable[str]) -> dict[str, str]:
    with _starting:  # another thread may have the environment of a start
        return {**os.environ, _SAFE: "1", _PATH: os.pathsep.join(filter(os.path.isabs, path))}


def spawn_context() -> SpawnContext:
    """Context of `multiprocessing` for processes, pools, queues and events.

    Raises:
        PlatformError: The interpreter was started so that its children ignore the environment.
    """
    _prepare_to_start()
    return _Context()


@contextmanager
def array_context(*modules: str) -> Iterator[SpawnContext]:
    """Context for processes that compute with arrays, whose server ends with it; see `ArrayContexts.get`."""
    contexts = ArrayContexts()
    try:
        yield contexts.get(*modules)
    finally:
        contexts.close()


class ArrayContexts:
    """Contexts for processes that compute with arrays; see `ARRAY_WORK`.

    Where that is safe, they are forked by one server, which ends with this object, or where the environment or the path
    of modules is another one by then.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._server: ForkServer | None = None
        self._environment: Mapping[str, str] = {}
        self._is_ready = False
        self.close: Callable[[], object] = lambda: None
        """End the server, if there is one; then there are no more contexts."""

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), ()  # another process has a server of its own

    def get(self, *modules: str) -> SpawnContext:
        """One for processes that need some modules, which the server imports before.

        Raises:
            PlatformError: The interpreter was started so that its children ignore the environment.
        """
        server = self.start(*modules)
        if server is None:
            return _ArrayContext()
        with self._lock:
            if not self._is_ready:
                server.wait()
                self._is_ready = True
        return _ForkContext(partial(server.fork, modules))

    def start(self, *modules: str) -> ForkServer | None:
        """Begin to import modules, for who needs them soon; ``None`` where nothing is forked.

        Raises:
            PlatformError: The interpreter was started so that its children ignore the environment.
        """
        _prepare_to_start()
        environment = {**_environment(_server_path()), **ARRAY_WORK}
        with self._lock:
            if _MAY_FORK and environment != self._environment:
                self.close()
                self._server, self._environment, self._is_ready = ForkServer(modules, environment), environment, False
                self.close = weakref.finalize(self, self._server.close)
            return self._server


def _prepare_to_start() -> None:
    if sys.flags.ignore_environment and not sys.flags.safe_path:
        raise PlatformError(
            "worker processes of `python -E` would import from the current folder; start Python with -P or -I as well"
        )
    with _safe_start():
        resource_tracker.ensure_running()


def _server_path() -> Iterator[str]:
    """Where a server finds modules: as this process, but for the folder of the main module and the one it began in."""
    main = getattr(sys.modules["__main__"], "__file__", None)
    began = process.ORIGINAL_DIR  # type: ignore[attr-defined]
    own = {began, *([] if main is None else [str(Path(main).absolute().parent)])}
    return (place for place in sys.path if place not in own)


def exit_after(wait: Callable[[], object]) -> None:
    """End this process once `wait` returns, whatever it is doing: a killed parent cannot tell its children to stop.

    Args:
        wait: Called in a thread of its own; returns when no process is left to take a result.
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


class _ForkedProcess(_ArrayProcess):
    """A process that a server forks, or that starts by itself where there is none."""

    def __init__(self, fork: Callable[..., None], *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._fork = fork

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  (the name is multiprocessing's)
        fork = vars(process_obj).pop("_fork")  # which does not travel to the process
        try:
            return ForkedPopen(process_obj, fork)
        except NoServerError:
            return _ArrayProcess._Popen(process_obj)


class _Context(SpawnContext):
    Process = _Process


class _ArrayContext(SpawnContext):
    Process = _ArrayProcess


class _ForkContext(SpawnContext):
    def __init__(self, fork: Callable[..., None]) -> None:
        self.Process = partial(_ForkedProcess, fork)  # type: ignore[assignment,misc]


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
