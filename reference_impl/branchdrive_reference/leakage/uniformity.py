"""Size of the leakage gate: p-values on features in which nothing leaks, over many seeds.

Permuting the rows of every group leaves the features what they are and breaks their tie to the actions, so the
p-values of each statistic must be uniform.

Source: this project's choice; the tail of the Kolmogorov-Smirnov distance is Stephens' approximation, J. R. Stat.
Soc. B 32 (1970).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.gate import leakage_gate
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.statistics.random_words import group_orders

__all__ = ["GateSize", "Uniformity", "gate_size", "uniformity"]

_SHUFFLES = "leakage/gate-size"


class GateSize(NamedTuple):
    """The gate on shuffled features.

    Attributes:
        p_values: ``[seeds]`` of every statistic, by name.
        failed: ``[seeds]``, whether the gate failed.
    """

    p_values: dict[str, NDArray[np.float64]]
    failed: NDArray[np.bool_]


def gate_size(features: ArrayLike, *, seeds: Iterable[int], protocol: GateProtocol) -> GateSize:
    """Gate on features whose rows are permuted within groups, once for every seed.

    Args:
        features: ``[groups, actions, features]``, as the gate takes them.
        seeds: Of the shuffles and of the gate.
        protocol: Numbers of the gate; without offsets the minimum detectable effect is not computed.

    Raises:
        ValueError: The shape is wrong.
    """
    x = np.asarray(features, np.float64)
    p_values: dict[str, list[float]] = {name: [] for name in STATISTICS}
    failed = []
    for seed in seeds:
        shuffled = group_orders(seed, _SHUFFLES, 1, *x.shape[:2])[0]
        gate = leakage_gate(np.take_along_axis(x, shuffled[:, :, None], axis=1), seed=seed, protocol=protocol)
        failed.append(gate.verdict == "fail")
        for test in gate.tests:
            p_values[test.name].append(test.p)
    return GateSize({name: np.array(p) for name, p in p_values.items()}, np.array(failed, np.bool_))


class Uniformity(NamedTuple):
    """Kolmogorov-Smirnov test of p-values against the uniform distribution.

    Attributes:
        distance: Largest difference of the two distribution functions.
        p: Probability of a distance at least as large, were they uniform; an approximation.
    """

    distance: float
    p: float


def uniformity(p_values: ArrayLike) -> Uniformity:
    """How far p-values are from uniform.

    ``lambda = (sqrt(n) + 0.12 + 0.11 / sqrt(n)) D`` and ``p = 2 sum_k (-1)^(k - 1) exp(-2 k^2 lambda^2)``.

    Args:
        p_values: ``[seeds]``, at least one.
    """
    values = np.sort(np.asarray(p_values, np.float64))
    n = len(values)
    steps = np.arange(n + 1) / n
    distance = float(max((steps[1:] - values).max(), (values - steps[:-1]).max()))
    scale = (math.sqrt(n) + 0.12 + 0.11 / math.sqrt(n)) * distance
    k = np.arange(1, 101)
    tail = 2.0 * float(((-1.0) ** (k - 1) * np.exp(-2.0 * (k * scale) ** 2)).sum())
    return Uniformity(distance, min(max(tail, 0.0), 1.0) if scale > 0.2 else 1.0)
