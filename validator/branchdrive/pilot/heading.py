"""What recorded headings are, where they are not those of the motion: degrees, clockwise, from north, backwards.

The direction of motion ``m`` is that of the way from the observation before to the one after, of actors that of their
velocity. Each reading of a heading says what would be recorded, from ``m`` alone; it is the right one where nearly all
recorded headings are nearer to it than to ``m``, of those where the two differ so that a heading can tell. Where the
ego turns against its steering, headings are clockwise or steering is, and smaller differences tell which.

Source: spec/02-time-frames-units.md#frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import wrap_rad
from branchdrive.pilot.pilot import Part
from branchdrive.raw.motion.contact import is_free
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.shard_view import ShardView

__all__ = ["Reading", "headings_read"]

Array = NDArray[np.float64]

_MIN_SPEED_MPS = 2.0
_MIN_ROWS = 20
_TELLING_RAD = 0.3
"""Difference of two readings from which a heading says which of them it is."""

_TELLING_SIGN_RAD = 0.1
"""The same where the sign alone is in doubt."""

_SHARE = 0.8
"""Share of the telling headings that are nearer to a reading; vehicles slip, and turn between observations."""

_AGREEMENT = 0.6
"""Mean cosine of the angle between headings and the reading; headings that have nothing to do with it have 0."""


class Reading(NamedTuple):
    """A wrong way to record a heading.

    Attributes:
        name: What the heading is.
        remedy: What makes it right.
        of_motion: What is recorded of a direction of motion, not wrapped.
    """

    name: str
    remedy: str
    of_motion: Callable[[Array], Array]


_CLOCKWISE = Reading("clockwise", "negate it; a left-handed frame needs y negated, too", np.negative)

_READINGS = (
    Reading("in degrees", "multiply by pi / 180, then wrap to [-pi, pi]", np.degrees),
    _CLOCKWISE,
    Reading("clockwise from the y axis, as a compass has it", "record pi / 2 minus it, wrapped to [-pi, pi]",
            lambda motion: math.pi / 2 - motion),
    Reading("counter-clockwise from the y axis", "add pi / 2, then wrap to [-pi, pi]",
            lambda motion: motion - math.pi / 2),
    Reading("clockwise from the negative y axis", "record -pi / 2 minus it, wrapped to [-pi, pi]",
            lambda motion: -math.pi / 2 - motion),
    Reading("backwards, from the front to the rear", "add pi, then wrap to [-pi, pi]", lambda motion: motion + math.pi),
    Reading("clockwise and in degrees", "negate it, multiply by pi / 180, then wrap to [-pi, pi]",
            lambda motion: np.degrees(-motion)),
    Reading("in degrees clockwise from the y axis, as a compass has it",
            "record pi / 2 minus it times pi / 180, wrapped to [-pi, pi]", lambda motion: 90 - np.degrees(motion)),
)  # fmt: skip


def headings_read(parts: Sequence[Part], *, is_steering_contrary: bool = False) -> dict[str, Reading]:
    """The wrong reading that headings show, of the ego and of vehicles, each where they show one.

    Args:
        parts: Shards of the pilot.
        is_steering_contrary: Whether the ego turns against its steering, as its headings have it.
    """
    found = {}
    for who, rows_of in (("the ego", _of_ego), ("vehicles", _of_vehicles)):
        rows = [np.zeros((2, 0)), *(values for part in parts for values in rows_of(part.view))]
        yaw, motion = np.concatenate(rows, axis=1)
        reading = _reading(yaw, motion, _READINGS, _TELLING_RAD)
        if reading is None and who == "the ego" and is_steering_contrary:
            reading = _reading(yaw, motion, (_CLOCKWISE,), _TELLING_SIGN_RAD)
        if reading is not None:
            found[who] = reading
    return found


def _reading(yaw: Array, motion: Array, readings: Iterable[Reading], telling_rad: float) -> Reading | None:
    """The reading of headings that nearly all of them agree with, and best of all; ``None`` where there is none."""
    best, best_share = None, _SHARE
    for reading in readings:
        recorded = wrap_rad(reading.of_motion(motion))
        telling = np.abs(wrap_rad(recorded - motion)) >= telling_rad
        if telling.sum() < _MIN_ROWS:
            continue
        off, off_motion = np.abs(wrap_rad(yaw - recorded)[telling]), np.abs(wrap_rad(yaw - motion)[telling])
        share = float((off < off_motion).mean()) * float(np.cos(off).mean() >= _AGREEMENT)
        if share >= best_share and (best is None or share > best_share):
            best, best_share = reading, share
    return best


def _of_ego(view: ShardView) -> Iterator[Array]:
    """Headings and directions of motion of the ego ``[2, rows]``."""
    stream = view.observations
    x, y, yaw, speed = (stream[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad", "speed_mps"))
    goes_on = follows(stream) & view.cached(is_free)
    row = np.flatnonzero(goes_on[:-1] & goes_on[1:]) if len(stream) else np.zeros(0, np.int64)
    sense = np.where(speed[row] < 0, -1.0, 1.0)
    way_x, way_y = (sense * (values[row + 1] - values[row - 1]) for values in (x, y))
    moves = np.hypot(way_x, way_y) >= 2 * _MIN_SPEED_MPS * OBSERVATION_S
    yield np.stack([yaw[row], np.arctan2(way_y, way_x)])[:, moves & np.isfinite(yaw[row])]


def _of_vehicles(view: ShardView) -> Iterator[Array]:
    """Headings and directions of the velocity of vehicles ``[2, rows]``."""
    if "actors" not in view:
        return
    stream = view.stream("actors")
    vel_x, vel_y, yaw = (stream[name].astype(np.float64) for name in ("vel_x_mps", "vel_y_mps", "yaw_rad"))
    drives = stream.equals("actor_class", "vehicle") | stream.equals("actor_class", "cycle")
    drives &= (np.hypot(vel_x, vel_y) >= _MIN_SPEED_MPS) & np.isfinite(yaw)
    drives &= np.append(view.cached(is_free), False)[view.observations.rows_of(stream)]
    yield np.stack([yaw, np.arctan2(vel_y, vel_x)])[:, drives]
