"""Classifiers and inputs of audits: of a module of their own, as the process of an audit imports what they are of."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from branchdrive.leakage.classifier import SequenceScores, SequenceTask
from branchdrive.leakage.inputs import ReplayInputs


@dataclass(frozen=True)
class Teller:
    """A classifier that tells by its number of epochs how many threads it may have."""

    settings: Mapping[str, int | float | str] = field(default_factory=lambda: {"name": "teller"})

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        threads = int(os.environ["OPENBLAS_NUM_THREADS"])
        num_actions = task.test.shape[1]
        scores = np.full((len(task.test), num_actions, num_actions), -np.log(num_actions))
        return SequenceScores(scores, num_epochs=threads, best_epoch=int(os.environ["OMP_NUM_THREADS"]))


@dataclass(frozen=True)
class Killer:
    """A classifier that ends its process."""

    settings: Mapping[str, int | float | str] = field(default_factory=lambda: {"name": "killer"})

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


@dataclass(frozen=True)
class Failing:
    """A classifier with scores of no shape."""

    settings: Mapping[str, int | float | str] = field(default_factory=lambda: {"name": "failing"})

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        return SequenceScores(np.zeros(3), 1, 1)


@dataclass(frozen=True)
class Known:
    """Inputs that wait nowhere."""

    inputs: ReplayInputs

    def __call__(self) -> ReplayInputs:
        return self.inputs
