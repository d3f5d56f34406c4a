"""A process that has imported what workers need, and forks them, so that they start in no time.

A worker that starts by itself imports hundreds of modules first. A server imports them once. It is started like any
other child (see `branchdrive.runtime.process`), runs no thread and no task, reads no data and never loads the main
module of its parent. For a worker it is sent the modules that it needs and the ends of two pipes; the child that it
forks goes on as spawned workers do: it loads the main module, and then takes its limits and its work from the parent.

A server ends with the other end of its socket: when that is closed, and when the parent dies, however that happens. It
refuses where it finds another copy of this package than its parent has, where a module cannot be imported, or where
a library has started a thread, of which forked processes would have nothing but the locks. Workers then start by
themselves.

The server runs this file as its script, which needs the standard library alone until the copies are compared.
"""

from __future__ import annotations

import io
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import context, forkserver, popen_forkserver, reduction, resource_tracker, spawn, util
from pathlib import Path
from typing import Any, NoReturn, cast

__all__ = ["ForkServer", "ForkedPopen", "NoServerError"]

_PACKAGE_DIR = Path(__file__).parents[1]
_PATIENCE_S = 1.0
"""How long workers without a waiting parent may keep a server from ending."""

_READY = b"!"
"""What a server sends as it begins to serve."""

_MAX_MODULES_BYTES = 4096
"""Names of modules in a request, at most."""

_MAX_PASSED = 64
"""File descriptors in a request, at most: data, status, the resource tracker, and what the worker shares."""


class NoServerError(Exception):
    """The server has ended, or never served."""


class ForkServer:
    """The parent's side of a server.

    Args:
        modules: What it imports first.
        environment: Its variables, and those of its workers.
    """

    def __init__(self, modules: Sequence[str], environment: Mapping[str, str]) -> None:
        self._requests, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)  # a request arrives as a whole
        interpreter = [spawn.get_executable(), *util._args_from_interpreter_flags(), "-P"]  # type: ignore[attr-defined]
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # interrupts are for its workers to take
        try:
            with theirs:
                self._process = subprocess.Popen(  # noqa: S603  (this interpreter, with a script of ours)
                    [*interpreter, __file__, str(theirs.fileno()), *modules],
                    stdin=subprocess.DEVNULL,
                    pass_fds=[theirs.fileno()],
                    env=environment,
                )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        self._has_workers = False

    def wait(self) -> None:
        """Wait until it serves, or will not; an interrupt is heard meanwhile."""
        self._requests.recv(len(_READY))

    def fork(self, modules: Sequence[str], data: int, status: int, shared: Sequence[int]) -> None:
        """Ask for a worker.

        Args:
            modules: What is imported first.
            data: Where it reads what to do; its parent is alive while the other end is open.
            status: Where it writes its process number; closes as it ends.
            shared: File descriptors of locks, queues and pipes that it shares.

        Raises:
            NoServerError: There is no server.
        """
        tracker = cast(int, resource_tracker.getfd())  # which is running since the context was made
        try:
            socket.send_fds(self._requests, [" ".join(modules).encode()], [data, status, tracker, *shared])
        except OSError as error:
            raise NoServerError from error
        self._has_workers = True

    def close(self) -> None:
        """End the server, which waits for its workers so that their processor time counts as that of this process."""
        self._requests.close()
        try:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S if self._has_workers else 0)
        finally:
            self._process.kill()
            self._process.wait()


class ForkedPopen(popen_forkserver.Popen):
    """A worker that a server forks, as `multiprocessing` knows it: what its own fork servers start, by another way.

    Args:
        process: What it does.
        fork: `ForkServer.fork` with the modules of the worker.

    Raises:
        NoServerError: There is no server.
    """

    def __init__(self, process: Any, fork: Callable[[int, int, Sequence[int]], None]) -> None:
        self._fork = fork
        super().__init__(process)

    def _launch(self, process: Any) -> None:
        what = io.BytesIO()
        context.set_spawning_popen(self)
        try:
            for part in (_preparation(process.name), process):
                reduction.dump(part, what)
        finally:
            context.set_spawning_popen(None)
        self.sentinel, status = os.pipe()
        data, feed = os.pipe()
        self.finalizer = util.Finalize(self, _close, (feed, self.sentinel))
        try:
            self._fork(data, status, self._fds)  # type: ignore[attr-defined]
        finally:
            _close(data, status)
        try:
            self.pid = forkserver.read_signed(self.sentinel)
        except EOFError as error:
            raise NoServerError from error
        with os.fdopen(os.dup(feed), "wb") as stream:
            stream.write(what.getbuffer())


def _preparation(name: str) -> dict[str, Any]:
    """What a worker loads of its parent; no main module that came from standard input, which cannot be read again."""
    found: dict[str, Any] = spawn.get_preparation_data(name)
    if not Path(found.get("init_main_from_path", __file__)).exists():
        del found["init_main_from_path"]
    return found


def _serve(requests: socket.socket) -> None:
    """Fork a worker at each request until there can be no more, and wait for all of them."""
    requests.sendall(_READY)
    while True:
        modules, passed, *_ = socket.recv_fds(requests, _MAX_MODULES_BYTES, _MAX_PASSED)
        if not passed or not _can_fork(modules.decode().split()):
            _close(*passed)
            break
        if os.fork() == 0:
            requests.close()
            _work(*passed)
        _close(*passed)
    requests.close()  # who asks then finds no server, whatever its request was
    with suppress(ChildProcessError):
        while True:
            os.wait()


def _can_fork(modules: Sequence[str]) -> bool:
    """Import modules, if that can be done and leaves this process with one thread."""
    try:
        for module in modules:
            import_module(module)
    except Exception:  # workers that start by themselves meet it, and tell of it
        return False
    return len(list(Path("/proc/self/task").iterdir())) == 1


def _work(data: int, status: int, tracker: int, *shared: int) -> NoReturn:
    """Be a worker; the end of `status` stays open until this process ends."""
    code = 1
    try:
        forkserver.write_signed(status, os.getpid())
        vars(resource_tracker._resource_tracker)["_fd"] = tracker
        vars(forkserver._forkserver)["_inherited_fds"] = shared
        code = spawn._main(data, os.dup(data))
    except (SystemExit, BrokenPipeError):
        pass  # the main module is a script that ends so wherever it is loaded; or who asked is gone
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)


def _close(*descriptors: int) -> None:
    for one in descriptors:
        os.close(one)


def _main(descriptor: int, modules: Sequence[str]) -> None:
    found = find_spec(_PACKAGE_DIR.name)
    if found is None or found.submodule_search_locations != [str(_PACKAGE_DIR)]:
        return
    if _can_fork(modules):
        with suppress(BrokenPipeError, ConnectionResetError), socket.socket(fileno=descriptor) as requests:
            _serve(requests)  # until who asks is gone, in the middle of a request too


if __name__ == "__main__":
    _main(int(sys.argv[1]), sys.argv[2:])
