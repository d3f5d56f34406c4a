"""Features of the gate: which value of the inputs each one is."""

from __future__ import annotations

import numpy as np
from tests.validator.leakage.replays import changed, replay_inputs

from branchdrive.leakage.gate_input import GateFeature, gate_features, pooled_controls

INPUTS = replay_inputs(4, seed=1, num_actions=4)
FEATURES, COLUMNS = gate_features(INPUTS)


def test_every_column_has_a_name_of_its_own() -> None:
    assert FEATURES.shape == (4, 3, len(COLUMNS))
    assert len(set(COLUMNS)) == len(COLUMNS) == 12 + 16 * 6 + 16 * 3 + 2


def test_a_name_leads_to_its_value() -> None:
    place = COLUMNS.index(GateFeature("ego", "speed_mps", (-10, -10)))
    np.testing.assert_array_equal(FEATURES[:, :, place], INPUTS.ego[:, 1:, 13, 3])
    place = COLUMNS.index(GateFeature("controls", "brake", (-5, -1)))
    np.testing.assert_allclose(FEATURES[:, :, place], INPUTS.controls[:, 1:, 75:, 2].mean(axis=2))
    place = COLUMNS.index(GateFeature("discrepancy", "position_m", None))
    np.testing.assert_array_equal(FEATURES[:, :, place], INPUTS.discrepancy[:, 1:, 0])
    place = COLUMNS.index(GateFeature("availability", "controls", None))
    np.testing.assert_array_equal(FEATURES[:, :, place], INPUTS.availability[:, 1:, 1])


def test_the_nominal_stays_out_wherever_it_is() -> None:
    moved = changed(INPUTS, nominal_index=2)
    np.testing.assert_array_equal(gate_features(moved)[0][:, 2, :12], INPUTS.discrepancy[:, 3])


def test_a_mean_over_a_missing_control_is_missing() -> None:
    controls = np.array(INPUTS.controls)
    controls[0, 1, 7, 0] = np.nan
    missing = np.isnan(pooled_controls(changed(INPUTS, controls=controls)))
    assert np.argwhere(missing).tolist() == [[0, 1, 1, 0]]


def test_no_group_gives_no_row() -> None:
    nothing = replay_inputs(0, seed=0, partitions=())
    assert gate_features(nothing)[0].shape == (0, 4, len(COLUMNS))
