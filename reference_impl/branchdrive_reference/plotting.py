"""The one door to matplotlib: independent of the current folder, and silent while it draws.

It reads a ``matplotlibrc`` of the current folder when it is loaded, and fails on one that is not text; what the file
says is set back before anything is drawn. What is wrong with a drawing is said once, as text, and not by the library.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from importlib import import_module
from pathlib import Path

__all__ = ["load_matplotlib", "quiet"]


def load_matplotlib() -> None:
    """Load matplotlib from a folder without such a file; to be called where no other thread works yet."""
    with chdir(Path(__file__).parent):
        import_module("matplotlib")


@contextmanager
def quiet() -> Iterator[None]:
    """Let neither warnings nor log lines of numpy and matplotlib reach the terminal."""
    import numpy as np

    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
