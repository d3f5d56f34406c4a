"""The command line that collectors share: collect into a folder, say what was collected and what comes next."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from branchdrive.collector.collection import collect_dataset
from branchdrive.collector.part import WHOLE, Part
from branchdrive.collector.report import CollectionReport
from branchdrive.collector.world import World
from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import BranchDriveError, ToolError
from branchdrive.exit_code import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_SUCCESS, EXIT_USAGE
from branchdrive.runtime.interrupt import heeded_termination

__all__ = ["collector_main"]


def collector_main(
    describe: Callable[[int], Descriptor],
    worlds: Mapping[str, Callable[[], World]],
    argv: Sequence[str] | None = None,
    **options: Any,
) -> int:
    """Carry out the command line of a collector: ``ROOT [--groups N] [--only IDS] [--part K/N] [--seed S] [--jobs J]``.

    Args:
        describe: The descriptor of a collection with a seed.
        worlds: What makes the world of each scenario type.
        argv: Arguments; those of the process by default.
        **options: As `collect_dataset` has them.

    Returns:
        0, or 2 where the collection cannot be carried out as asked, 4 where the machine fails, 130 where it is
        interrupted and 143 where it is asked to terminate; the same command goes on then.
    """
    parser = argparse.ArgumentParser(description="Collect branch groups; the same command goes on after a kill.")
    parser.add_argument("root", type=Path, help="folder of the dataset")
    parser.add_argument("--groups", type=int, default=1, help="branch groups of the dataset (default: 1)")
    parser.add_argument(
        "--only", type=lambda ids: ids.split(","), default=[], metavar="IDS",
        help="ids of the groups to collect of them, with commas, in this order (default: all)",
    )  # fmt: skip
    parser.add_argument(
        "--part", type=Part.parse, default=WHOLE, metavar="K/N",
        help="collect part K of N of the groups, for `branchdrive merge` (default: all)",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="seed of the collection (default: 1)")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes (default: 1)")
    args = parser.parse_args(argv)

    def watch(groups: int, ticks: int) -> None:
        whole = f"{groups} of {len(args.only) or args.groups} groups"
        part = f"{groups} groups of part {args.part}"
        sys.stderr.write(f"{whole if args.part == WHOLE else part}, {ticks:,} ticks\n")

    try:
        with heeded_termination():
            report = collect_dataset(
                args.root, describe(args.seed), worlds,
                num_groups=args.groups, jobs=args.jobs, only=args.only, part=args.part, watch=watch, **options,
            )  # fmt: skip
    except KeyboardInterrupt as interrupt:
        sys.stderr.write(f"{parser.prog}: interrupted; run the same command to go on\n")
        return int(getattr(interrupt, "exit_code", EXIT_INTERRUPTED))
    except (BranchDriveError, OSError) as error:
        sys.stderr.write(f"{parser.prog}: {error}\n")
        return EXIT_FAILED if isinstance(error, ToolError) else EXIT_USAGE
    sys.stdout.write(_summary(args.root, report))
    return EXIT_SUCCESS


def _summary(root: Path, report: CollectionReport) -> str:
    bare = sum(bool(group.unbranched_because) for group in report.groups)
    refused = sum(bool(group.refused_because) for group in report.groups)
    branched = f"{len(report.groups) - bare - refused} with a branch, {bare} without, {refused} refused"
    lines = [f"dataset   {root}", f"identity  {report.identity}"]
    lines.append(f"groups    {len(report.groups)} collected: {branched}; {report.num_found} found finished")
    lines.append(f"time      {report.seconds:.1f} s, {report.num_ticks:,} ticks")
    remarks = report.remarks("unbranched_because", "refused_because", "stopped_because", "note")
    lines += [f"          {remark}" for remark in remarks]
    lines.append(f"routes    {report.routes_text}")
    lines.append(f"next      {shlex.join(['branchdrive-validate', str(root)])}")
    return "\n".join([*lines, ""])
