"""Columnar views: rows that are compared bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from branchdrive.contract.columns import table_schema
from branchdrive.tables.view import TableView

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
