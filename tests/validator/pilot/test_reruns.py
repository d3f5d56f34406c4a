"""Runs of a command: its placeholders, what reruns and kills name, and what they say was not tried."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.validator.pilot import copying_collector

from branchdrive.errors import UsageError
from branchdrive.pilot.crash_drill import crash_drill
from branchdrive.pilot.determinism import determinism
from branchdrive.pilot.pilot import Pilot, read_pilot
from branchdrive.pilot.rerun import Command
from branchdrive.pilot.reruns import Reruns
from branchdrive.pilot.section import Section


def command(source: Path, mistake: str, groups: str = "{groups}", seconds: float = 0.0) -> str:
    words = [sys.executable, copying_collector.__file__, str(source), "{out}", mistake, groups, str(seconds)]
    return shlex.join(words)


def collect(source: Path, mistake: str, root: Path) -> Pilot:
    """A pilot as the collector with a mistake makes it."""
    assert Command.parse(command(source, mistake, "all")).run(root, [], limit_s=60).failure is None
    return read_pilot(root)


@pytest.fixture(scope="module")
def collected(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Pilot:
    """A pilot without a mistake."""
    return collect(source, "none", tmp_path_factory.mktemp("collected") / "dataset")


def reruns(pilot: Pilot, text: str, folder: Path) -> Reruns:
    return Reruns(pilot, Command.parse(text), folder, limit_s=60, note=lambda what: None)


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
    text = command(source, mistake, "all", seconds=1.0)
    runs = reruns(collected, text, tmp_path)
    assert runs.fresh.failure is None
    for leftover in tmp_path.glob("fresh.*"):
        leftover.unlink()
    section = crash_drill(collected, runs, num_kills=1)
    assert what in said(section)
    assert bool(section.concerns) is bool(what)
    assert section.figures["kills"] == 1
    assert section.figures["equal"] is (mistake == "none")


def test_a_command_ends_with_the_report_that_is_asked_to_terminate(tmp_path: Path) -> None:
    waits = "import os, time; open('{out}', 'w').write(str(os.getpid())); time.sleep(60)"
    words = [sys.executable, "-c", waits, "{out}"]
    out = tmp_path / "out"
    script = (
        "import os\nfrom pathlib import Path\nfrom branchdrive.pilot.rerun import Command\n"
        "from branchdrive.interrupt import heeded_termination\n"
        f"with heeded_termination():\n    Command({tuple(words)!r}).run(Path({str(out)!r}), [], limit_s=60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL) as report:
        while not (out.exists() and out.read_text()):
            assert report.poll() is None
            time.sleep(0.05)
        report.terminate()
        report.wait(30)
    with pytest.raises(ProcessLookupError):
        os.kill(int(out.read_text()), 0)
