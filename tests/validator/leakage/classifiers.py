"""Sequence classifiers without torch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from branchdrive.leakage.classifier import SequenceScores, SequenceTask, fit_logistic, log_probability


class Regression:
    """A regression on the flattened sequence."""

    settings: Mapping[str, int | float | str] = {"name": "regression", "penalty": 30.0}

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        train, test = (part.reshape(*part.shape[:2], -1) for part in (task.train, task.test))
        num_actions = train.shape[1]
        classes = np.tile(np.arange(num_actions), len(train))
        weights = fit_logistic(train.reshape(len(classes), -1), classes, num_actions, penalty=30.0)
        return SequenceScores(log_probability(test, weights), 1, 1)


class Undecided:
    """A classifier that makes nothing of what it sees."""

    settings: Mapping[str, int | float | str] = {"name": "undecided"}

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        num_groups, num_actions = task.test.shape[:2]
        return SequenceScores(np.full((num_groups, num_actions, num_actions), -np.log(num_actions)), 3, 1)
