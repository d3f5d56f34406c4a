"""Normalisation: fitted on training rows alone, inverted, bounded, and bound to its split."""

from __future__ import annotations

import statistics
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.driving.feature import MIXED_PROFILE, SENSOR_PROFILE
from branchdrive.driving.history import HistoryInput
from branchdrive.driving.target import TRAJECTORY, Targets, Trajectory
from branchdrive.model.normalisation import (
    Scaling,
    Training,
    fit_controls,
    fit_state,
    fit_targets,
    fit_trajectory,
    training,
)
from branchdrive.statistics.split import split_digest

IDS = [f"g{row}" for row in range(8)]
ASSIGNMENT = dict(zip(IDS, ["train"] * 5 + ["val", "test", "calibration"], strict=True))
FITTED_ON = training(IDS, ASSIGNMENT)
KEPT = [not feature.normalised for feature in MIXED_PROFILE.state]


def history(values: Any) -> HistoryInput:
    values = np.asarray(values, float)
    return HistoryInput(values, np.isfinite(values).all(axis=2))


def states(seed: int = 0) -> Any:
    """Mixed states of eight groups; the last three are out of proportion."""
    rng = np.random.default_rng(seed)
    values = rng.normal(5, 3, (8, 16, 25))
    values[..., KEPT] = rng.integers(0, 2, (8, 16, sum(KEPT)))
    values[5:] *= 1000
    return values


def targets(values: Any) -> Targets:
    return Targets(values, np.isfinite(values))


def trajectory(values: Any) -> Trajectory:
    return Trajectory(values, np.isfinite(values).all(axis=-1))


def test_training_rows_come_with_the_digest_of_their_split() -> None:
    assert FITTED_ON.rows.tolist() == [True] * 5 + [False] * 3
    assert FITTED_ON.split_digest == split_digest(ASSIGNMENT)


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        ([*IDS, "stranger"], "group 'stranger' is in no partition, of 9 groups and an assignment of 8"),
        (IDS[5:], "no group is in training, of 3 groups"),
        ([], "no group is in training, of 0 groups"),
    ],
)
def test_there_is_no_training_without_assigned_training_groups(ids: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        training(ids, ASSIGNMENT)


def test_standardised_training_states_have_mean_zero_and_deviation_one() -> None:
    values = states()
    scaling = fit_state(history(values), MIXED_PROFILE, FITTED_ON)
    there = scaling.apply(values)[:5].reshape(-1, 25)[:, ~np.array(KEPT)]
    np.testing.assert_allclose(there.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(there.std(axis=0), 1, atol=1e-12)
    assert scaling.split_digest == FITTED_ON.split_digest


def test_one_hots_and_flags_pass_to_the_bit_and_all_else_is_limited() -> None:
    values = states()
    found = fit_state(history(values), MIXED_PROFILE, FITTED_ON).apply(values)
    assert (found[..., KEPT] == values[..., KEPT]).all()
    assert np.abs(found[..., ~np.array(KEPT)]).max() == 8
    assert values[5:, :, KEPT].max() == 1000  # even such a value


def test_the_other_partitions_change_nothing() -> None:
    values, others = states(), states()
    others[5:] = np.nan
    found, expected = (fit_state(history(these), MIXED_PROFILE, FITTED_ON) for these in (others, values))
    for a, b in zip(found, expected, strict=True):
        assert np.array_equal(a, b)


@given(st.integers(0, 1000))
def test_the_plain_definition_agrees(seed: int) -> None:
    values = states(seed)
    values[1, 4] = np.nan
    scaling = fit_state(history(values), MIXED_PROFILE, FITTED_ON)
    for column in (0, 7, 20, 21):
        there = [row[column] for group in values[:5] for row in group.tolist() if row[column] == row[column]]
        kept = KEPT[column]
        assert len(there) == 79
        assert scaling.offset[column] == pytest.approx(0 if kept else statistics.fmean(there))
        assert scaling.scale[column] == pytest.approx(1 if kept else statistics.pstdev(there))


@given(st.integers(0, 1000))
def test_the_inverse_undoes_what_the_limit_left(seed: int) -> None:
    values = states(seed)
    scaling = fit_state(history(values), MIXED_PROFILE, FITTED_ON)
    normalised = scaling.apply(values)
    np.testing.assert_allclose(scaling.invert(normalised)[:5], values[:5], atol=1e-9)
    limited = np.abs(normalised) >= scaling.limit
    assert limited.any()
    np.testing.assert_allclose(scaling.invert(normalised)[~limited], values[~limited], atol=1e-9)


def test_a_column_that_hardly_varies_is_divided_by_the_floor() -> None:
    values = np.full((8, 16, 21), 4.0)
    values[0, 0, 4] += 1e-4
    scaling = fit_state(history(values), SENSOR_PROFILE, FITTED_ON)
    assert (scaling.scale[:15] == 1e-3).all()
    assert np.isfinite(scaling.apply(values)).all()


def test_controls_are_standardised_over_their_eighty_ticks() -> None:
    values = np.random.default_rng(1).uniform(0, 1, (8, 80, 3))
    scaling = fit_controls(history(values), SENSOR_PROFILE, FITTED_ON)
    np.testing.assert_allclose(scaling.offset, values[:5].mean(axis=(0, 1)))
    np.testing.assert_allclose(scaling.scale, values[:5].std(axis=(0, 1)))
    assert (scaling.limit == 8).all()


def test_targets_are_centred_on_the_median_and_scaled_by_the_quartiles() -> None:
    values = np.zeros((8, 13, 6))
    values[:5, :, 0] = np.arange(65).reshape(5, 13)
    values[:5, :, 1] = 7.0
    values[..., 2] = np.nan
    values[:5, 0, 3] = np.arange(5) * 4.0
    values[:5, 1:, 3] = np.nan
    values[5:] = 1e9
    scaling = fit_targets(targets(values), FITTED_ON)
    np.testing.assert_array_equal(scaling.offset, [32, 7, np.nan, 8, 0, 0])
    np.testing.assert_array_equal(scaling.scale, [32, 1e-6, np.nan, 8, 1e-6, 1e-6])
    assert (scaling.limit == np.inf).all()
    np.testing.assert_array_equal(scaling.apply(values[0, 0]), [-1, 0, np.nan, -1, 0, 0])


def test_unavailable_targets_do_not_enter_whatever_their_value() -> None:
    values = np.random.default_rng(0).normal(size=(8, 13, 6))
    available = values > -0.5
    found, expected = (
        fit_targets(Targets(np.where(available, values, stand_in), available), FITTED_ON) for stand_in in (99.0, np.nan)
    )
    for a, b in zip(found, expected, strict=True):
        assert np.array_equal(a, b)


@given(st.integers(0, 1000))
def test_targets_come_back(seed: int) -> None:
    values = np.random.default_rng(seed).lognormal(0, 2, (8, 13, 6))
    scaling = fit_targets(targets(values), FITTED_ON)
    np.testing.assert_allclose(scaling.invert(scaling.apply(values)), values, rtol=1e-9)


def test_trajectories_are_standardised_per_step_and_angles_are_kept() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(np.arange(10)[:, None], 1 + np.arange(10)[:, None], (8, 13, 10, 5))
    scaling = fit_trajectory(trajectory(values), FITTED_ON)
    found = scaling.apply(values)
    for component, name in enumerate(TRAJECTORY):
        there = found[:5, ..., component]
        if name in ("sin_yaw", "cos_yaw"):
            assert (there == values[:5, ..., component]).all()
        else:
            np.testing.assert_allclose(there.mean(axis=(0, 1)), 0, atol=1e-12)
            np.testing.assert_allclose(there.std(axis=(0, 1)), 1)
    np.testing.assert_allclose(scaling.invert(found), values, atol=1e-9)
    assert scaling.offset.shape == (10, 5)


def test_an_unavailable_step_stays_so() -> None:
    values = np.random.default_rng(3).normal(size=(8, 13, 10, 5))
    values[0, 0, 9] = np.nan
    found = fit_trajectory(trajectory(values), FITTED_ON).apply(values)
    assert np.isnan(found[0, 0, 9]).all()
    assert np.isfinite(found).sum() == found.size - 5


def test_a_scaling_applies_to_any_leading_axes() -> None:
    scaling = Scaling(np.array([1.0, 2.0]), np.array([2.0, 4.0]), np.array([1.0, np.inf]), "")
    assert scaling.apply([9.0, 10.0]).tolist() == [1, 2]
    assert scaling.apply(np.full((3, 1, 2), 2.0)).tolist() == [[[0.5, 0]]] * 3


@pytest.mark.parametrize("shape", [(3,), (), (2, 3)])
def test_values_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    scaling = Scaling(np.zeros(2), np.ones(2), np.full(2, np.inf), "")
    for call in (scaling.apply, scaling.invert):
        with pytest.raises(ValueError, match=r"the last axes not \[2\]"):
            call(np.zeros(shape))


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ValueError, match="a history of 25 features does not match a profile of 21"):
        fit_state(history(states()), SENSOR_PROFILE, FITTED_ON)
    with pytest.raises(ValueError, match=r"shape \[8, 16, 25\] do not match 7 groups"):
        fit_state(history(states()), MIXED_PROFILE, Training(FITTED_ON.rows[1:], ""))
    with pytest.raises(ValueError, match=r"shape \[8, 16\] do not match 8 groups"):
        fit_targets(targets(np.zeros((8, 16))), FITTED_ON)
    empty = states()
    empty[:5] = np.nan
    with pytest.raises(ValueError, match="no training row is available"):
        fit_state(history(empty), MIXED_PROFILE, FITTED_ON)
