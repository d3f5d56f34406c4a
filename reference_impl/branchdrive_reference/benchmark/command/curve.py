"""`branchdrive curve`: how regret falls with the number of groups that selectors are fitted on."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TextIO

from branchdrive.cli.executor import engine_of
from branchdrive.cli.output import check_output
from branchdrive.cli.validate import at_least
from branchdrive.contract.document import dump_json
from branchdrive.formats.durable import replace_file
from branchdrive_reference.benchmark.command.option import (
    add_device,
    add_jobs,
    add_no_figures,
    add_protocol,
    add_release,
    bars,
    check_device,
    need_models,
    need_plots,
)

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "tell how regret falls with the number of groups that models and baselines are fitted on"
ORDER = 195


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.epilog = (
        "Groups are those of `train`, held out by folds of whole route clusters; `test` is not looked at. The same "
        "command goes on where it was interrupted."
    )
    add_release(parser)
    parser.add_argument(
        "--output", metavar="DIR", type=Path, required=True, help="folder of checkpoints, figures and tables"
    )
    parser.add_argument(
        "--models", metavar="MODEL", nargs="+", help="models to train (default: all of the protocol without images)"
    )
    parser.add_argument(
        "--sizes", metavar="N", nargs="+", type=at_least(1), default=[],
        help="groups to fit on (default: a quarter, a half and all of what a fold leaves)",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", metavar="N", type=at_least(1), default=1, help="seeds of every model, of those declared (default: 1)"
    )
    add_jobs(parser)
    add_device(parser)
    add_protocol(parser)
    add_no_figures(parser)
    parser.add_argument(
        "--format", choices=("text", "markdown", "json"), default="text",
        help="print tables as text or markdown, or all figures as json (default: text)",
    )  # fmt: skip


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Fit, judge, write and print.

    Raises:
        PlatformError: An extra is not installed.
        UsageError: No model is called so, or the release is too small for folds or a size.
        DatasetError: The release or a checkpoint cannot be read.
    """
    check_output(args.output, outside=args.release, is_folder=True)
    need_models("curve")
    check_device(args.device)
    if not args.no_figures:
        need_plots()
    from branchdrive.runtime.interrupt import heeded_termination
    from branchdrive.text.terminal import print_section, render
    from branchdrive_reference.benchmark.curve import learning_curve, open_curve
    from branchdrive_reference.benchmark.curve_table import curve_sections, render_curve, warnings_of
    from branchdrive_reference.benchmark.document import published_protocol, read_protocol_file
    from branchdrive_reference.benchmark.release import open_release

    with heeded_termination():
        release = open_release(args.release)
        protocol = read_protocol_file(args.protocol) if args.protocol else published_protocol(release)
        curve = open_curve(release, protocol, models=args.models, sizes=args.sizes, num_seeds=args.seeds)
        with bars(stderr)("training") as show:
            found = learning_curve(
                curve, args.output, jobs=args.jobs, executor=engine_of(args), device=args.device, show=show
            )
    args.output.mkdir(parents=True, exist_ok=True)
    files = {"curve.json": dump_json(found), "CURVE.md": render_curve(found).encode()}
    if not args.no_figures:
        from branchdrive_reference.benchmark.figure.curve import curve_figures

        files |= curve_figures(found)
    for name, content in files.items():
        replace_file(args.output / name, content)
    if args.format == "text":
        for section in curve_sections(found):
            stdout.write(render(partial(print_section, section=section, warnings=warnings_of(found)), stdout) + "\n")
    else:
        stdout.write(render_curve(found) if args.format == "markdown" else dump_json(found).decode())
    return 0
