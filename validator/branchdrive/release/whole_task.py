"""What a build computes of all groups at once: tasks that take one array of them, or some rows of it.

Arrays of all groups lie in files. A scaling is fitted on one array, of trajectories on that of one step, with groups
in sorted order, so that its sums have the same order whatever the parts are.

Source: spec/11-fidelity.md#split, spec/12-model.md#normalisation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.engine.spool import Spool
from branchdrive.model.near_duplicate import (
    MIN_TRAINING,
    NearDuplicates,
    Nearest,
    judged_distances,
    nearest_in_training,
    nearest_other,
    standardised,
)
from branchdrive.model.normalisation import Scaling, Training
from branchdrive.model.normalisation_document import Scalings, fit_table
from branchdrive.quality.filtering import mean_share
from branchdrive.quality.replay_frames import FRAMED
from branchdrive.release.part_task import HistoriesTask, histories_part
from branchdrive.release.scan import RawPart
from branchdrive.release.stage_work import StageWork
from branchdrive.runtime.executor import memory_limit
from branchdrive.statistics.split import TRAINING

__all__ = ["duplicates_of_all", "mean_shares_of_all", "scalings_of_all"]

Array = NDArray[np.float64]

_COMPARED_AT_ONCE = 4096
"""Groups whose nearest neighbours are one task."""

_POINTS = "points"


@dataclass(frozen=True)
class _Gathered:
    """Arrays of parts, and where their rows go.

    Attributes:
        parts: The parts that have any.
        places: Place among all groups of each row of each part.
        count: Number of all groups.
    """

    parts: tuple[RawPart, ...]
    places: tuple[NDArray[np.int64], ...]
    count: int

    @classmethod
    def of(cls, groups_of: Mapping[int, Sequence[str]], parts: Sequence[RawPart]) -> _Gathered:
        """Arrays of groups that parts hold, by their place among the parts, all of them in sorted order."""
        there = [place for place, groups in groups_of.items() if groups]
        every = sorted(group for groups in groups_of.values() for group in groups)
        place_of = {group: place for place, group in enumerate(every)}
        places = (np.array([place_of[group] for group in groups_of[place]], np.int64) for place in there)
        return cls(tuple(parts[place] for place in there), tuple(places), len(every))

    def read(self, name: str, chosen: tuple[slice | int, ...] = ()) -> Array:
        """Values of all groups, those of them that are chosen by an index."""
        found: Array | None = None
        for part, places in zip(self.parts, self.places, strict=True):
            values = part.array(name)[chosen]
            if found is None:
                found = np.empty((self.count, *values.shape[1:]))
            found[places] = values
        if found is None:
            raise ValueError("no group")
        return found


@dataclass(frozen=True)
class _PointsTask:
    gathered: _Gathered
    spool: Spool
    in_training: NDArray[np.bool_]


def _put_points(task: _PointsTask) -> None:
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        state, controls = (task.gathered.read(f"valid.{table}") for table in ("state", "past_controls"))
        task.spool.put_array(_POINTS, standardised(state, controls, Training(task.in_training, "")))


@dataclass(frozen=True)
class _NearestTask:
    spool: Spool
    labels: NDArray[np.int64]
    in_training: NDArray[np.bool_] | None
    rows: slice


def _nearest(task: _NearestTask) -> Nearest | Array:
    """Nearest neighbours of some rows; in training, where that is given, their distances alone."""
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        points = task.spool.array(_POINTS)
        if task.in_training is not None:
            return nearest_in_training(points, task.in_training, task.rows)
        return nearest_other(points, task.labels, task.rows)


def duplicates_of_all(
    work: StageWork, groups_of: Mapping[int, Sequence[str]], assignment: Mapping[str, str]
) -> NearDuplicates:
    """Near duplicates among groups of all parts, in sorted order; see `model.near_duplicate`.

    Args:
        work: The build.
        groups_of: Groups by the place of their part, sorted in each; two of them are in training.
        assignment: Partition by group id.
    """
    parts, spool = work.scan.parts, work.scan.spool
    work.run(histories_part, [HistoriesTask(parts[place], [*own]) for place, own in groups_of.items() if own])
    gathered = _Gathered.of(groups_of, parts)
    homes = np.array([assignment[group] for group in sorted(g for own in groups_of.values() for g in own)], np.str_)
    in_training = homes == TRAINING
    work.run(_put_points, [_PointsTask(gathered, spool, in_training)])
    labels = np.unique(homes, return_inverse=True)[1].astype(np.int64)
    of_all = [_NearestTask(spool, labels, None, rows) for rows in _ranges(len(homes))]
    among = int(in_training.sum())
    judged = _ranges(among) if among >= MIN_TRAINING else []
    of_training = [_NearestTask(spool, labels, in_training, rows) for rows in judged]
    found = work.run(_nearest, [*of_all, *of_training])
    nearest = Nearest(*(np.concatenate(columns) for columns in zip(*found[: len(of_all)], strict=True)))
    return judged_distances(np.concatenate(found[len(of_all) :]) if of_training else None, nearest)


def _ranges(count: int) -> list[slice]:
    return [slice(start, min(start + _COMPARED_AT_ONCE, count)) for start in range(0, count, _COMPARED_AT_ONCE)]


def mean_shares_of_all(work: StageWork, groups_of: Mapping[int, Sequence[str]]) -> list[float]:
    """Means of the shares of frames above the floor, by variable; see `quality.filtering`.

    Args:
        work: The build.
        groups_of: Eligible training groups by the place of their part, sorted in each; at least one.
    """
    gathered = _Gathered.of(groups_of, work.scan.parts)
    return [mean_share(gathered.read("training.above", (slice(None), i))) for i in range(len(FRAMED))]


@dataclass(frozen=True)
class _ScalingTask:
    gathered: _Gathered
    table: str
    chosen: tuple[slice, ...]
    split_digest: str


def _fit(task: _ScalingTask) -> Scaling:
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        values = task.gathered.read(f"training.{task.table}", task.chosen)
        return fit_table(task.table, values, Training(np.ones(len(values), np.bool_), task.split_digest))


def scalings_of_all(work: StageWork, groups_of: Mapping[int, Sequence[str]], split_digest: str) -> Scalings:
    """Scalings that are fitted on training groups of all parts.

    Args:
        work: The build.
        groups_of: Groups in training by the place of their part, sorted in each; at least one.
        split_digest: Digest of the split.
    """
    gathered = _Gathered.of(groups_of, work.scan.parts)
    tables = ("state", "past_controls", "expert", "scalars")
    steps = [(slice(None), slice(None), slice(step, step + 1)) for step in range(FUTURE_OBSERVATIONS)]
    tasks = [_ScalingTask(gathered, table, (), split_digest) for table in tables]
    tasks += [_ScalingTask(gathered, "trajectories", step, split_digest) for step in steps]
    fitted = work.run(_fit, tasks)
    paths = fitted[len(tables) :]
    offset, scale, limit = (np.concatenate([getattr(path, name) for path in paths]) for name in Scaling._fields[:3])
    state, controls, expert, scalars = fitted[: len(tables)]
    return Scalings(state, controls, expert, scalars, Scaling(offset, scale, limit, split_digest))
