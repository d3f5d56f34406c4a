"""What is read of a group: the candidates around the branch, their touches, and the actors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.reference_impl.drawing.invented import scene_of, write_invented

from branchdrive import Dataset, Rollout, UsageError, load_action_bank
from branchdrive_reference.drawing.scene import HORIZON_TICKS

NOMINAL = "g0.nominal.a1"


def branch_tick(rollout: Rollout) -> int:
    return int(rollout.record["branch_tick"])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_invented(tmp_path_factory.mktemp("invented") / "d")


def test_candidates_are_those_of_the_bank_in_its_order(dataset: Dataset) -> None:
    keys = [candidate.policy.key for candidate in scene_of(dataset).candidates]
    assert keys == list(load_action_bank().keys)


def test_a_future_is_the_branch_and_ten_observations(dataset: Dataset) -> None:
    for candidate in scene_of(dataset).candidates:
        assert candidate.tick[candidate.future].tolist() == list(range(0, 51, 5))
        assert candidate.tick[0] == -80
        assert candidate.tick[candidate.recovery][0] == 50


def test_the_least_gap_is_that_of_the_recorded_evidence(dataset: Dataset) -> None:
    group = dataset.group("g0")
    for candidate in scene_of(dataset).candidates[1:]:
        rollout = group.interventions[candidate.policy.key][0]
        since = rollout.column("evidence", "tick") - (rollout.branch_tick or 0)
        gaps = rollout.column("evidence", "separation_m")[(since > 0) & (since <= 50)]
        touched = rollout.column("evidence", "collision")[(since > 0) & (since <= 50)].any()
        assert candidate.least_separation_m == (0 if touched else gaps.min())


def test_a_touch_in_the_future_is_a_gap_of_nothing(dataset: Dataset) -> None:
    whole = scene_of(dataset).candidates[0]
    for tick, gap in ((0, 3.5), (5, 0.0), (50, 0.0), (55, 3.5)):
        untouched, apart = np.zeros(len(whole.tick), bool), np.full(len(whole.tick), 3.5)
        candidate = replace(whole, separation_m=apart, touched=untouched | (whole.tick == tick))
        assert candidate.least_separation_m == gap


def test_a_rollout_that_reaches_the_horizon_does_not_end_early(dataset: Dataset) -> None:
    whole = scene_of(dataset).candidates[0]
    for last, is_early in ((HORIZON_TICKS, False), (HORIZON_TICKS - 5, True), (50, True)):
        candidate = replace(whole, tick=whole.tick - whole.tick[-1] + last)
        assert (candidate.ends_early, candidate.end_s) == (is_early, pytest.approx(last / 20))


def test_a_touch_begins_once_and_after_the_branch(dataset: Dataset) -> None:
    for candidate in scene_of(dataset).candidates:
        for row in candidate.contacts:
            assert candidate.tick[row] > 0
            assert candidate.touched[row]
            assert not candidate.touched[row - 1]
        assert bool(len(candidate.contacts)) == bool(candidate.touched[candidate.tick > 0].any())


def test_actors_are_those_of_the_branch_with_their_nominal_poses(dataset: Dataset) -> None:
    nominal = dataset.group("g0").nominal
    here = nominal.column("actors", "tick") == nominal.branch_tick
    scene = scene_of(dataset)
    assert [actor.actor_id for actor in scene.actors] == nominal.column("actors", "actor_id")[here].tolist()
    assert [float(actor.x_m[0]) for actor in scene.actors] == nominal.column("actors", "x_m")[here].tolist()
    assert all(len(actor.x_m) <= 11 for actor in scene.actors)


def test_the_nearest_actor_is_that_of_the_least_nominal_gap(dataset: Dataset) -> None:
    for group_id in dataset.groups:
        scene, nominal = scene_of(dataset, group_id), dataset.group(group_id).nominal
        rows = [row for row in nominal.tables["evidence"].to_pylist() if 0 < row["tick"] - branch_tick(nominal) <= 50]
        seen = [row for row in rows if row["separation_available"]]
        least = min(seen, key=lambda row: row["separation_m"], default={"separation_actor_id": None})
        assert scene.nearest_actor_id == least["separation_actor_id"]


def test_null_evidence_at_the_branch_is_none(dataset: Dataset) -> None:
    assert (scene_of(dataset).lane_id, scene_of(dataset).traffic_light) == (None, None)


def test_frames_without_relevant_actor_have_no_gap(dataset: Dataset) -> None:
    for group_id in dataset.groups:
        nominal = dataset.group(group_id).nominal
        since = nominal.column("evidence", "tick") - (nominal.branch_tick or 0)
        available = nominal.column("evidence", "separation_available")[since >= -80]
        assert np.array_equal(np.isfinite(scene_of(dataset, group_id).nominal.separation_m), available)


@pytest.mark.parametrize(
    ("rollout_id", "change", "told"),
    [
        (NOMINAL, {"status": "partial"}, "group 'g0' has no complete attempt of nominal"),
        (NOMINAL, {"branch_tick": None}, r"rollout 'g0\.nominal\.a1' has no observations around a branch"),
        ("g0.brake_0.30.a1", {"status": "partial"}, r"group 'g0' has no complete attempt of brake_0\.30"),
        ("g0.brake_0.30.a1", {"branch_tick": 10_000}, r"rollout 'g0\.brake_0\.30\.a1' has no observations around"),
    ],
    ids=["partial nominal", "no branch", "partial", "a branch beyond the end"],
)
def test_a_group_without_a_complete_branched_attempt_is_refused(
    tmp_path: Path, rollout_id: str, change: dict[str, object], told: str
) -> None:
    with pytest.raises(UsageError, match=told):
        scene_of(write_invented(tmp_path / "d", {rollout_id: change}))
