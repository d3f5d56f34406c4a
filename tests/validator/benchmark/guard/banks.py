"""Synthetic banks whose outcomes follow a few hidden numbers, with predictions of three seeds that know them partly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.target import Targets

Array = NDArray[np.float64]

STRENGTH = np.array([0.0, 0.3, 0.5, 0.8, -0.3, -0.5, -1.0, 0.05, 0.1, 0.15, -0.05, -0.1, -0.15])
"""How much faster a candidate drives; the first is nominal."""

SIDE = np.array([0.0, 0, 0, 0, 0, 0, 0, 0.4, 0.7, 1.0, -0.4, -0.7, -1.0])


class Banks(NamedTuple):
    """Outcomes ``[groups, 13, 6]``, predictions ``[3, groups, 13, 6]`` and the cluster of every group."""

    outcomes: Targets
    scalars: Array
    clusters: tuple[str, ...]


def banks(num_groups: int, *, seed: int, per_cluster: int = 2, hidden: float = 0.6) -> Banks:
    """Groups of `per_cluster` to a cluster; `hidden` scales what predictions do not know."""
    rng = np.random.default_rng(seed)
    cluster = np.arange(num_groups) // per_cluster
    shared = rng.normal(size=(cluster[-1] + 1, 3))[cluster]

    def each(spread: float) -> Array:
        return rng.normal(scale=spread, size=(num_groups, 1))

    lead = 9 + 4 * shared[:, :1] + each(2)
    closing = 1.2 + 1.5 * shared[:, 1:2] + each(1)
    drift = 1.5 * shared[:, 2:] + each(1)
    surprise, wind = each(1.2) * hidden, each(1.0) * hidden

    def world(lead: Array, closing: Array, drift: Array, pace: Array, need: Array) -> Array:
        displacement = pace + 7 * STRENGTH - 2 * np.abs(SIDE)
        separation = np.maximum(lead - 3 * closing * STRENGTH + 2 * drift * SIDE, 0)
        ttc = np.clip(separation / np.maximum(0.5 + closing, 0.3), 0, 30)
        effort = np.abs(STRENGTH + need) + 0.4 * np.abs(SIDE)
        comfort = [1 + 2 * effort + 0 * lead, 1.5 + 3 * effort + 0 * lead, 0.1 + 0.4 * np.abs(SIDE) + 0 * lead]
        return np.stack([ttc, separation, displacement, *comfort], axis=-1)

    pace, need = 14 + each(3), each(0.5)
    noise = rng.normal(scale=0.05, size=(num_groups, 13, 6))
    noise[:, 0] = 0
    outcomes = world(lead, closing + surprise, drift + wind, pace, need) + noise
    outcomes[..., 1] = np.maximum(outcomes[..., 1], 0)
    scalars = np.stack(
        [
            world(lead + each(0.5), closing + each(0.15), drift + each(0.15), pace + each(0.3), need + each(0.1))
            for _ in range(3)
        ]
    )
    return Banks(Targets(outcomes, np.isfinite(outcomes)), scalars, tuple(f"route-{place}" for place in cluster))
