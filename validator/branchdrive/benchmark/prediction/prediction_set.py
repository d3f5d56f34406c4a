"""Predictions of a benchmark: by model, seed and partition, from and to the tables of the layer.

A model predicts the whole bank of every group of a partition, or says nothing about that partition. Values are
finite, in physical units. The digest covers the numbers, not the file that holds them::

    digest = SHA-256 over models, seeds and partitions in order of
             the line "model seed partition N A", group ids and action keys one a line, scalars and paths as float64 LE

Source: paper, "Training and Test Locking"; spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.check import mismatch_text, prediction_mismatches
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.rows import TABLES, PredictionRows, prediction_frame
from branchdrive.errors import DatasetError
from branchdrive.tables.frame import Frame, Values, concat

__all__ = ["PredictionSet"]


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
                found.update(np.ascontiguousarray(values, "<f8").data)
        return found.hexdigest()

    @classmethod
    def of_rows(cls, rows: PredictionRows) -> PredictionSet:
        """Predictions of the tables `TABLES`, which are taken out of `rows`.

        Raises:
            DatasetError: A bank is not complete, a row is of no group or candidate, or a value is not a number.
        """
        for wrong in prediction_mismatches(rows):
            raise DatasetError(mismatch_text(wrong))
        by_model: dict[str, dict[int, dict[str, Predictions]]] = {}
        for owner in sorted(rows.owners["predictions"]):
            for partition in sorted(rows.partitions(owner)):
                scalars, paths = (rows.take(table, owner, partition) for table in TABLES)
                predicted = Predictions.of(scalars[:, :, 0], paths)
                by_model.setdefault(owner[0], {}).setdefault(owner[1], {})[partition] = predicted
        return cls(by_model)

    def to_frames(self, data: BenchmarkData) -> dict[str, dict[str, Values]]:
        """The tables `TABLES`; writers sort their rows.

        Raises:
            ValueError: There are no predictions.
        """
        return {name: concat([*self.frames(name, data)]) for name in TABLES}

    def frames(self, table: str, data: BenchmarkData, groups: Collection[str] | None = None) -> Iterator[Frame]:
        """Rows of one of the tables `TABLES`, of one model and seed after the other in ascending order.

        Args:
            table: Its name.
            data: The model layer.
            groups: Groups whose rows are wanted; all by default.
        """
        for model in self.models:
            for seed in self.seeds(model):
                parts = []
                for partition, predicted in sorted(self.by_model[model][seed].items()):
                    members = data.part(partition).groups
                    own = [place for place, group in enumerate(members) if groups is None or group in groups]
                    if not own:
                        continue
                    names = tuple(members[place] for place in own)
                    said = predicted if len(own) == len(members) else predicted.take(np.array(own, np.int64))
                    values = said.paths if table == "predicted_trajectories" else said.scalars[:, :, None]
                    parts.append(prediction_frame(table, model, seed, names, data.candidates, values))
                if parts:
                    yield concat(parts)

    def __repr__(self) -> str:
        return f"PredictionSet({', '.join(f'{model} {self.seeds(model)}' for model in self.models)})"

    def _all(self) -> Iterator[tuple[str, int, str, Predictions]]:
        for model in self.models:
            for seed in self.seeds(model):
                for partition in sorted(self.by_model[model][seed]):
                    yield model, seed, partition, self.by_model[model][seed][partition]
