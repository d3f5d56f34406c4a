"""How far recorded rates are ahead of the positions and headings that they belong to, in observations.

A recorded rate ``r`` is held against two values ``c_0`` and ``c_1`` that its neighbours make of it, with their mean
``m`` and the change ``d = c_1 - c_0``. The lead of an attempt is ``sum((r / k - m) d) / sum(d d)``, where ``k`` is the
value of the rate in `branchdrive.raw.motion.calibration`, so that a wrong unit or sign is no lead, and 1 of the yaw
rate, which says less of sharp turns: where its value is right of no attempt, neither it nor what is held against it has
a lead, and without a value it has none. With the steps 1 and 2 from observation 0 to 1 and from 1 to 2::

    quantity                         r           c of a step, or at its end
    speed, velocities of vehicles    v at 1      displacement / dt
    yaw rate                         w at 1      turn / dt
    longitudinal                     a at 2      change of speed / dt
    lateral                          a at 2      v w at the end

A state at 1 lies between what both steps make of it, so its lead lies between -1/2 and 1/2; that of the observation
before is -1, and that of the next one 1. An acceleration at 2 is that of the end of step 2: 1/2 or more, and less than
0 where it is that of the observation before. The centre of a box is ahead of the axle that does not slip, so that its
lateral acceleration comes before ``v w``, the more so the slower it drives; at high speeds tyres slip, and it comes
after.

Source: spec/07-rules.md#calibration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.motion.terms import Terms
from branchdrive.raw.motion.tracks import actor_steps
from branchdrive.raw.shard_view import ShardView

__all__ = ["LEADS", "OF_YAW_RATES", "lead", "leads_of_actors", "leads_of_ego"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEADS = {
    "speed_lead": "speed",
    "yaw_rate_lead": "",
    "longitudinal_lead": "longitudinal",
    "lateral_lead": "lateral",
    "actor_lead": "actor_speed",
}
"""Quantities that are leads, and the one that is their ratio of recorded values to those of the positions, if any."""

OF_YAW_RATES = ("yaw_rate_lead", "lateral_lead")
"""Leads of recorded yaw rates, and of what is held against them."""

MIN_CHANGE_MPS, MIN_CHANGE_RADPS, MIN_CHANGE_MPS2 = 0.125, 0.05, 0.5
"""Changes from step to step below which a rate is as right an observation later."""

STEADY_MPS = 8.0, 15.0
"""Speeds at which the lateral acceleration comes neither long before speed times yaw rate nor after it."""


def lead(by_change: Array, changes: Array, mixed: Array, ratio: Array | float = 1.0) -> Array:
    """Lead from its sums, of ``r d``, ``d d`` and ``m d``, and the ratio ``k``, each of one shape."""
    return np.asarray((by_change / ratio - mixed) / changes)


def _terms(row: Index, *axes: tuple[Array, Array, Array]) -> Terms:
    """Terms of a lead, from ``r``, ``c_0`` and ``c_1`` along each axis, and the observations that pairs lead to."""
    by_change, changes, mixed = np.zeros((3, len(row)))
    for recorded, first, last in axes:
        change = last - first
        by_change += recorded * change
        changes += change**2
        mixed += (first + last) / 2 * change
    known = np.flatnonzero(np.isfinite(by_change + changes + mixed))
    return Terms(row, (by_change, changes, mixed)).take(known)


def leads_of_ego(view: ShardView) -> dict[str, Terms]:
    """Terms of the leads of the ego's rates."""
    stream = view.observations
    joined = follows(stream)
    joined = joined[2:] & joined[1:-1]
    x, y, yaw, speed, rate, along, across = (
        stream[name].astype(np.float64)
        for name in (
            "x_m", "y_m", "yaw_rad", "speed_mps", "yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2",
        )
    )  # fmt: skip

    def terms(recorded: Array, of_step: Array, least: float, counts: Mask | None = None) -> Terms:
        pairs = joined & (np.abs(np.diff(of_step)) >= least)
        first = np.flatnonzero(pairs if counts is None else pairs & counts)
        return _terms(first + 2, (recorded[first], of_step[first], of_step[first + 1]))

    speed_mps = np.abs(speed)
    is_steady = (speed_mps >= STEADY_MPS[0]) & (speed_mps <= STEADY_MPS[1])
    way, turn = np.hypot(np.diff(x), np.diff(y)), wrap_rad(np.diff(yaw))
    return {
        "speed_lead": terms(speed_mps[1:], way / OBSERVATION_S, MIN_CHANGE_MPS),
        "yaw_rate_lead": terms(rate[1:], turn / OBSERVATION_S, MIN_CHANGE_RADPS),
        "longitudinal_lead": terms(along[2:], np.diff(speed) / OBSERVATION_S, MIN_CHANGE_MPS2),
        "lateral_lead": terms(across[2:], (speed * rate)[1:], MIN_CHANGE_MPS2, is_steady[2:]),
    }


def leads_of_actors(view: ShardView, chosen: Index, way_x: Array, way_y: Array) -> dict[str, Terms]:
    """Terms of the lead of the velocities of actors.

    Args:
        view: The shard.
        chosen: Steps of actors that count ``[chosen]``.
        way_x: Displacement of distinct steps, along x ``[distinct]``.
        way_y: The same along y.
    """
    stream, every = view.stream("actors"), view.cached(actor_steps)
    last, leads_to = every.place[chosen], np.full(len(stream), -1, np.int32)
    leads_to[every.row[chosen]] = last
    middle = every.before[chosen]
    first = leads_to[middle]
    change_x, change_y = way_x[last] - way_x[first], way_y[last] - way_y[first]
    is_large = change_x**2 + change_y**2 >= (MIN_CHANGE_MPS * OBSERVATION_S) ** 2
    kept = np.flatnonzero((first >= 0) & is_large)
    middle, first, last = middle[kept], first[kept], last[kept]
    axes = [
        (stream[name][middle].astype(np.float64), way[first] / OBSERVATION_S, way[last] / OBSERVATION_S)
        for name, way in (("vel_x_mps", way_x), ("vel_y_mps", way_y))
    ]
    return {"actor_lead": _terms(view.observations.rows_of(stream)[every.row[chosen[kept]]], *axes)}
