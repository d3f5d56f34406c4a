"""How far recorded motion is from what recorded speeds and rates say of it: residuals of each observation.

With ``p`` the position, ``u = (cos yaw, sin yaw)``, ``v`` the speed, ``w`` the yaw rate, ``a`` the accelerations,
``dt`` the time between an observation (1) and the one before it (0)::

    displacement  |p_1 - p_0 - (v_0 u_0 + v_1 u_1) dt / 2|
    turn          |wrap(yaw_1 - yaw_0 - (w_0 + w_1) dt / 2)|
    longitudinal  |a_longitudinal - (v_1 - v_0) / dt|
    lateral       |a_lateral - v_1 w_1|

Recorded accelerations and yaw rates are those of one tick, which observations five ticks apart cannot recompute, but
bound. Residuals are those of all observations; contacts, which break these relations, are of
`branchdrive.raw.motion.contact`.

Source: spec/05-raw-streams.md#motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = ["OBSERVATION_S", "RELATIONS", "Relation", "displacement", "follows", "lateral", "longitudinal", "turn"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OBSERVATION_S = OBSERVATION_STRIDE_TICKS * TICK_S
"""Time between neighbouring observations."""


class Relation(NamedTuple):
    """A relation between columns of the observations.

    Attributes:
        column: The column that it judges.
        residual: How far each observation is from it ``[observations]``, NaN where nothing can be compared.
        most: How far it may be ``[observations]``.
    """

    column: str
    residual: Array
    most: Array

    @property
    def is_compared(self) -> Mask:
        """Observations that it says something of."""
        return ~np.isnan(self.residual)

    @property
    def is_broken(self) -> Mask:
        """Observations that break it."""
        return np.asarray(self.residual > self.most)


def follows(stream: StreamView) -> Mask:
    """Rows whose predecessor in the stream is the observation before, of the same attempt."""
    found = np.zeros(len(stream), bool)
    found[1:] = (stream.rollout[1:] == stream.rollout[:-1]) & (np.diff(stream.tick) == OBSERVATION_STRIDE_TICKS)
    return found & (stream.rollout >= 0)


def _steps(values: Array) -> Array:
    return np.diff(values, prepend=np.nan)


def _means(values: Array) -> Array:
    return np.concatenate([[np.nan], (values[1:] + values[:-1]) / 2])[: len(values)]


def _numbers(view: ShardView, *names: str) -> list[Array]:
    return [view.observations[name].astype(np.float64) for name in names]


def displacement(view: ShardView) -> Relation:
    """The displacement since the previous observation, within an absolute part and a share of the way."""
    bounds = physical_bounds()
    x, y, yaw, speed = _numbers(view, "x_m", "y_m", "yaw_rad", "speed_mps")
    off_x = _steps(x) - _means(speed * np.cos(yaw)) * OBSERVATION_S
    off_y = _steps(y) - _means(speed * np.sin(yaw)) * OBSERVATION_S
    way_m = _means(np.abs(speed)) * OBSERVATION_S
    residual = np.where(follows(view.observations), np.hypot(off_x, off_y), np.nan)
    return Relation("x_m", residual, bounds.displacement_m + bounds.displacement_share * way_m)


def turn(view: ShardView) -> Relation:
    """The turn since the previous observation."""
    yaw, rate = _numbers(view, "yaw_rad", "yaw_rate_radps")
    off = np.abs(wrap_rad(_steps(yaw) - _means(rate) * OBSERVATION_S))
    return _within(view, "yaw_rad", np.where(follows(view.observations), off, np.nan), physical_bounds().turn_rad)


def longitudinal(view: ShardView) -> Relation:
    """The longitudinal acceleration against the change of speed since the previous observation."""
    speed, accel = _numbers(view, "speed_mps", "accel_longitudinal_mps2")
    off = np.abs(accel - _steps(speed) / OBSERVATION_S)
    residual = np.where(follows(view.observations), off, np.nan)
    return _within(view, "accel_longitudinal_mps2", residual, physical_bounds().acceleration_mps2)


def lateral(view: ShardView) -> Relation:
    """The lateral acceleration against speed times yaw rate."""
    speed, rate, accel = _numbers(view, "speed_mps", "yaw_rate_radps", "accel_lateral_mps2")
    residual = np.where(view.observations.tick > 0, np.abs(accel - speed * rate), np.nan)
    return _within(view, "accel_lateral_mps2", residual, physical_bounds().acceleration_mps2)


def _within(view: ShardView, column: str, residual: Array, most: float) -> Relation:
    return Relation(column, residual, np.broadcast_to(most, len(view.observations)))


RELATIONS: Mapping[str, tuple[Callable[[ShardView], Relation], ...]] = MappingProxyType(
    {"BD-MOT-001": (displacement,), "BD-MOT-002": (turn,), "BD-MOT-003": (longitudinal, lateral)}
)
"""Relations that a rule judges, by the rule; each is computed once for a view, see `ShardView.cached`."""
