"""`branchdrive show`: a contact sheet or an animated view of one branch group, made of its recorded images."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import part_lines, progress_bar
from branchdrive.contract.text import printable
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.durable import replace_file
from branchdrive.runtime.environment import extra

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "show a branch group with its images: a contact sheet, or an animated view"
ORDER = 70

_SUFFIXES = (".png", ".gif")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "dataset", metavar="DATASET", type=place, help="the dataset, with media: folder, URL or archive"
    )
    parser.add_argument("group", metavar="GROUP", help="the group to show")
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="a contact sheet of the branch (.png) or an animated view of history and futures (.gif); "
        "default: GROUP.png in the current folder",
    )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Show, and print where.

    Raises:
        UsageError: The dataset is not finished, has no media or no such group, the group cannot be shown, or the
            output is not such a file outside the dataset.
        PlatformError: The extra is not installed.
    """
    with extra("media", "sim", of="`show`"):
        from branchdrive_reference.drawing.choice import named_groups
        from branchdrive_reference.drawing.gallery import picture_path
        from branchdrive_reference.showing.sheet import animated_bytes, read_sheet, sheet_bytes
        from branchdrive_reference.study.label import sentence
        from branchdrive_reference.study.survey import open_finished

    output = args.output
    if output is not None and output.suffix.lower() not in _SUFFIXES:
        raise UsageError(f"--output: {str(output)!r} ends neither with .png nor with .gif")
    check_output(output, outside=args.dataset)
    try:
        dataset = open_finished(args.dataset)
        (group_id,) = named_groups(dataset, [args.group])
        output = output or picture_path(Path(), group_id, "png")
        check_output(output, outside=args.dataset)
        sheet = read_sheet(dataset, group_id)
        if output.suffix.lower() == ".png":
            content = sheet_bytes(sheet)
        else:
            part_lines(stderr, "drawing")(f"{len(sheet.ticks)} frames")
            with progress_bar(stderr, "drawing frames") as show:
                content = animated_bytes(sheet, show)
    except DatasetError as error:
        raise UsageError(sentence(error)) from error
    replace_file(output, content)
    stdout.write(f"{printable(str(output))}\n")
    return 0
