"""Leaving the lane for a while: around obstacles, and to make way for a siren.

A shift is planned around the next obstacles in the ego's lane, or into the next lane where somebody with a siren
comes from behind. It is dropped again as long as the ego has not left its lane and the neighbour lane does not stay
free, and it ends when the ego is back on its route behind the obstacle, or when the siren has passed.
"""

from __future__ import annotations

from branchdrive_reference.expert.obstacle import blocked_stretch, is_obstacle, next_obstacle, obstacle_sight_m
from branchdrive_reference.geometry.polyline import locate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide
from branchdrive_reference.world.body import EGO
from branchdrive_reference.world.corridor import NOBODY

__all__ = ["update_lane_shift"]

_SAME_DIRECTION, _ONCOMING = int(LaneSide.SAME_DIRECTION), int(LaneSide.ONCOMING)

_STANDSTILL_MPS = 0.2
_CLEARANCE_M, _LANE_MARGIN_M, _IN_LANE_M = 1.0, 0.4, 0.6
"""Lateral distances: kept to the obstacle, to users of the other lane, and from the route while in the own lane."""

_LONGITUDINAL_CLEARANCE_M = 2.0
_SHIFT_S, _SHIFT_MIN_M, _SHIFT_SHORTEST_M = 1.9, 12.0, 5.0
_PASSING_MPS = 4.0
_MARGIN_S = 1.0
_SIDE_GAP_M, _SIDE_HEADWAY_S = 6.0, 2.0
_SLOW_EGO_MPS = 1.0

_SIREN_HEARD_M, _SIREN_PASSED_M = 38.0, 8.0
_FAR_M = 1e6


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
def _ramp_m(ego: Records) -> float:
    """Way over which the ego moves over at its present speed."""
    return float(max(_SHIFT_MIN_M, _SHIFT_S * ego.speed_mps))


@kernel
def _meeting_m(ego: Records, arc_m: float, drift_mps: float) -> float:
    """Arc length at which the ego reaches a place that moves along the route, `arc_m` now."""
    closing = max(ego.speed_mps - drift_mps, _SLOW_EGO_MPS)
    return float(arc_m + drift_mps * max(arc_m - ego.arc_m, 0.0) / closing)


@kernel
def _try_side(plan: Records, bodies: Records, feet: Records, obstacle: int, side: int) -> bool:
    """Plan the shift to one side, +1 left or -1 right, if the ego is there already or the lane there is free."""
    ego = feet[EGO]
    drift = max(feet[obstacle].speed_mps, 0.0)
    begin_m, end_m, right_m, left_m = blocked_stretch(bodies, feet, obstacle)
    reach_m = ego.half_length_m + _LONGITUDINAL_CLEARANCE_M
    full_m, hold_m = _meeting_m(ego, begin_m - reach_m, drift), _meeting_m(ego, end_m + reach_m, drift)
    length_m = _ramp_m(ego)
    edge_m = left_m if side > 0 else right_m
    shift_m = edge_m + side * (0.5 * bodies[EGO].width_m + _CLEARANCE_M)
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
def _siren(bodies: Records, feet: Records) -> int:
    """Row of the nearest body with a siren that comes from behind in the ego's lane, or `NOBODY`."""
    found, nearest_m = NOBODY, _SIREN_HEARD_M
    for index in range(EGO + 1, bodies.shape[0]):
        behind_m = feet[EGO].arc_m - feet[index].arc_m
        in_lane = abs(feet[index].offset_m) < 0.5 * LANE_WIDTH_M
        if bodies[index].siren and in_lane and -_SIREN_PASSED_M < behind_m < nearest_m:
            found, nearest_m = index, behind_m
    return found


@kernel
def _make_way(plan: Records, bodies: Records, feet: Records, path: Records, siren: int) -> None:
    """Plan a shift into a lane of the own direction, the right one first, until the siren has passed."""
    ego = feet[EGO]
    vertex = path[locate(path, ego.arc_m)]
    length_m = _ramp_m(ego)
    for side in (-1, 1):
        beside = vertex.left_lane if side > 0 else vertex.right_lane
        if beside == _SAME_DIRECTION and _is_free(bodies, feet, siren, side * LANE_WIDTH_M, ego.arc_m + length_m):
            plan.shift_m, plan.obstacle = side * LANE_WIDTH_M, siren
            plan.begin_m, plan.full_m = ego.arc_m, ego.arc_m + length_m
            plan.hold_m, plan.end_m = _FAR_M, 2.0 * _FAR_M
            return


@kernel
def _keep_siren(plan: Records, ego: Records, siren: Records) -> None:
    """End the shift once the siren has passed."""
    passed = siren.arc_m - siren.half_length_m > ego.arc_m + ego.half_length_m + _SIREN_PASSED_M
    if passed and plan.hold_m >= _FAR_M:
        plan.hold_m = ego.arc_m
        plan.end_m = ego.arc_m + _ramp_m(ego)
    if ego.arc_m > plan.end_m:
        plan.shift_m = 0.0


@kernel
def _keep_obstacle(plan: Records, bodies: Records, feet: Records) -> None:
    """Follow a moving obstacle, and end or drop the shift."""
    ego, foot = feet[EGO], feet[plan.obstacle]
    committed = abs(ego.offset_m) >= _IN_LANE_M or ego.arc_m >= plan.full_m
    if foot.speed_mps > _STANDSTILL_MPS and ego.arc_m < plan.hold_m:
        _, end_m, _, _ = blocked_stretch(bodies, feet, plan.obstacle)
        length_m = plan.end_m - plan.hold_m
        plan.hold_m = _meeting_m(ego, end_m + ego.half_length_m + _LONGITUDINAL_CLEARANCE_M, foot.speed_mps)
        plan.end_m = plan.hold_m + length_m
    useful = is_obstacle(bodies[plan.obstacle])
    possible = _is_free(bodies, feet, plan.obstacle, plan.shift_m, plan.end_m)
    # where a moving obstacle is met depends on the ego's speed, so a shift that has not begun is planned again
    outdated = foot.speed_mps > _STANDSTILL_MPS and ego.arc_m < plan.begin_m
    if ego.arc_m > plan.end_m or outdated or not (committed or (useful and possible)):
        plan.shift_m = 0.0


@kernel
def update_lane_shift(plan: Records, bodies: Records, feet: Records, path: Records) -> None:
    """Keep, drop or make the lane shift of `plan`; `feet` and `path` are those of the ego's track."""
    ego = feet[EGO]
    if plan.shift_m != 0.0:
        if bodies[plan.obstacle].siren:
            _keep_siren(plan, ego, feet[plan.obstacle])
        else:
            _keep_obstacle(plan, bodies, feet)
    if plan.shift_m == 0.0:
        obstacle = next_obstacle(bodies, feet, obstacle_sight_m(ego.speed_mps))
        if obstacle != NOBODY:
            _plan_shift(plan, bodies, feet, path, obstacle)
    if plan.shift_m == 0.0:
        siren = _siren(bodies, feet)
        if siren != NOBODY:
            _make_way(plan, bodies, feet, path, siren)
