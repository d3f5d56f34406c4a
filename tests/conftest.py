"""What every test runs under: no network, and reproducible Hypothesis examples.

Choose the larger search with ``pytest --hypothesis-profile=thorough``.
"""

from __future__ import annotations

import gc
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: tests run side by side, one core each
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of torch, whose threads wait by turning

import shutil
import signal
import socket
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

# Hundreds of child processes import the package, and every worker the tests: they are compiled once.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

_MEMORY_DIR = Path("/dev/shm")
_ENOUGH_BYTES = 4 << 30
"""Free space from which on temporary files go there: a run leaves a few hundred MB until it ends."""


def _has_memory() -> bool:
    """Whether memory is plenty, programs may be started from it, and nobody said where temporary files go."""
    if "TMPDIR" in os.environ or not os.access(_MEMORY_DIR, os.W_OK):
        return False
    status = os.statvfs(_MEMORY_DIR)
    return status.f_bavail * status.f_frsize >= _ENOUGH_BYTES and not status.f_flag & getattr(os, "ST_NOEXEC", 0)


# Tests write and remove files by the ten thousand, which costs several times as much in a file system of a disk.
# Folders of tests have short names there, and what processes that were killed leave lies in one that goes at the end.
_own_folder = tempfile.mkdtemp(prefix="branchdrive-tests-", dir=_MEMORY_DIR) if _has_memory() else None
if _own_folder is not None:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(_MEMORY_DIR))
    os.environ["TMPDIR"] = tempfile.tempdir = _own_folder  # workers find it there, and have none of their own


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish() -> None:
    """Remove temporary files that no test removed."""
    if _own_folder is not None:
        shutil.rmtree(_own_folder, ignore_errors=True)


_COMMON: dict[str, Any] = {"deadline": None, "database": None, "suppress_health_check": [HealthCheck.too_slow]}
"""What Hypothesis would hold against a busy machine is left out."""

settings.register_profile("default", max_examples=20, derandomize=True, **_COMMON)
settings.register_profile("thorough", max_examples=2000, derandomize=False, **_COMMON)
settings.load_profile("default")


_GARBAGE = (20_000, 20, 50)
"""Objects and rounds after which the garbage collector looks: tests make many and leave few in circles."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What modules hold stays until the end: the garbage collector need not go through it again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.set_threshold(*_GARBAGE)
        gc.enable()


class NetworkError(RuntimeError):
    """A test tried to reach the network."""


_LOOPBACK = "127.0.0.1"


def _local_only(call: Callable[..., Any]) -> Callable[..., Any]:
    def guarded(self: socket.socket, *arguments: Any) -> Any:
        address = arguments[-1]
        if self.family != getattr(socket, "AF_UNIX", None) and address[0] != _LOOPBACK:
            raise NetworkError(f"tests run without network; `{call.__name__}` was asked for {address!r}")
        return call(self, *arguments)

    return guarded


def _no_lookup(look_up: Callable[..., Any]) -> Callable[..., Any]:
    def guarded(host: object, *arguments: Any, **options: Any) -> Any:
        if host != _LOOPBACK:
            raise NetworkError(f"tests run without network; the address of {host!r} was asked for")
        return look_up(host, *arguments, **options)

    return guarded


@pytest.fixture(scope="session", autouse=True)
def _blocked_network() -> Iterator[None]:
    """Sockets of this process reach nothing but local ones; child processes are not covered."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("connect", "connect_ex", "sendto"):
            patch.setattr(socket.socket, name, _local_only(getattr(socket.socket, name)))
        patch.setattr(socket, "getaddrinfo", _no_lookup(socket.getaddrinfo))
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_disks() -> Iterator[None]:
    """Files of this process reach the disk when the system wants: tests kill processes, and cut no power."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture
def heeded_interrupts() -> Iterator[None]:
    """Interrupts as a foreground process gets them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
