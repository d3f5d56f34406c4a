"""Every planted mistake is named by the section that measures it, with what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests import synthetic
from tests.validator.engine import datasets
from tests.validator.pilot import mistakes
from tests.validator.pilot.mistakes import Shards

from branchdrive.pilot.action_response import action_response
from branchdrive.pilot.column import columns
from branchdrive.pilot.physics import physics
from branchdrive.pilot.pilot import Pilot, read_pilot
from branchdrive.pilot.section import Section

Examine = Callable[[Pilot], Section]

PLANTED: list[tuple[Callable[[Shards], Shards], Examine, str, str]] = [
    (mistakes.mirrored_world, physics, "the world is mirrored", "negate y, yaw, yaw rate"),
    (mistakes.speed_in_kmh, physics, "the speed is in km/h", "divide by 3.6"),
    (mistakes.late_observations, action_response, "Observations are late", "with the state at tick t"),
    (mistakes.ignored_commands, action_response, "are ignored", "Apply the policy's command"),
    (mistakes.constant_column, columns, "observations.target_speed_mps is the same in every row: 10", "`unrecorded`"),
    (mistakes.half_extents, physics, "of ego 2.25 m x 0.94 m, of vehicle", "twice the half extents"),
    (mistakes.ten_hertz, physics, "10 Hz recorded as 20 Hz", "Step the simulator by 0.05 s"),
]


@pytest.mark.parametrize(("plant", "examine", "what", "remedy"), PLANTED, ids=[case[0].__name__ for case in PLANTED])
def test_a_planted_mistake_is_named(
    plant: Callable[[Shards], Shards], examine: Examine, what: str, remedy: str, tmp_path: Path, pilot: Pilot
) -> None:
    assert not [concern for concern in examine(pilot).concerns if what in concern.what]
    wrong = read_pilot(datasets.write(tmp_path / "dataset", plant(synthetic.base_tables())))
    named = [concern for concern in examine(wrong).concerns if what in concern.what]
    assert named
    assert all(remedy in concern.remedy for concern in named)
