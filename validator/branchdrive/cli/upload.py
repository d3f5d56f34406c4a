"""`branchdrive upload`: a finished dataset into a bucket."""

from __future__ import annotations

import argparse
import shlex
from typing import TextIO

from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar

SUMMARY = "put a finished dataset into a bucket, or go on with it"
ORDER = 124


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset: folder, URL or archive")
    parser.add_argument("target", metavar="URL", help="a prefix without objects: s3://BUCKET/PREFIX, gs:// or az://")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Upload, and say what is there.

    Raises:
        UsageError: Something else is there, or is being uploaded.
        DatasetError: The dataset is not finished, or is not what its manifest says.
        PlatformError: The store refuses or fails; the same command goes on.
    """
    from branchdrive.formats.bucket import Bucket
    from branchdrive.formats.place import open_store
    from branchdrive.formats.upload import upload_dataset

    target = Bucket.for_writing(args.target)
    with progress_bar(stderr, "uploading") as show:
        report = upload_dataset(open_store(args.dataset), target, show)
    stdout.write(
        f"files     {report.num_files:,}, {report.num_sent:,} of them sent now\n"
        f"dataset   {target}\n"
        f"identity  {report.identity}\n"
        f"next      {shlex.join(['branchdrive-validate', str(target)])}\n"
    )
    return 0
