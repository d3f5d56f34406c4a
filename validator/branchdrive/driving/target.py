"""Targets of a rollout: six scalars and ten steps of trajectory, from the 4 Hz record of the 2.5 s window.

With ``j = 0`` the observation at ``t_b`` and ``j = 1 .. 10`` those at ``t_b + 5 j``, ``dt = 0.25 s``::

    vel_j   = v_j (cos yaw_j, sin yaw_j)                  a_j = (vel_j - vel_{j-1}) / dt
    tau_j   = (R(-yaw_0) (p_j - p_0), sin(yaw_j - yaw_0), cos(yaw_j - yaw_0), v_j)
    T_min   = min_j ttc_j                                 over the frames in which it is available
    D_min   = min_j separation_j                          over the frames in which it is available
    P       = x of tau_10
    J       = mean over j = 2 .. 10 of |a_j - a_{j-1}| / dt
    A_max   = max_j |a_j|
    Omega_max = max_j |wrap(yaw_j - yaw_{j-1})| / dt

Trajectories are in the frame of that rollout's own pose at ``t_b``. No value stands for an absent
one: a value is NaN exactly where its mask is false, and the mask is true exactly where it is finite.

Source: paper, "Model Inputs and Targets"; the formulas are this project's choice where the paper names the quantity
alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OBSERVATIONS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad

__all__ = [
    "STEP_S",
    "TARGETS",
    "TRAJECTORY",
    "Motion",
    "Risk",
    "Target",
    "Targets",
    "Trajectory",
    "scalar_targets",
    "trajectory",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEP_S = OBSERVATION_STRIDE_TICKS * TICK_S
"""Time between two saved observations, seconds."""


class Target(NamedTuple):
    """One scalar target: name with unit suffix, symbol of the paper, unit."""

    name: str
    symbol: str
    unit: str


TARGETS = (
    Target("min_ttc_s", "T_min", "s"),
    Target("min_separation_m", "D_min", "m"),
    Target("displacement_m", "P", "m"),
    Target("mean_jerk_mps3", "J", "m/s3"),
    Target("max_accel_mps2", "A_max", "m/s2"),
    Target("max_yaw_rate_radps", "Omega_max", "rad/s"),
)
"""The scalar targets, in the order of `Targets.values`."""

TRAJECTORY = ("x_m", "y_m", "sin_yaw", "cos_yaw", "speed_mps")
"""Components of one step of the trajectory, in the order of `Trajectory.values`."""


class Motion(NamedTuple):
    """Ego motion at ``t_b + 5 j``, ``j = 0 .. 10``: each field ``[rollouts, 11]``, NaN where nothing was recorded.

    Centre and heading in one fixed frame; the speed is longitudinal and signed.
    """

    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array


class Risk(NamedTuple):
    """Risk evidence at ``t_b + 5 j``, ``j = 1 .. 10``: each field ``[rollouts, 10]``, values with their masks."""

    separation_m: Array
    separation_available: Mask
    ttc_s: Array
    ttc_available: Mask


class Targets(NamedTuple):
    """Scalar targets: `values` ``[rollouts, 6]`` in the order of `TARGETS`, `available` of the same shape."""

    values: Array
    available: Mask


class Trajectory(NamedTuple):
    """Future path: `values` ``[rollouts, 10, 5]`` in the order of `TRAJECTORY`, `available` ``[rollouts, 10]``."""

    values: Array
    available: Mask


def trajectory(motion: Motion) -> Trajectory:
    """Ten steps in the frame of the rollout's own pose at ``t_b``; a step is there where all of it is finite.

    Raises:
        ValueError: A field has another shape than ``[rollouts, 11]``.
    """
    x, y, yaw, speed = _frames(motion, FUTURE_OBSERVATIONS + 1)
    with np.errstate(over="ignore", invalid="ignore"):
        dx, dy, turned = (values[:, 1:] - values[:, :1] for values in (x, y, yaw))
        cos, sin = np.cos(yaw[:, :1]), np.sin(yaw[:, :1])
        steps = np.stack(
            [cos * dx + sin * dy, cos * dy - sin * dx, np.sin(turned), np.cos(turned), speed[:, 1:]], axis=2
        )
    available = np.isfinite(steps).all(axis=2)
    return Trajectory(np.where(available[..., None], steps, np.nan), available)


def scalar_targets(motion: Motion, risk: Risk) -> Targets:
    """The six scalar targets of every rollout.

    What follows from motion is there where all that it needs was recorded. A minimum over frames is
    there where any frame has evidence, and absent where a frame claims evidence that is not a number.

    Raises:
        ValueError: A field has another shape than `Motion` and `Risk` say.
    """
    _, _, yaw, speed = _frames(motion, FUTURE_OBSERVATIONS + 1)
    separation, has_separation, ttc, has_ttc = _frames(risk, FUTURE_OBSERVATIONS)
    if len(yaw) != len(separation):
        raise ValueError(f"motion has {len(yaw)} rollouts and risk {len(separation)}")
    with np.errstate(over="ignore", invalid="ignore"):
        accel_x, accel_y = (np.diff(speed * part, axis=1) / STEP_S for part in (np.cos(yaw), np.sin(yaw)))
        jerk = np.hypot(np.diff(accel_x, axis=1), np.diff(accel_y, axis=1)) / STEP_S
        values = np.stack(
            [
                np.where(has_ttc.astype(bool), ttc, np.inf).min(axis=1),
                np.where(has_separation.astype(bool), separation, np.inf).min(axis=1),
                trajectory(motion).values[:, -1, 0],
                jerk.mean(axis=1),
                np.hypot(accel_x, accel_y).max(axis=1),
                np.abs(wrap_rad(np.diff(yaw, axis=1))).max(axis=1) / STEP_S,
            ],
            axis=1,
        )
    available = np.isfinite(values)
    return Targets(np.where(available, values, np.nan), available)


def _frames(fields: Motion | Risk, num_frames: int) -> list[Array]:
    """Fields in float64, all of one shape ``[rollouts, num_frames]``."""
    arrays = [np.asarray(values, np.float64) for values in fields]
    wanted = (len(arrays[0]) if arrays[0].ndim else 0, num_frames)
    for name, values in zip(fields._fields, arrays, strict=True):
        if values.shape != wanted:
            raise ValueError(f"`{name}` has shape {list(values.shape)}, not {list(wanted)}: [rollouts, frames]")
    return arrays
