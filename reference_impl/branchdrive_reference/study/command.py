"""`branchdrive study`: print what a collected dataset contains."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TextIO

from branchdrive.cli.output import check_output
from branchdrive.cli.place import place
from branchdrive.cli.progress import progress_bar

__all__ = ["ORDER", "SUMMARY", "add_arguments", "run"]

SUMMARY = "show what a dataset contains: population, outcomes, replay fidelity"
ORDER = 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=place, help="a finished dataset: folder, URL or archive")
    parser.add_argument("--full", action="store_true", help="print every table: by scenario type, and every variable")
    parser.add_argument("--format", choices=("text", "json"), default="text", help="what to print (default: text)")
    parser.add_argument("--output", metavar="FILE", type=Path, help="write the study there instead of to the terminal")


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Study the dataset and print the result.

    Raises:
        UsageError: The folder holds no finished, readable dataset, or the output cannot be written.
    """
    import json

    from branchdrive.formats.durable import replace_file
    from branchdrive_reference.study.survey import study_dataset
    from branchdrive_reference.study.text import render_study

    check_output(args.output, outside=args.dataset)
    with progress_bar(stderr, "reading shards") as progress:
        study = study_dataset(args.dataset, progress)
    if args.format == "json":
        text = json.dumps(study.to_json(), indent=2, allow_nan=False) + "\n"
    else:
        text = render_study(study, stdout, is_file=args.output is not None, is_full=args.full)
    if args.output is not None:
        replace_file(args.output, text.encode())
    else:
        stdout.write(text)
    return 0
