"""`branchdrive pack`: a finished dataset as one archive."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar

SUMMARY = "put a finished dataset into one archive, which is read without unpacking"
ORDER = 122


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset: folder, URL or archive")
    parser.add_argument("output", metavar="ARCHIVE", type=Path, help="the archive, *.zip; must not exist")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Pack, and say what was made.

    Raises:
        UsageError: The archive cannot be made.
        DatasetError: The dataset is not finished, or is not what its manifest says.
    """
    from branchdrive.formats.pack import pack_dataset
    from branchdrive.formats.place import open_store

    check_output(args.output, outside=args.dataset)
    with progress_bar(stderr, "packing") as show:
        report = pack_dataset(open_store(args.dataset), args.output, show)
    stdout.write(
        f"files     {report.num_files:,}\n"
        f"bytes     {report.num_bytes:,}\n"
        f"archive   {args.output}\n"
        f"identity  {report.identity}\n"
        f"next      {shlex.join(['branchdrive-validate', str(args.output)])}\n"
    )
    return 0
