"""`branchdrive render`: add camera images and bird's-eye views to a dataset that has none, or go on with it."""

from __future__ import annotations

import argparse
import shlex
from contextlib import ExitStack
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.executor import add_executor_argument, engine_of
from branchdrive.cli.output import check_output
from branchdrive.cli.place import folder
from branchdrive.cli.progress import Update, progress_bar
from branchdrive.cli.validate import in_range
from branchdrive.errors import UsageError
from branchdrive.exit_code import EXIT_INTERRUPTED
from branchdrive.runtime.environment import extra
from branchdrive.runtime.interrupt import heeded_termination

if TYPE_CHECKING:
    from branchdrive_reference.rendering.dataset import RenderReport

__all__ = ["ORDER", "STREAM_NAMES", "SUMMARY", "add_arguments", "run"]

SUMMARY = "add camera images and bird's-eye views, drawn from what a dataset records"
ORDER = 40

STREAM_NAMES = ("rgb_surround", "rgb_top_down", "semantic_bev")
_image_size = in_range(16, 4096)
"""Parser of rows or columns of an image."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=folder, help="the dataset folder; it needs maps and actors")
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=folder,
        help="make a copy of the raw layer with media, and leave DATASET as it is",
    )
    parser.add_argument(
        "--streams",
        metavar="NAME,...",
        default=",".join(STREAM_NAMES),
        help=f"media streams to render (default: {','.join(STREAM_NAMES)})",
    )
    parser.add_argument(
        "--width", metavar="PX", type=_image_size, default=160, help="columns of RGB images (default: 160)"
    )
    parser.add_argument("--height", metavar="PX", type=_image_size, default=90, help="rows of RGB images (default: 90)")
    parser.add_argument(
        "--window",
        choices=("branch", "all"),
        default="branch",
        help="the 26 observations around the branch, or every observation (default: branch)",
    )
    parser.add_argument("--jobs", metavar="J", type=in_range(1, 1024), default=1, help="worker processes (default: 1)")
    add_executor_argument(parser)


def chosen_streams(text: str) -> tuple[str, ...]:
    """Media streams that a list names.

    Raises:
        UsageError: It names none, or one that cannot be rendered.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in STREAM_NAMES]
    if unknown or not names:
        raise UsageError(f"--streams: unknown stream {text!r}; choose from {', '.join(STREAM_NAMES)}")
    return tuple(name for name in STREAM_NAMES if name in names)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Render, finish the dataset and print a summary; 130 if interrupted, 143 if asked to terminate.

    Raises:
        UsageError: The options do not go together, or the dataset cannot be rendered.
        PlatformError: The extra is not installed.
    """
    streams = chosen_streams(args.streams)
    from branchdrive.collector.campaign import count_routes
    from branchdrive.collector.report import routes_text

    with extra("media", "sim", of="`render`"):
        from branchdrive_reference.rendering.dataset import render_dataset
        from branchdrive_reference.rendering.plan import MediaPlan
        from branchdrive_reference.rendering.rig import cameras_of
    check_output(args.output, outside=args.dataset, is_folder=True)
    plan = MediaPlan(cameras_of(streams, width_px=args.width, height_px=args.height), args.window)
    done = total = 0
    show: Update | None = None
    try:
        with ExitStack() as stack:
            stack.enter_context(heeded_termination())

            def watch(num_done: int, num_groups: int) -> None:
                nonlocal done, total, show
                done, total = num_done, num_groups
                if show is None:
                    counts = count_routes(args.dataset if args.output is None else args.output)
                    stdout.write(f"routes    {routes_text(*counts)}\n")
                    stdout.flush()
                    show = stack.enter_context(progress_bar(stderr, "rendering groups"))
                show(num_done, num_groups)

            report = render_dataset(
                args.dataset, plan, output=args.output, jobs=args.jobs, executor=engine_of(args), watch=watch
            )
    except KeyboardInterrupt as interrupt:
        stderr.write(f"interrupted; {done} of {total} groups are rendered; run the same command again to go on\n")
        return int(getattr(interrupt, "exit_code", EXIT_INTERRUPTED))
    stdout.write(_summary(report))
    return 0


def _summary(report: RenderReport) -> str:
    rendered = report.num_groups - report.num_found
    lines = [
        f"groups    {rendered:,} rendered, {report.num_found:,} found rendered",
        f"images    {report.num_images:,} in {report.num_bytes / 1e6:,.1f} MB",
        f"dataset   {report.root}",
        f"identity  {report.identity}",
        f"next      {shlex.join(['branchdrive-validate', str(report.root)])}",
    ]
    return "\n".join(lines) + "\n"
