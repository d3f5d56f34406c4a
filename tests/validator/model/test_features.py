"""The features document: a function of the descriptor, true to declarations and to arrays."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from tests.each import each
from tests.mismatch import pointers
from tests.model_release import BARE, CANDIDATES, DESCRIPTOR, make_arrays, make_frames

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layer import LAYERS
from branchdrive.driving.feature import InputContract
from branchdrive.driving.target import TARGETS
from branchdrive.errors import UsageError
from branchdrive.model.features import (
    CONTRACT_TABLES,
    HISTORIES,
    admit_column,
    feature_mismatches,
    features_document,
    target_mask,
)

DOCUMENT = features_document(DESCRIPTOR)
INPUT_COLUMNS = [
    (table, column.name, column.track) for table in LAYERS["model"].tables for column in LAYER_TABLES[table].columns
]


def test_contracts_read_one_more_table_each() -> None:
    assert DOCUMENT["contracts"] == {
        "sensor": ["state", "past_controls"],
        "mixed": ["state", "past_controls", "expert"],
        "privileged": ["state", "past_controls", "expert", "surroundings"],
    }


@pytest.mark.parametrize("table", HISTORIES)
def test_features_are_the_columns_of_their_table_with_unit_frame_and_track(table: str) -> None:
    declared = {column.name: column for column in LAYER_TABLES[table].columns}
    for feature in HISTORIES[table].features:
        name = (
            "traffic_light" if feature.name.startswith("traffic_light_") and table == "surroundings" else feature.name
        )
        column = declared.pop(name) if name in declared else LAYER_TABLES[table][name]
        assert (column.unit, column.frame) == (feature.unit, feature.frame)
        if table != "past_controls":  # audit columns of the raw layer that every contract admits
            assert column.track == feature.track
    masks = {column.available.mask for column in LAYER_TABLES[table].columns if column.available} - {None}
    assert set(declared) == {"partition", "group_id", "offset_ticks", *masks}


def test_the_document_describes_the_arrays() -> None:
    arrays = make_arrays(make_frames())
    assert arrays.surroundings is not None
    found = {
        "state": arrays.state, "controls": arrays.controls, "expert": arrays.expert,
        "surroundings": arrays.surroundings.values, "surroundings_available": arrays.surroundings.available,
        "actions": arrays.actions, "scalars": arrays.scalars.values, "scalars_available": arrays.scalars.available,
        "trajectories": arrays.trajectories.values,
    }  # fmt: skip
    shapes = {name: [5 if n == "groups" else n for n in about["shape"]] for name, about in DOCUMENT["arrays"].items()}
    assert shapes == {name: list(values.shape) for name, values in found.items() if values is not None}
    assert tuple(DOCUMENT["candidate_order"]) == CANDIDATES
    assert {name: about["rows"] for name, about in DOCUMENT["histories"].items()} == {
        "state": 16, "past_controls": 80, "expert": 16, "surroundings": 16,
    }  # fmt: skip
    assert [target["mask"] for target in DOCUMENT["targets"]] == [target_mask(target.name) for target in TARGETS]


def test_what_a_dataset_does_not_have_is_left_out() -> None:
    bare = features_document(BARE)
    assert bare["contracts"]["privileged"] == ["state", "past_controls", "expert"]
    assert "surroundings" not in bare["histories"]
    assert {"surroundings", "surroundings_available", "actions"}.isdisjoint(bare["arrays"])
    assert bare["encoding"] is None


def test_the_stored_document_has_no_mismatch() -> None:
    assert not list(feature_mismatches(json.loads(dump_json(DOCUMENT)), DESCRIPTOR))


@pytest.mark.parametrize(
    ("path", "value", "place"),
    [
        (("histories", "state", "features", 4, "track"), "privileged", "/histories/state/features/4/track"),
        (("contracts", "sensor"), ["state", "past_controls", "expert"], "/contracts/sensor"),
        (("candidate_order", 0), "hover", "/candidate_order/0"),
        (("histories", "past_controls", "rows"), 81, "/histories/past_controls/rows"),
        (("encoding",), None, "/encoding"),
        (("extra",), 1, "/extra"),
        (("trajectory", "steps"), True, "/trajectory/steps"),
    ],
)
def test_a_change_is_told_by_its_place(path: tuple[Any, ...], value: Any, place: str) -> None:
    document: Any = copy.deepcopy(DOCUMENT)
    *way, last = path
    node = document
    for step in way:
        node = node[step]
    node[last] = value
    assert pointers(feature_mismatches(document, DESCRIPTOR)) == [place]


@each("contract", InputContract)
@each(("table", "column", "track"), INPUT_COLUMNS)
def test_a_contract_admits_exactly_its_tracks(contract: InputContract, table: str, column: str, track: str) -> None:
    if track in contract.tracks:
        assert admit_column(contract, table, column).name == column
    else:
        with pytest.raises(UsageError, match=f"is of track '{track}' and the input contract '{contract.value}' admits"):
            admit_column(contract, table, column)


def test_a_contract_reads_the_tables_with_features_that_it_admits() -> None:
    for contract, tables in CONTRACT_TABLES.items():
        for table in HISTORIES:
            tracks = {column.track for column in LAYER_TABLES[table].value_columns}
            assert (table in tables) == tracks.issubset(contract.tracks)


@pytest.mark.parametrize(
    ("table", "column", "message"),
    [
        ("controls", "throttle", "no table 'controls' in the model layer"),
        ("state", "altitude_m", "no column 'altitude_m' in the table `state`"),
    ],
)
def test_what_is_not_declared_is_not_admitted(table: str, column: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        admit_column(InputContract.PRIVILEGED, table, column)
