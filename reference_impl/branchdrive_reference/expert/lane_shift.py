"""Passing a standing obstacle: a lane shift, taken when the neighbour lane is free.

A shift is planned around the nearest standing body in the ego's lane. It is dropped again as long
as the ego has not left its lane and the neighbour lane does not stay free, and it ends when the ego
is back on its route behind the obstacle.
"""

from __future__ import annotations

from branchdrive_reference.geometry.path import locate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.road import LANE_WIDTH_M
from branchdrive_reference.world.body import EGO, Behaviour
from branchdrive_reference.world.corridor import NOBODY

__all__ = ["OBSTACLE_SIGHT_M", "is_obstacle", "update_lane_shift"]

OBSTACLE_SIGHT_M = 50.0
"""Standing obstacles are noticed from here on, centre to centre."""

_SAME_DIRECTION, _ONCOMING = int(LaneSide.SAME_DIRECTION), int(LaneSide.ONCOMING)
_STANDING, _FREE = int(Behaviour.STANDING), int(Behaviour.FREE)

_STANDSTILL_MPS = 0.2
_CLEARANCE_M, _LANE_MARGIN_M, _IN_LANE_M = 0.8, 0.4, 0.6
"""Lateral distances: kept to the obstacle, to users of the other lane, and from the route while in the own lane."""

_LONGITUDINAL_CLEARANCE_M = 2.0
_SHIFT_S, _SHIFT_MIN_M, _SHIFT_SHORTEST_M = 2.2, 12.0, 5.0
_PASSING_MPS = 4.0
_MARGIN_S = 1.0
_SIDE_GAP_M, _SIDE_HEADWAY_S = 6.0, 2.0


@kernel
def is_obstacle(body: Records) -> bool:
    """Whether a body stands for good: parked, or left standing by a collision."""
    if body.behaviour == _STANDING:
        return True
    stands = abs(body.vel_x_mps) + abs(body.vel_y_mps) < _STANDSTILL_MPS
    return bool(body.behaviour == _FREE and stands)


@kernel
def _next_obstacle(bodies: Records, feet: Records) -> int:
    """Row of the nearest standing body in the ego's lane that the ego has not passed, or `NOBODY`."""
    found, nearest_m = NOBODY, OBSTACLE_SIGHT_M
    ego = feet[EGO]
    for index in range(EGO + 1, bodies.shape[0]):
        foot = feet[index]
        ahead_m = foot.arc_m - ego.arc_m
        passed = ahead_m + foot.half_length_m + ego.half_length_m < 0.0
        in_lane = abs(foot.offset_m) < 0.5 * LANE_WIDTH_M + foot.half_width_m
        if not passed and in_lane and ahead_m < nearest_m and is_obstacle(bodies[index]):
            found, nearest_m = index, ahead_m
    return found


@kernel
def _is_free(bodies: Records, feet: Records, obstacle: int, shift_m: float, end_m: float) -> bool:
    """Whether nobody needs the shifted lane between here and the end of the shift while the ego uses it."""
    ego = feet[EGO]
    ego_speed = max(ego.speed_mps, _PASSING_MPS)
    busy_s = (end_m - ego.arc_m) / ego_speed
    for index in range(EGO + 1, bodies.shape[0]):
        foot = feet[index]
        reach = 0.5 * bodies[EGO].width_m + foot.half_width_m + _LANE_MARGIN_M
        if index == obstacle or abs(foot.offset_m - shift_m) > reach:
            continue
        gap_m = foot.arc_m - ego.arc_m
        if foot.speed_mps < -_STANDSTILL_MPS:
            arrives_s = (foot.arc_m - foot.half_length_m - end_m) / -foot.speed_mps
            if gap_m > -ego.half_length_m and arrives_s < busy_s + _MARGIN_S:
                return False
        elif gap_m >= 0.0:
            if gap_m < end_m - ego.arc_m and foot.speed_mps < ego_speed:
                return False
        elif -gap_m < _SIDE_GAP_M + max(0.0, foot.speed_mps - ego.speed_mps) * _SIDE_HEADWAY_S:
            return False
    return True


@kernel
def _try_side(plan: Records, bodies: Records, feet: Records, obstacle: int, side: int) -> bool:
    """Plan the shift to one side, +1 left or -1 right, if the ego is there already or the lane there is free."""
    ego, foot = feet[EGO], feet[obstacle]
    reach_m = foot.half_length_m + ego.half_length_m + _LONGITUDINAL_CLEARANCE_M
    full_m, hold_m = foot.arc_m - reach_m, foot.arc_m + reach_m
    length_m = max(_SHIFT_MIN_M, _SHIFT_S * ego.speed_mps)
    shift_m = foot.offset_m + side * (foot.half_width_m + 0.5 * bodies[EGO].width_m + _CLEARANCE_M)
    beside = side * (ego.offset_m - shift_m) > -0.5 * _CLEARANCE_M
    in_time = full_m - ego.arc_m > _SHIFT_SHORTEST_M
    if not beside and not (in_time and _is_free(bodies, feet, obstacle, shift_m, hold_m + length_m)):
        return False
    plan.shift_m, plan.obstacle = shift_m, obstacle
    plan.begin_m = min(max(ego.arc_m, full_m - length_m), full_m)
    plan.full_m, plan.hold_m, plan.end_m = full_m, hold_m, hold_m + length_m
    return True


@kernel
def _plan_shift(plan: Records, bodies: Records, feet: Records, path: Records, obstacle: int) -> None:
    """Plan a shift into the first usable lane beside the obstacle, lanes of the own direction first."""
    vertex = path[locate(path, feet[obstacle].arc_m)]
    for kind in (_SAME_DIRECTION, _ONCOMING):
        if vertex.left_lane == kind and _try_side(plan, bodies, feet, obstacle, 1):
            return
        if vertex.right_lane == kind and _try_side(plan, bodies, feet, obstacle, -1):
            return


@kernel
def update_lane_shift(plan: Records, bodies: Records, feet: Records, path: Records) -> None:
    """Keep, drop or make the lane shift of `plan`; `feet` and `path` are those of the ego's track."""
    ego = feet[EGO]
    if plan.shift_m != 0.0:
        committed = abs(ego.offset_m) >= _IN_LANE_M or ego.arc_m >= plan.full_m
        useful = is_obstacle(bodies[plan.obstacle])
        possible = _is_free(bodies, feet, plan.obstacle, plan.shift_m, plan.end_m)
        if ego.arc_m > plan.end_m or not (committed or (useful and possible)):
            plan.shift_m = 0.0
    if plan.shift_m == 0.0:
        obstacle = _next_obstacle(bodies, feet)
        if obstacle != NOBODY:
            _plan_shift(plan, bodies, feet, path, obstacle)
