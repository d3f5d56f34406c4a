"""Result rules: what an attempt reports of its outcome agrees with its rows.

Source: spec/05-raw-streams.md#results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.raw.motion import COLLISION_COUNTS, follows
from branchdrive.raw.route_state import last_progress_m
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import RowSummary


def _lasting_overlaps(view: ShardView) -> RowSummary:
    """Observations at which the ego's box, and before them, overlaps that of a vehicle, cycle or pedestrian."""
    evidence = view.stream("evidence")
    overlaps = np.zeros(len(evidence), bool)
    for kind in ("vehicle", "pedestrian"):
        overlaps |= evidence[f"nearest_{kind}_available"].astype(bool) & (evidence[f"nearest_{kind}_gap_m"] == 0)
    lasting, joined = overlaps.copy(), follows(evidence)
    for _ in range(int(physical_bounds().contact_observations) - 1):
        lasting = overlaps & joined & np.append(False, lasting[:-1])
    return evidence.by_rollout(lasting)


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
    evidence, observations, rollouts = view.stream("evidence"), view.observations, view.rollouts
    known = np.logical_and.reduce([rollouts.valid(name) for name in COLLISION_COUNTS])
    count = np.sum([rollouts[name].astype(np.int64) for name in COLLISION_COUNTS], axis=0)
    counted_somewhere = np.logical_or.reduce(
        [rollouts.valid(name) & (rollouts[name].astype(np.int64) > 0) for name in COLLISION_COUNTS]
    )
    touched = evidence.by_rollout(evidence["collision"].astype(bool))
    is_covered = evidence.by_rollout(np.ones(len(evidence), bool)).count >= observations.stop - observations.start
    overlaps = _lasting_overlaps(view)
    unseen = known & (count == 0) & is_covered & ~touched.any & overlaps.any
    far, contact_row = _far_contacts(view)
    uncounted = known & (count == 0) & touched.any
    untouched = counted_somewhere & is_covered & ~touched.any

    def describe(i: int) -> Mismatch:
        if unseen[i]:
            tick = int(evidence.tick[overlaps.first_row[i]])
            expected = "a contact, as boxes of the ego and another road user overlap for half a second"
            return Mismatch({"table": "evidence", "column": "collision", "tick": tick}, expected, "false throughout")
        if far[i]:
            reach_m, tick = physical_bounds().contact_reach_m, int(evidence.tick[contact_row[i]])
            expected = f"a road user within {reach_m:g} m, then or at the observation before"
            return Mismatch({"table": "evidence", "column": "collision", "tick": tick}, expected, "none")
        place = {"table": "rollouts", "column": COLLISION_COUNTS[0]}
        if uncounted[i]:
            tick = int(evidence.tick[touched.first_row[i]])
            return Mismatch({**place}, f"a collision, as `collision` is true at tick {tick}", "0 of every kind")
        return Mismatch({**place}, "0 collisions, as `collision` is never true", f"{count[i]}")

    yield Check.of_subjects(subjects, subjects & (far | unseen | uncounted | untouched), describe)


@rule("BD-RES-002")
def completion_agrees_with_progress(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The share of the route that was driven is that of the last progress, and the whole where it is completed."""
    bounds, rollouts = physical_bounds(), view.rollouts
    fraction = rollouts["result_route_fraction"].astype(np.float64)
    furthest, length = last_progress_m(view)
    away = np.abs(fraction * length - furthest)
    most = bounds.route_end_m + bounds.route_fraction * length
    unfinished = rollouts.equals("result_completion", "completed") & (fraction < 1 - bounds.route_fraction)

    def describe(i: int) -> Mismatch:
        place = {"table": "rollouts", "column": "result_route_fraction"}
        if unfinished[i]:
            return Mismatch(
                {**place}, f"at least {1 - bounds.route_fraction:g} of a completed route", f"{fraction[i]:g}"
            )
        return Mismatch(
            {**place}, f"within {most[i]:.0f} m of the progress {furthest[i]:.1f} m on a route of {length[i]:.1f} m",
            f"{fraction[i]:g}",
        )  # fmt: skip

    yield Check.of_subjects(subjects, subjects & (unfinished | (away > most)), describe)
