"""Drawing without remarks of the plotting library: what is wrong with a group is said once, as text."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

__all__ = ["quiet"]


@contextmanager
def quiet() -> Iterator[None]:
    """Let neither warnings nor log lines of numpy and matplotlib reach the terminal."""
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
