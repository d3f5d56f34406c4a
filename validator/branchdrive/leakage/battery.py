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
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import cos_sin
from branchdrive.leakage.classifier import SequenceClassifier, SequenceTask, Unavailable, fit_logistic, log_probability
from branchdrive.leakage.draw import ONCE, Draw, Kept, KeptHere, drawn_here
from branchdrive.leakage.inputs import ReplayInputs, pooled_controls
from branchdrive.leakage.protocol import CLIP_SD, CONTROLS, SEQUENCE_TESTS, TESTS, BatteryProtocol
from branchdrive.leakage.score import held_out_score
from branchdrive.leakage.table import median_of_available, robust_sd
from branchdrive.statistics.random_words import group_orders, words

__all__ = ["PARTITIONS", "Part", "Way", "WayFacts", "way_facts", "ways"]

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
        inputs: What is seen, wherever it is kept.
        actions: Places of the actions.
        num_groups: Groups that enter, by partition.
        is_of_all: Whether all groups enter; else those with an independent nominal replay.
    """

    inputs: Kept[ReplayInputs]
    actions: tuple[int, ...]
    num_groups: dict[str, int]
    is_of_all: bool

    @property
    def name(self) -> str:
        """Its name, after the number of actions."""
        return f"{len(self.actions)}-way"

    def parts(
        self,
        *,
        seed: int,
        protocol: BatteryProtocol,
        classifier: SequenceClassifier | Unavailable,
        draw: Draw = drawn_here,
    ) -> tuple[Part, ...]:
        """Controls and then tests, each to be computed by itself; `draw` runs classifiers, and permutes labels."""
        found = []
        for name in (*CONTROLS, *TESTS):
            needed = PARTITIONS if name in SEQUENCE_TESTS else ("train", "test")
            empty = [partition for partition in needed if not self.num_groups[partition]]
            reason = f"no group of `{empty[0]}`" if empty else ""
            if reason and not self.is_of_all:
                reason += " with an independent nominal replay"
            if not reason and name in SEQUENCE_TESTS and isinstance(classifier, Unavailable):
                reason = classifier.reason
            run = _Run(self, name, seed, protocol, classifier)
            found.append(Part(name, None if reason else partial(_scored, run, draw), reason))
        return tuple(found)


class WayFacts(NamedTuple):
    """What is known of a way without its inputs; see `Way`."""

    actions: tuple[int, ...]
    num_groups: dict[str, int]
    is_of_all: bool


def way_facts(inputs: ReplayInputs) -> tuple[WayFacts, WayFacts]:
    """All actions, and the interventions alone."""

    def facts(actions: tuple[int, ...]) -> WayFacts:
        entering = _entering(inputs, actions)
        counts = {name: int((inputs.in_partition(name) & entering).sum()) for name in PARTITIONS}
        return WayFacts(actions, counts, bool(entering.all()))

    return facts(tuple(range(len(inputs.action_keys)))), facts(inputs.interventions)


def ways(inputs: ReplayInputs) -> tuple[Way, ...]:
    """All actions, and the interventions alone, of inputs in this process."""
    return tuple(Way(KeptHere(inputs), *facts) for facts in way_facts(inputs))


def _entering(inputs: ReplayInputs, actions: tuple[int, ...]) -> Mask:
    """Groups that enter ``[groups]``: those with a replay of each of the actions."""
    return inputs.has_nominal_replay if inputs.nominal_index in actions else np.ones(inputs.num_groups, np.bool_)


def _scored(run: _Run, draw: Draw) -> dict[str, Any]:
    """Score and training of a classifier, as JSON."""
    [(scores, training)] = draw(_classified, run, ONCE)
    p = run.protocol
    score = held_out_score(
        scores,
        seed=run.seed,
        num_permutations=p.num_permutations,
        num_resamples=p.num_resamples,
        atol=p.score_atol,
        draw=draw,
    )
    return {"score": {**score._asdict(), "accuracy_interval": list(score.accuracy_interval)}, "training": training}


def _classified(run: _Run, _: range) -> tuple[Array, dict[str, int] | None]:
    """Log-probabilities of the rows to test, and how long was trained where a network was."""
    return run(run.way.inputs.value)


@dataclass(frozen=True)
class _Run:
    way: Way
    name: str
    seed: int
    protocol: BatteryProtocol
    classifier: SequenceClassifier | Unavailable

    def __call__(self, inputs: ReplayInputs) -> tuple[Array, dict[str, int] | None]:
        return self._sequence(inputs) if self.name in SEQUENCE_TESTS else (self._regression(inputs), None)

    def _members(self, inputs: ReplayInputs, partition: str) -> Mask:
        """Which of the groups that enter are of the partition."""
        return np.asarray(inputs.in_partition(partition)[_entering(inputs, self.way.actions)])

    def _rows(self, inputs: ReplayInputs, values: Array) -> Array:
        """Values of the groups and actions that enter, each row flattened: ``[groups, actions, features]``."""
        taken = values[_entering(inputs, self.way.actions)][:, list(self.way.actions)]
        return taken.reshape(*taken.shape[:2], int(np.prod(taken.shape[2:])))

    def _seen(self, inputs: ReplayInputs) -> Array:
        """Standardised features of a regression ``[groups, actions, features]``."""
        train = self._members(inputs, "train")
        raw = self._rows(inputs, inputs.availability if self.name == "availability" else inputs.discrepancy)
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

    def _regression(self, inputs: ReplayInputs) -> Array:
        seen = self._seen(inputs)
        num_actions = seen.shape[1]
        train = seen[self._members(inputs, "train")]
        classes = np.tile(np.arange(num_actions), len(train))
        rows = train.reshape(len(classes), seen.shape[2])
        weights = fit_logistic(rows, classes, num_actions, penalty=self.protocol.penalty)
        return log_probability(seen[self._members(inputs, "test")], weights)

    def _sequence(self, inputs: ReplayInputs) -> tuple[Array, dict[str, int]]:
        if isinstance(self.classifier, Unavailable):
            raise ValueError(self.classifier.reason)
        histories = {"ego": inputs.ego, "controls": pooled_controls(inputs)}
        wanted = ("ego", "controls") if self.name == "ego_controls" else (self.name,)
        train = self._members(inputs, "train")
        seen = np.concatenate(
            [_sequences(self._rows(inputs, histories[name]), train, histories[name].shape[2:]) for name in wanted],
            axis=3,
        )
        training_seed = int(words(self.seed, f"{_TRAINING}/{self.way.name}/{self.name}", 1, 1)[0, 0] >> 32)
        task = SequenceTask(*(seen[self._members(inputs, partition)] for partition in PARTITIONS))
        scores = self.classifier(task, seed=training_seed)
        training = {"num_epochs": int(scores.num_epochs), "best_epoch": int(scores.best_epoch)}
        return scores.log_probability, training


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
