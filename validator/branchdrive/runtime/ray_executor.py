"""An executor on Ray: Ray schedules tasks over machines, and bounded processes of ours work on them.

Every worker of Ray keeps one process with the memory limit, the one thread and the safe path that those of a pool have;
files of a dataset are decoded there and nowhere else. Ray puts the current folder of the driver first on the path of
its workers, so the driver is in an empty folder of its own while it connects.

Source: spec/09-security.md#limits, #serialisation.
"""

from __future__ import annotations

import os
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from branchdrive.errors import PlatformError
from branchdrive.runtime.environment import extra
from branchdrive.runtime.executor import BoundedProcess, Died, Executor, Failed
from branchdrive.runtime.installation import installation_digest

__all__ = ["RayExecutor", "ray_executor"]

_REFERENCE = "branchdrive_reference"
"""What collects, renders and trains; its code has to be the same everywhere, too."""

_IN_FLIGHT_PER_CPU = 2
"""Tasks that are handed to Ray at a time, for each processor that it has."""


@dataclass(frozen=True)
class _Job:
    """What every task of a run has in common.

    Attributes:
        function: What runs tasks.
        installation: Digest of the driver's code and libraries.
        folder: The driver's current folder.
        places: Folders that tasks name.
    """

    function: Callable[[Any], Any]
    installation: str
    folder: str
    places: tuple[Path, ...]


@dataclass(frozen=True)
class _Fault:
    """What a machine lacks; an exception would come back as one of Ray's."""

    message: str


def ray_executor(address: str | None = None, *, jobs: int | None = None) -> Executor:
    """Executor over the workers of Ray (extra `ray`).

    A program that is connected to Ray keeps its connection, and the folder that it was in then is on the path of
    workers: connect from an empty one.

    Args:
        address: Of a cluster; a Ray of this machine is started where there is none.
        jobs: Processors of a Ray that is started here; all by default.
    """
    return RayExecutor(address, jobs)


@dataclass(frozen=True)
class RayExecutor:
    """An executor over the workers of Ray, which travels to other processes; see `ray_executor`."""

    address: str | None = None
    jobs: int | None = None

    def __call__(self, function: Callable[[Any], Any], tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        """Run tasks on Ray."""
        if tasks:
            yield from _results(self._connected(), function, tasks)

    def shared(self) -> RayExecutor:
        """The same workers for another process of this machine.

        Raises:
            PlatformError: Ray is not installed, or there is none at the address.
        """
        return RayExecutor(self._connected().get_runtime_context().gcs_address)

    def _connected(self) -> Any:
        with extra("ray", of="an executor on Ray"):
            import ray
        _connect(ray, self.address, self.jobs)
        return ray


def _connect(ray: Any, address: str | None, jobs: int | None) -> None:
    """Connect to Ray, once a process: it takes seconds, and Ray ends with this process."""
    if ray.is_initialized():
        return
    with _empty_folder():
        try:
            ray.init(
                address=address or "local",  # else it would join any Ray that it finds on this machine
                num_cpus=None if address else jobs,
                include_dashboard=None if address else False,
                logging_level="ERROR",
                log_to_driver=False,
            )
        except Exception as error:  # Ray raises plain ones, too, when a node does not start in time
            where = f"at {address}" if address else "on this machine"
            reason = next(iter(str(error).splitlines()), type(error).__name__)
            raise PlatformError(f"there is no Ray {where}: {reason}") from error


@contextmanager
def _empty_folder() -> Iterator[None]:
    """Be in an empty folder of one's own, which stays as long as this process: workers start later, too."""
    before = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.chdir(_private_folder())
        yield
    finally:
        os.fchdir(before)
        os.close(before)


_folders: list[tempfile.TemporaryDirectory[str]] = []


def _private_folder() -> str:
    if not _folders:
        _folders.append(tempfile.TemporaryDirectory(prefix="branchdrive-ray-", ignore_cleanup_errors=True))
    return _folders[0].name


def _results(ray: Any, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Results as they come; a task whose worker or node is lost runs once more."""
    work = ray.remote(num_cpus=1, max_retries=0)(_work)
    places = {place for task in tasks for place in _places(task) if place.is_dir()}
    job = ray.put(_Job(function, installation_digest(_REFERENCE), os.getcwd(), tuple(sorted(places))))  # noqa: PTH109
    limit = _IN_FLIGHT_PER_CPU * max(1, int(ray.cluster_resources().get("CPU", 1)))
    waiting, again = list(range(len(tasks)))[::-1], set[int]()
    running: dict[Any, int] = {}
    try:
        while waiting or running:
            while waiting and len(running) < limit:
                index = waiting.pop()
                running[work.remote(job, tasks[index])] = index
            (done, *_), _ = ray.wait([*running], num_returns=1)
            index = running.pop(done)
            try:
                result = ray.get(done)
            except ray.exceptions.RayTaskError as error:  # of `_work` itself, or of a result that does not travel
                result = Failed(str(error).rstrip().splitlines()[-1])
            except ray.exceptions.RayError:
                if index not in again:
                    again.add(index)
                    waiting.append(index)
                    continue
                result = Died()
            if isinstance(result, _Fault):
                raise PlatformError(result.message)
            yield index, result
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _places(value: Any, depth: int = 4) -> Iterator[Path]:
    """Folders and files that a task names, by itself or in the places of its datasets."""
    if isinstance(value, Path):
        yield value
    elif is_dataclass(value) and depth:
        for one in fields(value):
            yield from _places(getattr(value, one.name), depth - 1)


_processes: dict[str, BoundedProcess] = {}
"""Of a worker of Ray: one, by the folder that it is in."""


def _work(job: _Job, task: Any) -> Any:
    """Result of a task, in a worker of Ray."""
    node = socket.gethostname()
    if installation_digest(_REFERENCE) != job.installation:
        return _Fault(f"node {node} has another branchdrive, other libraries or another Python; install what is here")
    for place in (Path(job.folder), *job.places):
        if not Path(job.folder, place).is_dir():
            return _Fault(
                f"node {node} has no folder {str(place)!r}; all nodes need the folders of this one, by one name"
            )
    if job.folder not in _processes:
        vars(sys.modules["__main__"]).pop("__file__", None)  # Ray's program is not that of our processes
        while _processes:
            _processes.popitem()[1].close()
        _processes[job.folder] = BoundedProcess(job.folder)
    try:
        return _processes[job.folder].run(job.function, task)
    except PlatformError as error:
        return _Fault(f"node {node}: {error}")
