"""Features that are exchangeable over the actions of a group: heavy tails, and a scale and centre of every group."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def exchangeable(num_groups: int, num_actions: int, num_features: int, *, seed: int) -> Array:
    """``[groups, actions, features]`` in which nothing leaks."""
    rng = np.random.default_rng(seed)
    spread = np.exp(0.5 * rng.normal(size=(num_groups, 1, 1)))
    mixed = np.eye(num_features) + 0.3 * rng.normal(size=(num_features, num_features))
    drives = rng.standard_t(3, size=(num_groups, num_actions, num_features)) * spread
    return np.asarray(drives @ mixed + rng.normal(size=(num_groups, 1, num_features)))
