"""Inputs of an audit: what is refused, what the digest is of, and the features of the gate by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.each import each
from tests.validator.leakage.replays import changed, replay_inputs

from branchdrive.leakage.inputs import GateFeature, ReplayInputs, gate_features, pooled_controls
from branchdrive.leakage.streams import StreamColumn, Streams, ranked

INPUTS = replay_inputs(6, seed=0)


def with_value(name: str, place: tuple[int, ...], value: float) -> ReplayInputs:
    values = np.array(getattr(INPUTS, name))
    values[place] = value
    return changed(INPUTS, **{name: values})


def without_nominal_replay(inputs: ReplayInputs, groups: list[int]) -> dict[str, Any]:
    values: dict[str, Any] = {"has_nominal_replay": np.array(inputs.has_nominal_replay)}
    values["has_nominal_replay"][groups] = False
    for name in ("availability", "discrepancy", "ego", "controls"):
        values[name] = np.array(getattr(inputs, name))
        values[name][groups, inputs.nominal_index] = np.nan
    return values


def test_the_digest_is_of_contents() -> None:
    assert INPUTS.digest() == replay_inputs(6, seed=0).digest()
    assert len(INPUTS.digest()) == 64


@pytest.mark.parametrize(
    ("name", "place"),
    [("availability", (5, 4, 1)), ("discrepancy", (0, 0, 11)), ("ego", (3, 2, 15, 5)), ("controls", (1, 1, 79, 2))],
)
def test_every_bit_is_in_the_digest(name: str, place: tuple[int, ...]) -> None:
    value = float(getattr(INPUTS, name)[place])
    assert with_value(name, place, np.nextafter(value, 0.0)).digest() != INPUTS.digest()
    assert with_value(name, place, np.nan).digest() != INPUTS.digest()


def test_recorded_columns_are_in_the_digest() -> None:
    column = StreamColumn("evidence", "collision", 0)
    ranks, spread = ranked(np.arange(24.0).reshape(6, 4, 1))
    plain = changed(INPUTS, streams=Streams((column,), ranks, spread)).digest()
    others = [
        Streams((column._replace(offset_ticks=-5),), ranks, spread),
        Streams((column,), -ranks, spread),
        Streams((column,), ranks, 2 * spread),
    ]
    assert len({plain, INPUTS.digest(), *(changed(INPUTS, streams=other).digest() for other in others)}) == 5


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("group_ids", tuple("abcdef")),
        ("partitions", ("train",) * 6),
        ("action_keys", tuple("abcde")),
        ("nominal_index", 1),
        ("availability_names", ("x", "y")),
        ("ego_names", tuple("abcdef")),
        ("control_names", tuple("abc")),
    ],
)
def test_names_are_in_the_digest(name: str, value: Any) -> None:
    assert changed(INPUTS, **{name: value}).digest() != INPUTS.digest()


def test_signs_of_nothing_are_not_in_the_digest() -> None:
    assert with_value("ego", (0, 0, 0, 0), 0.0).digest() == with_value("ego", (0, 0, 0, 0), -0.0).digest()
    assert with_value("ego", (0, 0, 0, 0), np.nan).digest() == with_value("ego", (0, 0, 0, 0), -np.nan).digest()


def test_a_group_may_lack_a_nominal_replay() -> None:
    inputs = changed(INPUTS, **without_nominal_replay(INPUTS, [2]))
    assert inputs.has_nominal_replay.tolist() == [True, True, False, True, True, True]
    assert inputs.digest() != INPUTS.digest()


def test_values_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        INPUTS.ego[0, 0, 0, 0] = 1.0


def test_it_shows_shapes() -> None:
    assert repr(INPUTS) == (
        "ReplayInputs(availability [6, 5, 2], discrepancy [6, 5, 12], ego [6, 5, 16, 6], controls [6, 5, 80, 3] "
        "float64, 6 nominal replays)"
    )
    assert INPUTS.interventions == (1, 2, 3, 4)
    assert INPUTS.in_partition("test").tolist() == [False, False, True, False, False, False]


@each(
    ("values", "message"),
    [
        ({"group_ids": ("b", "a", "c", "d", "e", "f")}, "not sorted"),
        ({"group_ids": ("a", "a", "c", "d", "e", "f")}, "or repeat"),
        ({"partitions": ("train",)}, "1 partitions of 6 groups"),
        ({"ego_names": ("x",) * 6}, "`ego_names` are empty, or repeat"),
        ({"availability_names": (), "availability": np.zeros((6, 5, 0))}, "`availability_names` are empty"),
        ({"nominal_index": 5}, "nominal 5 of 5 actions"),
        ({"has_nominal_replay": [True]}, "`has_nominal_replay` has shape"),
        ({"has_nominal_replay": [False] * 6}, "nominal replay that is not there"),
        ({"ego": np.zeros((6, 5, 17, 6))}, "`ego` has shape"),
        ({"controls": np.full((6, 5, 80, 3), np.inf)}, "`controls` holds an infinite value"),
        ({"availability": np.full((6, 5, 2), 1.5)}, "`availability` is a share"),
        ({"discrepancy": np.full((6, 5, 12), -1.0)}, "`discrepancy` is negative"),
        ({"streams": Streams.none(6, 5)}, "`streams` has ranks of shape"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        changed(INPUTS, **values)


FOUR_ACTIONS = replay_inputs(4, seed=1, num_actions=4)
FEATURES, COLUMNS = gate_features(FOUR_ACTIONS)


def test_every_column_has_a_name_of_its_own() -> None:
    assert FEATURES.shape == (4, 3, len(COLUMNS))
    assert len(set(COLUMNS)) == len(COLUMNS) == 12 + 16 * 6 + 16 * 3 + 2


def test_a_name_leads_to_its_value() -> None:
    place = COLUMNS.index(GateFeature("ego", "speed_mps", (-10, -10)))
    np.testing.assert_array_equal(FEATURES[:, :, place], FOUR_ACTIONS.ego[:, 1:, 13, 3])
    place = COLUMNS.index(GateFeature("controls", "brake", (-5, -1)))
    np.testing.assert_allclose(FEATURES[:, :, place], FOUR_ACTIONS.controls[:, 1:, 75:, 2].mean(axis=2))
    place = COLUMNS.index(GateFeature("discrepancy", "position_m", None))
    np.testing.assert_array_equal(FEATURES[:, :, place], FOUR_ACTIONS.discrepancy[:, 1:, 0])
    place = COLUMNS.index(GateFeature("availability", "controls", None))
    np.testing.assert_array_equal(FEATURES[:, :, place], FOUR_ACTIONS.availability[:, 1:, 1])


def test_the_nominal_stays_out_wherever_it_is() -> None:
    moved = changed(FOUR_ACTIONS, nominal_index=2)
    np.testing.assert_array_equal(gate_features(moved)[0][:, 2, :12], FOUR_ACTIONS.discrepancy[:, 3])


def test_a_mean_over_a_missing_control_is_missing() -> None:
    controls = np.array(FOUR_ACTIONS.controls)
    controls[0, 1, 7, 0] = np.nan
    missing = np.isnan(pooled_controls(changed(FOUR_ACTIONS, controls=controls)))
    assert np.argwhere(missing).tolist() == [[0, 1, 1, 0]]


def test_no_group_gives_no_row() -> None:
    nothing = replay_inputs(0, seed=0, partitions=())
    assert gate_features(nothing)[0].shape == (0, 4, len(COLUMNS))
