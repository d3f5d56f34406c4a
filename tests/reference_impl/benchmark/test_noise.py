"""Noise of a release: from raw replays of training groups, and from those that have a value alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft

from branchdrive.benchmark.ranking.noise import OutcomeNoise
from branchdrive_reference.benchmark.noise import noise_of
from branchdrive_reference.benchmark.release import benchmark_data, open_release

SEPARATION = 1


def found(draft: BenchmarkDraft, root: Path, tolerance_m: float = 0.25) -> OutcomeNoise:
    release = open_release(draft.write(root))
    noise = noise_of(release, benchmark_data(release), tolerance_m=tolerance_m)
    assert noise is not None
    return noise


def without_separation(draft: BenchmarkDraft, *attempts: str) -> None:
    for attempt in attempts:
        draft.set("evidence", "separation_available", False, rollout_id=attempt)
        draft.set("evidence", "separation_m", None, rollout_id=attempt)


def test_every_replay_of_a_training_group_counts(tmp_path: Path) -> None:
    noise = found(BenchmarkDraft(), tmp_path / "dataset")
    assert noise.num_groups.tolist() == [11] * 6
    assert noise.num_one_sided.tolist() == [0] * 6
    assert (noise.rms > 0).all()
    assert (noise.rms < noise.tolerance).all()
    assert noise.losses == (11, 0, 22, 0)


def test_a_tolerance_below_the_noise_is_lost_by_repeats(tmp_path: Path) -> None:
    losses = found(BenchmarkDraft(), tmp_path / "dataset", tolerance_m=0.0).losses
    assert 0 < losses.num_groups_losing <= losses.num_repeats_losing < 22


@pytest.mark.parametrize(("lacking", "groups", "repeats"), [(("a1", "a2"), 10, 20), (("a2",), 11, 21)])
def test_a_group_without_a_repeated_value_is_no_group_that_did_not_move(
    tmp_path: Path, lacking: tuple[str, ...], groups: int, repeats: int
) -> None:
    draft = BenchmarkDraft()
    without_separation(draft, *(f"g0.nominal_replay.{attempt}" for attempt in lacking))
    noise, whole = found(draft, tmp_path / "dataset"), found(BenchmarkDraft(), tmp_path / "whole")
    assert noise.num_groups[SEPARATION] == noise.losses.num_groups == groups
    assert noise.losses.num_repeats == repeats
    assert noise.num_one_sided[SEPARATION] == 1
    others = [target for target in range(6) if target != SEPARATION]
    np.testing.assert_array_equal(noise.tolerance[others], whole.tolerance[others])
