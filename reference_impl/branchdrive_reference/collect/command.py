"""`branchdrive collect`: collect a dataset in the reference world, or go on where a run was interrupted."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.progress import progress_bar
from branchdrive.errors import UsageError

if TYPE_CHECKING:
    from branchdrive_reference.collect.campaign import CampaignReport

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "collect a dataset in the reference world"

EXIT_INTERRUPTED = 130
_MAX_SEED = 2**63 - 1
_MAX_COUNT = 1_000_000


def count(text: str) -> int:
    """A number of groups or processes; `argparse` names this function in its messages."""
    value = int(text)
    if not 1 <= value <= _MAX_COUNT:
        raise argparse.ArgumentTypeError(f"{value} is not in 1 .. {_MAX_COUNT}")
    return value


def seed(text: str) -> int:
    """The seed of a collection; `argparse` names this function in its messages."""
    value = int(text)
    if not 0 <= value <= _MAX_SEED:
        raise argparse.ArgumentTypeError(f"{value} is not in 0 .. {_MAX_SEED}")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", metavar="OUT", type=Path, help="folder of the dataset; an interrupted one is resumed")
    parser.add_argument("--groups", metavar="N", type=count, required=True, help="branch groups to collect")
    parser.add_argument("--seed", metavar="S", type=seed, required=True, help="seed of the whole collection")
    parser.add_argument("--jobs", metavar="J", type=count, default=1, help="worker processes (default: 1)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Collect, finish the dataset and print a summary; 130 if interrupted.

    Raises:
        UsageError: The folder cannot be used, or the extra is not installed.
    """
    try:
        from branchdrive_reference.collect.campaign import collect
    except ModuleNotFoundError as error:
        raise UsageError(f"`collect` needs the package {error.name!r}: pip install 'branchdrive[sim]'") from error

    finished = 0

    def note(groups: int, ticks: int) -> None:
        nonlocal finished
        finished = groups
        show(groups, args.groups, f"{ticks:,} ticks")

    try:
        with progress_bar(stderr, "collecting groups") as show:
            report = collect(args.out, num_groups=args.groups, seed=args.seed, jobs=args.jobs, watch=note)
    except KeyboardInterrupt:
        stderr.write(_interruption(args, finished))
        return EXIT_INTERRUPTED
    stdout.write(_summary(args, report))
    return 0


def _interruption(args: argparse.Namespace, finished: int) -> str:
    command = f"branchdrive collect {args.out} --groups {args.groups} --seed {args.seed} --jobs {args.jobs}"
    return f"interrupted; {finished} of {args.groups} groups are finished. To go on, run: {command}\n"


def _summary(args: argparse.Namespace, report: CampaignReport) -> str:
    simulated = sum(group.num_simulated for group in report.groups)
    reused = sum(group.num_reused for group in report.groups)
    unbranched = [group for group in report.groups if group.unbranched_because]
    jobs = "1 job" if args.jobs == 1 else f"{args.jobs} jobs"
    lines = [
        f"groups    {len(report.groups):,} collected, {report.num_found:,} found finished",
        *(f"          {group.group_id} has no branch: {group.unbranched_because}" for group in unbranched),
        f"rollouts  {simulated:,} simulated, {reused:,} found finished",
        f"ticks     {report.num_ticks:,} in {report.seconds:.1f} s with {jobs}, writing included: "
        f"{report.ticks_per_s:,.0f} ticks/s",
        f"dataset   {args.out}",
        f"identity  {report.identity}",
        f"next      branchdrive-validate {args.out}",
    ]
    return "\n".join(lines) + "\n"
