"""Rows of the tables of predictions: of which model, seed and partition each is, and its place in the bank.

Source: spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import MAX_MAGNITUDE
from branchdrive.benchmark.protocol.protocol import MAX_OWNERS
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.tables.frame import Frame, Values, num_rows, take

__all__ = ["COLUMNS", "STEPS", "TABLES", "Owner", "PredictionRows", "prediction_frame"]

TABLES = ("predictions", "predicted_trajectories")
"""Tables that hold predictions."""

COLUMNS = {"predictions": tuple(target.name for target in TARGETS), "predicted_trajectories": TRAJECTORY}
"""Predicted values of a row, by table."""

Index = NDArray[np.int64]

Owner = tuple[str, int]
"""A model and a seed."""

STEPS = {"predictions": 1, "predicted_trajectories": FUTURE_OBSERVATIONS}
"""Rows of a candidate, by table."""

_PIECE_ROWS = 2**16


class PredictionRows:
    """Rows of both tables by model, seed and partition, with their places in the bank.

    Tables are taken file by file, and of a row its place and its numbers are kept: 48 bytes of a step.

    Attributes:
        data: The model layer.
        owners: Models and seeds that have a row, by table.
        wrong: First row of each kind that belongs nowhere or holds no number, by table, model and seed.
        first: First row of each table, model, seed and partition.
    """

    def __init__(self, frames: Mapping[str, Iterable[Frame]], data: BenchmarkData) -> None:
        """Take all rows of the tables `TABLES`; none more where one has too many models and seeds."""
        self.data = data
        self.owners: dict[str, set[Owner]] = {name: set() for name in TABLES}
        self.wrong: dict[str, dict[Owner, dict[str, Mismatch]]] = {name: {} for name in TABLES}
        self.first: dict[str, dict[Owner, dict[str, Location]]] = {name: {} for name in TABLES}
        self._rows: dict[tuple[str, Owner, str], list[tuple[Index, NDArray[np.float64]]]] = {}
        self._names = sorted(data.parts)
        self._places = {
            group: (i, place)
            for i, name in enumerate(self._names)
            for place, group in enumerate(data.parts[name].groups)
        }
        for table in TABLES:
            for frame in chain.from_iterable(map(_pieces, frames[table])):
                rows = _by_owner(frame)
                self.owners[table] |= set(rows)
                if len(self.owners[table]) <= MAX_OWNERS:
                    self._take(table, frame, rows)

    def partitions(self, owner: Owner) -> set[str]:
        """Partitions of which a model and seed has any row in any table."""
        return {partition for table in TABLES for partition in self.first[table].get(owner, ())}

    def counts(self, table: str, owner: Owner, partition: str) -> Index:
        """Rows of every place of a partition ``[N * A * steps]``."""
        size = self._num_groups(partition) * len(self.data.candidates) * STEPS[table]
        found = [np.zeros(0, np.int64), *(flat for flat, _ in self._rows.get((table, owner, partition), ()))]
        return np.bincount(np.concatenate(found), minlength=size)

    def take(self, table: str, owner: Owner, partition: str) -> NDArray[np.float64]:
        """Values ``[N, A, steps, columns]`` of a complete partition, which are forgotten here."""
        shape = (self._num_groups(partition), len(self.data.candidates), STEPS[table], len(COLUMNS[table]))
        values = np.empty(shape)
        for flat, found in self._rows.pop((table, owner, partition)):
            values.reshape(-1, shape[-1])[flat] = found
        return values

    def _num_groups(self, partition: str) -> int:
        return len(self.data.part(partition).groups)

    def _take(self, table: str, frame: Frame, by_owner: Mapping[Owner, Index]) -> None:
        nowhere, num_steps = (-1, -1), STEPS[table]
        homes = [self._places.get(group, nowhere) for group in frame["group_id"].tolist()]
        part, group = np.array(homes, np.int64).reshape(-1, 2).T
        keys = {key: i for i, key in enumerate(self.data.candidates)}
        candidate = np.fromiter((keys.get(key, -1) for key in frame["action_key"].tolist()), np.int64)
        step = np.asarray(frame["step"], np.int64) - 1 if "step" in frame else np.zeros(len(part), np.int64)
        is_known = (candidate >= 0) & (step >= 0) & (step < num_steps)
        flat = (group * len(self.data.candidates) + candidate) * num_steps + step
        values = np.stack([np.ma.filled(np.ma.asarray(frame[n], np.float64), np.nan) for n in COLUMNS[table]], axis=-1)
        for owner, rows in by_owner.items():
            place = partial(_place, table, frame, owner)
            wrong = self.wrong[table].setdefault(owner, {})
            for row in rows[part[rows] < 0][:1].tolist():
                wrong.setdefault("group", Mismatch(place(row), "a group of the model layer", "none of its groups"))
            for row in rows[~is_known[rows]][:1].tolist():
                wrong.setdefault("place", Mismatch(place(row), "a candidate and step of the bank", "neither"))
            for i, column in enumerate(COLUMNS[table]):
                for row in rows[~(np.abs(values[rows, i]) <= MAX_MAGNITUDE)][:1].tolist():
                    at, found = place(row), str(frame[column][row])
                    wrong.setdefault(column, Mismatch({**at, "column": column}, f"a finite `{column}`", found))
            for i in np.unique(part[rows][part[rows] >= 0]).tolist():
                own = rows[part[rows] == i]
                self.first[table].setdefault(owner, {}).setdefault(self._names[i], place(int(own[0])))
                own = own[is_known[own]]
                self._rows.setdefault((table, owner, self._names[i]), []).append((flat[own], values[own]))


def _pieces(frame: Frame) -> Iterator[Frame]:
    """Rows of a file, some at a time: what is computed of them takes more memory than they do."""
    for start in range(0, num_rows(frame), _PIECE_ROWS):
        yield take(frame, slice(start, start + _PIECE_ROWS))


def _place(table: str, frame: Frame, owner: Owner, row: int) -> Location:
    """Table and key of a row."""
    place: Location = {"table": table, "model": owner[0], "seed": owner[1]}
    place |= {name: str(frame[name][row]) for name in ("group_id", "action_key")}
    if "step" in frame:
        place["step"] = int(frame["step"][row])
    return place


def _by_owner(frame: Frame) -> dict[Owner, Index]:
    """Rows of every model and seed, ascending, in the order of models and seeds."""
    models = frame["model"].tolist()
    if not models:
        return {}
    names = sorted(set(models))
    places = {name: i for i, name in enumerate(names)}
    seeds, seed_of = np.unique(np.asarray(frame["seed"], np.int64), return_inverse=True)
    owner = np.fromiter(map(places.__getitem__, models), np.int64) * len(seeds) + seed_of
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
