"""Columnar views: columns, their extremes, the order of streams, and rows that are compared bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from branchdrive.contract.columns import table_schema
from branchdrive.tables.view import StreamView, TableView

NAN = float("nan")


@pytest.mark.parametrize(
    ("column", "values", "differs"),
    [
        ("separation_m", [1.0, 1.0], False),
        ("separation_m", [1.0, np.nextafter(1.0, 2.0)], True),
        ("separation_m", [0.0, -0.0], True),
        ("separation_m", [NAN, NAN], False),
        ("separation_m", [None, 0.0], True),
        ("separation_m", [None, None], False),
        ("collision", [True, False], True),
        ("collision", [True, True], False),
        ("lane_id", ["a", "b"], True),
        ("lane_id", ["a", "a"], False),
        ("lane_id", [None, ""], True),
        ("lane_id", [None, None], False),
    ],
)
def test_rows_differ_where_their_bits_or_nulls_do(column: str, values: list[Any], differs: bool) -> None:
    values = pa.array(values, table_schema("evidence").field(column).type)
    view = TableView("evidence", pa.table({column: values}))
    assert view.differs(column, np.array([0]), np.array([1])).tolist() == [differs]
    assert view.differs(column, np.array([0, 1]), np.array([0, 1])).tolist() == [False, False]


@pytest.mark.parametrize(
    ("values", "least", "most"),
    [
        ([3.0, -1.0, 2.0], -1.0, 3.0),
        ([None, 2.0, 1.0], 1.0, 2.0),
        ([None, None], np.inf, -np.inf),
        ([], np.inf, -np.inf),
        ([*np.arange(100_000.0).tolist(), -5.0], -5.0, 99_999.0),
        ([1.0] * 100_000 + [NAN], NAN, NAN),
        ([NAN] + [1.0] * 100_000, NAN, NAN),
        ([None, NAN], NAN, NAN),
    ],
    ids=["plain", "null", "nulls", "empty", "long", "nan at the end", "nan at the start", "nan and null"],
)
def test_extremes_are_of_what_is_there(values: list[Any], least: float, most: float) -> None:
    view = TableView("evidence", pa.table({"separation_m": pa.array(values, pa.float64())}))
    np.testing.assert_array_equal(view.extremes("separation_m"), (least, most))


def test_columns_of_several_pieces_are_joined() -> None:
    pieces = pa.chunked_array([[1.0, None], [], [3.0]], pa.float64())
    view = TableView("evidence", pa.table({"separation_m": pieces}))
    assert view["separation_m"].tolist() == [1.0, 0.0, 3.0]
    assert view.valid("separation_m").tolist() == [True, False, True]


def test_rows_of_a_stream_know_their_places() -> None:
    stored = pa.table({"rollout_id": ["b", "a", "b"], "tick": pa.array([4, 0, 2], pa.int32())})
    stream = StreamView("controls", stored, {"a": 0, "b": 1}, 2)
    assert stream.position.tolist() == [1, 2, 0]
    assert StreamView("controls", stored.take([1, 2, 0]), {"a": 0, "b": 1}, 2).position.tolist() == [0, 1, 2]
