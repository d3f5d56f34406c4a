"""Packing: by key alone, whole or not at all."""

from __future__ import annotations

import weakref
from collections import UserDict
from collections.abc import Iterator
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.model_release import CANDIDATES, GROUPS, make_arrays, make_frames, shuffled

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.encoding import encode_bank
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import CONTROL_WINDOW
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import ModelArrays, pack_arrays, pack_column, pack_objects, pack_trajectories
from branchdrive.model.features import HISTORIES, OBJECT_FEATURES
from branchdrive.tables.frame import concat, num_rows, sort_rows, take

FRAMES = make_frames()
ARRAYS = make_arrays(FRAMES)
PACKED = ("state", "past_controls", "expert", "surroundings", "actions", "scalars", "trajectories")


def parts(arrays: ModelArrays) -> dict[str, Any]:
    assert arrays.surroundings is not None
    return {
        "state": arrays.state, "controls": arrays.controls, "expert": arrays.expert,
        "surroundings": arrays.surroundings.values, "surroundings_available": arrays.surroundings.available,
        "actions": arrays.actions, "scalars": arrays.scalars.values, "available": arrays.scalars.available,
        "trajectories": arrays.trajectories.values, "steps": arrays.trajectories.available,
    }  # fmt: skip


def cell(table: str, column: str, **key: Any) -> Any:
    """A cell by a walk through the rows, `None` for null."""
    rows = zip(*(FRAMES[table][name].tolist() for name in (*key, column)), strict=True)
    (found,) = (row[-1] for row in rows if row[:-1] == tuple(key.values()))
    return found


def test_shapes_are_those_of_the_paper() -> None:
    shapes = {name: values.shape for name, values in parts(ARRAYS).items()}
    assert shapes == {
        "state": (5, 16, 21), "controls": (5, 80, 3), "expert": (5, 16, 4), "surroundings": (5, 16, 11),
        "surroundings_available": (5, 16, 11), "actions": (13, 29), "scalars": (5, 13, 6), "available": (5, 13, 6),
        "trajectories": (5, 13, 10, 5), "steps": (5, 13, 10),
    }  # fmt: skip
    assert ARRAYS.trajectories.available.all()


def test_every_value_is_the_cell_of_its_key() -> None:
    for (n, group_id), (place, feature) in product(enumerate(GROUPS), enumerate(SENSOR_PROFILE.state)):
        assert ARRAYS.state[n, 15, place] == cell("state", feature.name, group_id=group_id, offset_ticks=0)
    for t, offset in enumerate(CONTROL_WINDOW):
        assert ARRAYS.controls[3, t, 1] == cell("past_controls", "throttle", group_id="g4", offset_ticks=offset)
    for a, key in enumerate(CANDIDATES):
        for place, target in enumerate(TARGETS):
            found = cell("scalars", target.name, group_id="g2", action_key=key)
            assert ARRAYS.scalars.available[1, a, place] == (found is not None)
            assert np.array_equal(
                ARRAYS.scalars.values[1, a, place], np.nan if found is None else found, equal_nan=True
            )
        for step, (place, name) in product((1, 10), enumerate(TRAJECTORY)):
            found = cell("trajectories", name, group_id="g5", action_key=key, step=step)
            assert ARRAYS.trajectories.values[4, a, step - 1, place] == found


def test_flags_are_numbers_and_the_light_is_three_of_them() -> None:
    assert ARRAYS.surroundings is not None
    assert set(np.unique(ARRAYS.expert[..., 1:])) == {0.0, 1.0}
    names = [feature.name for feature in HISTORIES["surroundings"].features]
    lights = [names.index(f"traffic_light_{word}") for word in ("red", "yellow", "green")]
    values, available = ARRAYS.surroundings
    assert (np.isfinite(values) == available).all()
    there = available[..., lights[0]]
    assert there.any() and not there.all()
    assert (values[there][:, lights].sum(axis=1) == 1).all()
    light = cell("surroundings", "traffic_light", group_id="g1", offset_ticks=0)
    expected = [np.nan] * 3 if light is None else [float(light == word) for word in ("red", "yellow", "green")]
    np.testing.assert_array_equal(values[0, 15, lights], expected)
    assert {"num_actors", "on_road", "collision"} <= set(names)


def test_actions_are_the_float32_encoding_of_the_bank() -> None:
    assert ARRAYS.actions is not None
    assert ARRAYS.actions.dtype == np.float32
    np.testing.assert_array_equal(ARRAYS.actions, encode_bank(load_action_bank()))


@given(st.integers(0, 2**32))
def test_the_order_of_the_rows_changes_no_array(seed: int) -> None:
    for name, values in parts(make_arrays(shuffled(FRAMES, seed))).items():
        np.testing.assert_array_equal(values, parts(ARRAYS)[name], err_msg=name)


def test_the_given_orders_are_those_of_the_axes() -> None:
    turned = pack_arrays(FRAMES, GROUPS[::-1], CANDIDATES[::-1])
    np.testing.assert_array_equal(turned.state, ARRAYS.state[::-1])
    np.testing.assert_array_equal(turned.scalars.values, ARRAYS.scalars.values[::-1, ::-1])
    np.testing.assert_array_equal(turned.trajectories.values, ARRAYS.trajectories.values[::-1, ::-1])
    assert turned.actions is not None and ARRAYS.actions is not None
    np.testing.assert_array_equal(turned.actions, ARRAYS.actions[::-1])


class Held(UserDict[str, Any]):
    """Rows of a file that can be watched."""


def test_rows_of_several_files_are_packed_one_file_at_a_time() -> None:
    rows, cuts = FRAMES["trajectories"], [0, 100, 333, 400, num_rows(FRAMES["trajectories"])]
    past: list[weakref.ref[Held]] = []

    def files() -> Iterator[Held]:
        for first, stop in pairwise(cuts):
            assert [one() for one in past[:-1]] == [None] * len(past[:-1])
            frame = Held(take(rows, slice(first, stop)))
            past.append(weakref.ref(frame))
            yield frame

    found = pack_trajectories(files(), GROUPS, CANDIDATES)
    np.testing.assert_array_equal(found.values, ARRAYS.trajectories.values)
    assert len(past) == 4


@pytest.mark.parametrize("table", PACKED)
def test_a_missing_row_is_refused_by_its_key(table: str) -> None:
    rest = take(FRAMES[table], np.arange(1, num_rows(FRAMES[table])))
    key = "`action_key`" if table == "actions" else "`group_id` 'g1'"
    with pytest.raises(DatasetError, match=f"table `{table}`: 0 rows of {key}.*exactly one for each key"):
        make_arrays({**FRAMES, table: rest})


@pytest.mark.parametrize("table", PACKED)
def test_a_repeated_row_is_refused_by_its_key(table: str) -> None:
    more = concat([FRAMES[table], take(FRAMES[table], np.array([7]))])
    with pytest.raises(DatasetError, match=f"table `{table}`: 2 rows of `"):
        make_arrays({**FRAMES, table: more})


@pytest.mark.parametrize(
    ("table", "column", "value", "message"),
    [
        ("state", "group_id", "g9", "row of `group_id` 'g9', `offset_ticks` -75: this `group_id` is not one of the 5"),
        ("past_controls", "offset_ticks", 0, "`offset_ticks` 0: this `offset_ticks` is not one of the 80 expected"),
        ("surroundings", "offset_ticks", -74, "`offset_ticks` -74: this `offset_ticks` is not one of the 16 expected"),
        (
            "actions",
            "action_key",
            "hover",
            "row of `action_key` 'hover': this `action_key` is not one of the 13 expected",
        ),
        ("scalars", "action_key", "hover", "`action_key` 'hover': this `action_key` is not one of the 13 expected"),
        ("trajectories", "step", 11, "`step` 11: this `step` is not one of the 10 expected"),
    ],
)
def test_an_unknown_key_is_refused(table: str, column: str, value: Any, message: str) -> None:
    frame = dict(FRAMES[table])
    frame[column] = frame[column].copy()
    frame[column][0] = value
    with pytest.raises(DatasetError, match=message):
        make_arrays({**FRAMES, table: frame})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_no_number_is_refused(value: float) -> None:
    frame = dict(FRAMES["state"])
    frame["speed_mps"] = frame["speed_mps"].copy()
    frame["speed_mps"][16] = value
    with pytest.raises(DatasetError, match=f"'g2', `offset_ticks` -75: `speed_mps` is {value}, not a finite number"):
        make_arrays({**FRAMES, "state": frame})


def test_nulls_against_the_mask_are_refused() -> None:
    frame = dict(FRAMES["scalars"])
    there = int(np.flatnonzero(frame["min_ttc_available"])[0])
    frame["min_ttc_available"] = frame["min_ttc_available"].copy()
    frame["min_ttc_available"][there] = False
    with pytest.raises(DatasetError, match="`min_ttc_s` is not null where its mask is false, `min_ttc_available`"):
        make_arrays({**FRAMES, "scalars": frame})


def test_encodings_of_two_widths_are_refused() -> None:
    frame = dict(FRAMES["actions"])
    frame["encoding"] = frame["encoding"].copy()
    frame["encoding"][3] = np.zeros(28)
    with pytest.raises(DatasetError, match=r"encodings have widths \[28, 29\]"):
        make_arrays({**FRAMES, "actions": frame})


def test_an_axis_that_repeats_a_label_is_refused() -> None:
    with pytest.raises(ValueError, match="`group_id` 'g1' is given twice"):
        pack_arrays(FRAMES, ("g1", *GROUPS), CANDIDATES)


def test_without_evidence_and_encoding_there_are_neither_surroundings_nor_actions() -> None:
    arrays = make_arrays(make_frames(bare=True))
    assert arrays.surroundings is None
    assert arrays.actions is None


def test_a_column_keeps_its_type() -> None:
    light = pack_column(FRAMES["surroundings"], "surroundings", "traffic_light", GROUPS, CANDIDATES)
    assert light.dtype == object
    assert light.shape == (5, 16)
    steps = pack_column(FRAMES["trajectories"], "trajectories", "x_m", GROUPS, CANDIDATES)
    np.testing.assert_array_equal(steps, ARRAYS.trajectories.values[..., 0])


def test_objects_of_an_observation_come_by_number_and_unused_places_are_0() -> None:
    values, available = pack_objects(shuffled({"objects": FRAMES["objects"]}, 3)["objects"], GROUPS)
    assert values.shape == (5, 16, 32, len(OBJECT_FEATURES))
    assert not values[~available].any()
    assert available.sum() == num_rows(FRAMES["objects"])
    rows = sort_rows(FRAMES["objects"], ("group_id", "offset_ticks", "object_index"))
    for (n, group_id), (t, offset) in product(enumerate(GROUPS), enumerate(HISTORY_OFFSETS)):
        own = take(rows, (rows["group_id"] == group_id) & (rows["offset_ticks"] == offset))
        assert available[n, t].tolist() == [True] * num_rows(own) + [False] * (32 - num_rows(own))
        for place, (name, column) in enumerate(OBJECT_FEATURES):
            cells = own[column] if name == column else own[column] == name.removeprefix("object_class_")
            np.testing.assert_array_equal(values[n, t, : len(cells), place], cells)
    assert [name for name, _ in OBJECT_FEATURES[:4]] == [
        f"object_class_{one}" for one in ("vehicle", "cycle", "pedestrian", "static")
    ]


@pytest.mark.parametrize(
    ("column", "value"),
    [("group_id", "g9"), ("offset_ticks", 5), ("offset_ticks", -1), ("object_index", 7), ("x_m", np.nan)],
)
def test_an_object_that_cannot_be_packed_is_refused_by_its_key(column: str, value: Any) -> None:
    frame = take(FRAMES["objects"], slice(None))
    other = np.flatnonzero((frame["object_index"] == 9) & (np.roll(frame["object_index"], 1) == 7))[0]
    frame[column] = frame[column].copy()
    frame[column][other] = value
    with pytest.raises(DatasetError, match="not one of at most 32 objects, in finite numbers, of an observation"):
        pack_objects(frame, GROUPS)


def test_more_objects_than_sensors_tell_of_are_refused() -> None:
    one = take(FRAMES["objects"], slice(0, 1))
    many = concat([{**one, "object_index": np.array([number], np.int32)} for number in range(33)])
    assert pack_objects(take(many, slice(0, 32)), GROUPS).available.sum() == 32
    with pytest.raises(DatasetError, match="`object_index` 32: not one of at most 32 objects"):
        pack_objects(many, GROUPS)
