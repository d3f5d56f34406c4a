"""The invented dataset for pictures: its town is none that the reference package has."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from tests.synthetic import base_tables, descriptor, write_dataset

from branchdrive import Dataset, open_dataset
from branchdrive_reference.drawing.scene import DrawnScene, read_scene


def write_invented(root: Path, changes: Mapping[str, Mapping[str, Any]] | None = None) -> Dataset:
    """Write the dataset with some values of the rollouts table replaced, by rollout id and column."""
    shards = {}
    for folder, tables in base_tables().items():
        rows = [{**row, **(changes or {}).get(row["rollout_id"], {})} for row in tables["rollouts"].to_pylist()]
        shards[folder] = {**tables, "rollouts": pa.Table.from_pylist(rows, schema=tables["rollouts"].schema)}
    write_dataset(root, shards, descriptor())
    return open_dataset(root)


def scene_of(dataset: Dataset, group_id: str = "g0") -> DrawnScene:
    return read_scene(dataset.group(group_id), dataset.descriptor)


def inside(values: np.ndarray[Any, Any], limits: tuple[float, float]) -> bool:
    return bool((values > limits[0]).all() and (values < limits[1]).all())
