"""Every planted mistake is named by the section that measures it, with what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests import synthetic
from tests.validator.collector.straight import EmptyRoad, ShortRoad
from tests.validator.collector.straight import descriptor as straight_descriptor
from tests.validator.engine import datasets
from tests.validator.pilot import mistakes
from tests.validator.pilot.mistakes import Shards

import branchdrive as bd
from branchdrive.pilot.action_response import action_response
from branchdrive.pilot.column import columns
from branchdrive.pilot.conformance import conformance
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


def test_ignored_commands_of_few_groups_are_named(tmp_path: Path) -> None:
    """Each policy was tried too seldom for a rule, all of them together were not."""
    one = {datasets.OTHER_FOLDER: synthetic.base_tables()[datasets.OTHER_FOLDER]}
    right = read_pilot(datasets.write(tmp_path / "right", one))
    wrong = read_pilot(datasets.write(tmp_path / "wrong", mistakes.ignored_commands(one)))
    assert right.report.dataset.num_groups < 3
    ignored = [[c for c in action_response(pilot).concerns if "are ignored" in c.what] for pilot in (right, wrong)]
    assert [len(concerns) for concerns in ignored] == [0, 1]
    assert ignored[1][0].is_problem


def test_a_seed_without_a_branch_is_no_concern_of_conformance(tmp_path: Path) -> None:
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    bd.collect_dataset(tmp_path / "dataset", straight_descriptor(), worlds, num_groups=2)
    section = conformance(read_pilot(tmp_path / "dataset"))
    assert section.concerns == []
    assert any("1 group without a branch, which the funnel counts" in fact for fact in section.facts)
