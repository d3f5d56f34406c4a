"""Obstacles: what the ego has to pass, and how much of its lane they block together."""

from __future__ import annotations

from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.lane import LANE_WIDTH_M
from branchdrive_reference.town.route import obstacle_sight_m as _obstacle_sight_m
from branchdrive_reference.world.body import EGO, Behaviour, Kind
from branchdrive_reference.world.corridor import NOBODY

__all__ = ["blocked_stretch", "is_obstacle", "next_obstacle", "obstacle_sight_m"]

_STANDING, _FREE, _FOLLOWING = int(Behaviour.STANDING), int(Behaviour.FREE), int(Behaviour.FOLLOWING)
_CYCLE, _WALKER = int(Kind.CYCLE), int(Kind.PEDESTRIAN)
_STANDSTILL_MPS = 0.2
_SLOW_MPS = 6.0
_SAME_GROUP_M = 22.0
_MAX_GROUP = 12

obstacle_sight_m = kernel(_obstacle_sight_m)
"""`town.route.obstacle_sight_m`, compiled."""


@kernel
def is_obstacle(body: Records) -> bool:
    """Whether a body stands for good (parked, or left standing by a collision), or is a slow cycle."""
    if body.behaviour == _STANDING:
        return bool(body.kind != _WALKER)
    if body.behaviour == _FOLLOWING:
        return bool(body.kind == _CYCLE and 0.0 < body.speed_mps < _SLOW_MPS)
    stands = abs(body.vel_x_mps) + abs(body.vel_y_mps) < _STANDSTILL_MPS
    return bool(body.behaviour == _FREE and stands)


@kernel
def _in_lane(body: Records, foot: Records) -> bool:
    ahead = foot.speed_mps > -_STANDSTILL_MPS
    return bool(ahead and abs(foot.offset_m) < 0.5 * LANE_WIDTH_M + foot.half_width_m and is_obstacle(body))


@kernel
def next_obstacle(bodies: Records, feet: Records, sight_m: float) -> int:
    """Row of the nearest obstacle in the ego's lane that the ego has not passed, or `NOBODY`."""
    found, nearest_m = NOBODY, sight_m
    ego = feet[EGO]
    for index in range(EGO + 1, bodies.shape[0]):
        foot = feet[index]
        ahead_m = foot.arc_m - ego.arc_m
        passed = ahead_m + foot.half_length_m + ego.half_length_m < 0.0
        if not passed and ahead_m < nearest_m and _in_lane(bodies[index], foot):
            found, nearest_m = index, ahead_m
    return found


@kernel
def blocked_stretch(bodies: Records, feet: Records, obstacle: int) -> tuple[float, float, float, float]:
    """Stretch ``(begin, end)`` and width ``(right, left)`` of the lane that an obstacle blocks with those behind it.

    Arc lengths and offsets from the route, metres. Obstacles that follow each other closely are passed as one.
    """
    foot = feet[obstacle]
    begin_m, end_m = foot.arc_m - foot.half_length_m, foot.arc_m + foot.half_length_m
    right_m, left_m = foot.offset_m - foot.half_width_m, foot.offset_m + foot.half_width_m
    for _ in range(_MAX_GROUP):
        reached_m = end_m
        for index in range(EGO + 1, bodies.shape[0]):
            other = feet[index]
            near = other.arc_m - other.half_length_m
            if begin_m <= near < end_m + _SAME_GROUP_M and _in_lane(bodies[index], other):
                end_m = max(end_m, other.arc_m + other.half_length_m)
                right_m = min(right_m, other.offset_m - other.half_width_m)
                left_m = max(left_m, other.offset_m + other.half_width_m)
        if end_m == reached_m:
            break
    return begin_m, end_m, right_m, left_m
