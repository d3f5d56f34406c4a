"""Sequence classifiers of the paper's battery, which come from outside of the core.

The core asks whoever registered in the entry-point group `branchdrive.leakage`; the extra `models` does.

Source: paper VI-A (three recurrent classifiers).
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["ENTRY_POINTS", "SequenceClassifier", "SequenceScores", "SequenceTask", "Unavailable", "sequence_classifier"]

Array = NDArray[np.float64]

ENTRY_POINTS = "branchdrive.leakage"
"""Entry-point group that names a sequence classifier."""


class SequenceTask(NamedTuple):
    """Standardised sequences ``[groups, actions, steps, variables]``; the place among the actions is the class.

    Attributes:
        train: To fit on.
        val: To stop by.
        test: To score.
    """

    train: Array
    val: Array
    test: Array


class SequenceScores(NamedTuple):
    """Scores of the rows to test.

    Attributes:
        log_probability: ``[groups, actions, classes]``, natural logarithm; the classes of a row sum to 1.
        num_epochs: Epochs trained.
        best_epoch: Epoch whose weights scored, counted from 1.
    """

    log_probability: Array
    num_epochs: int
    best_epoch: int


class SequenceClassifier(Protocol):
    """A classifier of sequences whose scores are a function of the task and the seed."""

    @property
    def settings(self) -> Mapping[str, int | float | str]:
        """What it fixes before it sees data, for the report; its `name` is among it."""

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        """Fit on `train`, stop by `val`, and score `test`."""


class Unavailable(NamedTuple):
    """Why there is no sequence classifier: one sentence with what to do."""

    reason: str


def sequence_classifier() -> SequenceClassifier | Unavailable:
    """The installed sequence classifier; none is chosen where there are several."""
    found = sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)
    if not found:
        return Unavailable("no sequence classifier is installed: pip install 'branchdrive[models]'")
    if len(found) > 1:
        names = ", ".join(f"`{point.name}`" for point in found)
        return Unavailable(f"several sequence classifiers are installed: {names}; uninstall all but one")
    try:
        classifier: SequenceClassifier = found[0].load()
    except ImportError as missing:
        return Unavailable(f"needs the package `{missing.name or found[0].module}`: pip install 'branchdrive[models]'")
    return classifier
