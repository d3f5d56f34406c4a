"""Arguments that name the place of a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path

from branchdrive.errors import UsageError

__all__ = ["folder", "local", "place"]


def place(text: str) -> Path | str:
    """A path, or the URL that it is, in which slashes count."""
    return text if "://" in text else Path(text)


def folder(text: str) -> Path:
    """A path, for what needs a folder of this machine; `argparse` shows the message of its error."""
    if "://" in text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is a URL, and this needs a folder of this machine; `branchdrive upload` puts what is finished "
            "into a bucket"
        )
    return Path(text)


def local(named: Path | str, what: str) -> Path:
    """The path that a place is.

    Args:
        named: The place.
        what: What needs a path.

    Raises:
        UsageError: It is a URL.
    """
    if isinstance(named, str):
        raise UsageError(f"{what} needs a folder of this machine, not a URL")
    return named
