"""Runs of a command: its placeholders, what reruns and kills name, and what they say was not tried."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.validator.pilot import copying_collector
from tests.waiting import PATIENCE_S, wait_for

from branchdrive.errors import UsageError
from branchdrive.pilot.crash_drill import crash_drill
from branchdrive.pilot.determinism import determinism
from branchdrive.pilot.pilot import Pilot, read_pilot
from branchdrive.pilot.rerun import Command, Run
from branchdrive.pilot.reruns import Reruns
from branchdrive.pilot.section import Section


def command(source: Path, mistake: str, groups: str = "{groups}", dies: str = "") -> str:
    words = [sys.executable, copying_collector.__file__, str(source), "{out}", mistake, groups, dies]
    return shlex.join(words)


def collect(source: Path, mistake: str, root: Path) -> Pilot:
    """A pilot as the collector with a mistake makes it."""
    assert Command.parse(command(source, mistake, "all")).run(root, [], limit_s=PATIENCE_S).failure is None
    return read_pilot(root)


@pytest.fixture(scope="module")
def collected(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Pilot:
    """A pilot without a mistake."""
    return collect(source, "none", tmp_path_factory.mktemp("collected") / "dataset")


def reruns(pilot: Any, text: str, folder: Path) -> Reruns:
    return Reruns(pilot, Command.parse(text), folder, limit_s=PATIENCE_S, note=lambda what: None)


def said(section: Section) -> str:
    return " ".join(concern.what for concern in section.concerns)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("collect", r"needs \{out\}"),
        ("collect {out} {seed}", r"no placeholder \{seed\}"),
        ("collect {out} {groups} {order}", "not both"),
        ("collect '{out}", "no command line"),
    ],
)
def test_a_command_that_cannot_be_run_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Command.parse(text)


def test_placeholders_stand_anywhere_in_a_word_and_no_shell_reads_them(tmp_path: Path) -> None:
    parsed = Command.parse("""collect --out={out} --ids {groups} ';' '{"a": 1}'""")
    assert parsed.line(tmp_path, ["a", "b"], is_reversed=True) == [
        "collect", f"--out={tmp_path}", "--ids", "b,a", ";", '{"a": 1}',
    ]  # fmt: skip
    assert Command.parse("c {out} {order}").line(tmp_path, ["a"], is_reversed=True)[2] == "reverse"


def test_a_command_that_takes_too_long_is_killed(tmp_path: Path) -> None:
    words = [sys.executable, "-c", "import time; time.sleep(60)", "{out}"]
    run = Command(tuple(words)).run(tmp_path / "out", [], limit_s=0.2)
    assert run.exit_code is None
    assert run.failure is not None
    with pytest.raises(UsageError, match="cannot be started"):
        Command.parse("no-such-program {out}").run(tmp_path / "out", [], limit_s=1)


def test_equal_runs_are_fine_and_say_what_was_not_tried(source: Path, collected: Pilot, tmp_path: Path) -> None:
    section = determinism(collected, reruns(collected, command(source, "none"), tmp_path))
    assert [*section.concerns] == []
    assert [section.figures[name]["equal"] for name in ("fresh", "reverse", "alone")] == [True, True, True]
    assert section.result == "in part"
    (tmp_path / "all").mkdir()
    fixed = determinism(collected, reruns(collected, command(source, "none", "all"), tmp_path / "all"))
    assert [*fixed.figures] == ["fresh"]
    assert "neither {groups} nor {order}" in " ".join(fixed.not_examined)


@pytest.mark.parametrize(
    ("mistake", "differing", "what"),
    [
        ("process", {"fresh", "again"}, "in a fresh process gives other data"),
        ("seed", {"reverse", "alone"}, "depends on the seeds that ran before it"),
        pytest.param("order", {"reverse"}, "depends on the order of groups", marks=pytest.mark.thorough),
    ],
)
def test_what_runs_differ_by_is_named(
    mistake: str, differing: set[str], what: str, source: Path, tmp_path: Path
) -> None:
    pilot = collect(source, mistake, tmp_path / "pilot")
    section = determinism(pilot, reruns(pilot, command(source, mistake), tmp_path))
    assert {name for name, figures in section.figures.items() if not figures["equal"]} == differing
    assert what in said(section)
    assert [concern.is_problem for concern in section.concerns] == [mistake != "process"] * len(differing)
    assert "first in observations.speed_mps at tick 50" in said(section)


def test_a_command_that_gives_other_data_than_the_pilot_every_time_is_told_apart(source: Path, tmp_path: Path) -> None:
    pilot = collect(source, "seed", tmp_path / "other")
    (tmp_path / "runs").mkdir()
    section = determinism(pilot, reruns(pilot, command(source, "none", "all"), tmp_path / "runs"))
    assert "the same every time, but not what the pilot holds" in said(section)


def test_without_a_command_nothing_is_examined(pilot: Pilot) -> None:
    for section in (determinism(pilot, None), crash_drill(pilot, None, num_kills=1)):
        assert section.result == "not examined"
        assert "--rerun" in section.not_examined[0]


def test_a_command_that_fails_is_a_problem(collected: Pilot, tmp_path: Path) -> None:
    section = determinism(collected, reruns(collected, "false {out}", tmp_path))
    assert "ended with exit code 1" in said(section)
    drill = crash_drill(collected, reruns(collected, "false {out}", tmp_path), num_kills=1)
    assert drill.result == "not examined"


class Cut(Command):
    """A command that is killed at one place of its work, by itself, and not after some time."""

    def run(self, out: Path, group_ids: Sequence[str], *, limit_s: float, is_reversed: bool = False) -> Run:
        found = super().run(out, group_ids, limit_s=PATIENCE_S, is_reversed=is_reversed)
        return replace(found, exit_code=None) if found.exit_code == -signal.SIGKILL else found


@pytest.mark.parametrize(
    ("mistake", "what"),
    [
        ("none", ""),
        ("begun", "A resume loses 1 group"),
        pytest.param("lock", "does not go on: it ended with exit code 1", marks=pytest.mark.thorough),
    ],
)
def test_a_crash_drill_names_what_a_resume_loses(
    mistake: str, what: str, source: Path, collected: Pilot, tmp_path: Path
) -> None:
    cut = Cut(Command.parse(command(source, mistake, "all", dies="killed")).words)
    runs = Reruns(collected, cut, tmp_path, limit_s=PATIENCE_S, note=lambda what: None)
    assert runs.fresh.failure is None
    for leftover in tmp_path.glob("fresh.*"):
        leftover.unlink()
    section = crash_drill(collected, runs, num_kills=1)
    assert what in said(section)
    assert bool(section.concerns) is bool(what)
    assert section.figures["kills"] == 1
    assert section.figures["equal"] is (mistake == "none")


FAMILY = """
import os, subprocess, sys, time
from pathlib import Path
role, *others = sys.argv[2].split(",")
if others:
    subprocess.Popen([sys.executable, *sys.argv[:2], ",".join(others)], start_new_session=others[0] == "leaves")
if role != "orphans":
    Path(sys.argv[1], str(os.getpid())).touch()
while role != "orphans" and not (role == "returns" and len(os.listdir(sys.argv[1])) == 4):
    time.sleep(0.02)
"""
"""A process that starts the rest of its family and notes its number: in a session of its own where it `leaves`, its
child without a parent where it `orphans`, and only until all are there where it `returns`."""

REPORT = """
from pathlib import Path
from branchdrive.runtime.interrupt import heeded_termination
from branchdrive.pilot.rerun import Command
with heeded_termination():
    Command({words!r}).run(Path({out!r}), [], limit_s=100_000)
"""


def alive(pids: Path) -> list[str]:
    return [pid.name for pid in pids.iterdir() if Path("/proc", pid.name).exists()]


@pytest.fixture
def family(tmp_path: Path) -> tuple[Callable[[str], Command], Path]:
    """What makes a command that starts further processes, and the folder in which all four note their numbers."""
    (tmp_path / "family.py").write_text(FAMILY)
    (tmp_path / "pids").mkdir()

    def command_of(role: str) -> Command:
        family = [tmp_path / "family.py", tmp_path / "pids", f"{role},leaves,orphans,stays,leaves"]
        return Command((sys.executable, *map(str, family), "{out}"))

    return command_of, tmp_path / "pids"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems cannot find those that left their process group")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_all_that_a_command_starts_ends_with_the_report(
    number: signal.Signals, family: tuple[Callable[[str], Command], Path], tmp_path: Path
) -> None:
    command_of, pids = family
    script = REPORT.format(words=command_of("stays").words, out=str(tmp_path / "out"))
    with subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL) as report:
        wait_for(lambda: len(list(pids.iterdir())) == 4)
        report.send_signal(number)
        report.wait(PATIENCE_S)
    wait_for(lambda: not alive(pids))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems cannot find those that left their process group")
def test_all_that_a_command_starts_ends_with_it(family: tuple[Callable[[str], Command], Path], tmp_path: Path) -> None:
    command_of, pids = family
    assert command_of("returns").run(tmp_path / "out", [], limit_s=PATIENCE_S).exit_code == 0
    assert len(list(pids.iterdir())) == 4
    assert alive(pids) == []


def test_ids_that_have_not_the_form_of_an_id_reach_no_command(collected: Pilot, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    hostile = SimpleNamespace(group_ids=["g0", f"g1; touch {mark}"])
    for text in ("sh -c 'echo {groups}' {out}", "true {out} --only={groups}"):
        with pytest.raises(UsageError, match=r"g1; touch .* is no id of a group, and is not handed to a command"):
            assert reruns(hostile, text, tmp_path).fresh is None
    assert reruns(hostile, "true {out} {order}", tmp_path).fresh.failure is None
    assert not mark.exists()
