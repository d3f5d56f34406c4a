"""Contacts of the ego: where they are known, which observations they leave to be judged, and who was near.

Contact breaks the relations of motion for a while: what collides is pushed, slides and spins. So nothing is judged at
an observation with `collision`, nor within the next `rest_observations`; after them the relations hold again.

Source: spec/05-raw-streams.md#contacts, #results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.driving.box import Boxes, box_gap
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import TableView

__all__ = [
    "COLLISION_COUNTS", "actors_within_reach", "bodies_within", "is_covered", "is_free", "knows_contacts",
    "rest_observations", "touches",
]  # fmt: skip

COLLISION_COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))
"""Columns of the rollouts table that count collisions."""

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_IDS = 1 << 31
"""More than the largest identity of an actor."""


def rest_observations() -> int:
    """Observations after a contact at which nothing is judged."""
    return int(physical_bounds().rest_observations)


def touches(view: ShardView) -> Mask:
    """Observations with a contact ``[observations]``; none without evidence."""
    found = np.zeros(len(view.observations), bool)
    if "evidence" in view:
        evidence = view.stream("evidence")
        frame = view.observations.rows_of(evidence)
        found[frame[(frame >= 0) & evidence["collision"].astype(bool)]] = True
    return found


def is_free(view: ShardView) -> Mask:
    """Observations that no recorded contact keeps from being judged ``[observations]``."""
    observations, touched = view.observations, view.cached(touches)
    last = np.maximum.accumulate(np.where(touched, np.arange(len(touched)), -1))
    owner = np.append(observations.rollout, -2)
    away = observations.tick - np.append(observations.tick, 0)[last]
    near = (owner[last] == observations.rollout) & (away <= rest_observations() * OBSERVATION_STRIDE_TICKS)
    return np.asarray(~near)


def knows_contacts(view: ShardView) -> Mask:
    """Attempts whose contacts are known: by evidence, or since all kinds were monitored and none is counted."""
    if "evidence" in view:
        return np.ones(view.num_rollouts, bool)
    counts = [view.rollouts.valid(name) & (view.rollouts[name] == 0) for name in COLLISION_COUNTS]
    return np.asarray(np.logical_and.reduce(counts))


def is_covered(view: ShardView) -> Mask:
    """Attempts whose every observation has a row of evidence."""
    evidence, observations = view.stream("evidence"), view.observations
    return evidence.by_rollout(np.ones(len(evidence), bool)).count >= observations.stop - observations.start


def bodies_within(view: ShardView, moments: Index, reach_m: float) -> tuple[Index, Index]:
    """Actors within a distance of the ego, as far as the corners of both reach: places of `moments`, and actor rows.

    Args:
        view: The shard.
        moments: Rows of observations.
        reach_m: The distance.
    """
    observations, actors, rollouts = view.observations, view.stream("actors"), view.rollouts
    start, stop = actors.span(observations.rollout[moments], observations.tick[moments])
    place = np.repeat(np.arange(len(moments)), stop - start)
    row = np.arange(len(place)) + (start - np.append(0, np.cumsum(stop - start)[:-1]))[place]
    ego = observations.rollout[moments]
    ego_m = np.hypot(rollouts["ego_length_m"], rollouts["ego_width_m"]).astype(np.float64)[ego] / 2
    away_m = np.hypot(*(actors[name][row] - observations[name][moments][place] for name in ("x_m", "y_m")))
    size_m = np.hypot(actors["length_m"][row], actors["width_m"][row]).astype(np.float64) / 2
    is_near = away_m <= reach_m + ego_m[place] + size_m
    return place[is_near], row[is_near]


@np.errstate(all="ignore")  # what overflows is within no reach
def _may_touch(view: ShardView, moment: Index, row: Index) -> Mask:
    """Whether the ego and an actor are within the way of a quarter second at the speed of the one against the other.

    Args:
        view: The shard.
        moment: Row of the observation of each pair.
        row: Row of the actor.
    """
    observations, actors, rollouts, bounds = view.observations, view.stream("actors"), view.rollouts, physical_bounds()

    def values(table: TableView, rows: Index, *columns: str) -> Iterator[Array]:
        return (table[name][rows].astype(np.float64) for name in columns)

    place, extents = ("x_m", "y_m", "yaw_rad"), ("length_m", "width_m")
    attempt = observations.rollout[moment]
    ego = Boxes(*values(observations, moment, *place), *values(rollouts, attempt, *(f"ego_{name}" for name in extents)))
    actor = Boxes(*values(actors, row, *place, *extents))
    (speed,) = values(observations, moment, "speed_mps")
    east, north = values(actors, row, "vel_x_mps", "vel_y_mps")
    relative = np.hypot(east - speed * np.cos(ego.yaw_rad), north - speed * np.sin(ego.yaw_rad))
    reach_m = np.minimum(bounds.contact_reach_m, bounds.edge_m + relative * OBSERVATION_S)
    return np.asarray(box_gap(ego, actor).gap_m <= reach_m)


def actors_within_reach(view: ShardView, frames: Index) -> dict[str, Index]:
    """Vehicles and cycles, and pedestrians, that can be touched at observations or the ones before: pairs, by attempt.

    Args:
        view: The shard.
        frames: Rows of observations, ascending.
    """
    observations, actors = view.observations, view.stream("actors")
    before = frames[follows(observations)[frames]] - 1
    moments = np.concatenate([frames, before])
    place, row = bodies_within(view, moments, physical_bounds().contact_reach_m)
    touchable = _may_touch(view, moments[place], row)
    place, row = place[touchable], row[touchable]
    contact = np.append(frames, before + 1)[place]  # the observation that an actor may explain
    found = {}
    codes, names = actors.categories("actor_class")
    for kind, classes in (("vehicle", ("vehicle", "cycle")), ("pedestrian", ("pedestrian",))):
        here = np.array([name in classes for name in (*names, None)])[codes[row]]
        pairs = np.unique(contact[here] * _IDS + actors["actor_id"][row[here]])
        found[kind] = np.bincount(observations.rollout[pairs // _IDS], minlength=view.num_rollouts)
    return found
