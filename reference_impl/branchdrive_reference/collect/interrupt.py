"""Keyboard interrupts that wait for the end of a rollout.

An interrupt that arrives inside a callback of the physics engine would be printed and forgotten
there, because C code cannot pass an exception on. So the first interrupt is only noted, and raised
where the collector asks for it; the second one is raised at once.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["deferred_interrupt"]


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], None]]:
    """Note keyboard interrupts; yields the function that raises a noted one.

    Outside the main thread, and where the caller handles interrupts in another way, nothing changes.
    """
    is_noted = False

    def note(_signal: int, _frame: FrameType | None) -> None:
        nonlocal is_noted
        is_noted = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def raise_if_noted() -> None:
        if is_noted:
            raise KeyboardInterrupt

    is_ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not is_ours:
        yield raise_if_noted
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield raise_if_noted
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
