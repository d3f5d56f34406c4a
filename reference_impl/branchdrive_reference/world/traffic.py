"""Traffic and pedestrians: where every body that is not the ego wants to be after one tick.

Intelligent driver model.

``a = a_0 [1 - (v / v_0)^4 - (s* / s)^2]`` with ``s* = s_0 + max(0, v T + v (v - v_lead) / (2 sqrt(a_0 b)))``.
Source: Treiber, Hennecke and Helbing, "Congested traffic states in empirical observations and
microscopic simulations", Physical Review E 62 (2000).
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.geometry.polyline import interpolate, locate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.noise import Purpose, uniform
from branchdrive_reference.world.body import EGO, Behaviour, Heed
from branchdrive_reference.world.corridor import NOBODY, nearest_ahead
from branchdrive_reference.world.priority import halt_gap_m, zipper_leader
from branchdrive_reference.world.vehicle import GRAVITY_MPS2, slip

__all__ = ["HARDEST_BRAKE_MPS2", "advance_traffic", "desired_gap_m", "following_accel_mps2", "idm_accel_mps2"]

_FOLLOWING, _WALKING, _FREE = int(Behaviour.FOLLOWING), int(Behaviour.WALKING), int(Behaviour.FREE)
_PRIORITY = int(Heed.PRIORITY)
_MOOD = int(Purpose.TRAFFIC_MOOD)
_MOOD_TICKS = 40
_MOOD_SHARE = 0.06
"""Drivers change their desired speed every 2 s by up to this share."""

_ACCEL_MPS2, _BRAKE_MPS2, _STANDSTILL_M = 1.5, 2.0, 2.0
_LINE_STANDSTILL_M = 0.6
_PRIORITY_S = 0.8
_ZIPPER_BRAKE_MPS2 = 2.5
"""Nobody brakes harder than this to let somebody in."""

_SIDE_MARGIN_M = 0.3
_MOST_ASIDE = 0.5
"""Sideways per way ahead, at most, while moving over."""

_MAX_TURN_RAD = 1.2 * TICK_S
_SLIDING_FRICTION = 0.6
_SPIN_DECEL_RADPS2 = 4.0


@kernel
def _behind(body: Records, lead_speed_mps: float, gap_m: float, standstill_m: float, free_mps2: float) -> float:
    """Acceleration behind somebody or something, at most that of the free road."""
    wanted_m = desired_gap_m(body.speed_mps, lead_speed_mps, body.headway_s, standstill_m, _ACCEL_MPS2, _BRAKE_MPS2)
    return min(free_mps2, idm_accel_mps2(body.speed_mps, np.inf, gap_m, wanted_m, _ACCEL_MPS2))


@kernel
def following_accel_mps2(
    bodies: Records, feet: Records, vertices: Records, tracks: Records, conflicts: Records, lights: Records,
    index: int, seed: int, tick: int,
) -> float:  # fmt: skip
    """Driver-model acceleration of body `index` on its track; notes where it means to halt.

    It reacts to whatever is ahead, to signals, and to who has priority, as far as it heeds them.
    """
    body, row = bodies[index], feet[bodies[index].track]
    path = vertices[tracks[body.track].first : tracks[body.track].end]
    mood = 1.0 + _MOOD_SHARE * (2.0 * uniform(seed, _MOOD, index, tick // _MOOD_TICKS) - 1.0)
    advisory = path[locate(path, body.arc_m)].advisory_speed_mps
    accel = idm_accel_mps2(body.speed_mps, body.eagerness * mood * advisory, np.inf, 0.0, _ACCEL_MPS2)
    lead, gap_m = nearest_ahead(row, index, body.offset_m, 0.5 * body.width_m + _SIDE_MARGIN_M)
    if lead != NOBODY:
        accel = _behind(body, row[lead].speed_mps, gap_m, _STANDSTILL_M, accel)
    body.halt_m = np.inf
    if conflicts.shape[0] == 0 and tracks[body.track].group < 0:
        return accel
    halt_m, _ = halt_gap_m(bodies, feet, tracks, conflicts, lights, body.track, index, body.heeds, _PRIORITY_S)
    if halt_m < np.inf:
        accel = _behind(body, 0.0, halt_m, _LINE_STANDSTILL_M, accel)
        body.halt_m = row[index].arc_m + row[index].half_length_m + halt_m
    if body.heeds & _PRIORITY:
        rival, gap_m = zipper_leader(bodies, feet, conflicts, body.track, index)
        if rival != NOBODY:
            let_in = _behind(body, bodies[rival].speed_mps, gap_m, _STANDSTILL_M, accel)
            accel = min(accel, max(let_in, -_ZIPPER_BRAKE_MPS2))
    return accel


@kernel
def _slide(body: Records) -> None:
    """Friction of a body that was hit: Coulomb on its velocity and on its spin."""
    speed = math.hypot(body.vel_x_mps, body.vel_y_mps)
    keep = max(0.0, speed - _SLIDING_FRICTION * GRAVITY_MPS2 * TICK_S) / max(speed, 1e-9)
    body.vel_x_mps *= keep
    body.vel_y_mps *= keep
    body.yaw_rate_radps = slip(body.yaw_rate_radps, 0.0, _SPIN_DECEL_RADPS2 * TICK_S)


@kernel
def advance_traffic(
    bodies: Records, feet: Records, vertices: Records, tracks: Records, conflicts: Records, lights: Records,
    goals: Records, seed: int, tick: int,
) -> None:  # fmt: skip
    """Choose velocities for the coming tick and the poses they lead to.

    The tables are those of `RouteTracks`, `lights` is the `Light` of each signal group ``[2]``.
    Writes ``goals[bodies, 3]`` (x, y, yaw at the end of the tick) and the speeds and velocities of
    `bodies`; free bodies have no goal, and the ego is left alone.
    """
    accel = np.zeros(bodies.shape[0])
    for index in range(bodies.shape[0]):
        body = bodies[index]
        if body.behaviour == _FOLLOWING:
            accel[index] = body.commanded_accel_mps2
            if math.isnan(accel[index]):
                accel[index] = following_accel_mps2(
                    bodies, feet, vertices, tracks, conflicts, lights, index, seed, tick
                )
    for index in range(EGO + 1, bodies.shape[0]):
        body = bodies[index]
        if body.behaviour == _FREE:
            _slide(body)
            continue
        x, y, yaw = body.x_m, body.y_m, body.yaw_rad
        if body.behaviour == _FOLLOWING:
            before = body.speed_mps
            body.speed_mps = max(0.0, before + accel[index] * TICK_S)
            way_m = 0.5 * (before + body.speed_mps) * TICK_S
            body.arc_m += way_m
            aside_m = slip(body.offset_m, body.goal_offset_m, min(body.lateral_mps * TICK_S, _MOST_ASIDE * way_m))
            path = vertices[tracks[body.track].first : tracks[body.track].end]
            x, y, tangent = interpolate(path, body.arc_m, aside_m)
            if aside_m != body.offset_m:
                tangent += math.atan2(aside_m - body.offset_m, way_m)
            yaw += slip(0.0, wrap(tangent - yaw), _MAX_TURN_RAD)
            body.offset_m = aside_m
        elif body.behaviour == _WALKING:
            step_m = min(body.speed_mps * TICK_S, body.travel_m)
            body.travel_m -= step_m
            x += step_m * math.cos(yaw)
            y += step_m * math.sin(yaw)
        body.vel_x_mps, body.vel_y_mps = (x - body.x_m) / TICK_S, (y - body.y_m) / TICK_S
        body.yaw_rate_radps = (yaw - body.yaw_rad) / TICK_S
        goals[index, 0], goals[index, 1], goals[index, 2] = x, y, yaw


HARDEST_BRAKE_MPS2 = 8.0
_SMALLEST_GAP_M = 0.1


@kernel
def desired_gap_m(
    speed_mps: float, lead_speed_mps: float, headway_s: float, standstill_m: float, accel_mps2: float, brake_mps2: float
) -> float:
    """Gap ``s*`` that the driver wants to keep."""
    dynamic = speed_mps * headway_s
    dynamic += speed_mps * (speed_mps - lead_speed_mps) / (2.0 * math.sqrt(accel_mps2 * brake_mps2))
    return standstill_m + max(0.0, dynamic)


@kernel
def idm_accel_mps2(
    speed_mps: float, desired_speed_mps: float, gap_m: float, wanted_gap_m: float, accel_mps2: float
) -> float:
    """Acceleration, not below the hardest braking; `gap_m` is bumper to bumper, infinity without a leader."""
    free = (speed_mps / desired_speed_mps) ** 4
    blocked = (wanted_gap_m / max(gap_m, _SMALLEST_GAP_M)) ** 2
    return max(accel_mps2 * (1.0 - free - blocked), -HARDEST_BRAKE_MPS2)
