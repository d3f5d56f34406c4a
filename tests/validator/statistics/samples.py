"""Random banks with gaps and ties, and predictions of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale

UNIT = Scale(np.ones(6), np.ones(6))


def outcomes(
    num_groups: int = 9, num_candidates: int = 5, *, seed: int = 0, gaps: float = 0.2, ties: bool = False
) -> Outcomes:
    rng = np.random.default_rng(seed)
    shape = (num_groups, num_candidates)
    values = rng.gamma(2.0, size=(*shape, 6))
    if ties:
        values = np.round(values)
    available = rng.random((*shape, 6)) >= gaps
    return Outcomes.of(np.where(available, values, np.nan), available, paths(rng, shape))


def paths(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    values = rng.normal(size=(*shape, 10, 5))
    yaw = rng.uniform(-np.pi, np.pi, (*shape, 10))
    values[..., 2], values[..., 3] = np.sin(yaw), np.cos(yaw)
    return values


def predictions(truth: Outcomes, *, seed: int = 1, noise: float = 1.0, ties: bool = False) -> Predictions:
    rng = np.random.default_rng(seed)
    scalars = truth.scalars + noise * rng.normal(size=truth.scalars.shape)
    shape = truth.complete.shape
    return Predictions.of(np.round(scalars) if ties else scalars, truth.paths + noise * paths(rng, shape))


def alone(num_groups: int) -> list[str]:
    """A cluster of its own for every group."""
    return [f"c{i:03}" for i in range(num_groups)]


def pairs(num_groups: int) -> list[str]:
    """Clusters of two groups, of one where their number is odd."""
    return [f"c{i // 2:03}" for i in range(num_groups)]


def perfect(truth: Outcomes) -> Predictions:
    return Predictions.of(truth.scalars, truth.paths)


def same(left: Any, right: Any) -> None:
    """Equal to rounding, NaN in the same places."""
    np.testing.assert_allclose(np.asarray(left), np.asarray(right), rtol=1e-12, atol=1e-12)
