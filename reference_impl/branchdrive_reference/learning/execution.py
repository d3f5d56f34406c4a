"""How torch computes here: on one thread, by deterministic algorithms, on a device that is there.

One process has one thread: small matrices gain nothing from more, and threads of several processes that wait for
each other on the same cores lose much. Runs side by side are processes, see `branchdrive_reference.learning.pool`.

Source: measured, research of this project; torch notes on reproducibility.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from branchdrive.errors import UsageError

__all__ = ["DEVICES", "deterministic", "open_device"]

DEVICES = ("cpu", "cuda", "auto")
"""Names of devices; ``auto`` is ``cuda`` where there is one."""


def open_device(name: str) -> torch.device:
    """The device of a name in `DEVICES`.

    Raises:
        UsageError: There is no such device.
    """
    if name not in DEVICES:
        raise UsageError(f"no device {name!r}; there are {', '.join(DEVICES)}")
    has_cuda = torch.cuda.is_available()
    if name == "cuda" and not has_cuda:
        raise UsageError("no CUDA device is here; use the device 'cpu'")
    return torch.device("cuda" if has_cuda and name != "cpu" else "cpu")


@contextmanager
def deterministic() -> Iterator[None]:
    """One thread, deterministic algorithms and full float32; afterwards everything is as before.

    The workspace of cuBLAS stays as it is set here: the library reads it once, when it is first used.
    """
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # CUDA is deterministic only with it
    threads = torch.get_num_threads()
    mode = torch.get_deterministic_debug_mode()
    torch.set_num_threads(1)
    torch.set_deterministic_debug_mode("error")  # `use_deterministic_algorithms` loads a compiler, for seconds
    short_floats = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_deterministic_debug_mode(mode)
        torch.backends.cudnn.allow_tf32 = short_floats
