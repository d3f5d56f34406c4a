"""Answers about a map are those of its bytes, and few of them are kept."""

from __future__ import annotations

import pyarrow as pa
import pytest
from tests import synthetic

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw import known_map
from branchdrive.raw.known_map import once_per_map
from branchdrive.raw.shard_view import ShardView


def view_with(x_m: float, order: tuple[int, ...] = (0, 1)) -> ShardView:
    schema = pa.schema([field for field in table_schema("map") if field.name in ("town", "element_id", "kind", "x_m")])
    rows = [{"town": "T", "element_id": f"e{i}", "kind": "signal", "x_m": [x_m + i]} for i in order]
    tables = {**next(iter(synthetic.base_tables().values())), "map": pa.Table.from_pylist(rows, schema=schema)}
    return ShardView(tables, Descriptor.model_validate(synthetic.descriptor()))


@pytest.fixture(autouse=True)
def forgotten() -> None:
    known_map._known.clear()


def test_shards_with_one_map_share_answers() -> None:
    asked: list[ShardView] = []

    def first_x(view: ShardView) -> float:
        asked.append(view)
        return float(view.map["x_m"][0][0])

    assert [once_per_map(view_with(x_m), first_x) for x_m in (1.0, 1.0, 2.0, 1.0)] == [1.0, 1.0, 2.0, 1.0]
    assert len(asked) == 2
    assert once_per_map(view_with(1.0, order=(1, 0)), first_x) == 2.0
    assert once_per_map(view_with(1.0), first_x, "of another shard") == 1.0
    assert len(asked) == 4


def test_few_maps_are_kept() -> None:
    for x_m in range(5):
        once_per_map(view_with(float(x_m)), len_of_map)
    assert len(known_map._known) == 2


def len_of_map(view: ShardView) -> int:
    return len(view.map)
