"""Near duplicates: groups of different partitions whose standardised histories are all but the same.

With ``h_g`` the standardised state and control history of group ``g`` as one vector::

    threshold = 1 % quantile (linear) over training groups of the distance to the nearest other training group,
                0 for fewer than 10 of them
    g is a near duplicate  iff  the nearest h of another partition is closer than the threshold, or equal

Distances are Euclidean. A matrix product finds who may be nearest, and exact differences decide, so equal
histories are at distance 0. Of points that are equal, the first two of different labels stand for all.

Source: paper, "Evaluation Population" (partitions share no context); the measure is this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.comparison import TOLERANCE
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import history_of
from branchdrive.model.arrays import pack_history
from branchdrive.model.normalisation import Training, fit_controls, fit_state, training
from branchdrive.statistics.split import TRAINING
from branchdrive.tables.frame import Frame, distinct

__all__ = [
    "MIN_TRAINING", "QUANTILE", "DuplicateFlags", "Histories", "NearDuplicates", "Nearest", "duplicates_among",
    "history_vectors", "judged_distances", "judged_flags", "near_duplicates", "nearest_in_training", "nearest_other",
    "standardised", "valid_groups",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]

QUANTILE = 0.01
"""Quantile of the training distances below which a neighbour is too close."""

MIN_TRAINING = 10
"""Training groups from which there is a threshold: of ``n`` the quantile is all but the least of ``n`` distances, and
unrelated groups come closer than that in one of ``n + 1`` cases."""

_MAX_CELLS = 1 << 21
"""Pairs of points that are held at once: 16 MiB per intermediate array."""


_MAX_COORDINATE = 1e100
"""Largest coordinate, far from where a square overflows."""


class Nearest(NamedTuple):
    """Nearest point of another label: `distance` ``[points]``, ``inf`` where none, and its `row`, then -1."""

    distance: Array
    row: Index


class NearDuplicates(NamedTuple):
    """Near duplicates across partitions.

    Attributes:
        threshold: Distance below which a neighbour is too close.
        nearest: For every group, its nearest group of another partition.
        flagged: ``[groups]``, who has a neighbour that is too close.
    """

    threshold: float
    nearest: Nearest
    flagged: NDArray[np.bool_]

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """``[groups]``, who has a nearest neighbour so close to the threshold that last bits decide."""
        distance = self.nearest.distance
        return np.asarray((distance > 0) & (np.abs(distance - self.threshold) <= TOLERANCE * (1 + self.threshold)))

    @property
    def num_examined(self) -> int:
        """Groups that have a group of another partition to be compared with; 0 is no pass."""
        return int((self.nearest.row >= 0).sum())


def history_vectors(state: ArrayLike, controls: ArrayLike) -> Array:
    """Standardised state ``[groups, 16, features]`` and controls ``[groups, 80, 3]`` as ``[groups, dimensions]``.

    Raises:
        ValueError: They differ in groups.
    """
    parts = [np.asarray(part, np.float64) for part in (state, controls)]
    if parts[0].ndim != 3 or parts[1].ndim != 3 or len(parts[0]) != len(parts[1]):
        raise ValueError(f"histories of shapes {[list(part.shape) for part in parts]}: [groups, rows, features] each")
    return np.concatenate([part.reshape(len(part), part.shape[1] * part.shape[2]) for part in parts], axis=1)


def near_duplicates(vectors: ArrayLike, partition_of: Sequence[str]) -> NearDuplicates:
    """Near duplicates across partitions.

    Args:
        vectors: Standardised histories ``[groups, dimensions]``, all finite.
        partition_of: Partition of each group ``[groups]``; ``train`` sets the threshold, if it has 10 groups.

    Raises:
        ValueError: Shapes do not match, a value is not finite, or fewer than two groups are in training.
    """
    home = np.asarray(partition_of, np.str_)
    points = np.asarray(vectors, np.float64)
    in_training = home == TRAINING
    if home.shape != points.shape[:1] or in_training.sum() < 2:
        raise ValueError(
            f"vectors of shape {list(points.shape)} and {len(home)} partitions, {in_training.sum()} groups in "
            "training; expected [groups, dimensions], [groups] and at least two"
        )
    own = nearest_in_training(points, in_training) if in_training.sum() >= MIN_TRAINING else None
    return judged_distances(own, nearest_other(points, np.unique(home, return_inverse=True)[1]))


def nearest_in_training(points: Array, in_training: NDArray[np.bool_], rows: slice = slice(None)) -> Array:
    """Distance of groups in training to the nearest other one.

    Args:
        points: Standardised histories ``[groups, dimensions]``.
        in_training: Whether a group is in training ``[groups]``.
        rows: Which of the groups in training to look at.
    """
    among = points[in_training]
    return nearest_other(among, np.arange(len(among)), rows).distance


def judged_distances(in_training: Array | None, nearest: Nearest) -> NearDuplicates:
    """Near duplicates, by distances of groups in training, ``None`` for too few of them, and of all groups."""
    threshold = 0.0 if in_training is None else float(np.quantile(in_training, QUANTILE))
    return NearDuplicates(threshold, nearest, (nearest.distance < threshold) | (nearest.distance == 0))


def nearest_other(points: ArrayLike, labels: ArrayLike, wanted: slice = slice(None)) -> Nearest:
    """For every point the nearest point of another label; among equally near ones the first.

    Args:
        points: ``[points, dimensions]``, all finite.
        labels: ``[points]``, integers.
        wanted: Points to look at, consecutive ones; all by default.

    Raises:
        ValueError: Shapes do not match, or a coordinate is not a number or beyond 1e100.
    """
    at, label = np.asarray(points, np.float64), np.asarray(labels)
    if at.ndim != 2 or label.shape != at.shape[:1]:
        raise ValueError(f"points of shape {list(at.shape)} and labels of shape {list(label.shape)} do not match")
    if not (np.abs(at) <= _MAX_COORDINATE).all():
        raise ValueError(f"a coordinate of a point is not a number or beyond {_MAX_COORDINATE:g}")
    begin, end, _ = wanted.indices(len(at))
    distance, row = np.full(end - begin, np.inf), np.full(end - begin, -1)
    kept = _representatives(at, label)
    block = max(1, _MAX_CELLS // max(1, len(kept)))
    square = np.square(at).sum(axis=1)
    # A dot product of n terms is off by less than n eps |a| |b|; twice over and generously rounded up.
    slack = 8 * (at.shape[1] + 8) * np.finfo(np.float64).eps
    for start in range(begin, end, block):
        rows = np.arange(start, min(start + block, end))
        size = square[rows, None] + square[kept]
        other = label[rows, None] != label[kept]
        rough = size - 2 * (at[rows] @ at[kept].T)
        at_most = np.where(other, rough + slack * size, np.inf).min(axis=1, keepdims=True, initial=np.inf)
        here, near = np.nonzero(other & (rough - slack * size <= at_most))
        there = kept[near]
        exact = _distance(at, rows[here], there)
        order = np.lexsort((there, exact, here))
        first = order[np.flatnonzero(np.diff(here[order], prepend=-1))]
        found = rows[here[first]] - begin
        distance[found], row[found] = exact[first], there[first]
    return Nearest(distance, row)


def _representatives(points: Array, label: NDArray[np.generic]) -> Index:
    """Rows that can be the first nearest one of another label: of equal points the first, and the first of a second."""
    seen: dict[bytes, set[object]] = {}
    kept = []
    for row, (point, own) in enumerate(zip(points + 0.0, label.tolist(), strict=True)):  # -0.0 becomes 0.0
        labels = seen.setdefault(point.tobytes(), set())
        if len(labels) < 2 and own not in labels:
            labels.add(own)
            kept.append(row)
    return np.array(kept, np.int64)


def _distance(points: Array, a: Index, b: Index) -> Array:
    """Distances of paired points, a part at a time."""
    at_once = max(1, _MAX_CELLS // max(1, points.shape[1]))
    parts = [
        np.sqrt(np.square(points[a[start : start + at_once]] - points[b[start : start + at_once]]).sum(axis=1))
        for start in range(0, len(a), at_once)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


class Histories(NamedTuple):
    """Histories of groups: their ids, state ``[groups, 16, features]`` and controls ``[groups, 80, 3]``."""

    groups: list[str]
    state: Array
    controls: Array

    @classmethod
    def of(cls, state: Frame, past_controls: Frame, groups: Sequence[str]) -> Histories:
        """Histories of groups, of rows of the tables `state` and `past_controls` of these groups and no others.

        Raises:
            DatasetError: A group lacks a row.
        """
        packed = pack_history([state], "state", groups), pack_history([past_controls], "past_controls", groups)
        return cls([*groups], *packed)

    @classmethod
    def joined(cls, parts: Sequence[Histories]) -> Histories:
        """Histories of the groups of all parts, in sorted order.

        Raises:
            ValueError: Two parts have the same group.
        """
        groups = distinct([part.groups for part in parts])
        order = np.argsort(np.array(groups, object), kind="stable")
        state, controls = (np.concatenate([part[place] for part in parts])[order] for place in (1, 2))
        return cls([groups[place] for place in order.tolist()], state, controls)


def duplicates_among(histories: Histories, assignment: Mapping[str, str]) -> NearDuplicates:
    """Near duplicates among groups, by histories that are scaled on those of them that are in training.

    Args:
        histories: Of groups in sorted order.
        assignment: Partition by group id.

    Raises:
        ValueError: Fewer than two groups are in training.
    """
    points = standardised(histories.state, histories.controls, training(histories.groups, assignment))
    return near_duplicates(points, [assignment[group] for group in histories.groups])


def standardised(state: Array, controls: Array, fitted_on: Training) -> Array:
    """Histories ``[groups, dimensions]`` that are scaled on those in training, without what is not recorded.

    Args:
        state: ``[groups, 16, features]``.
        controls: ``[groups, 80, 3]``.
        fitted_on: Which groups are in training.

    Raises:
        ValueError: None is.
    """
    scaled = []
    for values, fit in zip((state, controls), (fit_state, fit_controls), strict=True):
        scaled.append(fit(history_of(values), SENSOR_PROFILE, fitted_on).apply(values))
    return history_vectors(*(part[..., np.isfinite(part).any(axis=(0, 1))] for part in scaled))


class DuplicateFlags(NamedTuple):
    """Groups outside of training that are near duplicates, and those of which last bits decide, ``[groups]`` each."""

    flagged: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]


def valid_groups(groups: Frame, assignment: Mapping[str, str]) -> list[str]:
    """Core-valid groups, sorted, which are compared; none where fewer than two of them are in training.

    Args:
        groups: Rows of `group_quality` with `core_valid`.
        assignment: Partition by group id.
    """
    valid = sorted(groups["group_id"][np.asarray(groups["core_valid"], bool)].tolist())
    return valid if sum(assignment[group] == TRAINING for group in valid) >= 2 else []


def judged_flags(
    groups: Frame, valid: Sequence[str], found: NearDuplicates | None, assignment: Mapping[str, str]
) -> DuplicateFlags:
    """What near duplicates among the groups `valid` say of all groups.

    Args:
        groups: Rows of `group_quality`, of which `group_id` is read.
        valid: Groups that were compared, in order.
        found: What came of it; ``None`` where none were.
        assignment: Partition by group id.
    """
    if found is None:
        return DuplicateFlags(*np.zeros((2, len(groups["group_id"])), bool))
    judged = {group: row for row, group in enumerate(valid) if assignment[group] != TRAINING}
    rows = [judged.get(group, len(valid)) for group in groups["group_id"].tolist()]
    return DuplicateFlags(*(np.append(flags, False)[rows] for flags in (found.flagged, found.doubtful)))
