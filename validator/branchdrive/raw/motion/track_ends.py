"""Where tracks of actors begin and end between ``t_b - 75`` and ``t_b + 50``: in range of the ego, or beyond it.

An actor whose track begins was a quarter second before where its velocity comes from, and one whose track ends is then
where it leads to; the ego's own pose there is recorded. Source: spec/05-raw-streams.md#completeness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.driving.box import Boxes, box_gap
from branchdrive.driving.risk import RANGE_M
from branchdrive.driving.track_end import CLASSES, MEASURES, TrackEnds
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.motion.response import group_digests
from branchdrive.raw.motion.tracks import track_frames, tracks
from branchdrive.raw.shard_view import ShardView

__all__ = ["track_ends"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MOST_REACH_M = 200.0
"""More than half the diagonals of two boxes of 100 m: extents of attempts that break the rule on boxes say nothing."""


@np.errstate(all="ignore")  # what overflows is no number, and in no range
def track_ends(view: ShardView, broken: Mask) -> TrackEnds:
    """Ends of tracks of the attempts that break no structure rule."""
    if "actors" not in view:
        return TrackEnds.none()
    stream, observations, found = view.stream("actors"), view.observations, view.cached(tracks)
    row, previous = found.row, found.previous
    frame = view.cached(track_frames)
    kept = np.append(~broken, False)[observations.rollout[frame]]
    names = stream.categories("actor_class")[1]
    kinds = np.array([CLASSES.index(name) if name in CLASSES else -1 for name in names] + [-1])
    kind = kinds[stream.categories("actor_class")[0][row]]
    goes_on = np.zeros(len(stream), bool)
    goes_on[previous[previous >= 0]] = True
    joined = np.append(follows(observations), False)
    offset = observations.tick[frame] - view.branch_tick[observations.rollout[frame]]
    begins = kept & (previous < 0) & (offset > HISTORY_OFFSETS[0]) & joined[frame]
    ends = kept & ~goes_on[row] & (offset < FUTURE_OFFSETS[-1]) & joined[frame + 1]
    places = np.concatenate([np.flatnonzero(begins), np.flatnonzero(ends)])
    step = np.repeat([-1, 1], [begins.sum(), ends.sum()])
    beyond_m = np.stack(_distances(view, row[places], frame[places] + step, step * OBSERVATION_S), axis=1)
    # A copy is as far away as its source, which counts unless its attempt is broken.
    is_copy = ~view.cached(Copies).at_moments("observations").judged(len(observations))
    counts = is_copy & ~np.append(broken, False)[np.append(view.nominal, -1)[observations.rollout]]
    kept &= ~counts[frame]
    return TrackEnds(
        step < 0,
        kind[places].astype(np.int8),
        view.cached(group_digests)[view.group[observations.rollout[frame[places]]]],
        beyond_m.astype(np.float32),
        _farthest(view, row[kept], frame[kept], kind[kept]),
    )


def _distances(view: ShardView, row: Index, frame: Index, later_s: Array | float) -> tuple[Array, Array]:
    """Distances of centres and of boxes from the ego at observations to actors, moved on for a while."""
    stream, observations = view.stream("actors"), view.observations
    x, y, yaw, length, width, vel_x, vel_y = (
        stream[name][row].astype(np.float64) for name in (*Boxes._fields, "vel_x_mps", "vel_y_mps")
    )
    boxes = Boxes(x + vel_x * later_s, y + vel_y * later_s, yaw, length, width)
    pose = (observations[name][frame].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
    extents = (view.rollouts[f"ego_{name}_m"][observations.rollout[frame]] for name in ("length", "width"))
    ego = Boxes(*pose, *(extent_m.astype(np.float64) for extent_m in extents))
    return np.hypot(boxes.x_m - ego.x_m, boxes.y_m - ego.y_m), box_gap(ego, boxes).gap_m


def _farthest(view: ShardView, row: Index, frame: Index, kind: Index) -> Array:
    """Largest distances of rows of each class ``[classes, 2]``; that of boxes beyond the range is a lower bound."""
    stream, observations = view.stream("actors"), view.observations
    away_x, away_y = (stream[name][row] - observations[name][frame] for name in ("x_m", "y_m"))
    square = away_x * away_x + away_y * away_y
    reach_m = _largest_reach_m(view)
    farthest_m = np.zeros((len(CLASSES), len(MEASURES)))
    for code in range(len(CLASSES)):
        most_m = float(np.sqrt(square.max(initial=0.0, where=kind == code)))
        farthest_m[code] = most_m, max(most_m - reach_m, 0.0)
        if farthest_m[code, 1] <= RANGE_M:
            places = np.flatnonzero((kind == code) & (square >= farthest_m[code, 1] ** 2))
            farthest_m[code, 1] = _distances(view, row[places], frame[places], 0.0)[1].max(initial=0.0)
    return farthest_m


def _largest_reach_m(view: ShardView) -> float:
    """Most by which the gap between the ego's box and an actor's falls short of the distance of their centres."""
    actor, ego = view.stream("actors"), view.rollouts
    boxes = ((actor, "length_m", "width_m"), (ego, "ego_length_m", "ego_width_m"))
    reach_m = sum(np.hypot(*(table.extremes(name)[1] for name in names)) / 2 for table, *names in boxes)
    return float(np.fmin(reach_m, _MOST_REACH_M))
