"""Parts of long work are named where no bar is seen, once each, and nothing stops where they cannot be."""

from __future__ import annotations

import io

import pytest

from branchdrive.cli.progress import part_lines, progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Full(io.StringIO):
    def write(self, text: str) -> int:
        raise OSError(28, "No space left on device")


def test_each_part_is_told_once() -> None:
    stderr = io.StringIO()
    tell = part_lines(stderr, "timing")
    for part in ("M1", "M1", "M3", "M1"):
        tell(part)
    assert stderr.getvalue() == "timing M1\ntiming M3\n"


def test_a_terminal_has_a_bar_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    terminal, elsewhere = Terminal(), io.StringIO()
    part_lines(terminal, "timing")("M1")
    assert terminal.getvalue() == ""
    for stderr in (terminal, elsewhere):
        with progress_bar(stderr, "timing") as show:
            show(1, 2, "M1")
    assert "timing" in terminal.getvalue()
    assert elsewhere.getvalue() == ""


def test_without_a_terminal_there_is_a_line_a_minute() -> None:
    stderr, moments = io.StringIO(), iter([0.0, 59.0, 60.0, 100.0, 120.0, 130.0])
    with progress_bar(stderr, "validating shards", clock=lambda: next(moments)) as show:
        for done in (1, 2, 30, 40, 41):
            show(done, 100, "raw")
    lines = ["validating shards raw: 2 of 100, 2.0/min",
             "validating shards raw: 40 of 100, 20.0/min, about 3 min left"]  # fmt: skip
    assert stderr.getvalue().splitlines() == lines


def test_the_last_minute_is_no_number_of_minutes() -> None:
    stderr, moments = io.StringIO(), iter([0.0, 90.0])
    with progress_bar(stderr, "building", clock=lambda: next(moments)) as show:
        show(9, 10)
    assert stderr.getvalue() == "building: 9 of 10, 6.0/min, less than a minute left\n"


def test_the_rate_of_other_work_is_its_own() -> None:
    stderr, moments = io.StringIO(), iter([0.0, 50.0, 300.0, 360.0])
    with progress_bar(stderr, "building", clock=lambda: next(moments)) as show:
        show(10, 10, "model")
        show(0, 30, "leakage")
        show(10, 30, "leakage")
    assert stderr.getvalue().splitlines() == [
        "building leakage: 0 of 30", "building leakage: 10 of 30, 10.0/min, about 2 min left",
    ]  # fmt: skip


def test_a_line_that_cannot_be_written_stops_no_work() -> None:
    moments = iter([0.0, 61.0])
    with progress_bar(Full(), "building", clock=lambda: next(moments)) as show:
        show(0, 0)


def test_a_full_disk_stops_no_work() -> None:
    part_lines(Full(), "timing")("M1")
