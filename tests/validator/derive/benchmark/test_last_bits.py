"""Last bits decide nothing: results of inputs that differ by them alone agree to 1e-9, and no choice or count differs.

Inputs are perturbed by a relative noise of 1e-15 to 1e-14, equal values alike, as another processor would have rounded
what they were computed from. Most is at stake where numbers tie, so one benchmark lies on a lattice of 0.05: groups
occur several times, errors of different groups are equal but for rounding, and so are their sums.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.validator.audit.rules.benchmark_release import BenchmarkDraft
from tests.validator.derive.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol

from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.prediction_set import PredictionSet
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.derive.benchmark.results import TOLERANCE, results_document
from branchdrive.derive.layer.comparison import document_problems
from branchdrive.derive.metric.outcome import Outcomes, Predictions

Array = NDArray[np.float64]
Inputs = tuple[BenchmarkProtocol, BenchmarkData, PredictionSet]


def sampled() -> Inputs:
    return small_protocol(), data(), prediction_set()


def released() -> Inputs:
    draft = BenchmarkDraft()
    return draft.protocol, draft.data, draft.predictions


def tied(step: float, unit: float = 1.0) -> Inputs:
    """The samples on a lattice, every second group a copy of the one before it."""

    def change(values: Array) -> Array:
        return np.asarray(np.rint(np.repeat(values[::2], 2, axis=0) / step) * step * unit)

    return small_protocol(), _mapped_data(data(), change), _mapped_predictions(prediction_set(), change)


def _mapped_data(given: BenchmarkData, change: Any) -> BenchmarkData:
    parts = {}
    for name, part in given.parts.items():
        found = part.outcomes
        changed = Outcomes(change(found.scalars), found.available, change(found.paths), found.complete)
        parts[name] = replace(part, outcomes=changed)
    return replace(given, parts=parts)


def _mapped_predictions(given: PredictionSet, change: Any) -> PredictionSet:
    return PredictionSet(
        {
            model: {
                seed: {
                    name: Predictions.of(change(found.scalars), change(found.paths)) for name, found in parts.items()
                }
                for seed, parts in by_seed.items()
            }
            for model, by_seed in given.by_model.items()
        }
    )


def perturbed(inputs: Inputs, seed: int) -> Inputs:
    rng = np.random.default_rng(seed)

    def change(values: Array) -> Array:
        distinct, place = np.unique(values, return_inverse=True)
        size = rng.choice([-1.0, 1.0], len(distinct)) * rng.uniform(1e-15, 1e-14, len(distinct))
        return np.asarray((distinct * (1 + size))[place].reshape(values.shape))

    protocol, given, predictions = inputs
    return protocol, _mapped_data(given, change), _mapped_predictions(predictions, change)


INPUTS = {
    "sampled": sampled,
    "released": released,
    "tied": partial(tied, 0.05),
    "tied often": partial(tied, 0.5),
    "tied and large": partial(tied, 0.05, 1e4),
}


@cache
def inputs_of(name: str) -> Inputs:
    return INPUTS[name]()


@pytest.mark.parametrize("name", INPUTS)
def test_results_of_inputs_that_differ_in_last_bits_agree(name: str) -> None:
    inputs = inputs_of(name)
    expected = results_document(*inputs, risk_fit(), noise())
    problems = []
    for seed in range(3):
        found = results_document(*perturbed(inputs, seed), risk_fit(), noise())
        problems += document_problems(expected, found, tolerance=TOLERANCE)
    assert [(problem.place, problem.expected, problem.found) for problem in problems] == []
