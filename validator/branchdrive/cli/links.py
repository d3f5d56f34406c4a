"""Arguments of commands that may follow links."""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["add_link_arguments"]


def add_link_arguments(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Declare `--follow-links` and `--allow`."""
    parser.add_argument(
        "--follow-links", action="store_true", help="follow links inside a dataset, and into allowed folders"
    )
    parser.add_argument(
        "--allow", metavar="FOLDER", type=Path, action="append", default=[],
        help="a folder that links may lead into, such as the blobs of a download cache (repeatable)",
    )  # fmt: skip
