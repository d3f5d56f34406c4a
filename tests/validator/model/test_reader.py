"""The model layer as users read it: by key, under a contract, safely."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.each import each
from tests.model_release import (
    ASSIGNMENT,
    CANDIDATES,
    DESCRIPTOR,
    GROUPS,
    make_arrays,
    make_frames,
    shuffled,
    write_release,
)
from tests.synthetic import base_tables, descriptor, write_dataset

from branchdrive import (
    DatasetError,
    InputContract,
    MixedInputs,
    ModelLayer,
    ObjectsInputs,
    PrivilegedInputs,
    SensorInputs,
    UsageError,
    open_model,
)
from branchdrive.contract.columns import LAYER_TABLES, table_schema
from branchdrive.contract.layer import LAYERS
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import PROFILES, fit_scale, utility
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import join_parts, parts_of
from branchdrive.model.arrays import pack_objects
from branchdrive.model.features import features_document
from branchdrive.model.normalisation_document import normalisation_document, scalings_of
from branchdrive.quality.variants import Variant
from branchdrive.tables.arrow import to_arrow
from branchdrive.tables.frame import take
from branchdrive.testing.defect import with_cells

FRAMES = make_frames()
ARRAYS = make_arrays(FRAMES)
OBJECTS = pack_objects(FRAMES["objects"], GROUPS)
SCALINGS = scalings_of(normalisation_document(ARRAYS, ASSIGNMENT))
INPUTS: dict[InputContract, type] = {
    InputContract.SENSOR: SensorInputs,
    InputContract.OBJECTS: ObjectsInputs,
    InputContract.MIXED: MixedInputs,
    InputContract.PRIVILEGED: PrivilegedInputs,
}
COLUMNS = [(table, column) for table in LAYERS["model"].tables for column in LAYER_TABLES[table].columns]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    variants = (
        Variant("words", "Extended", {"extended_valid": True}),
        Variant("whole", "All", {"near_duplicate": False}),
    )
    return write_release(tmp_path_factory.mktemp("model") / "release", FRAMES, variants=variants)


@pytest.fixture(scope="module")
def layer(root: Path) -> ModelLayer:
    return open_model(root)


def inputs(layer: ModelLayer, contract: InputContract, *arguments: Any, **options: Any) -> Any:
    call: Callable[..., Any] = getattr(layer, f"{contract.value}_inputs")
    return call(*arguments, **options)


def test_groups_are_sorted_and_divided_by_partition_and_variant(layer: ModelLayer) -> None:
    assert layer.groups() == GROUPS
    assert layer.groups("train") == ("g1", "g2", "g5")
    assert layer.groups("val") == ("g3",)
    assert layer.groups(variant="extended") == ("g1", "g4")
    assert layer.groups("train", "extended") == ("g1",)
    assert layer.groups("val", "extended") == ()
    assert layer.candidate_order == CANDIDATES


@pytest.mark.parametrize(
    ("partition", "variant", "message"),
    [
        ("tset", None, r"unknown partition 'tset'; did you mean 'test'\?"),
        ("validation", None, r"unknown partition 'validation'; did you mean 'val'\?"),
        ("calibration", None, r"no group is in the partition 'calibration'; groups are in \['test', 'train', 'val'\]"),
        (None, "mine", r"no variant 'mine'; there are \['extended', 'words', 'whole'\]"),
        (None, "whole", "1 groups of the variant 'whole', as 'g0', are not in the frozen population"),
    ],
)
def test_what_the_layer_does_not_hold_is_refused(
    layer: ModelLayer, partition: str | None, variant: str | None, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        layer.groups(partition, variant)


@pytest.mark.parametrize("contract", InputContract)
def test_inputs_are_the_packed_arrays_of_their_contract(layer: ModelLayer, contract: InputContract) -> None:
    found = inputs(layer, contract, "train")
    assert type(found) is INPUTS[contract]
    assert ARRAYS.surroundings is not None
    expected = {
        "state": ARRAYS.state, "controls": ARRAYS.controls, "expert": ARRAYS.expert,
        "surroundings": ARRAYS.surroundings.values, "surroundings_available": ARRAYS.surroundings.available,
        "objects": OBJECTS.values, "objects_available": OBJECTS.available,
    }  # fmt: skip
    for field in fields(found):
        np.testing.assert_array_equal(getattr(found, field.name), expected[field.name][[0, 1, 4]], err_msg=field.name)


def test_the_types_of_inputs_hold_what_their_contracts_admit_and_are_no_subtypes() -> None:
    names = {contract: [field.name for field in fields(type_)] for contract, type_ in INPUTS.items()}
    assert names == {
        InputContract.SENSOR: ["state", "controls"],
        InputContract.OBJECTS: ["state", "controls", "objects", "objects_available"],
        InputContract.MIXED: ["state", "controls", "expert"],
        InputContract.PRIVILEGED: ["state", "controls", "expert", "surroundings", "surroundings_available"],
    }
    pairs = [(one, other) for one in INPUTS.values() for other in INPUTS.values() if one is not other]
    assert not any(issubclass(one, other) for one, other in pairs)


def test_inputs_show_their_shapes(layer: ModelLayer) -> None:
    shown = "SensorInputs(state float64 [3, 16, 21], controls float64 [3, 80, 3])"
    assert repr(layer.sensor_inputs("train")) == shown


def test_normalised_inputs_and_targets_are_scaled_by_training_statistics(layer: ModelLayer) -> None:
    found, targets = layer.mixed_inputs("val", normalised=True), layer.targets("val", normalised=True)
    np.testing.assert_array_equal(found.state, SCALINGS.state.apply(ARRAYS.state[2:3]))
    np.testing.assert_array_equal(found.controls, SCALINGS.controls.apply(ARRAYS.controls[2:3]))
    np.testing.assert_array_equal(found.expert, SCALINGS.expert.apply(ARRAYS.expert[2:3]))
    np.testing.assert_array_equal(targets.scalars, SCALINGS.scalars.apply(ARRAYS.scalars.values[2:3]))
    back = layer.scalings().trajectories.invert(targets.trajectories)
    np.testing.assert_allclose(back, ARRAYS.trajectories.values[2:3], atol=1e-9)


def test_surroundings_stay_in_their_units(layer: ModelLayer) -> None:
    plain, scaled = layer.privileged_inputs(), layer.privileged_inputs(normalised=True)
    np.testing.assert_array_equal(plain.surroundings, scaled.surroundings)
    assert (plain.state != scaled.state).any()


def test_targets_are_the_packed_arrays(layer: ModelLayer) -> None:
    targets = layer.targets()
    np.testing.assert_array_equal(targets.scalars, ARRAYS.scalars.values)
    np.testing.assert_array_equal(targets.scalars_available, ARRAYS.scalars.available)
    np.testing.assert_array_equal(targets.trajectories, ARRAYS.trajectories.values)


def test_a_target_that_cannot_be_scaled_is_not_available_normalised(tmp_path: Path) -> None:
    document = normalisation_document(ARRAYS, ASSIGNMENT)
    document["scalars"][2] |= {"offset": None, "scale": None}
    layer = open_model(write_release(tmp_path / "release", FRAMES, normalisation=document))
    assert layer.targets().scalars_available[..., 2].any()
    targets = layer.targets(normalised=True)
    assert not targets.scalars_available[..., 2].any()
    assert np.isfinite(targets.scalars[targets.scalars_available]).all()


def test_a_variant_selects_rows(layer: ModelLayer) -> None:
    np.testing.assert_array_equal(layer.sensor_inputs(variant="extended").state, ARRAYS.state[[0, 3]])
    assert layer.targets("val", variant="extended").scalars.shape == (0, 13, 6)


def test_what_is_handed_out_is_the_users_own(layer: ModelLayer) -> None:
    layer.sensor_inputs().state[:] = 0
    layer.actions()[:] = 0
    np.testing.assert_array_equal(layer.sensor_inputs().state, ARRAYS.state)
    assert ARRAYS.actions is not None
    np.testing.assert_array_equal(layer.actions(), ARRAYS.actions)


@settings(max_examples=5)
@given(seed=st.integers(0, 1000))
def test_the_order_of_stored_rows_changes_nothing(
    tmp_path_factory: pytest.TempPathFactory, layer: ModelLayer, seed: int
) -> None:
    other = open_model(write_release(tmp_path_factory.mktemp("model") / "release", shuffled(FRAMES, seed)))
    assert other.groups("train") == layer.groups("train")
    for contract in InputContract:
        one, two = (inputs(each, contract, "train", normalised=True) for each in (layer, other))
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
    for field in fields(layer.targets()):
        np.testing.assert_array_equal(getattr(layer.targets(), field.name), getattr(other.targets(), field.name))
    np.testing.assert_array_equal(layer.actions(), other.actions())


@each("contract", InputContract)
@each(("table", "column"), COLUMNS, ids=lambda value: getattr(value, "name", value))
def test_a_contract_refuses_every_column_of_another_track(
    layer: ModelLayer, contract: InputContract, table: str, column: Any
) -> None:
    if column.track not in contract.tracks:
        with pytest.raises(UsageError, match=f"column `{table}.{column.name}` is of track '{column.track}'"):
            layer.column(contract, table, column.name)
    elif table == "objects":
        with pytest.raises(UsageError, match="has no row for each observation; use `objects_inputs` or `arrow`"):
            layer.column(contract, table, column.name)
    else:
        rows = {"actions": (13,), "past_controls": (3, 80)}.get(table, (3, 16))
        values = layer.column(contract, table, column.name, "train")
        assert values.shape == rows
        assert isinstance(values, np.ma.MaskedArray) == (column.nullable and column.available.when != "recorded")


def test_a_column_is_in_its_own_type_and_order(layer: ModelLayer) -> None:
    speed = layer.column(InputContract.SENSOR, "state", "speed_mps", "val")
    np.testing.assert_array_equal(speed, ARRAYS.state[2:3, :, 4])
    light = layer.column(InputContract.PRIVILEGED, "surroundings", "traffic_light", variant="extended")
    assert set(light.compressed()) <= {"red", "yellow", "green"}
    assert light.shape == (2, 16)


@pytest.mark.parametrize("table", ["contexts", "state", "actions", "scalars", "trajectories"])
def test_arrow_tables_have_the_declared_schema(layer: ModelLayer, table: str) -> None:
    found = layer.arrow(table)
    assert found.schema.equals(table_schema(table), check_metadata=True)
    assert found.equals(join_parts([*parts_of(table, to_arrow(table, FRAMES[table])).values()]))


def test_files_of_a_table_are_joined_whatever_the_order_of_their_columns() -> None:
    first, *others = parts_of("state", to_arrow("state", FRAMES["state"])).values()
    turned = [first, *(part.select(part.column_names[::-1]) for part in others)]
    assert join_parts(turned).equals(join_parts([first, *others]))


@each("column", table_schema("scalars").names)
def test_files_of_a_table_are_joined_whichever_of_them_holds_a_null(column: str) -> None:
    parts = [part for part in parts_of("scalars", to_arrow("scalars", FRAMES["scalars"])).values() if len(part)]
    for place, part in enumerate(parts):
        joined = join_parts([*parts[:place], with_cells(part, column, {0: None}), *parts[place + 1 :]])
        assert joined[column].null_count - join_parts(parts)[column].null_count in (0, 1)
        assert joined[column][sum(map(len, parts[:place]))].as_py() is None


@pytest.mark.parametrize("table", ["records", "controls", "../state"])
def test_only_tables_of_the_layer_are_read(layer: ModelLayer, table: str) -> None:
    with pytest.raises(UsageError, match="in the model layer, which has"):
        layer.arrow(table)


def test_a_dataset_without_evidence_and_encoding_says_so(tmp_path: Path) -> None:
    layer = open_model(write_release(tmp_path / "release", make_frames(bare=True), bare=True))
    assert layer.mixed_inputs().expert.shape == (5, 16, 4)
    with pytest.raises(UsageError, match="has no evidence of surroundings"):
        layer.privileged_inputs()
    with pytest.raises(DatasetError, match="has no table `objects`, which `branchdrive build --objects` adds"):
        layer.objects_inputs()
    with pytest.raises(UsageError, match="declares no encoding of its action bank"):
        layer.actions()


def test_nothing_is_read_before_it_is_asked_for(tmp_path: Path) -> None:
    folder = write_release(tmp_path / "release", FRAMES)
    (folder / "model/surroundings-test-00000.parquet").unlink()
    (folder / "model/expert-val-00000.parquet").write_bytes(b"no table")
    layer = open_model(folder)
    assert layer.sensor_inputs().state.shape == (5, 16, 21)
    with pytest.raises(DatasetError, match=r"'model/expert-val-00000.parquet': table `expert` does not decode"):
        layer.mixed_inputs()
    with pytest.raises(DatasetError, match=r"'model/surroundings-test-00000.parquet' is missing"):
        layer.privileged_inputs()


def test_links_are_not_followed(tmp_path: Path) -> None:
    folder = write_release(tmp_path / "release", FRAMES)
    (folder / "model/state-train-00000.parquet").rename(tmp_path / "elsewhere.parquet")
    (folder / "model/state-train-00000.parquet").symlink_to(tmp_path / "elsewhere.parquet")
    with pytest.raises(DatasetError, match="cannot be opened without following links"):
        open_model(folder).sensor_inputs()


def test_columns_that_are_not_declared_are_refused(tmp_path: Path) -> None:
    folder = write_release(tmp_path / "release", FRAMES)
    table = to_arrow("state", FRAMES["state"]).append_column("rollout", pa.array(FRAMES["state"]["group_id"].tolist()))
    (folder / "model/state-train-00000.parquet").write_bytes(encode_table(table))
    with pytest.raises(DatasetError, match=r"columns \['rollout'\] are not as layers.json declares"):
        open_model(folder).sensor_inputs()


def test_a_layer_that_repeats_a_context_is_refused(tmp_path: Path) -> None:
    frames = {**FRAMES, "contexts": take(FRAMES["contexts"], np.array([0, 1, 2, 3, 4, 0]))}
    with pytest.raises(DatasetError, match="table `contexts` repeats a group"):
        open_model(write_release(tmp_path / "release", frames)).groups()


def test_a_candidate_that_is_missing_is_refused(tmp_path: Path) -> None:
    document = normalisation_document(ARRAYS, ASSIGNMENT)
    frames = {**FRAMES, "scalars": take(FRAMES["scalars"], np.arange(1, 65))}
    layer = open_model(write_release(tmp_path / "release", frames, normalisation=document))
    with pytest.raises(DatasetError, match="table `scalars`: 0 rows of `group_id` 'g1', `action_key` 'nominal'"):
        layer.targets()


@pytest.mark.parametrize("width", [28, None])
def test_encodings_of_another_width_than_declared_are_refused(tmp_path: Path, width: int | None) -> None:
    actions = dict(FRAMES["actions"])
    vectors = np.empty(len(CANDIDATES), object)
    for i in range(len(CANDIDATES)):
        vectors[i] = np.zeros(width or 0)
    actions["encoding"] = np.ma.masked_array(vectors, np.full(len(CANDIDATES), width is None))
    actions["encoded"] = np.full(len(CANDIDATES), width is not None)
    layer = open_model(write_release(tmp_path / "release", {**FRAMES, "actions": actions}))
    with pytest.raises(DatasetError, match=f"encodings have width {width}, and the descriptor declares 29"):
        layer.actions()


def test_features_that_are_not_those_of_the_descriptor_are_refused(tmp_path: Path) -> None:
    document = copy.deepcopy(features_document(DESCRIPTOR))
    document["candidate_order"] = document["candidate_order"][::-1]
    with pytest.raises(DatasetError, match=r"'model/features.json': /candidate_order/0 is '.*', expected 'nominal'"):
        open_model(write_release(tmp_path / "release", FRAMES, features=document))


@pytest.mark.parametrize(
    ("path", "content", "message"),
    [
        ("model/features.json", b"{", "'model/features.json': "),
        ("model/features.json", b"[]", "expected type 'object'"),
        ("model/normalisation.json", b"{}", "'model/normalisation.json': / is {}, expected properties"),
        ("quality/variants.json", b'{"variants": 3}', "'quality/variants.json': .*expected"),
    ],
)
def test_a_broken_document_is_told_in_one_line(tmp_path: Path, path: str, content: bytes, message: str) -> None:
    folder = write_release(tmp_path / "release", FRAMES)
    (folder / path).write_bytes(content)
    with pytest.raises(DatasetError, match=message) as caught:
        layer = open_model(folder)
        layer.sensor_inputs(variant="extended", normalised=True)
    assert "\n" not in str(caught.value)


def test_a_dataset_without_a_model_layer_names_the_command(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset", base_tables(), descriptor())
    with pytest.raises(DatasetError, match=r"layers \['raw'\] and no model layer; run `branchdrive build`"):
        open_model(tmp_path / "dataset")
    with pytest.raises(DatasetError, match="is not a folder"):
        open_model(tmp_path / "nothing")


def test_outcomes_are_the_targets_with_a_utility_for_every_profile(layer: ModelLayer) -> None:
    found = layer.outcomes("val")
    assert found.column_names == [
        "group_id",
        "action_key",
        *(t.name for t in TARGETS),
        *(f"utility_{p}" for p in PROFILES),
    ]
    targets, train = layer.targets("val"), layer.targets("train")
    assert found["group_id"].to_pylist() == [group for group in layer.groups("val") for _ in CANDIDATES]
    assert found["action_key"].to_pylist() == [*CANDIDATES] * len(layer.groups("val"))
    for place, target in enumerate(TARGETS):
        values, there = targets.scalars[..., place].ravel(), targets.scalars_available[..., place].ravel()
        expected = [float(value) if is_there else None for value, is_there in zip(values, there, strict=True)]
        assert found[target.name].to_pylist() == expected
    scale = fit_scale(Targets(train.scalars, train.scalars_available))
    worth = utility(Targets(targets.scalars, targets.scalars_available), scale, PROFILES["safety"]).ravel()
    known = [None if np.isnan(value) else value for value in worth.tolist()]
    assert found["utility_safety"].to_pylist() == known
    assert None in known
