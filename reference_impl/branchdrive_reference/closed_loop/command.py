"""`branchdrive drive`: selectors drive, closed loop, on a population whose routes are in no cluster of `train`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from branchdrive.cli.build import seed
from branchdrive.cli.output import check_output
from branchdrive.cli.place import folder
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least, in_range
from branchdrive.contract.document import dump_json
from branchdrive.contract.text import printable
from branchdrive.exit_code import EXIT_INTERRUPTED
from branchdrive.formats.durable import replace_file
from branchdrive.runtime.environment import extra
from branchdrive.runtime.interrupt import deferred_interrupt, heeded_termination
from branchdrive_reference.plotting import load_matplotlib

if TYPE_CHECKING:
    from branchdrive_reference.closed_loop.run import Request

__all__ = ["ORDER", "SUMMARY", "add_arguments", "request_of", "run"]

SUMMARY = "let selectors drive, closed loop, where none was trained"
ORDER = 185

_MAX_STRENGTH = 100.0


def ticks(text: str) -> int:
    """Ticks between decisions; `argparse` names this function in its messages."""
    from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS

    value = int(text)
    if value < OBSERVATION_STRIDE_TICKS or value % OBSERVATION_STRIDE_TICKS:
        raise argparse.ArgumentTypeError(f"{value} is no multiple of {OBSERVATION_STRIDE_TICKS} above 0")
    return value


def strength(text: str) -> float:
    """Strength of a noise; `argparse` names this function in its messages."""
    value = float(text)
    if not (math.isfinite(value) and 0 < value <= _MAX_STRENGTH):
        raise argparse.ArgumentTypeError(f"{value} is not above 0 and at most {_MAX_STRENGTH:g}")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.epilog = (
        "The same command goes on where it was interrupted. What is driven is locked before the first drive, and put "
        "on record beside the release."
    )
    parser.add_argument("release", metavar="RELEASE", type=folder, help="release with its model layer")
    parser.add_argument("--output", metavar="DIR", type=Path, required=True, help="folder of lock, drives and tables")
    what = parser.add_argument_group("who drives")
    what.add_argument(
        "--selector", metavar="NAME", action="append", required=True,
        help="nominal, an action key, constants (all of them), action_prior, a baseline of the protocol, E-MODEL (a "
        "locked model by its ONNX export), oracle, or NAME=COMMAND for a program of others (repeatable)",
    )  # fmt: skip
    what.add_argument(
        "--profile", metavar="NAME", default="near_range", help="what utility weighs (default: near_range)"
    )
    where = parser.add_argument_group("where and when")
    where.add_argument("--groups", metavar="N", type=at_least(1), required=True, help="groups of the population")
    where.add_argument("--seed", metavar="S", type=seed, required=True, help="seed of the population, one not used yet")
    where.add_argument("--every", metavar="TICKS", type=ticks, default=50, help="ticks between decisions (default: 50)")
    where.add_argument(
        "--decisions", metavar="K", type=in_range(1, 100), action="append",
        help="decisions of a drive at most, the first at the branch (repeatable; default: 1)",
    )  # fmt: skip
    where.add_argument(
        "--world", metavar="MODULE:NAME",
        help="worlds of the collector SDK that the release was collected in: a WorldCollector, or a mapping of worlds "
        "by scenario type (default: the reference world)",
    )  # fmt: skip
    wrong = parser.add_argument_group("noise, each as further drives beside the exact ones")
    wrong.add_argument("--replay-noise", metavar="STRENGTH", type=strength, help="noise of replays, as in a collection")
    wrong.add_argument("--sensor-noise", metavar="STRENGTH", type=strength, help="noise on what selectors see")
    what.add_argument(
        "--look-ahead", action="store_true",
        help="drive the whole bank ahead at every decision too, and tell its regret; it takes about as long as a drive "
        "for each candidate, decision and selector",
    )  # fmt: skip
    work = parser.add_argument_group("how to work")
    work.add_argument(
        "--record", action="store_true", help="keep what is driven as a raw dataset too, in the folder `dataset` of DIR"
    )
    work.add_argument(
        "--figures", action="store_true",
        help="draw driving scores over offline figures too, as offline.png and offline.svg (extra `plots`)",
    )  # fmt: skip
    work.add_argument("--jobs", metavar="N", type=at_least(1), default=1, help="worker processes (default: 1)")
    work.add_argument(
        "--format", choices=("text", "markdown", "json"), default="text",
        help="where the tables are as text, all tables as markdown, or all results as json (default: text)",
    )  # fmt: skip


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Lock, drive, and write tables; 130 if interrupted, 143 if asked to terminate.

    Raises:
        PlatformError: An extra is not installed.
        UsageError: The options do not go together, or a selector cannot decide.
        DatasetError: The release or what was driven cannot be read.
    """
    check_output(args.output, outside=args.release, is_folder=True)
    with extra("drive", of="`drive`"):
        import scipy.stats  # noqa: F401
    with extra("sim", of="`drive`"), deferred_interrupt() as raise_if_noted:
        from branchdrive_reference.closed_loop.run import drive_release

        if args.figures:
            with extra("plots", of="`--figures`"):
                load_matplotlib()
    raise_if_noted()
    try:
        with heeded_termination(), progress_bar(stderr, "driving groups") as show:
            found = drive_release(request_of(args), watch=lambda done, total: show(done, total))
    except KeyboardInterrupt as interrupt:
        stderr.write("interrupted; run the same command to go on\n")
        return int(getattr(interrupt, "exit_code", EXIT_INTERRUPTED))
    if args.figures:
        from branchdrive_reference.closed_loop.figure import drive_figures

        for name, content in drive_figures(found.results).items():
            replace_file(args.output / name, content)
    for warning in found.results["warnings"]:
        stderr.write(f"warning: {warning}\n")
    if args.format == "text":
        stdout.write(_summary(args.output, found.results))
    else:
        stdout.write(found.tables if args.format == "markdown" else dump_json(found.results).decode())
    return 0


def request_of(args: argparse.Namespace) -> Request:
    """What the arguments ask for."""
    from branchdrive_reference.closed_loop.arm import CONDITIONS, Condition
    from branchdrive_reference.closed_loop.course import Schedule
    from branchdrive_reference.closed_loop.run import Request

    numbers = list(dict.fromkeys(args.decisions or [1]))
    conditions = [Condition(CONDITIONS[0])]
    conditions += [Condition(CONDITIONS[1], replay=args.replay_noise)] if args.replay_noise else []
    conditions += [Condition(CONDITIONS[2], sensor=args.sensor_noise)] if args.sensor_noise else []
    return Request(
        release=args.release,
        output=args.output,
        selectors=tuple(args.selector),
        profile=args.profile,
        num_groups=args.groups,
        seed=args.seed,
        schedules=tuple(Schedule(args.every, number) for number in numbers),
        conditions=tuple(conditions),
        world=args.world,
        looks_ahead=args.look_ahead,
        is_recorded=args.record,
        jobs=args.jobs,
    )


def _summary(output: Path, results: dict[str, Any]) -> str:
    lines = [
        f"groups    {results['num_driven']:,} of {results['num_planned']:,} driven, in {results['num_clusters']:,} "
        "route clusters that none of `train` belongs to",
        *_scores(results["arms"]),
        f"tables    {printable(str(output / 'TABLES.md'))}",
    ]
    return "\n".join(lines) + "\n"


def _scores(arms: Sequence[dict[str, Any]]) -> list[str]:
    from branchdrive.benchmark.cell import number

    return [
        f"score     {number(arm['means']['score']['value'])}  {printable(arm['selector'])}, "
        f"decisions {arm['num_decisions']}, {arm['condition']}"
        for arm in arms
    ]
