"""Actor rules: an actor stays what it is, is there once, is not the ego, has no gap, and moves as its velocities say.

Source: spec/05-raw-streams.md#tracks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS, TICK_S
from branchdrive.driving.risk import RANGE_M
from branchdrive.raw.motion.contact import is_free, touches
from branchdrive.raw.motion.tracks import actor_displacements, actor_returns, repeats_nominal, track_frames, tracks
from branchdrive.raw.shard_view import ShardView

Index = NDArray[np.int64]

_KIND = ("actor_class", "length_m", "width_m", "height_m")
_BOX = ("x_m", "y_m", "yaw_rad", "length_m", "width_m")
_BODY = ("x_m", "y_m", "length_m", "width_m")

_MOST_NEIGHBOURS = 64
"""Rows that each is compared with at most, of those of its observation and class that follow along x."""


def _of_actors(
    view: ShardView,
    subjects: Mask,
    compared: Mask,
    rows: NDArray[np.integer],
    column: str,
    text: Callable[[int], tuple[str, str]],
) -> Check:
    """Check of the attempts that are compared, by rows of the actors table that are wrong."""
    stream, subjects = view.stream("actors"), subjects & compared
    marked = np.zeros(len(stream), bool)
    marked[rows] = True
    summary = stream.by_rollout(marked)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        actor_id = int(stream["actor_id"][row])
        place: Location = {"table": "actors", "column": column, "tick": int(stream["tick"][row]), "actor_id": actor_id}
        return Mismatch(place, *text(row), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)


@rule("BD-ACT-001")
def actors_stay_what_they_are(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Class and extents of an actor are those of its previous row."""
    stream, (row, previous, resumed, left) = view.stream("actors"), view.cached(tracks)
    goes_on = previous >= 0
    compared = stream.with_rows(row[goes_on]) | stream.with_rows(resumed)

    def differing(steps: Index, column: str) -> tuple[Index, Index]:
        """Rows that have another value than the row before."""
        values = stream.categories(column)[0] if column == "actor_class" else stream[column]
        rows, before = np.concatenate([row[steps], resumed]), np.concatenate([previous[steps], left])
        bad = np.flatnonzero(values[rows] != values[before])
        return rows[bad], before[bad]

    judged, checks = np.flatnonzero(goes_on & ~view.cached(repeats_nominal)[view.cached(track_frames)]), []
    for column in _KIND:
        rows, before = differing(judged, column)
        if len(rows):  # and what repeats it
            rows, before = differing(np.flatnonzero(goes_on), column)
        source = dict(zip(rows.tolist(), before.tolist(), strict=True))

        def text(row: int, column: str = column, source: dict[int, int] = source) -> tuple[str, str]:
            was, found = (quote(stream[column][k]) for k in (source[row], row))
            return f"{was}, as at tick {stream['tick'][source[row]]}", found

        checks.append(_of_actors(view, subjects, compared, rows, column, text))
    yield Check.of_any(*checks)


def _crowded_rows(view: ShardView) -> Index:
    """Rows at observations where a track begins: of an actor that is there twice."""
    row, previous, *_ = view.cached(tracks)
    frame = view.cached(track_frames)
    is_crowded = np.zeros(len(view.observations), bool)
    is_crowded[frame[previous < 0]] = True
    return row[is_crowded[frame]]


def _twins(view: ShardView, rows: Index, columns: Sequence[str]) -> tuple[Index, Index]:
    """Rows that have all columns of another row of their observation, and these others."""
    stream = view.stream("actors")
    parts = [view.observations.rows_of(stream)[rows], *(stream[column][rows] for column in columns)]
    order = np.lexsort(parts[::-1])
    repeats = np.flatnonzero(np.logical_and.reduce([values[order][1:] == values[order][:-1] for values in parts]))
    return rows[order[repeats + 1]], rows[order[repeats]]


def _near_twins(view: ShardView, rows: Index) -> tuple[Index, Index]:
    """Rows whose body differs by no more than bodies are thick from another one's of their class, and these others.

    One of both begins its track there; the row with the larger identity is the twin.
    """
    stream, reach = view.stream("actors"), physical_bounds().body_m
    row, previous, *_ = view.cached(tracks)
    begins, kinds = np.zeros(len(stream), bool), stream.categories("actor_class")[0]
    begins[row[previous < 0]] = True
    frame, x = view.observations.rows_of(stream)[rows], stream["x_m"][rows]
    rows = rows[np.lexsort((x, kinds[rows], frame))]
    frame, kind, x = view.observations.rows_of(stream)[rows], kinds[rows], stream["x_m"][rows]
    found = [np.zeros((2, 0), np.int64)]
    for step in range(1, min(_MOST_NEIGHBOURS, len(rows) - 1) + 1):
        near = (frame[step:] == frame[:-step]) & (kind[step:] == kind[:-step]) & (x[step:] - x[:-step] <= reach)
        one = np.flatnonzero(near)
        if not len(one):
            break
        pair = np.stack([rows[one], rows[one + step]])
        is_one = begins[pair].any(axis=0)
        for column in _BODY:
            is_one &= np.abs(np.subtract(*stream[column][pair].astype(np.float64))) <= reach
        found.append(pair[:, is_one])
    pairs = np.concatenate(found, axis=1)
    is_later = np.argmax(stream["actor_id"][pairs], axis=0), np.arange(pairs.shape[1])
    return pairs[is_later], pairs[1 - is_later[0], is_later[1]]


@rule("BD-ACT-002")
def actors_are_others(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No actor has the place of the ego, and no two actors of an observation have one box, or nearly."""
    stream, observations = view.stream("actors"), view.observations
    row, previous, *_ = view.cached(tracks)
    rows = row[previous < 0]
    frame = observations.rows_of(stream)[rows]
    near = np.hypot(stream["x_m"][rows] - observations["x_m"][frame], stream["y_m"][rows] - observations["y_m"][frame])
    is_same = near <= physical_bounds().same_centre_m
    away = dict(zip(rows[is_same].tolist(), near[is_same].tolist(), strict=True))
    ego = _of_actors(
        view, subjects, stream.with_rows(rows), rows[is_same], "x_m",
        lambda row: ("another road user than the ego", f"a box whose centre is {away[row]:.2f} m from that of the ego"),
    )  # fmt: skip

    rows = _crowded_rows(view)
    some = rows[~view.cached(repeats_nominal)[observations.rows_of(stream)[rows]]]
    second, first = _twins(view, some, _BOX[:1])  # few share as much as one number
    if len(second):
        second, first = _twins(view, rows, _BOX)
    near = _near_twins(view, some)
    if len(near[0]):
        near = _near_twins(view, rows)
    twin = dict(zip(*(np.concatenate(pair).tolist() for pair in zip(near, (second, first), strict=True)), strict=True))
    second = np.array(sorted(twin), np.int64)
    twice = _of_actors(
        view, subjects, stream.with_rows(row), second, "actor_id",
        lambda row: (
            "a box of its own", f"that of actor {stream['actor_id'][twin[row]]}, or nearly",
        ),
    )  # fmt: skip
    yield Check.of_any(ego, twice)


def _moments(view: ShardView) -> tuple[Index, Index]:
    """Place of each observation among distinct ticks of attempts ``[observations]``, and the first one of each."""
    observations = view.observations
    keys = np.stack([observations.rollout, observations.tick])
    is_new = np.append(True, (np.diff(keys) != 0).any(axis=0))[: len(observations)]
    return np.cumsum(is_new) - 1, np.flatnonzero(is_new)


@rule("BD-ACT-003")
def tracks_have_no_gap(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Who is in range on the way between two of its rows, however it got from one to the other, is there in between."""
    stream, observations, bounds = view.stream("actors"), view.observations, physical_bounds()
    frame, (row, _, resumed, left) = observations.rows_of(stream), view.cached(tracks)
    last, next_ = frame[left], frame[resumed]
    whole_s = (observations.tick[next_] - observations.tick[last]) * TICK_S
    missing = np.full(len(resumed), -1)
    # Of rows that repeat a tick the first is looked at, so that there are no more steps than ticks in a window.
    moment, first = view.cached(_moments)
    for step in range(1, int((moment[next_] - moment[last]).max(initial=1))):
        here = np.minimum(first.take(moment[last] + step, mode="clip"), next_)
        gone_s = (observations.tick[here] - observations.tick[last]) * TICK_S
        share = gone_s / whole_s
        away = [
            (1 - share) * stream[name][left] + share * stream[name][resumed] - observations[name][here]
            for name in ("x_m", "y_m")
        ]
        margin_m = np.maximum(bounds.gap_margin_m, bounds.road_user_mps2 * gone_s * (whole_s - gone_s) / 2)
        missing = np.where((missing < 0) & (here < next_) & (np.hypot(*away) <= RANGE_M - margin_m), here, missing)
    tick = dict(zip(resumed[missing >= 0].tolist(), observations.tick[missing[missing >= 0]].tolist(), strict=True))
    yield _of_actors(
        view, subjects, stream.with_rows(row), resumed[missing >= 0], "actor_id",
        lambda row: (f"a row at tick {tick[row]}, too, where the actor is in range", "none"),
    )  # fmt: skip


@rule("BD-ACT-004")
def actors_move_as_their_velocity_says(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The way of an actor between two observations is that of its velocities."""
    steps, bounds = view.cached(actor_displacements), physical_bounds()
    stream = view.stream("actors")
    free = view.cached(is_free)[view.observations.rows_of(stream)[steps.row]]
    rows, residual = steps.row[free], steps.residual_m[free]
    far = np.flatnonzero(residual > steps.most_m[free])
    away = dict(zip(rows[far].tolist(), residual[far].tolist(), strict=True))
    yield _of_actors(
        view, subjects, stream.with_rows(rows), rows[far], "vel_x_mps",
        lambda row: (
            f"a displacement within {bounds.displacement_m:g} m and {bounds.displacement_share:.0%} of what the "
            "velocity gives", f"{away[row]:.2f} m away from it",
        ),
    )  # fmt: skip


@rule("BD-ACT-005")
def actors_come_back_where_they_can(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The way of an actor over a gap of its track is one that a road user can take."""
    back = view.cached(actor_returns)
    stream = view.stream("actors")
    frame = view.observations.rows_of(stream)
    rows, left = frame[back.row], frame[view.cached(tracks).left]
    num_touched = np.cumsum(view.cached(touches))
    free = view.cached(is_free)[left] & (num_touched[left] == num_touched[rows])
    far = np.flatnonzero(free & (back.residual_m > back.most_m))
    step = dict(zip(back.row[far].tolist(), far.tolist(), strict=True))
    yield _of_actors(
        view, subjects, stream.with_rows(back.row[free]), back.row[far], "actor_id",
        lambda row: (
            f"after {back.time_s[step[row]]:.2f} s a place within {back.most_m[step[row]]:.1f} m of where its "
            "velocities lead",
            f"{back.residual_m[step[row]]:.1f} m away from it",
        ),
    )  # fmt: skip


@rule("BD-ACT-008")
def pedestrians_that_are_braked_for_are_there(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """A pedestrian has a row at one of the observations of the window at which a slow ego brakes for one."""
    actors, observations = view.stream("actors"), view.observations
    offset = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    brakes = observations.valid("pedestrian_hazard") & observations["pedestrian_hazard"].astype(bool)
    brakes &= (offset >= HISTORY_OFFSETS[0]) & (offset <= FUTURE_OFFSETS[-1])
    brakes &= np.abs(observations["speed_mps"]) <= physical_bounds().heeding_mps
    is_there = np.zeros(len(observations) + 1, bool)
    if brakes.any() and len(actors):
        is_pedestrian = actors.equals("actor_class", "pedestrian")
        is_there[observations.rows_of_moments(actors)] = np.logical_or.reduceat(is_pedestrian, actors.moments)
    summary = observations.by_rollout(brakes)

    def describe(i: int) -> Mismatch:
        place: Location = {"table": "observations", "column": "pedestrian_hazard"}
        place["tick"] = int(observations.tick[summary.first_row[i]])
        return Mismatch(
            place, "a pedestrian within 50 m, for whom it brakes", "none in any of these rows", int(summary.count[i])
        )

    subjects = subjects & view.branched & summary.any
    yield Check.of_subjects(subjects, subjects & ~observations.by_rollout(brakes & is_there[:-1]).any, describe)
