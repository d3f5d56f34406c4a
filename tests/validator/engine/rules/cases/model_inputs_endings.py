"""Defects and limits of the table of endings, which a release may do without."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import ENDINGS, ReleaseDraft

TEST = "g12"
"""A test context."""

BRAKES = {"group_id": TEST, "action_key": "brake_0.50"}


@boundary("BD-MOD-022", "BD-MOD-004", "BD-MOD-021", "BD-LYR-001", "BD-LYR-008", "BD-REL-003")
def release_that_tells_how_drives_end(d: ReleaseDraft) -> None:
    d.add_endings()


@mutant("BD-MOD-022", at={"table": ENDINGS, "group_id": TEST, "action_key": "brake_0.50", "column": "off_road"})
def drive_that_is_told_to_leave_the_road(d: ReleaseDraft) -> None:
    d.add_endings()
    d.set(ENDINGS, "off_road", True, **BRAKES)


@mutant("BD-MOD-022", at={"table": ENDINGS, "group_id": TEST, "column": "collision_monitored"}, findings=13)
def collisions_that_are_said_to_be_unmonitored(d: ReleaseDraft) -> None:
    d.add_endings()
    d.set(ENDINGS, "collision_monitored", False, group_id=TEST)
    d.set(ENDINGS, "collision", None, group_id=TEST)


@mutant("BD-MOD-022", at={"table": ENDINGS, "group_id": TEST, "column": "completed"})
def route_that_is_told_to_be_given_up(d: ReleaseDraft) -> None:
    d.add_endings()
    d.set(ENDINGS, "completed", lambda value: not value, **BRAKES)


@mutant("BD-MOD-022", at={"table": ENDINGS, "group_id": TEST, "column": "route_fraction"})
def share_of_a_route_with_another_last_bit(d: ReleaseDraft) -> None:
    d.add_endings()
    d.set(ENDINGS, "route_fraction", lambda value: float(np.nextafter(np.float32(value), np.float32(0))), **BRAKES)


@mutant("BD-MOD-004", at={"table": ENDINGS, "group_id": TEST, "action_key": "brake_0.50"})
def candidate_of_which_no_end_is_told(d: ReleaseDraft) -> None:
    d.add_endings()
    d.drop(ENDINGS, **BRAKES)
