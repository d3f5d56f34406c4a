"""Defects and limits of the table of objects, which a release may do without."""

from __future__ import annotations

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.model.objects import OBJECTS

TEST = "g12"
"""A test context."""

AT_BRANCH = {"group_id": TEST, "offset_ticks": 0, "object_index": 0}


@boundary("BD-MOD-023", "BD-MOD-021", "BD-LYR-001", "BD-LYR-008", "BD-REL-003")
def release_that_tells_what_sensors_see(d: ReleaseDraft) -> None:
    d.add_objects()


@mutant("BD-MOD-023", at={"table": OBJECTS, "group_id": TEST, "column": "x_m"})
def object_that_is_told_a_last_bit_nearer(d: ReleaseDraft) -> None:
    d.add_objects()
    d.set(OBJECTS, "x_m", lambda value: float(np.nextafter(np.float32(value), np.float32(0))), **AT_BRANCH)


@mutant("BD-MOD-023", at={"table": OBJECTS, **AT_BRANCH})
def object_that_is_left_out(d: ReleaseDraft) -> None:
    d.add_objects()
    d.drop(OBJECTS, **AT_BRANCH)


@mutant("BD-MOD-023", at={"table": OBJECTS, "group_id": TEST, "offset_ticks": 0, "object_index": 500}, findings=2)
def object_that_nobody_recorded(d: ReleaseDraft) -> None:
    d.add_objects()
    d.set(OBJECTS, "object_index", 500, group_id=TEST, offset_ticks=-5, object_index=0)
    d.set(OBJECTS, "offset_ticks", 0, group_id=TEST, object_index=500)
    d.sort(OBJECTS)
