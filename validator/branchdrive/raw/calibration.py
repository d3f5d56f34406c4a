"""Sign, unit and clock of recorded motion: ratios of what attempts record to what their poses say of the same.

Between neighbouring observations 0 and 1 of an attempt, ``dt`` apart, with the position ``p``, the heading ``yaw``,
``u = (cos yaw, sin yaw)``, the speed ``v``, the way ``s = |p_1 - p_0|`` and the turn ``q = wrap(yaw_1 - yaw_0)``::

    quantity        recorded              of the poses        where
    speed           |v_0 + v_1| dt / 2    s                   s / dt >= 2 m/s
    yaw rate        (w_0 + w_1) / 2       q / dt              |q / dt| >= 0.05 rad/s
    longitudinal    a_longitudinal        (v_1 - v_0) / dt    |(v_1 - v_0) / dt| >= 0.5 m/s2
    lateral         a_lateral             v_1 q / dt          |v_1 q / dt| >= 0.5 m/s2

The ratio of an attempt is the slope of the regression through the origin, ``sum(r c) / sum(c c)``, of recorded values
``r`` on those of the poses ``c``; of the speed it is ``sum(r) / sum(c)``. Two more are no ratios: the angle from the
mean heading to the displacement, on straight ways, and the share of the velocity of vehicles along their heading.
Nothing is compared from the first contact on. Source: spec/07-rules.md#calibration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.motion import OBSERVATION_S, before_contact, follows
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.tracks import tracks

__all__ = ["QUANTITIES", "Quantity", "calibration"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_STEPS = 4
"""Observations below which an attempt says nothing: less than a second."""

MIN_SPEED_MPS = 2.0
MIN_RATE_RADPS = 0.05
MIN_ACCELERATION_MPS2 = 0.5
"""Motion below these says nothing: it would compare noise and what happens inside of a quarter second."""

MAX_STRAIGHT_RAD = 0.01
"""Turn of a straight way: on others the centre of a box slips to the side."""

MIN_SINE = 0.5
"""Sine of the least angle between velocity and x axis: along that axis, a heading of the wrong sense is the same."""


class Quantity(NamedTuple):
    """What is calibrated.

    Attributes:
        table: Table of the column.
        column: The recorded column.
        least: The least value that is right, of the quantity named by `text`.
        most: The largest.
        text: What the values bound, in words.
    """

    table: str
    column: str
    least: float
    most: float
    text: str


QUANTITIES = {
    "speed": Quantity("observations", "speed_mps", 0.95, 1.05, "way by speed and clock over way of the positions"),
    "yaw_rate": Quantity("observations", "yaw_rate_radps", 0.5, 2.0, "slope of the yaw rate on the turn"),
    "longitudinal": Quantity(
        "observations", "accel_longitudinal_mps2", 0.5, 2.0, "slope of the acceleration on the change of speed"
    ),
    "lateral": Quantity(
        "observations", "accel_lateral_mps2", 0.5, 2.0, "slope of the acceleration on speed times turn"
    ),
    "heading": Quantity(
        "observations", "yaw_rad", -3.0, 3.0, "degrees from the heading to the displacement on straight ways"
    ),
    "actor_heading": Quantity("actors", "yaw_rad", 0.9, 1.0, "share of the velocity of vehicles along their heading"),
}


@np.errstate(all="ignore")  # what overflows is no number, and says nothing
def calibration(view: ShardView, broken: Mask) -> dict[str, Array]:
    """Values of every quantity in the attempts that say something of it, ``[attempts]`` each; at most six decimals."""
    stream = view.observations
    is_judged = np.append(~broken, False)
    row = np.flatnonzero(follows(stream) & view.cached(before_contact) & is_judged[stream.rollout])
    x, y, yaw, speed, rate, along, across = (
        stream[name].astype(np.float64)
        for name in (
            "x_m", "y_m", "yaw_rad", "speed_mps", "yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2",
        )
    )  # fmt: skip
    way_x, way_y, turn = x[row] - x[row - 1], y[row] - y[row - 1], wrap_rad(yaw[row] - yaw[row - 1])
    way, turning = np.hypot(way_x, way_y), turn / OBSERVATION_S
    mean_speed, gained = (speed[row] + speed[row - 1]) / 2, (speed[row] - speed[row - 1]) / OBSERVATION_S
    heading = yaw[row] - turn / 2
    drives = way >= MIN_SPEED_MPS * OBSERVATION_S
    owner, sense = stream.rollout[row], np.sign(mean_speed)
    ahead = sense * (np.cos(heading) * way_x + np.sin(heading) * way_y)
    left = sense * (np.cos(heading) * way_y - np.sin(heading) * way_x)

    def slope(recorded: Array, of_poses: Array, least: float) -> Array:
        return _of_attempts(owner, np.abs(of_poses) >= least, recorded * of_poses, of_poses**2)[0]

    angle = _of_attempts(owner, drives & (np.abs(turn) <= MAX_STRAIGHT_RAD), left, ahead)
    found = {
        "speed": _of_attempts(owner, drives, np.abs(mean_speed) * OBSERVATION_S, way)[0],
        "yaw_rate": slope((rate[row] + rate[row - 1]) / 2, turning, MIN_RATE_RADPS),
        "longitudinal": slope(along[row], gained, MIN_ACCELERATION_MPS2),
        "lateral": slope(across[row], speed[row] * turning, MIN_ACCELERATION_MPS2),
        "heading": np.degrees(np.arctan2(angle[1], angle[2])),
    }
    if "actors" in view:
        found["actor_heading"] = _actor_heading(view, is_judged)
    return {name: np.round(values[np.isfinite(values)], 6) for name, values in found.items()}


def _of_attempts(owner: Index, counts: Mask, above: Array, below: Array) -> tuple[Array, Array, Array]:
    """Ratio of two sums over the steps that count, and the sums, of the attempts with enough of them."""
    counts = counts & np.isfinite(above) & np.isfinite(below)
    steps = np.bincount(owner[counts])
    upper, lower = (
        np.bincount(owner[counts], values[counts])[steps >= MIN_STEPS].astype(np.float64) for values in (above, below)
    )
    return upper / lower, upper, lower


def _actor_heading(view: ShardView, is_judged: Mask) -> Array:
    stream, observations = view.stream("actors"), view.observations
    row = view.cached(tracks).row
    frame = observations.rows_of(stream)[row]
    is_vehicle = stream.equals("actor_class", "vehicle") | stream.equals("actor_class", "cycle")
    row = row[is_vehicle[row] & view.cached(before_contact)[frame] & is_judged[observations.rollout[frame]]]
    vel_x, vel_y, yaw = (stream[name][row].astype(np.float64) for name in ("vel_x_mps", "vel_y_mps", "yaw_rad"))
    speed = np.hypot(vel_x, vel_y)
    counts = (speed >= MIN_SPEED_MPS) & (np.abs(vel_y) >= MIN_SINE * speed)
    along = np.cos(yaw) * vel_x + np.sin(yaw) * vel_y
    return _of_attempts(stream.rollout[row], counts, along, speed)[0]
