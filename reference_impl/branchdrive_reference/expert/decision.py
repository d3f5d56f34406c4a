"""The expert's decision of one tick: the lowest acceleration over its hazards, and the steering."""

from __future__ import annotations

import numpy as np

from branchdrive_reference.expert.control import (
    Cause,
    pedals,
    pursuit_curvature_1pm,
    reference_offset_m,
    sight_m,
    steer_command,
)
from branchdrive_reference.expert.forecast import crossing_gap_m, nearest_conflict
from branchdrive_reference.expert.lane_shift import update_lane_shift
from branchdrive_reference.expert.obstacle import is_obstacle, obstacle_sight_m
from branchdrive_reference.geometry.polyline import locate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Heed, Kind
from branchdrive_reference.world.corridor import NOBODY
from branchdrive_reference.world.priority import AT_LINE_M, PAST_LINE_M, STOPPED_MPS, halt_gap_m, zipper_leader
from branchdrive_reference.world.traffic import HARDEST_BRAKE_MPS2, desired_gap_m, idm_accel_mps2

__all__ = ["decide"]

_CRUISE, _LEADER, _PEDESTRIAN, _CONFLICT, _SIGNAL, _PRIORITY = (int(cause) for cause in Cause)
_WALKER = int(Kind.PEDESTRIAN)
_HEEDS_ALL = int(Heed.ALL)

_ACCEL_MPS2 = 2.0
_FOLLOW_MPS2, _BRAKE_MPS2, _HEADWAY_S = 8.0, 4.0, 0.5
"""The driver model towards whatever stands ahead: late and firm, as PDM-Lite's."""

_MOVING_HEADWAY_S, _MOVING_MPS = 0.6, 5.0
"""Headway kept in addition to road users that move, in full from this speed on."""

_LEADER_STANDSTILL_M, _PEDESTRIAN_STANDSTILL_M, _OBSTACLE_STANDSTILL_M = 4.0, 6.0, 11.0
"""Gaps at standstill; before an obstacle there stays room to pull out."""

_LINE_STANDSTILL_M = 0.8
_PRIORITY_S = 1.2
"""Time kept to who has priority."""

_SIDE_MARGIN_M = 0.25
_SIGHT_M = 70.0
_CRUISE_LAG_S, _CRUISE_BRAKE_MPS2 = 0.8, 3.5
_TARGET_S = 0.5
_SHIFT_SPEED_MPS, _SHIFT_SHARE = 12.0, 0.85
"""Speed of a lane shift: the first, or this share of the advisory speed where that is more."""

_ASTRAY_M, _ASTRAY_MAX_MPS, _ASTRAY_MIN_MPS, _ASTRAY_SLOPE_1PS = 0.8, 12.0, 4.0, 4.0
"""Beyond this distance from the reference path the speed is capped, the lower the further away."""

_CONFLICT_MARGIN_M = 1.0


@kernel
def _cruise_speed_mps(plan: Records, path: Records, arc_m: float, offset_m: float) -> float:
    """Advisory speed of the route, lower on a lane shift and the further the ego is from its planned path."""
    speed = path[locate(path, arc_m)].advisory_speed_mps
    if plan.shift_m != 0.0 and arc_m + sight_m(speed) > plan.begin_m:
        speed = min(speed, max(_SHIFT_SPEED_MPS, _SHIFT_SHARE * speed))
    astray_m = abs(offset_m - reference_offset_m(plan, arc_m)) - _ASTRAY_M
    if astray_m > 0.0:
        speed = min(speed, max(_ASTRAY_MIN_MPS, _ASTRAY_MAX_MPS - _ASTRAY_SLOPE_1PS * astray_m))
    return float(speed)


@kernel
def _leader(plan: Records, bodies: Records, feet: Records) -> tuple[int, float]:
    """Nearest body ahead on the reference path and the bumper gap to it; `NOBODY` and infinity if none."""
    found, nearest_m = NOBODY, np.inf
    ego = feet[EGO]
    half_width_m = 0.5 * bodies[EGO].width_m + _SIDE_MARGIN_M
    for index in range(EGO + 1, feet.shape[0]):
        foot = feet[index]
        gap_m = foot.arc_m - foot.half_length_m - ego.arc_m - ego.half_length_m
        sight_m = obstacle_sight_m(ego.speed_mps) if is_obstacle(bodies[index]) else _SIGHT_M
        if foot.arc_m <= ego.arc_m or foot.arc_m - ego.arc_m > sight_m or gap_m >= nearest_m:
            continue
        if abs(foot.offset_m - reference_offset_m(plan, foot.arc_m)) < half_width_m + foot.half_width_m:
            found, nearest_m = index, gap_m
    return found, nearest_m


@kernel
def _follow(speed_mps: float, lead_speed_mps: float, gap_m: float, standstill_m: float) -> float:
    """Interaction part of the driver model; the cruising speed is a hazard of its own."""
    headway_s = _HEADWAY_S + _MOVING_HEADWAY_S * min(max(lead_speed_mps / _MOVING_MPS, 0.0), 1.0)
    wanted_m = desired_gap_m(speed_mps, lead_speed_mps, headway_s, standstill_m, _FOLLOW_MPS2, _BRAKE_MPS2)
    return idm_accel_mps2(speed_mps, np.inf, gap_m, wanted_m, _FOLLOW_MPS2)


@kernel
def _stop_sign_gap_m(plan: Records, foot: Records, track: Records) -> float:
    """Way to the line of a stop sign at which the ego has not stopped yet, infinite otherwise."""
    gap_m = track.stop_m - foot.arc_m - foot.half_length_m
    if not track.stop_sign or plan.stopped or gap_m < -PAST_LINE_M:
        return np.inf
    if foot.speed_mps < STOPPED_MPS and gap_m < AT_LINE_M:
        plan.stopped = 1
        return np.inf
    return float(gap_m)


@kernel
def _cause_of(body: Records, otherwise: int) -> int:
    return _PEDESTRIAN if body.kind == _WALKER else otherwise


@kernel
def decide(
    plan: Records, bodies: Records, feet: Records, vertices: Records, tracks: Records, conflicts: Records,
    lights: Records,
) -> None:  # fmt: skip
    """Set the target speed, cause and commands of `plan` (a `PLAN` row) for the present state.

    Args:
        plan: Memory and decision.
        bodies: `BODY` rows.
        feet: `FOOT` rows ``[tracks, bodies]``, up to date.
        vertices: `VERTEX` rows of all tracks.
        tracks: `TRACK` rows.
        conflicts: `CONFLICT` rows.
        lights: `Light` of each signal group ``[2]``.
    """
    path, row = vertices[tracks[EGO_TRACK].first : tracks[EGO_TRACK].end], feet[EGO_TRACK]
    ego, foot = bodies[EGO], row[EGO]
    update_lane_shift(plan, bodies, row, path)
    speed = max(ego.speed_mps, 0.0)
    cruise = _cruise_speed_mps(plan, path, foot.arc_m, foot.offset_m)
    accel = min(max((cruise - speed) / _CRUISE_LAG_S, -_CRUISE_BRAKE_MPS2), _ACCEL_MPS2)
    plan.cause = _CRUISE

    leader, gap_m = _leader(plan, bodies, row)
    if leader != NOBODY:
        standstill_m = _OBSTACLE_STANDSTILL_M if is_obstacle(bodies[leader]) else _LEADER_STANDSTILL_M
        candidate = _follow(speed, row[leader].speed_mps, gap_m, standstill_m)
        if candidate < accel:
            accel, plan.cause = candidate, _cause_of(bodies[leader], _LEADER)
    halt_m, by_signal = halt_gap_m(bodies, feet, tracks, conflicts, lights, EGO_TRACK, EGO, _HEEDS_ALL, _PRIORITY_S)
    sign_m = _stop_sign_gap_m(plan, foot, tracks[EGO_TRACK])
    by_signal = by_signal or sign_m < halt_m
    halt_m = min(halt_m, sign_m)
    if halt_m < np.inf:
        candidate = _follow(speed, 0.0, halt_m, _LINE_STANDSTILL_M)
        if candidate < accel:
            accel, plan.cause = candidate, _SIGNAL if by_signal else _PRIORITY
    rival, gap_m = zipper_leader(bodies, feet, conflicts, EGO_TRACK, EGO)
    if rival != NOBODY:
        candidate = max(_follow(speed, bodies[rival].speed_mps, gap_m, _LEADER_STANDSTILL_M), -_CRUISE_BRAKE_MPS2)
        if candidate < accel:
            accel, plan.cause = candidate, _PRIORITY
    crossing_m = crossing_gap_m(plan, bodies, row)
    if crossing_m < np.inf:
        candidate = _follow(speed, 0.0, crossing_m, _PEDESTRIAN_STANDSTILL_M)
        if candidate < accel:
            accel, plan.cause = candidate, _PEDESTRIAN
    rival, conflict_m = nearest_conflict(plan, bodies, row, vertices, tracks, leader)
    if rival != NOBODY:
        candidate = -(max(speed, 1.0) ** 2) / (2.0 * max(conflict_m - _CONFLICT_MARGIN_M, 0.5))
        if candidate < accel:
            accel, plan.cause = max(candidate, -HARDEST_BRAKE_MPS2), _cause_of(bodies[rival], _CONFLICT)

    plan.target_speed_mps = max(0.0, speed + accel * _TARGET_S)
    plan.sighted_offset_m = reference_offset_m(plan, foot.arc_m + sight_m(speed))
    throttle, brake = pedals(accel, speed)
    curvature = pursuit_curvature_1pm(plan, path, ego.x_m, ego.y_m, ego.yaw_rad, foot.arc_m, speed)
    plan.steer = np.float32(min(max(steer_command(curvature), -1.0), 1.0))
    plan.throttle, plan.brake = np.float32(throttle), np.float32(brake)
