"""`make kills`: collector, builder and benchmark, killed again and again, end with what an undisturbed run leaves.

The builder is killed on a raw layer of one part, and on one of two, whose tables workers write.

A command runs in a session of its own, whose processes are all killed (SIGKILL) at a moment drawn from the time that an
undisturbed run takes; then it is run again on what is left. After some kills it may end, and every file below the
dataset is compared, byte by byte.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import Progress
from tests.reference_impl.benchmark.small_release import contents, make_release, smallest_protocol, write_protocol
from tests.synthetic import seal_dataset
from tests.synthetic_release import raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.layer import PART_SHARDS
from branchdrive.contract.layout import RAW_DIR, shard_name
from branchdrive.statistics.random_words import uniforms, words

KILLS_A_ROUND = 4
"""Kills after which a command may end."""

_COLLECTED_GROUPS = 6


class Drill(NamedTuple):
    """A command that goes on where it was killed.

    Attributes:
        prepare: Makes what the command starts from, at a path that does not exist.
        words: The command for a dataset.
    """

    prepare: Callable[[Path], object]
    words: Callable[[Path], list[str]]


def _collect(root: Path) -> list[str]:
    return _command("collect", str(root), "--preset", "demo", "--groups", str(_COLLECTED_GROUPS), "--seed", "1")


def _command(*arguments: str) -> list[str]:
    return [str(Path(sys.executable).with_name("branchdrive")), *arguments, "--jobs", "2"]


def _collected(root: Path) -> None:
    subprocess.run(_collect(root), check=True, capture_output=True)


def _collected_in_parts(root: Path) -> None:
    """Raw shards of two parts: the last one has the number of the first of another part."""
    Draft(raw_tables(), raw_descriptor()).write(root)
    last = max((root / RAW_DIR).iterdir())
    last.rename(last.with_name(shard_name(PART_SHARDS)))
    seal_dataset(root)


def _benchmark(root: Path) -> list[str]:
    return _command("benchmark", str(root), "--protocol", str(root.parent / "protocol.json"))


def _release(root: Path) -> None:
    make_release(root)
    protocol = root.parent / "protocol.json"
    protocol.unlink(missing_ok=True)
    write_protocol(protocol, smallest_protocol())


DRILLS = {
    "collect": Drill(lambda root: root.parent.mkdir(exist_ok=True), _collect),
    "build": Drill(_collected, lambda root: _command("build", str(root))),
    "build in parts": Drill(_collected_in_parts, lambda root: _command("build", str(root))),
    "benchmark": Drill(_release, _benchmark),
}


def _run(words: Sequence[str], limit_s: float | None = None) -> bool:
    """Whether the command ended before its time; if not, all its processes are killed."""
    with subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as child:
        try:
            _, errors = child.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            return False
        if child.returncode:
            raise SystemExit(f"{' '.join(words)} ended with {child.returncode}: {errors.strip()[-2000:]}")
        return True


def drill(name: str, num_kills: int, folder: Path, progress: Callable[[], object]) -> tuple[int, list[str]]:
    """Kill a command; gives how many runs were compared, and the files that differ.

    Raises:
        SystemExit: A run that was not killed failed.
    """
    command = DRILLS[name]
    start, whole = folder / "start" / "dataset", folder / "whole" / "dataset"
    for place in (start, whole):
        place.parent.mkdir(parents=True)
    command.prepare(start)

    def fresh(root: Path) -> Path:
        shutil.rmtree(root.parent, ignore_errors=True)
        shutil.copytree(start.parent, root.parent)
        return root

    began_s = time.monotonic()
    _run(command.words(fresh(whole)))
    whole_s, expected = time.monotonic() - began_s, contents(whole)
    kills = rounds = 0
    differing: set[str] = set()
    while kills < num_kills:
        root, killed = fresh(folder / "killed" / "dataset"), 0
        (shares,) = uniforms(words(0, f"kills of {name}", 1, KILLS_A_ROUND, first_row=rounds)).tolist()
        for share in shares:
            began_s = time.monotonic()
            if _run(command.words(root), share * whole_s):
                if not killed:  # the machine was slower when the time was taken
                    whole_s = time.monotonic() - began_s
                break
            killed += 1
            progress()
        _run(command.words(root))
        found = contents(root)
        differing |= {path for path in found.keys() | expected.keys() if found.get(path) != expected.get(path)}
        kills, rounds = kills + killed, rounds + 1
    return rounds, sorted(differing)


def main() -> int:
    """Exit code 1 if any file differs from that of an undisturbed run."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=f"of {', '.join(DRILLS)} (default: all)")
    parser.add_argument("--kills", type=int, default=100, help="kills of each (default: 100)")
    arguments = parser.parse_args()
    if unknown := set(arguments.commands) - DRILLS.keys():
        parser.error(f"no drill is called {', '.join(sorted(unknown))}")
    console, is_same = Console(), True
    for name in arguments.commands or DRILLS:
        with tempfile.TemporaryDirectory(prefix="branchdrive-kills-") as scratch, Progress(console=console) as bar:
            task = bar.add_task(name, total=arguments.kills)
            rounds, differing = drill(name, arguments.kills, Path(scratch), lambda: bar.advance(task))  # noqa: B023
        result = f"these files differ: {', '.join(differing[:10])}" if differing else "all files equal"
        console.print(f"{name}: killed at least {arguments.kills} times, ended {rounds} times: {result}")
        is_same &= not differing
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main())
