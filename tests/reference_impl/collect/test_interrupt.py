"""The first interrupt waits until it is asked for, the second does not."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from branchdrive_reference.collect.interrupt import deferred_interrupt


@pytest.fixture(autouse=True)
def heeded() -> Iterator[None]:
    """Interrupts as a foreground process gets them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_waits_until_it_is_asked_for() -> None:
    with deferred_interrupt() as raise_if_noted:
        raise_if_noted()
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            raise_if_noted()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_does_not_wait() -> None:
    with deferred_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_the_handler_of_another_program_is_left_alone() -> None:
    def handler(_signal: int, _frame: object) -> None: ...

    signal.signal(signal.SIGINT, handler)
    with deferred_interrupt() as raise_if_noted:
        assert signal.getsignal(signal.SIGINT) is handler
        raise_if_noted()
    assert signal.getsignal(signal.SIGINT) is handler
