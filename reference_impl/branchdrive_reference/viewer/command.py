"""`branchdrive rerun`: a branch group as a file for the viewer of rerun."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TextIO

from branchdrive.cli.output import check_output
from branchdrive.contract.text import counted, printable
from branchdrive.runtime.environment import extra

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "write a branch group for the viewer of rerun: its futures on the map, over time"
ORDER = 75


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="the dataset folder")
    parser.add_argument("group", metavar="GROUP", help="id of a branch group")
    parser.add_argument("--output", metavar="FILE", type=Path, required=True, help="the file, as group.rrd")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Write the file and print what it shows.

    Raises:
        UsageError: There is no such group, it has no nominal rollout, or the output lies in the dataset.
        DatasetError: The dataset cannot be read.
        PlatformError: The extra is not installed.
    """
    check_output(args.output, outside=args.dataset)
    with extra("rerun", of="`rerun`"):
        from branchdrive_reference.viewer.recording import save_recording
    from branchdrive.raw.reader import open_dataset
    from branchdrive.raw.rollout import MAP

    dataset = open_dataset(args.dataset)
    group, elements = dataset.group(args.group), []
    if MAP in dataset.descriptor.tables:
        town = group.nominal.record["town"]
        rows = (row for part in dataset.table(MAP) for row in part.to_pylist())
        elements = [*{row["element_id"]: row for row in rows if row["town"] == town}.values()]
    num_shown = save_recording(group, elements, args.output)
    if num_shown < len(group.candidates):
        stderr.write(f"{len(group.candidates) - num_shown} of its candidates have no branch and are left out\n")
    num_bytes = args.output.stat().st_size
    stdout.write(f"{printable(str(args.output))}: {counted(num_shown, 'candidate')}, {num_bytes:,} bytes\n")
    return 0
