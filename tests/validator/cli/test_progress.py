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


def test_a_full_disk_stops_no_work() -> None:
    part_lines(Full(), "timing")("M1")
