"""`branchdrive latency`: how long the locked models take to rank, measured here and published in the release."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TextIO

from branchdrive.cli.progress import part_lines
from branchdrive.cli.validate import at_least
from branchdrive_reference.benchmark.command.option import add_release, at_work, bars, need_models

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "measure how long the locked models take to rank on this machine, and publish it in the release"
ORDER = 190


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.epilog = (
        "Models of histories or surround views are exported first and compared with torch on every context of `val`, "
        "which takes longer than a few repeats do."
    )
    add_release(parser)
    parser.add_argument(
        "--repeats", metavar="N", type=at_least(1), default=500, help="rankings that are timed (default: 500)"
    )


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Measure, publish, and print the table.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: No benchmark is published, or another command is running on the release.
        DatasetError: The release or a checkpoint cannot be read.
    """
    need_models("latency")
    from branchdrive.benchmark.latency import latency_table
    from branchdrive.text.terminal import print_section, render
    from branchdrive_reference.benchmark.latency import latency_document, publish_latency

    tell = part_lines(stderr, "timing")
    with at_work(args.release) as (workspace, _), bars(stderr)("timing") as show:

        def show_model(done: int, total: int, note: str = "") -> None:
            if note:
                tell(f"{note}, model {done + 1} of {total}")
            show(done, total, note)

        document = latency_document(workspace.release, repeats=args.repeats, show=show_model)
        publish_latency(workspace, document)
    stdout.write(render(partial(print_section, section=latency_table(document), warnings=[]), stdout))
    return 0
