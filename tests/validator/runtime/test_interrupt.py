"""The first interrupt waits until it is asked for, the second does not; children never see one."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from tests.waiting import PATIENCE_S

from branchdrive.runtime.interrupt import (
    TerminationInterrupt,
    deferred_interrupt,
    heeded_termination,
    shielded_children,
)

pytestmark = pytest.mark.usefixtures("heeded_interrupts")


def test_an_interrupt_waits_until_it_is_asked_for() -> None:
    with deferred_interrupt() as raise_if_noted:
        raise_if_noted()
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            raise_if_noted()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_who_insists_is_told_once_and_raises_nothing_in_the_middle() -> None:
    told: list[str] = []
    with deferred_interrupt(insist=lambda: told.append("once")) as raise_if_noted:
        signal.raise_signal(signal.SIGINT)
        assert told == []
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
            assert told == ["once"]
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


def test_a_request_to_terminate_is_an_interrupt_and_waits_like_one() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with heeded_termination():
        with pytest.raises(TerminationInterrupt):
            signal.raise_signal(signal.SIGTERM)
        with deferred_interrupt() as raise_if_noted:
            signal.raise_signal(signal.SIGTERM)
            with pytest.raises(TerminationInterrupt):
                raise_if_noted()
    assert before is signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_another_handler_of_terminations_is_left_alone() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with heeded_termination(), deferred_interrupt():
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_shielded_child_outlives_signals_and_none_is_lost(number: signal.Signals) -> None:
    is_reached = False
    with heeded_termination(), pytest.raises(KeyboardInterrupt) as caught:
        with shielded_children():
            child = subprocess.Popen([sys.executable, "-c", "print(input())"], stdin=-1, stdout=-1, text=True)
            child.send_signal(number)
            signal.raise_signal(number)
            is_reached = True
        pytest.fail("the signal is lost")
    assert is_reached
    assert (caught.type is TerminationInterrupt) == (number is signal.SIGTERM)
    assert child.communicate("alive\n", timeout=PATIENCE_S)[0] == "alive\n"
    assert child.returncode == 0
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()
