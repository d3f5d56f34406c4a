"""Where bodies are along tracks, and what stands in the way of one that follows a track."""

from __future__ import annotations

import math

import numpy as np

from branchdrive_reference.geometry.box import half_extent_along
from branchdrive_reference.geometry.polyline import project
from branchdrive_reference.kernel import Records, kernel

__all__ = ["FOOT", "NOBODY", "find_feet", "nearest_ahead", "update_feet"]

FOOT = np.dtype(
    [
        ("arc_m", np.float64),
        ("offset_m", np.float64),  # to the left of the track
        ("half_length_m", np.float64),  # half the shadow of the box along the track
        ("half_width_m", np.float64),  # and across it
        ("speed_mps", np.float64),  # velocity along the track
        ("drift_mps", np.float64),  # velocity across it, to the left
        ("segment", np.int64),
    ],
    align=True,
)
"""A body relative to a track."""

NOBODY = -1
_FAR_M = 90.0
_NOTICE_S = 0.8
"""A body that drifts towards the corridor counts this long before it is in."""


@kernel
def _set_foot(foot: Records, body: Records, path: Records) -> None:
    """`foot` (a `FOOT` row) of one `BODY` row, searched from the segment it holds."""
    foot.arc_m, foot.offset_m, foot.segment = project(path, body.x_m, body.y_m, foot.segment)
    vertex = path[foot.segment]
    direction = math.atan2(path[foot.segment + 1].y_m - vertex.y_m, path[foot.segment + 1].x_m - vertex.x_m)
    skew = body.yaw_rad - direction
    foot.half_length_m = half_extent_along(skew, body.length_m, body.width_m)
    foot.half_width_m = half_extent_along(skew, body.width_m, body.length_m)
    cos, sin = math.cos(direction), math.sin(direction)
    foot.speed_mps = body.vel_x_mps * cos + body.vel_y_mps * sin
    foot.drift_mps = body.vel_y_mps * cos - body.vel_x_mps * sin


@kernel
def find_feet(feet: Records, bodies: Records, vertices: Records, tracks: Records) -> None:
    """Start the segment hints of ``feet[tracks, bodies]`` at the globally nearest vertices."""
    for track in range(tracks.shape[0]):
        path = vertices[tracks[track].first : tracks[track].end]
        for index in range(bodies.shape[0]):
            best = np.inf
            for vertex in range(path.shape[0] - 1):
                dx, dy = path[vertex].x_m - bodies[index].x_m, path[vertex].y_m - bodies[index].y_m
                if dx * dx + dy * dy < best:
                    best = dx * dx + dy * dy
                    feet[track, index].segment = vertex


@kernel
def update_feet(feet: Records, bodies: Records, vertices: Records, tracks: Records) -> None:
    """Move ``feet[tracks, bodies]`` to the bodies' present poses."""
    for track in range(tracks.shape[0]):
        path = vertices[tracks[track].first : tracks[track].end]
        for index in range(bodies.shape[0]):
            _set_foot(feet[track, index], bodies[index], path)


@kernel
def nearest_ahead(feet: Records, own: int, offset_m: float, half_width_m: float) -> tuple[int, float]:
    """Nearest body in a corridor ahead of body `own`, or about to step into it, and the bumper gap to it.

    Args:
        feet: `FOOT` rows of one track ``[bodies]``.
        own: Row of the body that looks ahead.
        offset_m: Centre of the corridor, to the left of the track.
        half_width_m: Half the corridor's width.

    Returns:
        Row and gap in metres (negative on overlap); `NOBODY` and infinity where the corridor is free.
    """
    found, gap_m = NOBODY, np.inf
    front_m = feet[own].arc_m + feet[own].half_length_m
    for index in range(feet.shape[0]):
        foot = feet[index]
        ahead_m = foot.arc_m - feet[own].arc_m
        if index == own or ahead_m <= 0.0 or ahead_m > _FAR_M:
            continue
        aside_m = foot.offset_m - offset_m
        approach_mps = -foot.drift_mps if aside_m > 0.0 else foot.drift_mps
        if abs(aside_m) - max(0.0, approach_mps) * _NOTICE_S >= half_width_m + foot.half_width_m:
            continue
        candidate = foot.arc_m - foot.half_length_m - front_m
        if candidate < gap_m:
            found, gap_m = index, candidate
    return found, gap_m
