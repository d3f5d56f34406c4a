"""Targets of candidates with whole windows, how their drives end, and where their own branch poses lie.

Source: paper, "Model Inputs and Targets"; spec/12-model.md#targets, #endings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OFFSETS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.target import TARGETS, TRAJECTORY, Motion, Risk, Targets, scalar_targets, trajectory
from branchdrive.model.features import target_mask
from branchdrive.raw.motion.contact import COLLISION_COUNTS
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import take_float, window_rows
from branchdrive.tables.frame import Values

__all__ = ["candidate_columns", "ending_columns", "scalar_columns", "targets_of", "trajectory_columns"]

Index = NDArray[np.int64]

_COUNTS = {
    "collision": COLLISION_COUNTS,
    "off_road": ("result_num_off_road_infractions",),
    "infraction": ("result_num_red_light_infractions", "result_num_stop_sign_infractions"),
}
"""Recorded counts of an attempt that an event of its drive follows from, by event."""


def _motion(view: ShardView, rollouts: Index) -> Motion:
    rows = window_rows(view, view.observations, rollouts, (0, *FUTURE_OFFSETS))
    return Motion(*(take_float(view.observations, name, rows) for name in Motion._fields))


def targets_of(view: ShardView, rollouts: Index) -> Targets:
    """Scalar targets of rollouts with whole windows; what needs evidence is absent where none is claimed."""
    shape = (len(rollouts), len(FUTURE_OFFSETS))
    nothing, never = np.full(shape, np.nan), np.zeros(shape, bool)
    risk = Risk(nothing, never, nothing, never)
    if "evidence" in view:
        evidence = view.stream("evidence")
        rows = window_rows(view, evidence, rollouts, FUTURE_OFFSETS)
        risk = Risk(
            take_float(evidence, "separation_m", rows),
            evidence["separation_available"][rows],
            take_float(evidence, "ttc_s", rows),
            evidence["ttc_available"][rows],
        )
    return scalar_targets(_motion(view, rollouts), risk)


def _keys(view: ShardView, rollouts: Index) -> dict[str, Values]:
    return {column: view.rollouts[column][rollouts] for column in ("group_id", "action_key")}


def scalar_columns(view: ShardView, rollouts: Index) -> dict[str, Values]:
    """Scalar targets with their masks, ``[rollouts]``."""
    targets = targets_of(view, rollouts)
    frame = _keys(view, rollouts)
    for i, target in enumerate(TARGETS):
        available = targets.available[:, i]
        frame[target_mask(target.name)] = available
        frame[target.name] = np.ma.masked_array(np.where(available, targets.values[:, i], 0.0), ~available)
    return frame


def trajectory_columns(view: ShardView, rollouts: Index) -> dict[str, Values]:
    """Trajectories, ten rows for each rollout."""
    values = trajectory(_motion(view, rollouts)).values
    num_steps = values.shape[1]
    return {
        **{name: np.repeat(column, num_steps) for name, column in _keys(view, rollouts).items()},
        "step": np.tile(np.arange(1, num_steps + 1, dtype=np.int32), len(rollouts)),
        **dict(zip(TRAJECTORY, values.reshape(-1, values.shape[2]).T, strict=True)),
    }


def ending_columns(view: ShardView, rollouts: Index) -> dict[str, Values]:
    """What was recorded of whole drives, ``[rollouts]``: events where all their counts were monitored, and progress."""
    frame = _keys(view, rollouts)
    for event, names in _COUNTS.items():
        monitored = np.logical_and.reduce([view.rollouts.valid(name)[rollouts] for name in names])
        happened = np.logical_or.reduce([view.rollouts[name][rollouts] > 0 for name in names])
        frame[f"{event}_monitored"] = monitored
        frame[event] = np.ma.masked_array(happened & monitored, ~monitored)
    frame["completed"] = view.rollouts["result_completion"][rollouts] == "completed"
    frame["route_fraction"] = view.rollouts["result_route_fraction"][rollouts]
    return frame


def candidate_columns(view: ShardView, rollouts: Index, nominals: Index) -> dict[str, Values]:
    """Executed rollouts, with their branch pose in the frame of that of their nominal, ``[rollouts]``."""
    own, reference = (
        [view.observations[name][window_rows(view, view.observations, side, (0,))[:, 0]].astype(np.float64)
         for name in ("x_m", "y_m", "yaw_rad")]
        for side in (rollouts, nominals)
    )  # fmt: skip
    dx, dy = own[0] - reference[0], own[1] - reference[1]
    cos, sin = np.cos(reference[2]), np.sin(reference[2])
    return {
        **_keys(view, rollouts),
        "rollout_id": np.array(view.rollout_ids, object)[rollouts],
        "offset_x_m": cos * dx + sin * dy,
        "offset_y_m": cos * dy - sin * dx,
        "offset_yaw_rad": np.asarray(wrap_rad(own[2] - reference[2])),
    }
