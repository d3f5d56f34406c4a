"""`branchdrive pilot`: what to know of a dozen groups before thousands are collected."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least
from branchdrive.errors import UsageError
from branchdrive.runtime.interrupt import heeded_termination

if TYPE_CHECKING:
    from branchdrive.pilot.report import PilotReport

SUMMARY = "report on a pilot before thousands of groups are collected"
ORDER = 90


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the pilot, a finished dataset of few groups")
    parser.add_argument(
        "--rerun",
        metavar="COMMAND",
        help="the command that collects the same groups, run again to test determinism, resumption and time; "
        "{out} stands for the folder of the dataset, {groups}, if there, for group ids separated by commas, in order, "
        "or {order} for forward or reverse; no shell runs it",
    )
    parser.add_argument(
        "--groups", metavar="N", type=at_least(1), help="groups that are to be collected (default: 24,000 rollouts)"
    )
    parser.add_argument(
        "--kills", metavar="N", type=at_least(1), default=2, help="kills of the crash drill (default: 2)"
    )
    parser.add_argument(
        "--rerun-limit", metavar="SECONDS", type=at_least(1), default=3600,
        help="longest that one run of the command may take (default: 3600)",
    )  # fmt: skip
    parser.add_argument(
        "--work",
        metavar="FOLDER",
        type=Path,
        help="put the datasets of the runs there and keep them (default: temporary)",
    )
    parser.add_argument(
        "--format", choices=("text", "json", "markdown"), default="text", help="what to print (default: text)"
    )
    parser.add_argument("--output", metavar="FILE", type=Path, help="write the report there instead of to the terminal")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Examine the pilot and print the report; 1 where it has a problem, 4 where the validator failed, else 0.

    Raises:
        UsageError: There is no dataset, it is larger than a pilot, or the command cannot be run.
    """
    from branchdrive.formats.durable import replace_file
    from branchdrive.pilot.pilot import read_pilot
    from branchdrive.pilot.report import examine_pilot
    from branchdrive.pilot.rerun import Command
    from branchdrive.pilot.reruns import Reruns
    from branchdrive.runtime.executor import isolated

    check_output(args.output, outside=args.dataset)
    check_output(args.work, outside=args.dataset, is_folder=True)
    command = None if args.rerun is None else Command.parse(args.rerun)
    with progress_bar(stderr, "validating shards") as progress:
        pilot = read_pilot(args.dataset, num_wanted=args.groups, executor=isolated(1), progress=progress)

    def note(what: str) -> None:
        stderr.write(f"rerun: {what}\n")
        stderr.flush()

    with heeded_termination(), _work_folder(args.work) as folder:  # a command that runs must not outlive this one
        reruns = None if command is None else Reruns(pilot, command, folder, limit_s=args.rerun_limit, note=note)
        report = examine_pilot(pilot, reruns, num_kills=args.kills)
    text = _text(report, args.format, stdout, is_file=args.output is not None)
    if args.output is not None:
        replace_file(args.output, text.encode())
    else:
        stdout.write(text)
        stdout.flush()
    return report.exit_code


def _text(report: PilotReport, form: str, stdout: TextIO, *, is_file: bool) -> str:
    from branchdrive.cli.pilot_text import pilot_markdown, render_pilot

    if form == "json":
        return json.dumps(report.to_json(), indent=2, sort_keys=True, allow_nan=False) + "\n"
    return pilot_markdown(report) if form == "markdown" else render_pilot(report, stdout, is_file=is_file)


@contextmanager
def _work_folder(wanted: Path | None) -> Iterator[Path]:
    """A new folder for the datasets of runs; one that the user named is kept.

    Raises:
        UsageError: The named folder holds something.
    """
    if wanted is None:
        with tempfile.TemporaryDirectory(prefix="branchdrive-pilot-") as folder:
            yield Path(folder).resolve()
        return
    if wanted.exists() and any(wanted.iterdir()):
        raise UsageError(f"--work: {str(wanted)!r} is not empty; name a new folder")
    wanted.mkdir(parents=True, exist_ok=True)
    yield wanted.resolve()
