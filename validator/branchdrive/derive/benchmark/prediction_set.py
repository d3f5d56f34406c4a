"""Predictions of a benchmark: by model, seed and partition, from and to the tables of the layer.

A model predicts the whole bank of every group of a partition, or says nothing about that partition. Values are
finite, in physical units. The digest covers the numbers, not the file that holds them::

    digest = SHA-256 over models, seeds and partitions in order of
             the line "model seed partition N A", group ids and action keys one a line, scalars and paths as float64 LE

Source: paper IV-C; spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.protocol import MAX_OWNERS, BenchmarkProtocol
from branchdrive.derive.layer.frame import Frame, Values, concat
from branchdrive.derive.metric.outcome import MAX_MAGNITUDE, Predictions
from branchdrive.derive.target import TARGETS, TRAJECTORY
from branchdrive.errors import DatasetError

__all__ = ["TABLES", "PredictionProblem", "PredictionSet", "prediction_problems"]

TABLES = ("predictions", "predicted_trajectories")
"""Tables that hold predictions."""

Index = NDArray[np.int64]

_SCALARS = tuple(target.name for target in TARGETS)
_COLUMNS = {"predictions": _SCALARS, "predicted_trajectories": TRAJECTORY}
_STEPS = {"predictions": 1, "predicted_trajectories": FUTURE_OBSERVATIONS}


class PredictionProblem(NamedTuple):
    """What is wrong with predictions.

    Attributes:
        kind: ``group``, ``candidate``, ``missing``, ``repeated``, ``number``, ``partition``, ``seed`` or ``owners``.
        table: Table that it is about.
        place: Values of the key columns that say where.
        expected: What belongs there.
        found: What is there.
    """

    kind: str
    table: str
    place: Mapping[str, str | int]
    expected: str
    found: str

    def __str__(self) -> str:
        where = ", ".join(f"{name} {value!r}" for name, value in self.place.items())
        return f"table `{self.table}`: {where}: expected {self.expected}, found {self.found}"


@dataclass(frozen=True, eq=False)
class PredictionSet:
    """Predictions by model, seed and partition; groups of a partition in the order of their ids.

    Attributes:
        by_model: `Predictions` ``[N, A, ..]`` by model, seed and partition.
    """

    by_model: Mapping[str, Mapping[int, Mapping[str, Predictions]]]

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the models, sorted."""
        return tuple(sorted(self.by_model))

    def seeds(self, model: str) -> tuple[int, ...]:
        """Seeds of a model, ascending."""
        return tuple(sorted(self.by_model.get(model, {})))

    def covers(self, model: str, partition: str) -> bool:
        """Whether every seed of a model, at least one, predicts a partition."""
        seeds = self.by_model.get(model, {})
        return bool(seeds) and all(partition in parts for parts in seeds.values())

    def of(self, partition: str) -> dict[str, dict[int, Predictions]]:
        """Predictions of one partition by model and seed, of the models that predict it."""
        return {
            model: {seed: self.by_model[model][seed][partition] for seed in self.seeds(model)}
            for model in self.models
            if self.covers(model, partition)
        }

    def scalars(self, model: str, partition: str) -> NDArray[np.float64]:
        """Predicted targets of a model ``[seeds, N, A, 6]``, seeds ascending."""
        return np.stack([self.by_model[model][seed][partition].scalars for seed in self.seeds(model)])

    def joined(self, other: PredictionSet) -> PredictionSet:
        """These predictions and those of further models.

        Raises:
            DatasetError: Both have a model of one name.
        """
        shared = sorted(set(self.by_model) & set(other.by_model))
        if shared:
            raise DatasetError(f"there are predictions of a model {shared[0]!r} already; choose another name")
        return PredictionSet({**self.by_model, **other.by_model})

    def digest(self, data: BenchmarkData) -> str:
        """SHA-256 of all predictions with the groups and candidates that they are of, hexadecimal."""
        found = hashlib.sha256()
        labels = "".join(f"{key}\n" for key in data.candidates)
        for model, seed, partition, predicted in self._all():
            groups = data.part(partition).groups
            lines = "".join(f"{group}\n" for group in groups)
            found.update(f"{model} {seed} {partition} {len(groups)} {len(data.candidates)}\n{lines}{labels}".encode())
            for values in (predicted.scalars, predicted.paths):
                found.update(np.ascontiguousarray(values, "<f8").tobytes())
        return found.hexdigest()

    @classmethod
    def from_frames(cls, frames: Mapping[str, Frame], data: BenchmarkData) -> PredictionSet:
        """Predictions of the tables `TABLES`.

        Raises:
            DatasetError: A bank is not complete, a row is of no group or candidate, or a value is no number.
        """
        for problem in prediction_problems(frames, data):
            raise DatasetError(str(problem))
        places = {name: _Rows(frames[name], data) for name in TABLES}
        by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
        for owner in places["predictions"].owners:
            for partition in places["predictions"].partitions(owner):
                packed = [places[name].packed(owner, partition) for name in TABLES]
                predicted = Predictions.of(packed[0][:, :, 0], packed[1])
                by_model.setdefault(owner[0], {}).setdefault(owner[1], {})[partition] = predicted
        return cls(by_model)

    def to_frames(self, data: BenchmarkData) -> dict[str, dict[str, Values]]:
        """The tables `TABLES`; writers sort their rows.

        Raises:
            ValueError: There are no predictions.
        """
        parts: dict[str, list[Frame]] = {name: [] for name in TABLES}
        for model, seed, partition, predicted in self._all():
            groups = data.part(partition).groups
            for name, values in zip(TABLES, (predicted.scalars[:, :, None], predicted.paths), strict=True):
                parts[name].append(_rows_of(name, model, seed, groups, data.candidates, values))
        return {name: concat(found) for name, found in parts.items()}

    def __repr__(self) -> str:
        return f"PredictionSet({', '.join(f'{model} {self.seeds(model)}' for model in self.models)})"

    def _all(self) -> Iterator[tuple[str, int, str, Predictions]]:
        for model in self.models:
            for seed in self.seeds(model):
                for partition in sorted(self.by_model[model][seed]):
                    yield model, seed, partition, self.by_model[model][seed][partition]


def prediction_problems(
    frames: Mapping[str, Frame], data: BenchmarkData, protocol: BenchmarkProtocol | None = None
) -> list[PredictionProblem]:
    """What is wrong with the tables `TABLES`; at most one problem of a kind for each model, seed and table.

    A partition is predicted where it has any row. With a protocol, its models have their seeds and predict every
    partition but the one they are fitted on, and any other model predicts the one that is reported.

    Args:
        frames: Rows of both tables, whose columns are those declared.
        data: The model layer.
        protocol: What the models are held to; only completeness by default.
    """
    found: list[PredictionProblem] = []
    places = {name: _Rows(frames[name], data) for name in TABLES}
    owners = {name: set(places[name].owners) for name in TABLES}
    for name in TABLES:
        if len(owners[name]) > MAX_OWNERS:
            expected = f"at most {MAX_OWNERS} pairs of a model and a seed"
            return [PredictionProblem("owners", name, {}, expected, f"{len(owners[name])} pairs")]
    for owner in sorted(owners["predictions"] | owners["predicted_trajectories"]):
        partitions = {part for name in TABLES for part in places[name].partitions(owner)}
        partitions |= _wanted(owner, data, protocol)
        for name in TABLES:
            found += places[name].problems(owner, sorted(partitions), protocol)
    if protocol is not None:
        found += _seed_problems(owners["predictions"], protocol)
    return found


def _wanted(owner: tuple[str, int], data: BenchmarkData, protocol: BenchmarkProtocol | None) -> set[str]:
    if protocol is None:
        return set()
    names = (protocol.partitions.report,) if protocol.model(owner[0]) is None else protocol.predicted
    return {name for name in names if name in data.parts}


def _seed_problems(owners: set[tuple[str, int]], protocol: BenchmarkProtocol) -> Iterator[PredictionProblem]:
    for model in protocol.models:
        seeds = {seed for name, seed in owners if name == model.id}
        if seeds != set(model.seeds):
            yield PredictionProblem(
                "seed", "predictions", {"model": model.id}, f"seeds {sorted(model.seeds)}", f"seeds {sorted(seeds)}"
            )


class _Rows:
    """Rows of one table with the places of their groups and candidates."""

    def __init__(self, frame: Frame, data: BenchmarkData) -> None:
        self.name = "predicted_trajectories" if "step" in frame else "predictions"
        self.frame, self.data = frame, data
        self.homes = data.partition_of
        seeds = frame["seed"].tolist()
        models = frame["model"].tolist()
        owners: dict[tuple[str, int], list[int]] = {}
        for row, owner in enumerate(zip(models, seeds, strict=True)):
            owners.setdefault(owner, []).append(row)
        self.rows = {owner: np.array(rows, np.int64) for owner, rows in sorted(owners.items())}
        places = {group: i for part in data.parts.values() for i, group in enumerate(part.groups)}
        names = sorted(data.parts)
        of = {name: i for i, name in enumerate(names)}
        keys = {key: i for i, key in enumerate(data.candidates)}
        groups = frame["group_id"].tolist()
        self.names = names
        self.group = np.array([places.get(group, -1) for group in groups], np.int64)
        self.part = np.array([of[self.homes[group]] if group in self.homes else -1 for group in groups], np.int64)
        self.candidate = np.array([keys.get(key, -1) for key in frame["action_key"].tolist()], np.int64)
        self.step = np.asarray(frame["step"], np.int64) - 1 if "step" in frame else np.zeros(len(groups), np.int64)
        self.num_steps = _STEPS[self.name]

    @property
    def owners(self) -> tuple[tuple[str, int], ...]:
        return tuple(self.rows)

    def partitions(self, owner: tuple[str, int]) -> tuple[str, ...]:
        """Partitions of which a model and seed has any row."""
        rows = self.rows.get(owner, np.zeros(0, np.int64))
        return tuple(self.names[i] for i in np.unique(self.part[rows]) if i >= 0)

    def flat(self, owner: tuple[str, int], partition: str) -> tuple[Index, Index]:
        """Rows of a partition and their places in ``[N, A, steps]``; rows of no candidate or step are left out."""
        rows = self.rows.get(owner, np.zeros(0, np.int64))
        rows = rows[self.part[rows] == self.names.index(partition)]
        known = (self.candidate[rows] >= 0) & (self.step[rows] >= 0) & (self.step[rows] < self.num_steps)
        rows = rows[known]
        size = len(self.data.candidates)
        return rows, (self.group[rows] * size + self.candidate[rows]) * self.num_steps + self.step[rows]

    def packed(self, owner: tuple[str, int], partition: str) -> NDArray[np.float64]:
        """Values ``[N, A, steps, columns]`` of a complete partition."""
        rows, flat = self.flat(owner, partition)
        values = np.stack([np.asarray(self.frame[name], np.float64)[rows] for name in _COLUMNS[self.name]], axis=1)
        shape = (len(self.data.part(partition).groups), len(self.data.candidates), self.num_steps, values.shape[1])
        packed = np.empty_like(values)
        packed[flat] = values
        return packed.reshape(shape)

    def problems(
        self, owner: tuple[str, int], partitions: list[str], protocol: BenchmarkProtocol | None
    ) -> Iterator[PredictionProblem]:
        rows = self.rows.get(owner, np.zeros(0, np.int64))
        about: dict[str, str | int] = {"model": owner[0], "seed": owner[1]}

        def at(row: int) -> dict[str, str | int]:
            place: dict[str, str | int] = {**about}
            place |= {name: str(self.frame[name][row]) for name in ("group_id", "action_key")}
            if "step" in self.frame:
                place["step"] = int(self.frame["step"][row])
            return place

        for row in rows[self.part[rows] < 0][:1].tolist():
            yield PredictionProblem("group", self.name, at(row), "a group of the model layer", "none of its groups")
        for row in rows[(self.candidate[rows] < 0) | (self.step[rows] < 0) | (self.step[rows] >= self.num_steps)][
            :1
        ].tolist():
            yield PredictionProblem("candidate", self.name, at(row), "a candidate and step of the bank", "neither")
        for column in _COLUMNS[self.name]:
            values = np.ma.filled(np.ma.asarray(self.frame[column], np.float64), np.nan)[rows]
            for row in rows[~(np.abs(values) <= MAX_MAGNITUDE)][:1].tolist():
                found = str(self.frame[column][row])
                yield PredictionProblem("number", self.name, at(row), f"a finite `{column}`", found)
        for partition in partitions:
            if protocol is not None and partition == protocol.partitions.fit:
                for row in rows[self.part[rows] == self.names.index(partition)][:1].tolist():
                    expected = f"a group outside of {partition!r}"
                    yield PredictionProblem("partition", self.name, at(row), expected, f"one of {partition!r}")
                continue
            yield from self._incomplete(owner, partition)

    def _incomplete(self, owner: tuple[str, int], partition: str) -> Iterator[PredictionProblem]:
        groups, keys = self.data.part(partition).groups, self.data.candidates
        counts = np.bincount(self.flat(owner, partition)[1], minlength=len(groups) * len(keys) * self.num_steps)
        for wrong, kind, words in (
            (counts == 0, "missing", "no row"),
            (counts > 1, "repeated", "several rows"),
        ):
            for place in np.flatnonzero(wrong)[:1].tolist():
                bank, step = divmod(place, self.num_steps)
                group, key = divmod(bank, len(keys))
                at: dict[str, str | int] = {"model": owner[0], "seed": owner[1], "group_id": groups[group]}
                at["action_key"] = keys[key]
                if self.num_steps > 1:
                    at["step"] = step + 1
                yield PredictionProblem(kind, self.name, at, "one row of this candidate", words)


def _rows_of(
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
    return frame | {name: flat[:, i].copy() for i, name in enumerate(_COLUMNS[table])}
