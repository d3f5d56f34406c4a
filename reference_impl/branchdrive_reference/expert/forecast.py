"""Short kinematic forecasts of what the ego would hit if it kept its speed.

* A pedestrian, or a cyclist who crosses the road, is a hazard while it will be in the ego's band of the road
  during the time in which the ego passes its place (both at constant velocity).
* Any other body conflicts when its forecast box (along its track, or straight on if it has none)
  meets the ego's, which follows its reference path.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive_reference.expert.control import pursuit_curvature_1pm, reference_offset_m
from branchdrive_reference.geometry.box import boxes_overlap
from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Behaviour, Kind
from branchdrive_reference.world.corridor import NOBODY
from branchdrive_reference.world.vehicle import slip

__all__ = ["crossing_gap_m", "nearest_conflict"]

_PEDESTRIAN = int(Kind.PEDESTRIAN)
_FOLLOWING, _WALKING = int(Behaviour.FOLLOWING), int(Behaviour.WALKING)

_PEDESTRIAN_MARGIN_M = 0.7
_PEDESTRIAN_MARGIN_S = 0.6
_PEDESTRIAN_HORIZON_S = 1.4
"""A pedestrian counts once it will be in the band this soon."""

_SLOWEST_MPS = 3.0
"""Speeds below this are forecast as this, so that a stopped ego stays stopped for who is crossing."""

_STEP_S, _STEPS = 0.2, 10
_BOX_MARGIN_M = 0.2
_SIGHT_M = 60.0


@kernel
def _band_interval_s(offset_m: float, drift_mps: float, half_band_m: float) -> tuple[float, float]:
    """When ``|offset + drift t| <= half_band`` for ``t >= 0``; empty intervals have begin > end."""
    if abs(drift_mps) < 0.05:
        return (0.0, np.inf) if abs(offset_m) <= half_band_m else (1.0, 0.0)
    enters, leaves = (-half_band_m - offset_m) / drift_mps, (half_band_m - offset_m) / drift_mps
    if enters > leaves:
        enters, leaves = leaves, enters
    return max(enters, 0.0), leaves


@kernel
def _on_foot(body: Records) -> bool:
    return bool(body.kind == _PEDESTRIAN or body.behaviour == _WALKING)


@kernel
def crossing_gap_m(plan: Records, bodies: Records, feet: Records) -> float:
    """Gap to the nearest pedestrian that the ego would meet, metres; infinite if there is none."""
    nearest_m = np.inf
    ego = feet[EGO]
    speed = max(ego.speed_mps, _SLOWEST_MPS)
    for index in range(EGO + 1, bodies.shape[0]):
        foot = feet[index]
        gap_m = foot.arc_m - foot.half_length_m - ego.arc_m - ego.half_length_m
        if not _on_foot(bodies[index]) or gap_m > _SIGHT_M or gap_m < -2.0 * ego.half_length_m:
            continue
        half_band_m = 0.5 * bodies[EGO].width_m + foot.half_width_m + _PEDESTRIAN_MARGIN_M
        offset_m = foot.offset_m - reference_offset_m(plan, foot.arc_m)
        enters_s, leaves_s = _band_interval_s(offset_m, foot.drift_mps, half_band_m)
        if enters_s > _PEDESTRIAN_HORIZON_S or leaves_s < 0.0 or enters_s > leaves_s:
            continue
        arrives_s = max(gap_m, 0.0) / speed
        passed_s = (gap_m + 2.0 * (ego.half_length_m + foot.half_length_m)) / speed
        if enters_s <= passed_s + _PEDESTRIAN_MARGIN_S and leaves_s >= arrives_s - _PEDESTRIAN_MARGIN_S:
            nearest_m = min(nearest_m, max(gap_m, 0.0))
    return nearest_m


@kernel
def _forecast_pose(body: Records, vertices: Records, tracks: Records, ahead_s: float) -> tuple[float, float, float]:
    if body.behaviour == _FOLLOWING:
        path = vertices[tracks[body.track].first : tracks[body.track].end]
        halt_m = max(body.arc_m, body.halt_m - 0.5 * body.length_m)
        arc_m = min(body.arc_m + body.speed_mps * ahead_s, halt_m)
        return interpolate(path, arc_m, slip(body.offset_m, body.goal_offset_m, body.lateral_mps * ahead_s))
    x, y = body.x_m + body.vel_x_mps * ahead_s, body.y_m + body.vel_y_mps * ahead_s
    return x, y, body.yaw_rad


@kernel
def nearest_conflict(
    plan: Records, bodies: Records, feet: Records, vertices: Records, tracks: Records, leader: int
) -> tuple[int, float]:
    """Body ahead, other than the `leader`, that the ego meets first, and the way to go until then.

    `NOBODY` and infinity if there is none within the horizon.
    """
    path = vertices[tracks[EGO_TRACK].first : tracks[EGO_TRACK].end]
    ego = bodies[EGO]
    speed = max(feet[EGO].speed_mps, ego.speed_mps, _SLOWEST_MPS)
    x, y, yaw, arc = ego.x_m, ego.y_m, ego.yaw_rad, feet[EGO].arc_m
    ahead_x, ahead_y = math.cos(yaw), math.sin(yaw)
    for step in range(1, _STEPS + 1):
        rate = speed * pursuit_curvature_1pm(plan, path, x, y, yaw, arc, speed)
        heading = yaw + 0.5 * rate * _STEP_S
        x += speed * math.cos(heading) * _STEP_S
        y += speed * math.sin(heading) * _STEP_S
        yaw += rate * _STEP_S
        arc += speed * _STEP_S
        for index in range(EGO + 1, bodies.shape[0]):
            body = bodies[index]
            dx, dy = body.x_m - ego.x_m, body.y_m - ego.y_m
            if index == leader or dx * ahead_x + dy * ahead_y < 0.0 or dx * dx + dy * dy > _SIGHT_M * _SIGHT_M:
                continue
            bx, by, bend = _forecast_pose(body, vertices, tracks, step * _STEP_S)
            margin = 2.0 * _BOX_MARGIN_M
            if boxes_overlap(
                x, y, yaw, ego.length_m + margin, ego.width_m + margin, bx, by, bend, body.length_m, body.width_m
            ):
                return index, speed * _STEP_S * (step - 1)
    return NOBODY, np.inf
