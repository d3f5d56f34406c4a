"""Tasks of executors: functions of a module, because they travel to other processes, which import no more than this."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing import parent_process
from pathlib import Path
from typing import Any


def double(value: int) -> int:
    return 2 * value


def own_process(_: object) -> int:
    return os.getpid()


def started_by(_: object) -> int:
    return os.getppid()


def die_on_three(value: int) -> int:
    if value == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * value


def die_once(task: tuple[str, int]) -> int:
    """Kill the own process the first time that the task is seen."""
    marks, value = task
    mark = Path(marks) / str(value)
    if value == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * value


def raise_on_three(value: int) -> int:
    if value == 3:
        raise ValueError("three\x1b[31m\nsecond line")
    return 2 * value


def exhaust_memory_on_three(value: int) -> int:
    if value == 3:
        raise MemoryError
    return 2 * value


def allocate(num_bytes: int) -> int:
    return len(bytearray(num_bytes))


def converts_with_pandas(value: int) -> bool:
    """Whether pyarrow has loaded pandas for a conversion."""
    import pyarrow as pa

    pa.array([value]).to_numpy()
    return sys.modules.get("pandas") is not None


def interrupt(value: int) -> int:
    raise KeyboardInterrupt


def leave_quietly(value: int) -> int:
    os._exit(0)


def broken_import(value: int) -> int:
    return value


def sleep_and_tell(place: str) -> None:
    Path(place).write_text(str(os.getpid()))
    time.sleep(600)


def die_at_rules(task: Any) -> Any:
    from branchdrive.engine.shard import audit_shard

    if task.folder == "raw/shard-00001" and task.descriptor is not None:
        os.kill(os.getpid(), signal.SIGKILL)
    return audit_shard(task)


def die_at_file(task: Any) -> Any:
    from branchdrive.engine.shard import audit_shard

    if "raw/shard-00001/actors.parquet" in task.files:
        os.kill(os.getpid(), signal.SIGKILL)
    return audit_shard(task)


def lack(value: int) -> int:
    from branchdrive.errors import PlatformError

    raise PlatformError(f"no disk for {value}")


def kill_worker_once(task: tuple[str, int]) -> int:
    """Kill the worker of Ray that this process belongs to, the first time."""
    mark = Path(task[0])
    if not mark.exists():
        mark.touch()
        pid = os.getppid()
        while not Path(f"/proc/{pid}/cmdline").read_bytes().startswith(b"ray::"):
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        os.kill(pid, signal.SIGKILL)
        time.sleep(60)
    return 2 * task[1]


def where(_: int) -> dict[str, Any]:
    """What the process of a task is like."""
    import resource

    return {
        "path": sys.path,
        "folder": str(Path.cwd()),
        "threads": os.environ.get("OPENBLAS_NUM_THREADS"),
        "bytes": resource.getrlimit(resource.RLIMIT_DATA)[0],
        "safe": sys.flags.safe_path,
        "has_ray": "ray" in sys.modules,
    }


def slow(value: int) -> int:
    time.sleep(0.5)
    return 2 * value


@dataclass(frozen=True)
class Adding:
    """Adds a number to a task, and reports twice meanwhile."""

    number: int

    def __call__(self, task: int, between: Callable[..., None]) -> int:
        for part in range(2):
            between(task, part)
        return task + self.number


def raise_between(task: int, between: Callable[..., None]) -> None:
    between()
    raise LookupError(f"no seed {task}")


def die_between(task: int, between: Callable[..., None]) -> None:
    between()
    os.kill(os.getpid(), signal.SIGKILL)


def count_parts(num_parts: int, between: Callable[..., None]) -> int:
    """Ends after `num_parts` parts, or works on until it is stopped."""
    part = 0
    while part != num_parts or not num_parts:
        part += 1
        between(part)
        time.sleep(0.01)
    return num_parts


def variables(names: list[str]) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in names}


def faults_of_a_second_array(num_bytes: int) -> int:
    """Pages that the system hands out for an array of the size of one that was just given back."""
    import resource

    import numpy as np

    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        np.ones(num_bytes, np.uint8)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def who_i_am(_: int) -> tuple[int, int, list[str]]:
    """This process and the one that started it, and what this one has loaded."""
    return os.getpid(), os.getppid(), list(sys.modules)


def refuse(task: int, between: Callable[..., None]) -> int:
    from branchdrive.errors import UsageError

    between(task)
    raise UsageError(f"no {task}")


@dataclass
class Counting:
    """Counts its tasks in a process, and takes what memory it likes."""

    name: str
    seen: list[int] = field(default_factory=list)

    def __call__(self, task: int, between: Callable[..., None]) -> tuple[int, int, bool]:
        import resource

        from branchdrive.contract.limits import spec_limits

        self.seen.append(task)
        soft, _ = resource.getrlimit(resource.RLIMIT_DATA)
        return os.getpid(), len(self.seen), soft == resource.RLIM_INFINITY or soft > spec_limits().max_worker_bytes


def cannot_import(task: int) -> int:
    raise ImportError("libarrow.so: cannot open shared object file", name="pyarrow")


if parent_process() is not None and "BROKEN_IMPORT" in os.environ:
    raise ImportError("libarrow cannot be opened", name="pyarrow")
