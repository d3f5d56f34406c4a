"""How far recorded motion is from what recorded speeds and rates say of it: residuals of each observation.

With ``p`` the position, ``u = (cos yaw, sin yaw)``, ``v`` the speed, ``w`` the yaw rate, ``a`` the accelerations,
``dt`` the time between an observation (1) and the one before it (0)::

    displacement  |p_1 - p_0 - (v_0 u_0 + v_1 u_1) dt / 2|
    turn          |wrap(yaw_1 - yaw_0 - (w_0 + w_1) dt / 2)|
    longitudinal  |a_longitudinal - (v_1 - v_0) / dt|
    lateral       |a_lateral - v_1 w_1|

Recorded accelerations and yaw rates are those of one tick, which observations five ticks apart cannot recompute, but
bound. Contact breaks every such relation, so that nothing is compared from the first contact of an attempt on.

Source: spec/05-raw-streams.md#motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = [
    "COLLISION_COUNTS",
    "OBSERVATION_S",
    "before_contact",
    "displacement_m",
    "follows",
    "lateral_mps2",
    "longitudinal_mps2",
    "max_displacement_m",
    "turn_rad",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OBSERVATION_S = OBSERVATION_STRIDE_TICKS * TICK_S
"""Time between neighbouring observations."""

COLLISION_COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))
"""Columns of the rollouts table that count collisions."""


def follows(stream: StreamView) -> Mask:
    """Rows whose predecessor in the stream is the observation before, of the same attempt."""
    found = np.zeros(len(stream), bool)
    found[1:] = (stream.rollout[1:] == stream.rollout[:-1]) & (np.diff(stream.tick) == OBSERVATION_STRIDE_TICKS)
    return found & (stream.rollout >= 0)


def before_contact(view: ShardView) -> Mask:
    """Observations before the first contact of their attempt.

    Without recorded evidence these are all observations of the attempts that count no collision, and no others.
    """
    observations = view.observations
    if "evidence" not in view:
        counts = [view.rollouts.valid(name) & (view.rollouts[name] == 0) for name in COLLISION_COUNTS]
        return np.append(np.logical_and.reduce(counts), False)[observations.rollout]
    evidence = view.stream("evidence")
    touched = np.flatnonzero(evidence["collision"].astype(bool) & (evidence.rollout >= 0))
    first_tick = np.full(view.num_rollouts + 1, np.iinfo(np.int64).max)
    np.minimum.at(first_tick, evidence.rollout[touched], evidence.tick[touched])
    return np.asarray(observations.tick < first_tick[observations.rollout])


def _compared(view: ShardView, residual: Array) -> Array:
    """`residual` of the observations that the bounds hold for, NaN elsewhere."""
    return np.where(view.cached(before_contact), residual, np.nan)


def _steps(values: Array) -> Array:
    return np.diff(values, prepend=np.nan)


def _means(values: Array) -> Array:
    return np.concatenate([[np.nan], (values[1:] + values[:-1]) / 2])[: len(values)]


def _numbers(view: ShardView, *names: str) -> list[Array]:
    return [view.observations[name].astype(np.float64) for name in names]


def displacement_m(view: ShardView) -> Array:
    """Residual of the displacement since the previous observation, ``[observations]``, NaN where none is compared."""
    x, y, yaw, speed = _numbers(view, "x_m", "y_m", "yaw_rad", "speed_mps")
    off_x = _steps(x) - _means(speed * np.cos(yaw)) * OBSERVATION_S
    off_y = _steps(y) - _means(speed * np.sin(yaw)) * OBSERVATION_S
    return _compared(view, np.where(follows(view.observations), np.hypot(off_x, off_y), np.nan))


def max_displacement_m(speed_mps: Array, before_mps: Array) -> Array:
    """Largest residual of a displacement at two speeds: an absolute part, and a share of the way."""
    bounds = physical_bounds()
    way_m = (np.abs(speed_mps) + np.abs(before_mps)) / 2 * OBSERVATION_S
    return np.asarray(bounds.displacement_m + bounds.displacement_share * way_m)


def turn_rad(view: ShardView) -> Array:
    """Residual of the turn since the previous observation, ``[observations]``, NaN where none is compared."""
    yaw, rate = _numbers(view, "yaw_rad", "yaw_rate_radps")
    off = np.abs(wrap_rad(_steps(yaw) - _means(rate) * OBSERVATION_S))
    return _compared(view, np.where(follows(view.observations), off, np.nan))


def longitudinal_mps2(view: ShardView) -> Array:
    """Residual of the longitudinal acceleration, ``[observations]``, NaN where none is compared."""
    speed, accel = _numbers(view, "speed_mps", "accel_longitudinal_mps2")
    off = np.abs(accel - _steps(speed) / OBSERVATION_S)
    return _compared(view, np.where(follows(view.observations), off, np.nan))


def lateral_mps2(view: ShardView) -> Array:
    """Residual of the lateral acceleration, ``[observations]``, NaN where none is compared."""
    speed, rate, accel = _numbers(view, "speed_mps", "yaw_rate_radps", "accel_lateral_mps2")
    return _compared(view, np.where(view.observations.tick > 0, np.abs(accel - speed * rate), np.nan))
