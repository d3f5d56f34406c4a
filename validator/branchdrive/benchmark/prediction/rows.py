"""Rows of the tables of predictions: of which model, seed and partition each is, and its place in the bank.

Source: spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.tables.frame import Frame, Values

__all__ = ["COLUMNS", "TABLES", "Owner", "PredictionRows", "prediction_frame"]

TABLES = ("predictions", "predicted_trajectories")
"""Tables that hold predictions."""

COLUMNS = {"predictions": tuple(target.name for target in TARGETS), "predicted_trajectories": TRAJECTORY}
"""Predicted values of a row, by table."""

Index = NDArray[np.int64]

Owner = tuple[str, int]
"""A model and a seed."""

_STEPS = {"predictions": 1, "predicted_trajectories": FUTURE_OBSERVATIONS}


class PredictionRows:
    """Rows of one table with the places of their groups and candidates.

    Attributes:
        name: The table.
        frame: Its columns, ``[rows]`` each.
        data: The model layer.
        num_steps: Rows of a candidate.
        part: Place of the partition of every row among those of the model layer, sorted; -1 for an unknown group.
        group: Place of its group in the partition; -1 for an unknown one.
        candidate: Place of its candidate in the bank; -1 for an unknown one.
        step: Its step from 0.
        is_known: Whether it is of a candidate and a step of the bank.
    """

    def __init__(self, frame: Frame, data: BenchmarkData) -> None:
        self.name = "predicted_trajectories" if "step" in frame else "predictions"
        self.frame, self.data, self.num_steps = frame, data, _STEPS[self.name]
        self._names = sorted(data.parts)
        parts = {group: i for i, name in enumerate(self._names) for group in data.parts[name].groups}
        places = {group: i for part in data.parts.values() for i, group in enumerate(part.groups)}
        groups = frame["group_id"].tolist()
        self.part, self.group = _places(groups, parts), _places(groups, places)
        self.candidate = _places(frame["action_key"].tolist(), {key: i for i, key in enumerate(data.candidates)})
        self.step = np.asarray(frame["step"], np.int64) - 1 if "step" in frame else np.zeros(len(groups), np.int64)
        self.is_known = (self.candidate >= 0) & (self.step >= 0) & (self.step < self.num_steps)
        self._rows = _by_owner(frame)

    @property
    def owners(self) -> tuple[Owner, ...]:
        """Models and seeds that have a row, sorted."""
        return tuple(self._rows)

    def of(self, owner: Owner, partition: str | None = None) -> Index:
        """Rows of a model and seed, of one partition or of all and of unknown groups."""
        rows = self._rows.get(owner, np.zeros(0, np.int64))
        return rows if partition is None else rows[self.part[rows] == self._names.index(partition)]

    def partitions(self, owner: Owner) -> tuple[str, ...]:
        """Partitions of which a model and seed has any row."""
        return tuple(self._names[i] for i in np.unique(self.part[self.of(owner)]) if i >= 0)

    def flat(self, owner: Owner, partition: str) -> tuple[Index, Index]:
        """Rows of a partition and their places in ``[N, A, steps]``; rows of no candidate or step are left out."""
        rows = self.of(owner, partition)
        rows = rows[self.is_known[rows]]
        size = len(self.data.candidates)
        return rows, (self.group[rows] * size + self.candidate[rows]) * self.num_steps + self.step[rows]

    def packed(self, owner: Owner, partition: str) -> NDArray[np.float64]:
        """Values ``[N, A, steps, columns]`` of a complete partition."""
        rows, flat = self.flat(owner, partition)
        values = np.stack([np.asarray(self.frame[name], np.float64)[rows] for name in COLUMNS[self.name]], axis=1)
        shape = (len(self.data.part(partition).groups), len(self.data.candidates), self.num_steps, values.shape[1])
        packed = np.empty_like(values)
        packed[flat] = values
        return packed.reshape(shape)


def _places(keys: Iterable[str], places: Mapping[str, int]) -> Index:
    """Place of every key, -1 for one that has none."""
    return np.fromiter(map(places.get, keys, repeat(-1)), np.int64)


def _by_owner(frame: Frame) -> dict[Owner, Index]:
    """Rows of every model and seed, ascending, in the order of models and seeds."""
    models = frame["model"].tolist()
    if not models:
        return {}
    names = sorted(set(models))
    seeds, seed_of = np.unique(np.asarray(frame["seed"], np.int64), return_inverse=True)
    owner = _places(models, {name: i for i, name in enumerate(names)}) * len(seeds) + seed_of
    order = np.argsort(owner, kind="stable")
    found, starts = np.unique(owner[order], return_index=True)
    parts = np.split(order, starts[1:])
    return {
        (names[code // len(seeds)], int(seeds[code % len(seeds)])): rows
        for code, rows in zip(found.tolist(), parts, strict=True)
    }


def prediction_frame(
    table: str,
    model: str,
    seed: int,
    groups: tuple[str, ...],
    candidates: tuple[str, ...],
    values: NDArray[np.float64],
) -> Frame:
    """Rows of one model, seed and partition, of values ``[N, A, steps, columns]``."""
    num_steps = values.shape[2]
    size = len(groups) * len(candidates) * num_steps
    frame: dict[str, Values] = {
        "model": np.full(size, model, object),
        "seed": np.full(size, seed, np.int64),
        "group_id": np.repeat(np.array(groups, object), len(candidates) * num_steps),
        "action_key": np.tile(np.repeat(np.array(candidates, object), num_steps), len(groups)),
    }
    if table == "predicted_trajectories":
        frame["step"] = np.tile(np.arange(1, num_steps + 1, dtype=np.int32), len(groups) * len(candidates))
    flat = values.reshape(size, -1)
    return frame | {name: flat[:, i].copy() for i, name in enumerate(COLUMNS[table])}
