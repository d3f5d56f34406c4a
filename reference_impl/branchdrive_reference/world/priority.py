"""Right of way: where a driver has to stop before a junction, and whom it follows into a merge.

A driver waits before a conflict (`town.conflict`) if its own passage and that of somebody with priority would
overlap in time: its own as `travel_s` says, the other's at constant speed. One that means to halt before the conflict
is no reason to wait.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.signal import Light
from branchdrive_reference.world.body import EGO, Behaviour, Heed
from branchdrive_reference.world.corridor import NOBODY

__all__ = ["AT_LINE_M", "PAST_LINE_M", "STOPPED_MPS", "halt_gap_m", "travel_s", "zipper_leader"]

_GREEN, _RED = int(Light.GREEN), int(Light.RED)
_FOLLOWING = int(Behaviour.FOLLOWING)
_SIGNALS, _PRIORITY = int(Heed.SIGNALS), int(Heed.PRIORITY)

_FIRMEST_RED_MPS2, _FIRMEST_YELLOW_MPS2, _FIRMEST_YIELD_MPS2 = 6.0, 2.5, 5.5
"""Who would have to brake harder than this goes on."""

PAST_LINE_M = 1.5
"""Who is further beyond a line than this does not stop for it any more."""

STOPPED_MPS, AT_LINE_M = 0.2, 5.0
"""Slower than this, with the front at most this far before the line, is a stop at a stop sign."""

_START_ACCEL_MPS2, _CROSSING_MPS = 1.5, 7.0
_CREEP_MPS = 0.5
_IN_LANE_M = 2.5
_NOTICE_M = 90.0
_ZIPPER_NOTICE_M = 45.0
_YIELD_LINE_M = 1.0


@kernel
def travel_s(way_m: float, speed_mps: float) -> float:
    """Time over a way at the present speed, or speeding up to a crossing speed if that is faster."""
    if way_m <= 0.0:
        return 0.0
    if speed_mps >= _CROSSING_MPS:
        return way_m / speed_mps
    ramp_s = (_CROSSING_MPS - speed_mps) / _START_ACCEL_MPS2
    ramp_m = 0.5 * (speed_mps + _CROSSING_MPS) * ramp_s
    if way_m >= ramp_m:
        return ramp_s + (way_m - ramp_m) / _CROSSING_MPS
    return (math.sqrt(speed_mps * speed_mps + 2.0 * _START_ACCEL_MPS2 * way_m) - speed_mps) / _START_ACCEL_MPS2


@kernel
def _can_stop(gap_m: float, speed_mps: float, firmest_mps2: float) -> bool:
    return speed_mps * speed_mps <= 2.0 * firmest_mps2 * max(gap_m, 0.05)


@kernel
def _is_threat(
    bodies: Records, feet: Records, conflict: Records, rival: int, enters_s: float, leaves_s: float, margin_s: float
) -> bool:
    """Whether `rival` passes the conflict within `margin_s` of the interval in which the driver would."""
    body = bodies[rival]
    if body.track != conflict.other or (rival != EGO and body.behaviour != _FOLLOWING):
        return False
    foot = feet[conflict.other, rival]
    to_enter_m = conflict.other_enter_m - foot.arc_m - foot.half_length_m
    to_leave_m = conflict.other_leave_m - foot.arc_m + foot.half_length_m
    if to_leave_m < 0.0 or to_enter_m > _NOTICE_M or abs(foot.offset_m) > _IN_LANE_M:
        return False
    if to_enter_m <= 0.0:
        return True
    if foot.speed_mps < _CREEP_MPS or (rival != EGO and body.halt_m < conflict.other_enter_m):
        return False
    rival_enters_s, rival_leaves_s = to_enter_m / foot.speed_mps, to_leave_m / foot.speed_mps
    return bool(enters_s < rival_leaves_s + margin_s and rival_enters_s < leaves_s + margin_s)


@kernel
def _must_wait(bodies: Records, feet: Records, conflict: Records, own: int, margin_s: float) -> bool:
    foot = feet[conflict.track, own]
    speed = max(foot.speed_mps, 0.0)
    enters_s = travel_s(conflict.enter_m - foot.arc_m - foot.half_length_m, speed)
    leaves_s = travel_s(conflict.leave_m - foot.arc_m + foot.half_length_m, speed)
    for rival in range(bodies.shape[0]):
        if rival != own and _is_threat(bodies, feet, conflict, rival, enters_s, leaves_s, margin_s):
            return True
    return False


@kernel
def halt_gap_m(
    bodies: Records, feet: Records, tracks: Records, conflicts: Records, lights: Records,
    track: int, own: int, heeds: int, margin_s: float,
) -> tuple[float, bool]:  # fmt: skip
    """Way that the front of body `own` has until it has to stop, and whether a signal is the reason.

    Args:
        bodies: `BODY` rows.
        feet: `FOOT` rows ``[tracks, bodies]``.
        tracks: `TRACK` rows.
        conflicts: `CONFLICT` rows.
        lights: `Light` of each signal group ``[2]``.
        track: Track that the body follows.
        own: Row of the body.
        heeds: `Heed` flags of its driver.
        margin_s: Time kept to who has priority.

    Returns:
        Metres, infinite where nothing holds it; negative once the front is beyond the line.
    """
    foot, row = feet[track, own], tracks[track]
    speed = max(foot.speed_mps, 0.0)
    front_m = foot.arc_m + foot.half_length_m
    nearest_m, by_signal = np.inf, False
    gap_m = row.stop_m - front_m
    if row.group >= 0 and heeds & _SIGNALS and -PAST_LINE_M < gap_m < _NOTICE_M and lights[row.group] != _GREEN:
        firmest = _FIRMEST_RED_MPS2 if lights[row.group] == _RED else _FIRMEST_YELLOW_MPS2
        if _can_stop(gap_m, speed, firmest):
            nearest_m, by_signal = gap_m, True
    if heeds & _PRIORITY:
        for index in range(conflicts.shape[0]):
            conflict = conflicts[index]
            if conflict.track != track or not conflict.yields or conflict.zipper or front_m > conflict.enter_m:
                continue
            # a left turn waits inside the junction, everybody else at the line
            line_m = conflict.enter_m - _YIELD_LINE_M if row.group >= 0 else row.stop_m
            gap_m = line_m - front_m
            if gap_m < -PAST_LINE_M or gap_m > _NOTICE_M or gap_m >= nearest_m:
                continue
            if _can_stop(gap_m, speed, _FIRMEST_YIELD_MPS2) and _must_wait(bodies, feet, conflict, own, margin_s):
                nearest_m, by_signal = gap_m, False
    return nearest_m, by_signal


@kernel
def zipper_leader(bodies: Records, feet: Records, conflicts: Records, track: int, own: int) -> tuple[int, float]:
    """Whom body `own` follows into a merge, and the bumper gap to it along the way to the join.

    `NOBODY` and infinity where it is not near a merge or goes first.
    """
    found, nearest_m = NOBODY, np.inf
    for index in range(conflicts.shape[0]):
        conflict = conflicts[index]
        if conflict.track != track or not conflict.zipper:
            continue
        foot = feet[track, own]
        to_join_m = conflict.leave_m - foot.arc_m
        if to_join_m < 0.0 or foot.arc_m < conflict.enter_m - _ZIPPER_NOTICE_M:
            continue
        for rival in range(bodies.shape[0]):
            body = bodies[rival]
            if rival == own or body.track != conflict.other or (rival != EGO and body.behaviour != _FOLLOWING):
                continue
            other = feet[conflict.other, rival]
            rival_to_join_m = conflict.other_leave_m - other.arc_m
            if rival_to_join_m < 0.0 or other.arc_m < conflict.other_enter_m - _ZIPPER_NOTICE_M:
                continue
            gap_m = to_join_m - rival_to_join_m - foot.half_length_m - other.half_length_m
            is_first = rival_to_join_m < to_join_m or (rival_to_join_m == to_join_m and rival < own)
            if is_first and gap_m < nearest_m and abs(other.offset_m) < _IN_LANE_M:
                found, nearest_m = rival, gap_m
    return found, nearest_m
