"""Columns that collectors make of their arrays: declared types, and nulls as they come."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from branchdrive.collector.recording import column, pose_columns
from branchdrive.contract.columns import TABLES


@pytest.mark.parametrize(
    ("name", "values", "dtype"),
    [
        ("speed_mps", [1, 2], np.float32),
        ("speed_mps", np.array([1.0, 2.0]), np.float32),
        ("x_m", np.array([1.0, 2.0]), np.float64),
        ("vehicle_hazard", [True, False], np.bool_),
        ("command", ["left", "follow"], object),
    ],
)
def test_columns_have_their_declared_types(name: str, values: Any, dtype: Any) -> None:
    found = column("observations", name, values)
    assert found.dtype == dtype
    assert found.tolist() == list(values)


def test_missing_values_stay() -> None:
    assert column("observations", "speed_limit_mps", [8.0, None]) == [8.0, None]
    lanes = np.array(["a", None], object)
    assert column("evidence", "lane_id", lanes) is lanes


def test_what_follows_from_the_pose_follows_from_the_recorded_one() -> None:
    yaw_rad = 0.1 + 2 * np.pi
    columns = pose_columns([3.0], [1.0], [yaw_rad], [0.0, 50.0], [0.0, 0.0])
    assert columns["yaw_rad"].dtype == np.float32
    assert columns["yaw_rad"][0] == pytest.approx(0.1)
    assert columns["route_heading_error_rad"][0] == np.float64(columns["yaw_rad"][0])
    assert (columns["route_progress_m"][0], columns["route_offset_m"][0]) == (3.0, 1.0)
    assert set(columns) < {declared.name for declared in TABLES["observations"].columns}
