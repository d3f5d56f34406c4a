"""Which way lanes are driven: how many vehicles drive along each lane, and how many against it.

The vehicles are the ego of each nominal, at a few observations, and those that are recorded around it at its branch,
where they move and one lane alone holds their centre; the ego where it is on its route, as it may overtake beside it.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import PreconditionError
from branchdrive.raw.motion.outline import OUTLINE_OFFSETS
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import lanes_along

__all__ = ["lane_use"]

Array = NDArray[np.float64]

MIN_COSINE = 0.7
"""Of the angle between a vehicle and its lane: at more than 45 degrees it crosses the lane."""

_IDS = 1 << 32
"""More than the largest identity of an actor, the ego's own included."""


@np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
def lane_use(view: ShardView) -> dict[tuple[str, str], tuple[int, int]]:
    """Numbers of vehicles along each lane and against it, by town and lane; a lane that nobody drives has none.

    A map that covers too much ground has no lanes here: the rules on what lies under the ego say so.
    """
    if "map" not in view:
        return {}
    bodies, attempts, x_m, y_m, vel_x_mps, vel_y_mps = (
        np.concatenate(part) for part in zip(*_vehicles(view), strict=True)
    )
    speed_mps = np.hypot(vel_x_mps, vel_y_mps)
    moves = (speed_mps >= physical_bounds().driving_mps) & (np.maximum(np.abs(x_m), np.abs(y_m)) <= 1e7)
    bodies, attempts, x_m, y_m = bodies[moves], attempts[moves], x_m[moves], y_m[moves]
    towns = view.rollouts.categories("town")[0].astype(np.int64)[attempts]
    try:
        point, lane, heading_rad = lanes_along(view, towns, x_m, y_m)
    except PreconditionError:
        return {}
    cosine = np.cos(heading_rad - np.arctan2(vel_y_mps[moves], vel_x_mps[moves])[point])
    counts = np.abs(cosine) >= MIN_COSINE
    codes, lanes = view.map.categories("lane_id")
    keys = np.stack([towns[point], codes[lane], bodies[point]])[:, counts]
    (town, code, _), member = np.unique(keys, axis=1, return_inverse=True)
    votes = np.bincount(member.reshape(-1), np.sign(cosine[counts]), len(town))
    names = view.rollouts.categories("town")[1]
    found: dict[tuple[str, str], tuple[int, int]] = {}
    for own, label, vote in zip(town.tolist(), code.tolist(), votes.tolist(), strict=True):
        along, against = found.get((names[own], lanes[label]), (0, 0))
        found[names[own], lanes[label]] = along + (vote > 0), against + (vote < 0)
    return found


def _vehicles(view: ShardView) -> list[tuple[Array, ...]]:
    """Identity of vehicles of the shard, row of their attempt, positions and velocities, of the ego and of others."""
    nominals = np.flatnonzero(view.branched & view.rollouts.equals("role", "nominal"))
    observations = view.observations
    ticks = view.branch_tick[nominals][:, None] + np.asarray(OUTLINE_OFFSETS)
    at = observations.find(np.broadcast_to(nominals[:, None], ticks.shape), ticks)
    at = at[at >= 0]
    at = at[np.abs(observations["route_offset_m"][at]) <= physical_bounds().deviated_m]
    owner, yaw, speed = observations.rollout[at], observations["yaw_rad"][at], observations["speed_mps"][at]
    place = [observations[name][at].astype(np.float64) for name in ("x_m", "y_m")]
    found = [(owner * _IDS, owner, *place, speed * np.cos(yaw), speed * np.sin(yaw))]
    if "actors" in view:
        actors = view.stream("actors")
        start, stop = actors.span(nominals, view.branch_tick[nominals])
        count = stop - start
        owner = np.repeat(nominals, count)
        row = np.arange(len(owner)) + np.repeat(start - np.cumsum(count) + count, count)
        is_vehicle = actors.equals("actor_class", "vehicle")[row]
        owner, row = owner[is_vehicle], row[is_vehicle]
        columns = [actors[name][row].astype(np.float64) for name in ("x_m", "y_m", "vel_x_mps", "vel_y_mps")]
        found.append((owner * _IDS + actors["actor_id"][row] + 1, owner, *columns))
    return found
