"""Elements of a picture: those of the dataset's map near the candidates, or of a town that is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.reference_impl.drawing.invented import scene_of, write_invented
from tests.synthetic import write_dataset
from tests.synthetic_map import map_descriptor, map_tables

from branchdrive import Dataset, open_dataset
from branchdrive.contract.columns import table_schema
from branchdrive_reference.drawing.elements import elements_around
from branchdrive_reference.town.elements import town_elements
from branchdrive_reference.town.town import TOWN_NAMES, town


def mapped(root: Path, **changes: Any) -> Dataset:
    """The invented dataset with its maps, and with changed columns of the lane of the first group."""
    shards = {}
    for folder, tables in map_tables().items():
        rows = [row | changes if row["element_id"] == "lane-0" else row for row in tables["map"].to_pylist()]
        shards[folder] = {**tables, "map": pa.Table.from_pylist(rows, schema=table_schema("map"))}
    write_dataset(root, shards, map_descriptor())
    return open_dataset(root)


def test_elements_are_those_of_the_map_near_the_candidates(tmp_path: Path) -> None:
    dataset = mapped(tmp_path / "d")
    elements = {element["element_id"]: element for element in elements_around(dataset, scene_of(dataset))}
    assert set(elements) == {"lane-0", "ground-0"}
    stored = next(row for row in dataset.table("map").read().to_pylist() if row["element_id"] == "lane-0")
    lane = elements["lane-0"]
    assert all(np.array_equal(lane[name], stored[name]) for name in ("x_m", "y_m", "width_m"))
    assert (lane["kind"], lane["lane_id"], lane["marking"]) == ("lane", "road1:-1", None)


@pytest.mark.parametrize("change", [{"y_m": [0.0]}, {"width_m": None}, {"x_m": [np.nan] * 81}])
def test_broken_elements_are_left_out(tmp_path: Path, change: dict[str, Any]) -> None:
    dataset = mapped(tmp_path / "d", **change)
    assert {e["element_id"] for e in elements_around(dataset, scene_of(dataset))} == {"ground-0"}


def test_a_town_without_map_has_no_elements(tmp_path: Path) -> None:
    dataset = mapped(tmp_path / "d")
    scene = scene_of(dataset)
    assert elements_around(dataset, replace(scene, record={**scene.record, "town": "Town99"})) == ()


def test_without_a_map_a_known_town_is_drawn_all_the_same(tmp_path: Path) -> None:
    dataset = write_invented(tmp_path / "d")
    scene = scene_of(dataset)
    assert elements_around(dataset, scene) == ()
    for name in TOWN_NAMES:
        known = replace(scene, record={**scene.record, "town": name})
        assert elements_around(dataset, known) == town_elements(town(name))
