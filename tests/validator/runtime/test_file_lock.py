from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from branchdrive.runtime.file_lock import FileLock


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "some.lock"


def test_a_lock_is_exclusive_until_released(path: Path) -> None:
    first, second = FileLock(path), FileLock(path)
    assert first.acquire(blocking=False)
    assert not second.acquire(blocking=False)
    first.release()
    assert second.acquire(blocking=False)
    second.release()


def test_this_process_knows_which_locks_it_holds(path: Path) -> None:
    with FileLock(path) as lock:
        assert lock.is_held
        assert FileLock.held_here(path)
    assert not lock.is_held
    assert not FileLock.held_here(path)


def test_a_waiting_lock_is_taken_when_its_holder_lets_go(path: Path) -> None:
    holder = FileLock(path)
    holder.acquire(blocking=True)
    happened: list[str] = []

    def let_go() -> None:
        happened.append("let go")
        holder.release()

    threading.Timer(0.05, let_go).start()
    with FileLock(path):
        assert happened == ["let go"]


def test_a_lock_whose_file_was_removed_is_taken_on_the_new_file(path: Path) -> None:
    holder, other = FileLock(path), FileLock(path)
    holder.acquire(blocking=True)
    threading.Timer(0.05, holder.remove).start()
    with other:
        assert path.exists()
        assert not FileLock(path).acquire(blocking=False)


def test_a_forked_child_neither_holds_nor_releases_the_lock_of_its_parent(path: Path) -> None:
    with FileLock(path) as lock:
        pid = os.fork()
        if pid == 0:
            os._exit(0 if not lock.is_held and not FileLock(path).acquire(blocking=False) else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        assert not FileLock(path).acquire(blocking=False)


def test_a_child_that_outlives_the_lock_does_not_block_the_next_holder(path: Path) -> None:
    lock = FileLock(path)
    lock.acquire(blocking=True)
    release_child, hold_child = os.pipe()
    hear, tell = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(hold_child)
        os.write(tell, b"1")
        os.read(release_child, 1)
        os._exit(0)
    lock.release()
    try:
        os.read(hear, 1)  # the child runs on, without what it gave up as it was forked
        assert FileLock(path).acquire(blocking=False)
    finally:
        os.close(hold_child)
        os.waitpid(pid, 0)
        for end in (release_child, hear, tell):
            os.close(end)
