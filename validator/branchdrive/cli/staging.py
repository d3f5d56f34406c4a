"""`branchdrive staging`: what a running or killed collection has not yet committed, and settling it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.place import folder
from branchdrive.contract.text import counted, printable

if TYPE_CHECKING:
    from branchdrive.writer.staging import StagedFacts

SUMMARY = "list, close or abandon groups that a collection left open"
ORDER = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=folder, help="folder of a collection that is not finished")
    parser.add_argument(
        "--close",
        metavar="GROUP",
        action="append",
        default=[],
        help="keep its rollouts as they are; repeatable",
    )
    parser.add_argument(
        "--abandon", metavar="GROUP", action="append", default=[], help="remove it with its rollouts; repeatable"
    )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Settle the named groups, then list what is staged.

    Raises:
        UsageError: There is no staging area, or a group is not in it, or is written at this moment.
    """
    from branchdrive.writer.staging import abandon_group, close_group, staged_groups

    for group_id in args.close:
        close_group(args.dataset, group_id)
    for group_id in args.abandon:
        abandon_group(args.dataset, group_id)
    groups = staged_groups(args.dataset)
    stdout.write("".join(f"{printable(_line(group))}\n" for group in groups))
    states = ", ".join(
        f"{count} {state}"
        for state in ("closed", "open", "written now")
        if (count := sum(group.state == state for group in groups))
    )
    stdout.write(f"{counted(len(groups), 'staged group')}{': ' if states else ''}{states}\n")
    if any(group.state == "open" for group in groups):
        stdout.write("The collector's command goes on with open groups; --close and --abandon settle one without it.\n")
    return 0


def _line(group: StagedFacts) -> str:
    earlier = ", of which a shard holds an earlier state" if group.is_committed else ""
    return f"{group.index:>6}  {group.group_id}  {group.state}  {counted(group.num_rollouts, 'rollout')}{earlier}"
