"""Outcomes of candidates: targets, and whether the ego touched anything."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.view import ShardView, TableView
from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.derive.target import Motion, Risk, Targets, scalar_targets
from branchdrive_reference.study.window import window_rows

__all__ = ["RESULTS", "Collisions", "NominalResults", "collisions", "nominal_results", "targets_of"]

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


def _take(table: TableView, column: str, rows: Index) -> NDArray[np.float64]:
    """Values of a numeric column at `rows`, float64, NaN where null."""
    values = np.asarray(table[column][rows], np.float64)
    return np.where(table.valid(column)[rows], values, np.nan)


def targets_of(view: ShardView, rollouts: Index) -> Targets:
    """Scalar targets of rollouts with whole windows; what needs evidence is absent where none is claimed."""
    rows = window_rows(view, view.observations, rollouts, (0, *FUTURE_OFFSETS))
    motion = Motion(*(_take(view.observations, name, rows) for name in Motion._fields))
    shape = (len(rollouts), len(FUTURE_OFFSETS))
    nothing, never = np.full(shape, np.nan), np.zeros(shape, bool)
    if "evidence" not in view:
        return scalar_targets(motion, Risk(nothing, never, nothing, never))
    evidence = view.stream("evidence")
    rows = window_rows(view, evidence, rollouts, FUTURE_OFFSETS)
    separation, ttc = (_take(evidence, name, rows) for name in ("separation_m", "ttc_s"))
    has_separation, has_ttc = (evidence[f"{name}_available"][rows] for name in ("separation", "ttc"))
    return scalar_targets(motion, Risk(separation, has_separation, ttc, has_ttc))


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
    counts = [_take(view.rollouts, column, rollouts) for column in RESULTS]
    return NominalResults(view.rollouts.equals("result_completion", "completed")[rollouts], np.stack(counts, axis=1))
