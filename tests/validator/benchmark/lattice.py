"""The small benchmark on a lattice, where errors, sums, resamples, scores and losses tie in many places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tests.validator.benchmark.samples import data, prediction_set, small_protocol

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol

__all__ = ["Inputs", "changed", "tied"]

Array = NDArray[np.float64]
Inputs = tuple[BenchmarkProtocol, BenchmarkData, PredictionSet]


def tied(step: float, unit: float = 1.0) -> Inputs:
    """The samples on a lattice, every second group a copy of the one before it."""

    def change(values: Array) -> Array:
        return np.asarray(np.rint(np.repeat(values[::2], 2, axis=0) / step) * step * unit)

    return changed((small_protocol(), data(), prediction_set()), change)


def changed(inputs: Inputs, change: Callable[[Array], Array]) -> Inputs:
    """Inputs whose outcomes and predictions are changed, array by array."""
    protocol, given, predictions = inputs
    parts = {}
    for name, part in given.parts.items():
        found = part.outcomes
        outcomes = Outcomes(change(found.scalars), found.available, change(found.paths), found.complete)
        parts[name] = replace(part, outcomes=outcomes)
    by_model = {
        model: {
            seed: {name: Predictions.of(change(found.scalars), change(found.paths)) for name, found in parts.items()}
            for seed, parts in by_seed.items()
        }
        for model, by_seed in predictions.by_model.items()
    }
    return protocol, replace(given, parts=parts), PredictionSet(by_model)
