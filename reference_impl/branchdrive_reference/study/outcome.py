"""Outcomes of rollouts: whether the ego touched anything, and what a nominal's result counts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import take_float, window_rows

__all__ = ["RESULTS", "Collisions", "NominalResults", "collisions", "nominal_results"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

RESULTS = {
    "result_num_vehicle_collisions": "vehicle collisions",
    "result_num_pedestrian_collisions": "pedestrian collisions",
    "result_num_static_collisions": "static collisions",
    "result_num_red_light_infractions": "red lights",
    "result_num_stop_sign_infractions": "stop signs",
    "result_num_off_road_infractions": "departures from the road",
}
"""What a rollout's result counts, by column."""


class Collisions(NamedTuple):
    """Whether rollouts touched anything, each field ``[rollouts]``: at any time, and within 2.5 s of the branch."""

    ever: Mask
    in_window: Mask


def collisions(view: ShardView, rollouts: Index) -> Collisions | None:
    """Collisions of rollouts with whole windows; ``None`` where no evidence is claimed."""
    if "evidence" not in view:
        return None
    evidence = view.stream("evidence")
    collided = evidence["collision"]
    rows = window_rows(view, evidence, rollouts, FUTURE_OFFSETS)
    return Collisions(evidence.by_rollout(collided).any[rollouts], np.asarray(collided[rows].any(axis=1)))


class NominalResults(NamedTuple):
    """Route results of nominal rollouts.

    Attributes:
        completed: Whether the route was completed ``[rollouts]``.
        counts: Collisions and infractions ``[rollouts, 6]`` in the order of `RESULTS`, NaN where not monitored.
    """

    completed: Mask
    counts: NDArray[np.float64]


def nominal_results(view: ShardView, rollouts: Index) -> NominalResults:
    """Results of `rollouts` as recorded."""
    counts = [take_float(view.rollouts, column, rollouts) for column in RESULTS]
    return NominalResults(view.rollouts.equals("result_completion", "completed")[rollouts], np.stack(counts, axis=1))
