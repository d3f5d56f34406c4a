"""Ego history of replays in the frame of their group's nominal at its branch.

With ``p_j``, ``yaw_j`` and ``v_j`` of a replay at the observations ``t_b - 80 .. t_b``, ``p_n`` and ``yaw_n`` the
pose of the group's nominal at ``t_b`` and ``dt = 0.25 s``::

    x, y     = R(-yaw_n) (p_j - p_n)         yaw      = wrap(yaw_j - yaw_n)           speed = v_j
    accel    = (v_j - v_{j-1}) / dt          yaw_rate = wrap(yaw_j - yaw_{j-1}) / dt

All rows of a group share one frame, so that an offset between replays stays visible.

Source: this project's choice of variables, paper VI-A for the kind.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.box import cos_sin, wrap_rad
from branchdrive.driving.target import STEP_S

__all__ = ["EGO_NAMES", "ego_frames"]

Array = NDArray[np.float64]

EGO_NAMES = ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "yaw_rate_radps")
"""Variables in the order of the last axis of `ego_frames`."""


def ego_frames(
    x_m: ArrayLike, y_m: ArrayLike, yaw_rad: ArrayLike, speed_mps: ArrayLike, nominal_pose: ArrayLike
) -> Array:
    """Ego history ``[groups, actions, 16, 6]`` in the order of `EGO_NAMES`, NaN where it cannot be had.

    Args:
        x_m: Ego centre ``[groups, actions, 17]`` at ``t_b - 80, t_b - 75, .. t_b``, world frame.
        y_m: As `x_m`.
        yaw_rad: Heading, as `x_m`.
        speed_mps: Longitudinal speed, as `x_m`.
        nominal_pose: ``[groups, 3]``: x (m), y (m) and heading (rad) of the nominal at its ``t_b``, world frame.

    Raises:
        ValueError: A shape is wrong.
    """
    fields = [np.asarray(values, np.float64) for values in (x_m, y_m, yaw_rad, speed_mps)]
    pose = np.asarray(nominal_pose, np.float64)
    shape = fields[0].shape
    if len(shape) != 3 or shape[2] != HISTORY_OBSERVATIONS + 1 or any(f.shape != shape for f in fields):
        raise ValueError(f"histories have shapes {[list(f.shape) for f in fields]}, not [groups, actions, 17]")
    if pose.shape != (shape[0], 3):
        raise ValueError(f"`nominal_pose` has shape {list(pose.shape)}, not [{shape[0]}, 3]")
    x, y, yaw, speed = (np.where(np.isfinite(f), f, np.nan) for f in fields)
    x_n, y_n, yaw_n = (column[:, None, None] for column in pose.T)
    with np.errstate(over="ignore", invalid="ignore"):
        dx, dy = x[..., 1:] - x_n, y[..., 1:] - y_n
        cos, sin = cos_sin(yaw_n)
        frames = np.stack(
            [
                cos * dx + sin * dy,
                cos * dy - sin * dx,
                wrap_rad(yaw[..., 1:] - yaw_n),
                speed[..., 1:],
                np.diff(speed, axis=2) / STEP_S,
                wrap_rad(np.diff(yaw, axis=2)) / STEP_S,
            ],
            axis=3,
        )
    return np.where(np.isfinite(frames), frames, np.nan)
