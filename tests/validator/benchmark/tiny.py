"""A model layer of a few groups of three candidates, for tests that judge many tables."""

from __future__ import annotations

from functools import cache

import numpy as np

from branchdrive.benchmark.prediction.data import BenchmarkData, Part
from branchdrive.benchmark.prediction.metric.outcome import Outcomes
from branchdrive.driving.target import TARGETS, TRAJECTORY

__all__ = ["CANDIDATES", "SIZES", "data"]

SIZES = {"train": 2, "val": 1, "calibration": 2, "test": 3}
CANDIDATES = ("nominal", "brake_0.50", "steer_left_0.10")


@cache
def data() -> BenchmarkData:
    """A few groups of three candidates, whose ids are not in the order of their partitions."""
    parts, rng = {}, np.random.default_rng(0)
    for place, (name, size) in enumerate(SIZES.items()):
        bank = (size, len(CANDIDATES))
        scalars, paths = rng.normal(size=(*bank, len(TARGETS))), rng.normal(size=(*bank, 10, len(TRAJECTORY)))
        groups = tuple(f"g{i}.{name}" for i in range(place, place + size))
        outcomes = Outcomes.of(scalars, np.ones(scalars.shape, bool), paths)
        parts[name] = Part(groups, tuple(f"cluster {group}" for group in groups), outcomes)
    return BenchmarkData(parts, CANDIDATES, 0, (1,))
