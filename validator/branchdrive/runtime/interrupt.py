"""Keyboard interrupts and requests to terminate, which wait for the end of a rollout.

A signal that arrives inside a callback of the physics engine would be printed and forgotten there,
because C code cannot pass an exception on. So the first signal is only noted, and raised where the
collector asks for it. The second one is raised at once or, where an exception would break off what has
to be finished, calls a function.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from branchdrive.exit_code import EXIT_TERMINATED

__all__ = ["TerminationInterrupt", "deferred_interrupt", "heeded_termination", "shielded_children"]

_Handler = Callable[[int, FrameType | None], object]


class TerminationInterrupt(KeyboardInterrupt):
    """The process was asked to terminate, as batch schedulers do before they kill."""

    exit_code = EXIT_TERMINATED
    """What a command ends with then."""


@contextmanager
def heeded_termination() -> Iterator[None]:
    """Raise `TerminationInterrupt` on SIGTERM instead of dying.

    Outside the main thread, and where the caller handles SIGTERM in another way, nothing changes.
    """
    is_ours = _is_main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if is_ours:
        signal.signal(signal.SIGTERM, _raise_termination)
    try:
        yield
    finally:
        if is_ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _raise_termination(_signal: int, _frame: FrameType | None) -> NoReturn:
    """Handler of SIGTERM."""
    raise TerminationInterrupt


@contextmanager
def deferred_interrupt(insist: Callable[[], object] | None = None) -> Iterator[Callable[[], None]]:
    """Note keyboard interrupts and heeded terminations; yields the function that raises a noted one.

    Outside the main thread, and for signals that the caller handles in another way, nothing changes.

    Args:
        insist: Called by the second one, which is raised at once otherwise; later ones do nothing then.
    """
    noted: list[int] = []
    raising: dict[int, _Handler] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: _raise_termination}
    ours = {number: handler for number, handler in raising.items() if signal.getsignal(number) is handler}
    if not _is_main_thread():
        ours = {}

    def restore() -> None:
        for number, handler in ours.items():
            signal.signal(number, handler)

    def note(number: int, _frame: FrameType | None) -> None:
        noted.append(number)
        if insist is None:
            restore()
        elif len(noted) == 2:
            insist()

    def raise_if_noted() -> None:
        if noted:
            raising[noted[0]](noted[0], None)

    for number in ours:
        signal.signal(number, note)
    try:
        yield raise_if_noted
    finally:
        restore()


@contextmanager
def shielded_children() -> Iterator[None]:
    """Start processes that neither interrupts nor requests to terminate ever reach.

    They inherit the mask that blocks both. A signal that this process gets meanwhile is raised at the end.
    """
    with deferred_interrupt() as raise_if_noted:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    raise_if_noted()


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
