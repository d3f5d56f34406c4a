"""`branchdrive report`: a report that people open, in one file."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar
from branchdrive.cli.validate import at_least
from branchdrive.contract.text import counted, printable
from branchdrive.errors import UsageError
from branchdrive.runtime.environment import extra

if TYPE_CHECKING:
    from branchdrive_reference.report.facts import DatasetReport

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "write a report that opens in a browser: verdict, findings, groups, and a player of their futures"
ORDER = 55


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="the dataset: folder, URL or archive")
    parser.add_argument(
        "--raw", metavar="PATH", type=place, help="dataset with the raw layer that a detached release names by digest"
    )
    parser.add_argument("--output", metavar="FILE", type=Path, help="file of the report; html needs one")
    parser.add_argument(
        "--format",
        choices=("html", "markdown", "text", "json"),
        default="html",
        help="a page with a player, or what it says as markdown, text or json (default: html)",
    )
    parser.add_argument(
        "--folder",
        action="store_true",
        help="write groups that the page has no room for as pages into a folder beside it, FILE-groups",
    )
    parser.add_argument("--jobs", metavar="N", type=at_least(1), default=1, help="worker processes (default: 1)")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Validate the dataset, read what it holds, and write the report; the exit code says that it was written.

    Raises:
        UsageError: There is no dataset, or the output cannot be written.
        PlatformError: An extra is not installed.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers: each has one core
    if args.format == "html" and args.output is None:
        raise UsageError("a page needs a file; give `--output report.html`, or `--format text`")
    if args.folder and args.format != "html":
        raise UsageError("`--folder` belongs to `--format html`")
    with extra("sim", "report", of="`report`"):
        import jinja2  # noqa: F401

        from branchdrive_reference.report.facts import read_report
    from branchdrive.formats.durable import replace_file
    from branchdrive.runtime.executor import isolated

    folder = args.output.with_name(f"{args.output.stem}-groups") if args.folder else None
    for root in (args.dataset, args.raw):
        check_output(args.output, outside=root)
        check_output(folder, outside=root, is_folder=True)
    with progress_bar(stderr, "reading shards") as progress:
        report = read_report(args.dataset, raw=args.raw, executor=isolated(args.jobs), progress=progress)
    if args.format != "html":
        text = _text(report, args.format, stdout, is_file=args.output is not None)
        if args.output is None:
            stdout.write(text)
        else:
            replace_file(args.output, text.encode())
        return 0
    from branchdrive.cli.formats.outcome import headline
    from branchdrive_reference.report.page import render_pages

    pages = render_pages(report, name=args.output.name, folder=None if folder is None else folder.name)
    replace_file(args.output, pages.report)
    num_beside = 0
    for name, content in pages.beside:
        if folder is not None:
            folder.mkdir(exist_ok=True)
            replace_file(folder / name, content)
            num_beside += 1
    beside = f", {num_beside:,} in {printable(str(folder))}" if num_beside else ""
    stdout.write(
        f"{printable(str(args.output))}: {len(pages.report):,} bytes; {counted(len(report.groups), 'group')}, "
        f"{pages.num_played:,} to play in it{beside}\n"
        f"Verdict: {headline(report.validation)}\n"
    )
    return 0


def _text(report: DatasetReport, form: str, stdout: TextIO, *, is_file: bool) -> str:
    from branchdrive_reference.report.text import render_json, render_markdown, render_text

    if form == "text":
        return render_text(report, stdout, is_file=is_file)
    return render_json(report) if form == "json" else render_markdown(report)
