"""`branchdrive merge`: raw datasets that several machines collected become one."""

from __future__ import annotations

import argparse
import shlex
from typing import TextIO

from branchdrive.cli.place import folder
from branchdrive.cli.progress import progress_bar
from branchdrive.contract.text import counted

SUMMARY = "make one dataset of parts that several machines collected"
ORDER = 35


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("parts", metavar="DATASET", type=folder, nargs="+", help="finished raw datasets, in any number")
    parser.add_argument(
        "--output", metavar="FOLDER", type=folder, required=True, help="where the merged dataset goes; must not exist"
    )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Merge, and say what was made.

    Raises:
        UsageError: The output cannot be made, or parts contradict each other.
        DatasetError: A part is damaged.
    """
    from branchdrive.writer.merge import merge_datasets

    with progress_bar(stderr, "merging") as show:
        report = merge_datasets(args.parts, args.output, progress=show)
    numbers = "renumbered" if report.is_renumbered else "with their numbers"
    copied = f", {counted(report.num_copied, 'file')} copied" if report.num_copied else ""
    stdout.write(
        f"parts     {report.num_parts:,}\n"
        f"shards    {report.num_shards:,} {numbers}{copied}\n"
        f"groups    {report.num_groups:,} with {counted(report.num_rollouts, 'rollout')}\n"
        f"dataset   {args.output}\n"
        f"identity  {report.identity}\n"
        f"next      {shlex.join(['branchdrive-validate', str(args.output)])}\n"
    )
    return 0
