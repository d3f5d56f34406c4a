"""Contacts of the ego: where they are known, which observations they leave to be judged, and who was near.

Contact breaks the relations of motion for a while: what collides is pushed, slides and spins. So nothing is judged at
an observation with `collision`, nor within the next `rest_observations`; after them the relations hold again.

Source: spec/05-raw-streams.md#contacts, #results.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.raw.motion.residual import follows
from branchdrive.raw.shard_view import ShardView

__all__ = [
    "COLLISION_COUNTS", "actors_within_reach", "bodies_within", "is_covered", "is_free", "knows_contacts",
    "rest_observations", "touches",
]  # fmt: skip

COLLISION_COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))
"""Columns of the rollouts table that count collisions."""

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


def actors_within_reach(view: ShardView, frames: Index) -> dict[str, Index]:
    """Vehicles and cycles, and pedestrians, within reach at observations or the ones before: pairs, by attempt.

    Args:
        view: The shard.
        frames: Rows of observations, ascending.
    """
    observations, actors = view.observations, view.stream("actors")
    before = frames[follows(observations)[frames]] - 1
    moments = np.concatenate([frames, before])
    place, row = bodies_within(view, moments, physical_bounds().contact_reach_m)
    contact = np.append(frames, before + 1)[place]  # the observation that an actor may explain
    found = {}
    codes, names = actors.categories("actor_class")
    for kind, classes in (("vehicle", ("vehicle", "cycle")), ("pedestrian", ("pedestrian",))):
        here = np.array([name in classes for name in (*names, None)])[codes[row]]
        pairs = np.unique(contact[here] * _IDS + actors["actor_id"][row[here]])
        found[kind] = np.bincount(observations.rollout[pairs // _IDS], minlength=view.num_rollouts)
    return found
