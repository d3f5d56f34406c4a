"""The paper's battery: classifiers of the action, fitted on `train`, stopped by `val`, scored once on `test`.

Each runs on all actions, over groups with an independent nominal replay, and on the interventions alone, over
all groups. A feature is seen as its distance from the median of its group, in robust standard deviations of
the training groups, clipped to 6; what is unavailable sits at the median. So the drive that all replays
of a group share tells nothing and hides nothing.

Three controls tell whether the battery works on these very data, with the regression on discrepancies: the label
as a feature, labels drawn at random, and, on discrepancy ``f = 1 .. 12`` of action ``a = 0 .. K - 1``, the offset
``offset_sd (cos u + sin u)`` with ``u = 2 pi a f / K``, which sets all actions about equally far apart.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import cos_sin
from branchdrive.leakage.classifier import SequenceClassifier, SequenceTask, Unavailable, fit_logistic, log_probability
from branchdrive.leakage.draw import Draw, drawn_here
from branchdrive.leakage.inputs import ReplayInputs, pooled_controls
from branchdrive.leakage.protocol import CLIP_SD, CONTROLS, SEQUENCE_TESTS, TESTS, BatteryProtocol
from branchdrive.leakage.score import held_out_score
from branchdrive.leakage.table import median_of_available, robust_sd
from branchdrive.statistics.random_words import group_orders, words

__all__ = ["PARTITIONS", "Part", "Way", "ways"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PARTITIONS = ("train", "val", "test")
"""Partitions that the battery uses."""

_RANDOM_LABELS = "leakage/random-labels"
_TRAINING = "leakage/training"


class Part(NamedTuple):
    """One classifier to run.

    Attributes:
        name: Of `TESTS` or `CONTROLS`.
        compute: Gives its score and training as JSON; None where it cannot run.
        reason: Why it cannot run; empty where it can.
    """

    name: str
    compute: Callable[[], dict[str, Any]] | None
    reason: str


class Way(NamedTuple):
    """A set of actions to tell apart.

    Attributes:
        inputs: What is seen.
        actions: Places of the actions.
        groups: Groups that enter ``[groups]``.
    """

    inputs: ReplayInputs
    actions: tuple[int, ...]
    groups: Mask

    @property
    def name(self) -> str:
        """Its name, after the number of actions."""
        return f"{len(self.actions)}-way"

    @property
    def num_groups(self) -> dict[str, int]:
        """Groups by partition."""
        return {name: int((self.inputs.in_partition(name) & self.groups).sum()) for name in PARTITIONS}

    def parts(
        self,
        *,
        seed: int,
        protocol: BatteryProtocol,
        classifier: SequenceClassifier | Unavailable,
        draw: Draw = drawn_here,
    ) -> tuple[Part, ...]:
        """Controls and then tests, each to be computed by itself, permutations of labels by `draw`."""
        found = []
        for name in (*CONTROLS, *TESTS):
            needed = PARTITIONS if name in SEQUENCE_TESTS else ("train", "test")
            empty = [partition for partition in needed if not self.num_groups[partition]]
            reason = f"no group of `{empty[0]}`" if empty else ""
            if reason and self.groups.sum() < self.inputs.num_groups:
                reason += " with an independent nominal replay"
            if not reason and name in SEQUENCE_TESTS and isinstance(classifier, Unavailable):
                reason = classifier.reason
            compute = None if reason else _Run(self, name, seed, protocol, classifier, draw)
            found.append(Part(name, compute, reason))
        return tuple(found)

    def members(self, partition: str) -> Mask:
        """Which of the groups that enter are of the partition."""
        return np.asarray(self.inputs.in_partition(partition)[self.groups])

    def rows(self, values: Array) -> Array:
        """Values of the groups and actions that enter, each row flattened: ``[groups, actions, features]``."""
        taken = values[self.groups][:, list(self.actions)]
        return taken.reshape(*taken.shape[:2], int(np.prod(taken.shape[2:])))


def ways(inputs: ReplayInputs) -> tuple[Way, Way]:
    """All actions, and the interventions alone."""
    every = np.ones(inputs.num_groups, np.bool_)
    return (
        Way(inputs, tuple(range(len(inputs.action_keys))), inputs.has_nominal_replay),
        Way(inputs, inputs.interventions, every),
    )


@dataclass(frozen=True)
class _Run:
    way: Way
    name: str
    seed: int
    protocol: BatteryProtocol
    classifier: SequenceClassifier | Unavailable
    draw: Draw

    def __call__(self) -> dict[str, Any]:
        if self.name in SEQUENCE_TESTS:
            return self._sequence()
        return self._regression(self._seen())

    def _seen(self) -> Array:
        """Standardised features of a regression ``[groups, actions, features]``."""
        way = self.way
        train = way.members("train")
        raw = way.rows(way.inputs.availability if self.name == "availability" else way.inputs.discrepancy)
        num_groups, num_actions, num_features = raw.shape
        if self.name == "explicit_label":
            label = np.broadcast_to(np.eye(num_actions), (num_groups, num_actions, num_actions))
            return np.concatenate([_standardised(raw, train)[0], label], axis=2)
        if self.name == "synthetic_offset":
            sd = _standardised(raw, train)[1]
            turn = 2 * np.pi * np.outer(np.arange(num_actions), np.arange(1, num_features + 1)) / num_actions
            cos, sin = cos_sin(turn)
            with np.errstate(over="ignore", invalid="ignore"):
                raw = raw + self.protocol.offset_sd * sd * (cos + sin)
        if self.name == "random_label":
            order = group_orders(self.seed, _RANDOM_LABELS, 1, num_groups, num_actions)[0]
            raw = np.take_along_axis(raw, order[:, :, None], axis=1)
        return _standardised(raw, train)[0]

    def _regression(self, seen: Array) -> dict[str, Any]:
        num_actions = seen.shape[1]
        train = seen[self.way.members("train")]
        classes = np.tile(np.arange(num_actions), len(train))
        rows = train.reshape(len(classes), seen.shape[2])
        weights = fit_logistic(rows, classes, num_actions, penalty=self.protocol.penalty)
        return self._scored(log_probability(seen[self.way.members("test")], weights), None)

    def _sequence(self) -> dict[str, Any]:
        way = self.way
        if isinstance(self.classifier, Unavailable):
            raise ValueError(self.classifier.reason)
        histories = {"ego": way.inputs.ego, "controls": pooled_controls(way.inputs)}
        wanted = ("ego", "controls") if self.name == "ego_controls" else (self.name,)
        seen = np.concatenate(
            [_sequences(way.rows(histories[name]), way.members("train"), histories[name].shape[2:]) for name in wanted],
            axis=3,
        )
        training_seed = int(words(self.seed, f"{_TRAINING}/{way.name}/{self.name}", 1, 1)[0, 0] >> 32)
        task = SequenceTask(*(seen[way.members(partition)] for partition in PARTITIONS))
        scores = self.classifier(task, seed=training_seed)
        training = {"num_epochs": int(scores.num_epochs), "best_epoch": int(scores.best_epoch)}
        return self._scored(scores.log_probability, training)

    def _scored(self, scores: Array, training: dict[str, int] | None) -> dict[str, Any]:
        p = self.protocol
        score = held_out_score(
            scores,
            seed=self.seed,
            num_permutations=p.num_permutations,
            num_resamples=p.num_resamples,
            atol=p.score_atol,
            draw=self.draw,
        )
        return {"score": {**score._asdict(), "accuracy_interval": list(score.accuracy_interval)}, "training": training}


def _sequences(rows: Array, train: Mask, shape: tuple[int, ...]) -> Array:
    return _standardised(rows, train)[0].reshape(*rows.shape[:2], *shape)


def _standardised(rows: Array, train: Mask) -> tuple[Array, Array]:
    """Rows ``[groups, actions, features]`` as the battery sees them, and the standard deviations ``[features]``."""
    unavailable = np.isnan(rows)
    median = median_of_available(rows, ~unavailable)
    filled = np.where(unavailable, median, rows)
    with np.errstate(over="ignore", invalid="ignore"):
        signed = np.where(filled == median, 0.0, filled - median)
        sd = robust_sd(np.abs(signed)[train], unavailable[train])
        sd = np.where(sd > 0, sd, 1.0)
        return np.clip(signed / sd, -CLIP_SD, CLIP_SD), sd
