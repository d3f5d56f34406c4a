"""The one door to matplotlib, deaf to the current folder.

It reads a ``matplotlibrc`` of the current folder when it is loaded, and fails on one that is not text; what the file
says is set back before anything is drawn.
"""

from __future__ import annotations

from contextlib import chdir
from importlib import import_module
from pathlib import Path

__all__ = ["load_matplotlib"]


def load_matplotlib() -> None:
    """Load matplotlib from a folder without such a file; to be called where no other thread works yet."""
    with chdir(Path(__file__).parent):
        import_module("matplotlib")
