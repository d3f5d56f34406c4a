"""Result rules: what an attempt reports of its outcome agrees with its rows.

Source: spec/05-raw-streams.md#results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.raw.motion.contact import COLLISION_COUNTS, actors_within_reach, bodies_within, is_covered
from branchdrive.raw.motion.residual import follows
from branchdrive.raw.motion.route_state import last_progress_m
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import RowSummary

_USERS = ("vehicle", "pedestrian")
"""Road users of whom evidence has the nearest gap; cycles are with vehicles."""

_COUNT_OF_USERS = COLLISION_COUNTS[: len(_USERS)]


def _overlaps(view: ShardView, user: str) -> Mask:
    """Rows of evidence at which the ego's box overlaps that of a road user ``[evidence]``."""
    evidence = view.stream("evidence")
    return np.asarray(evidence[f"nearest_{user}_available"].astype(bool) & (evidence[f"nearest_{user}_gap_m"] == 0))


def _lasting_overlaps(view: ShardView) -> RowSummary:
    """Observations at which, and before them, the ego's box overlaps that of road users whose count is 0."""
    evidence, rollouts = view.stream("evidence"), view.rollouts
    overlaps = np.zeros(len(evidence), bool)
    for user, column in zip(_USERS, _COUNT_OF_USERS, strict=True):
        is_none = np.append(rollouts.valid(column) & (rollouts[column] == 0), False)
        overlaps |= _overlaps(view, user) & is_none[evidence.rollout]
    lasting, joined = overlaps.copy(), follows(evidence)
    for _ in range(int(physical_bounds().contact_observations) - 1):
        lasting = overlaps & joined & np.append(False, lasting[:-1])
    return evidence.by_rollout(lasting)


def _plain_contacts(view: ShardView) -> dict[str, RowSummary]:
    """Contacts at which the box of a road user overlaps, and no other recorded body is near, by count."""
    evidence, actors, rollouts, reach_m = (
        view.stream("evidence"), view.stream("actors"), view.rollouts, physical_bounds().contact_reach_m
    )  # fmt: skip
    frame, touched = view.observations.rows_of(evidence), evidence["collision"].astype(bool)
    codes, names = actors.categories("actor_class")
    is_static = np.array([name == "static" for name in (*names, None)])[codes]
    found = {}
    for user, other, column in zip(_USERS, _USERS[::-1], _COUNT_OF_USERS, strict=True):
        is_none = np.append(rollouts.valid(column) & (rollouts[column] == 0), False)[evidence.rollout]
        is_near = evidence[f"nearest_{other}_gap_m"] <= reach_m
        is_joined = evidence[f"nearest_{other}_available"].astype(bool) & is_near
        rows = np.flatnonzero(touched & (frame >= 0) & is_none & ~is_joined & _overlaps(view, user))
        place, body = bodies_within(view, frame[rows], reach_m)
        plain = np.zeros(len(evidence), bool)
        plain[np.delete(rows, place[is_static[body]])] = True
        found[column] = evidence.by_rollout(plain)
    return found


def _far_contacts(view: ShardView) -> tuple[Mask, NDArray[np.int64]]:
    """Attempts that count collisions with road users and none with things, of whom nobody is near at the first contact.

    Returns:
        The attempts, and the first row of evidence with `collision` of each, -1 where there is none ``[rollouts]``.
    """
    evidence, rollouts = view.stream("evidence"), view.rollouts
    first = evidence.by_rollout(evidence["collision"].astype(bool)).first_row
    gap_m = np.where(evidence["separation_available"].astype(bool), evidence["separation_m"], np.inf)
    before_m = np.where(follows(evidence), np.roll(gap_m, 1), np.inf)
    nearest_m = np.append(np.minimum(gap_m, before_m), 0.0)[first]
    vehicles, pedestrians, things = (rollouts.valid(name) & (rollouts[name] > 0) for name in COLLISION_COUNTS)
    of_road_users = (vehicles | pedestrians) & ~things & rollouts.valid(COLLISION_COUNTS[-1])
    return of_road_users & (nearest_m > physical_bounds().contact_reach_m), first


@rule("BD-RES-001")
def collisions_agree_with_contacts(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Contacts are recorded where collisions are counted or boxes overlap, and somebody is near who was hit."""
    evidence, rollouts = view.stream("evidence"), view.rollouts
    known = np.logical_and.reduce([rollouts.valid(name) for name in COLLISION_COUNTS])
    count = np.sum([rollouts[name].astype(np.int64) for name in COLLISION_COUNTS], axis=0)
    counted_somewhere = np.logical_or.reduce(
        [rollouts.valid(name) & (rollouts[name].astype(np.int64) > 0) for name in COLLISION_COUNTS]
    )
    touched = evidence.by_rollout(evidence["collision"].astype(bool))
    overlaps, plain = _lasting_overlaps(view), _plain_contacts(view)
    covered = view.cached(is_covered)
    unseen = ~counted_somewhere & covered & ~touched.any & overlaps.any
    far, contact_row = _far_contacts(view)
    uncounted = known & (count == 0) & touched.any
    unnamed = np.logical_or.reduce([contacts.any for contacts in plain.values()])
    untouched = counted_somewhere & covered & ~touched.any
    is_recorded = evidence.is_there & (covered | touched.any)
    of_users = np.logical_or.reduce([rollouts.valid(name) for name in _COUNT_OF_USERS])
    subjects = subjects & is_recorded & (known | counted_somewhere | of_users & (overlaps.any | unnamed))

    def describe(i: int) -> Mismatch:
        if unseen[i]:
            tick = int(evidence.tick[overlaps.first_row[i]])
            expected = "a contact, as boxes of the ego and another road user overlap for half a second"
            return Mismatch({"table": "evidence", "column": "collision", "tick": tick}, expected, "false throughout")
        if far[i]:
            reach_m, tick = physical_bounds().contact_reach_m, int(evidence.tick[contact_row[i]])
            expected = f"a road user within {reach_m:g} m, then or at the observation before"
            return Mismatch({"table": "evidence", "column": "collision", "tick": tick}, expected, "none")
        place: Location = {"table": "rollouts", "column": COLLISION_COUNTS[0]}
        if uncounted[i]:
            tick = int(evidence.tick[touched.first_row[i]])
            return Mismatch({**place}, f"a collision, as `collision` is true at tick {tick}", "0 of every kind")
        if unnamed[i]:
            column, contacts = next(item for item in plain.items() if item[1].any[i])
            tick = int(evidence.tick[contacts.first_row[i]])
            expected = (
                f"at least 1, as in the contact of tick {tick} a box of this kind overlaps and nothing else is near"
            )
            return Mismatch({**place, "column": column}, expected, "0")
        return Mismatch({**place}, "0 collisions, as `collision` is never true", f"{count[i]}")

    yield Check.of_subjects(subjects, subjects & (far | unseen | uncounted | unnamed | untouched), describe)


_LAST_OBSERVATIONS = 8
"""Observations of two seconds, at one of which who is blocked stands."""


@rule("BD-RES-002")
def completion_agrees_with_progress(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The share of the route is that of the furthest progress; who is blocked stands, and who deviates was away."""
    bounds, rollouts, observations = physical_bounds(), view.rollouts, view.observations
    subjects = subjects & observations.is_there
    fraction = rollouts["result_route_fraction"].astype(np.float64)
    furthest, length = last_progress_m(view)
    away = np.abs(fraction * length - furthest)
    most = bounds.route_end_m + bounds.route_fraction * length
    unfinished = rollouts.equals("result_completion", "completed") & (fraction < 1 - bounds.route_fraction)
    is_last = np.arange(len(observations)) >= np.append(observations.stop, 0)[observations.rollout] - _LAST_OBSERVATIONS
    stands = observations.by_rollout(is_last & (np.abs(observations["speed_mps"]) <= bounds.driving_mps)).any
    drives = rollouts.equals("result_completion", "blocked") & ~stands
    was_away = observations.by_rollout(np.abs(observations["route_offset_m"]) > bounds.deviated_m).any
    stays = rollouts.equals("result_completion", "deviated") & ~was_away

    def describe(i: int) -> Mismatch:
        place: Location = {"table": "rollouts", "column": "result_route_fraction"}
        if unfinished[i]:
            return Mismatch(
                {**place}, f"at least {1 - bounds.route_fraction:g} of a completed route", f"{fraction[i]:g}"
            )
        completion: Location = {"table": "rollouts", "column": "result_completion"}
        if drives[i]:
            expected = (
                f"a vehicle not faster than {bounds.driving_mps:g} m/s in its last two seconds, as it is `blocked`"
            )
            return Mismatch(completion, expected, "faster at all of their observations")
        if stays[i]:
            expected = f"an offset from the route above {bounds.deviated_m:g} m, as the attempt is `deviated`"
            return Mismatch(completion, expected, "none")
        return Mismatch(
            {**place}, f"within {most[i]:.0f} m of the progress {furthest[i]:.1f} m on a route of {length[i]:.1f} m",
            f"{fraction[i]:g}",
        )  # fmt: skip

    yield Check.of_subjects(subjects, subjects & (unfinished | drives | stays | (away > most)), describe)


_FREE_OBSERVATIONS = 6
"""Observations from one contact to the next between which a second without any surely lies."""


@rule("BD-RES-005")
def collisions_are_as_many_as_contacts(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No kind is hit more often than actors of it can be touched at a contact, and each contact is counted."""
    evidence, rollouts = view.stream("evidence"), view.rollouts
    subjects = subjects & view.cached(is_covered)
    rows = np.flatnonzero(evidence["collision"].astype(bool) & np.append(subjects, False)[evidence.rollout])
    owner, tick = evidence.rollout[rows], evidence.tick[rows]
    is_new = np.ones(len(rows), bool)
    is_new[1:] = (owner[1:] != owner[:-1]) | (np.diff(tick) >= _FREE_OBSERVATIONS * OBSERVATION_STRIDE_TICKS)
    contacts = np.bincount(owner[is_new], minlength=view.num_rollouts)
    counts = {name: rollouts[name].astype(np.int64) for name in COLLISION_COUNTS}
    known = np.logical_and.reduce([rollouts.valid(name) for name in COLLISION_COUNTS])
    total = np.sum(list(counts.values()), axis=0)
    hits_somebody = np.append(counts[COLLISION_COUNTS[0]] + counts[COLLISION_COUNTS[1]] > 0, False)
    near = actors_within_reach(view, view.observations.rows_of(evidence)[rows[hits_somebody[owner]]])
    is_counted = known | np.logical_or.reduce([rollouts.valid(name) for name in COLLISION_COUNTS[:2]])
    subjects = subjects & (contacts > 0) & is_counted
    more = {kind: counts[f"result_num_{kind}_collisions"] > most for kind, most in near.items()}
    fewer = known & (total < contacts)

    def describe(i: int) -> Mismatch:
        if fewer[i]:
            place: Location = {"table": "rollouts", "column": COLLISION_COUNTS[0]}
            return Mismatch(
                place, f"{contacts[i]} collisions, as so many contacts are apart", f"{total[i]} of all kinds"
            )
        kind = next(kind for kind in more if more[kind][i])
        column = f"result_num_{kind}_collisions"
        expected = f"at most {near[kind][i]}, as so many are near enough at contacts for their speed against the ego"
        return Mismatch({"table": "rollouts", "column": column}, expected, f"{counts[column][i]}")

    yield Check.of_subjects(subjects, subjects & np.logical_or.reduce([fewer, *more.values()]), describe)
