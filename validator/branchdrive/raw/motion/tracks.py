"""Tracks of actors: rows of the actors table that follow each other under one id of an attempt.

Source: spec/05-raw-streams.md#tracks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS, TICK_S
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.join import KeyIndex

__all__ = [
    "ActorSteps", "Displacements", "Tracks", "actor_displacements", "actor_returns", "actor_steps",
    "repeats_nominal", "track_frames", "tracks",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rows = NDArray[np.int32]  # tables have fewer
Mask = NDArray[np.bool_]


class Tracks(NamedTuple):
    """How rows of the actors table follow each other at the observations from ``t_b - 75`` to ``t_b + 50``.

    Attributes:
        row: Rows at those observations, of attempts with a branch ``[rows]``.
        previous: Row of the same actor at the previous observation, -1 where it has none ``[rows]``.
        resumed: Rows of actors that have none there, but at an earlier observation ``[gaps]``.
        left: Their last rows before ``[gaps]``.
    """

    row: Index
    previous: Index
    resumed: Index
    left: Index


def _window_rows(view: ShardView) -> Index:
    """Rows of the actors table at the observations of the windows, by observation and actor."""
    stream, observations = view.stream("actors"), view.observations
    offset = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    is_inside = (offset >= HISTORY_OFFSETS[0]) & (offset <= FUTURE_OFFSETS[-1])
    is_inside &= np.append(view.branched, False)[observations.rollout]
    rows = np.flatnonzero(np.append(is_inside, False)[observations.rows_of(stream)])
    frame, ids = observations.rows_of(stream)[rows], stream["actor_id"][rows]
    if ((frame[1:] == frame[:-1]) & (ids[1:] < ids[:-1])).any():
        rows = rows[np.lexsort((ids, frame))]
    return rows


def tracks(view: ShardView) -> Tracks:
    """Tracks of a shard; an observation that the attempt lacks is no gap."""
    stream, observations, row = view.stream("actors"), view.observations, _window_rows(view)
    frame, ids = observations.rows_of(stream)[row], stream["actor_id"][row].astype(np.int64)
    if not len(row):
        return Tracks(row, row, row, row)
    # Actors keep their place in the list from one observation to the next, but for those that come and go.
    num_before = np.roll(np.bincount(frame, minlength=len(observations)), 1)
    previous = np.arange(len(row)) - num_before[frame]
    same_actor = ids.take(previous, mode="clip") == ids
    unsure = np.flatnonzero(~same_actor | (frame.take(previous, mode="clip") != frame - 1))
    previous[unsure] = KeyIndex(frame, ids).find(frame[unsure] - 1, ids[unsure])
    owner = observations.rollout
    previous[(np.diff(owner, prepend=-1) != 0)[frame]] = -1

    goes_on = np.zeros(len(row), bool)
    goes_on[previous[previous >= 0]] = True
    begins, ends = np.flatnonzero(previous < 0), np.flatnonzero(~goes_on)
    key = (owner[frame], ids, frame)
    left = KeyIndex(*(part[ends] for part in key)).last_before(*(part[begins] for part in key))
    resumed, left = begins[left >= 0], ends[left[left >= 0]]
    return Tracks(row, np.where(previous >= 0, row[previous], -1), row[resumed], row[left])


def track_frames(view: ShardView) -> Index:
    """Observation of each row of the tracks ``[rows]``."""
    return view.observations.rows_of(view.stream("actors"))[view.cached(tracks).row]


def repeats_nominal(view: ShardView) -> Mask:
    """Observations that are copies as a whole, as the ones before them are, which precede their sources, too.

    So tracks go on and begin there as they do in the nominal ``[observations]``.
    """
    owner, copied = view.observations.rollout, view.cached(Copies).at_moments("observations")
    source, is_copy = np.arange(len(owner)), ~copied.judged(len(owner))
    source[copied.row] = copied.source
    found = np.zeros(len(owner), bool)
    found[1:] = is_copy[1:] & is_copy[:-1] & (owner[1:] == owner[:-1]) & (np.diff(source) == 1)
    return found


class ActorSteps(NamedTuple):
    """Steps of actors from one observation to the next, a quarter second later.

    Attributes:
        row: Row of the actors table that each leads to ``[steps]``.
        before: Row that it comes from ``[steps]``.
        distinct: Steps that repeat none of a nominal ``[distinct]``.
        place: The one of these that each step is or repeats ``[steps]``.
    """

    row: Rows
    before: Rows
    distinct: Index
    place: Rows


def actor_steps(view: ShardView) -> ActorSteps:
    """Steps of the tracks of a shard between neighbouring observations."""
    observations, stream = view.observations, view.stream("actors")
    row, before, *_ = view.cached(tracks)
    compared = np.flatnonzero((before >= 0) & follows(observations)[view.cached(track_frames)])
    later, earlier = row[compared].astype(np.int32), before[compared].astype(np.int32)
    distinct, place = view.cached(Copies).at_moments("actors").distinct(later, earlier, len(stream))
    return ActorSteps(later, earlier, distinct, place.astype(np.int32))


class Displacements(NamedTuple):
    """How far actors are from where their velocities lead, between two of their rows.

    Attributes:
        row: The later rows, of the actors table ``[steps]``.
        residual_m: Distance from where the mean velocity leads ``[steps]``.
        most_m: How large it may be ``[steps]``.
        time_s: Time between the rows ``[steps]``.
    """

    row: NDArray[np.integer]
    residual_m: Array
    most_m: Array
    time_s: Array


def actor_displacements(view: ShardView) -> Displacements:
    """Displacements of actors between neighbouring observations, those after a contact of the ego among them."""
    row, before, distinct, place = view.cached(actor_steps)
    found = _displacements(view, row[distinct], before[distinct])
    time_s = np.broadcast_to(OBSERVATION_S, len(row))
    return Displacements(row, found.residual_m[place], found.most_m[place], time_s)


def actor_returns(view: ShardView) -> Displacements:
    """Displacements of actors over a gap of their track, those over a contact of the ego among them."""
    *_, rows, left = view.cached(tracks)
    back = _displacements(view, rows, left)
    return back._replace(most_m=back.most_m + physical_bounds().road_user_mps2 * back.time_s**2 / 4)


def _displacements(view: ShardView, rows: NDArray[np.integer], before: NDArray[np.integer]) -> Displacements:
    stream, bounds = view.stream("actors"), physical_bounds()
    time_s = np.asarray(np.subtract(stream["tick"][rows], stream["tick"][before], dtype=np.int64) * TICK_S, np.float64)
    off, way = [], []
    for place, velocity in (("x_m", "vel_x_mps"), ("y_m", "vel_y_mps")):
        values, speed = stream[place], stream[velocity]
        moved = np.add(speed[rows], speed[before], dtype=np.float64) * (time_s / 2)
        off.append(values[rows] - values[before] - moved)
        way.append(moved)
    most_m = bounds.displacement_m + bounds.displacement_share * np.hypot(*way)
    return Displacements(rows, np.hypot(*off), most_m, time_s)
