"""What a map says of places: nearest lane, drivable ground, limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from branchdrive import UsageError, crossing_element, sign_element, stop_line_element
from branchdrive.collector.town import lane_element, under

RIGHT = lane_element("right", [0.0, 100.0], [0.0, 0.0], 4.0, 10.0)
LEFT = lane_element("left", [0.0, 100.0], [3.0, 3.0], 4.0)
SHOULDER = {**lane_element("s", [0.0, 100.0], [-3.0, -3.0], 2.0), "kind": "shoulder", "lane_id": None}
PLAZA = {"element_id": "p", "kind": "road_area", "x_m": [100.0, 120.0, 120.0, 100.0], "y_m": [-9.0, -9.0, 9.0, 9.0]}


def test_the_nearest_of_the_lanes_that_hold_a_point_is_recorded() -> None:
    ground = under([RIGHT, LEFT, SHOULDER, PLAZA], np.full(5, 50.0), np.array([0.0, 1.4, 1.6, 4.9, 5.1]))
    assert ground.lane_id == ["right", "right", "left", "left", None]
    assert ground.on_road.tolist() == [True, True, True, True, False]
    assert ground.speed_limit_mps == [10.0, 10.0, None, None, None]


def test_shoulders_and_areas_are_road_and_no_lanes() -> None:
    ground = under([RIGHT, SHOULDER, PLAZA], np.array([50.0, 110.0, 130.0]), np.array([-3.0, 8.0, 8.0]))
    assert ground.lane_id == [None, None, None]
    assert ground.on_road.tolist() == [True, True, False]


def test_beside_the_lanes_the_limit_is_that_of_the_nearest() -> None:
    other = lane_element("far", [0.0, 100.0], [30.0, 30.0], 4.0, 20.0)
    ground = under([RIGHT, other], np.array([50.0, 50.0]), np.array([10.0, 20.0]))
    assert (ground.lane_id, ground.speed_limit_mps) == ([None, None], [10.0, 20.0])


def test_what_stands_beside_lanes_changes_no_ground() -> None:
    beside = [
        sign_element("yield_sign", "y", 50.0, 5.0),
        stop_line_element("l", [50.0, 50.0], [-2.0, 2.0], "right"),
        crossing_element("c", [40.0, 44.0, 44.0], [-9.0, -9.0, 9.0]),
    ]
    ground = under([RIGHT, *beside], np.array([50.0, 43.0]), np.array([0.0, 5.0]))
    assert (ground.lane_id, ground.on_road.tolist()) == (["right", None], [True, False])


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: sign_element("light", "s", 0.0, 0.0), "s: there is no sign of kind 'light'; one of 'signal', "),  # type: ignore[arg-type]
        (lambda: stop_line_element("l", [0.0], [0.0]), r"l: .* at least 2; found shapes \[1\] and \[1\]"),
        (lambda: stop_line_element("l", [0.0, 1.0], [0.0]), r"l: .* found shapes \[2\] and \[1\]"),
        (lambda: crossing_element("c", [0.0, 1.0], [0.0, 1.0]), "c: .* at least 3"),
        (lambda: crossing_element("c", [0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0]), "the last vertex .* leave it out"),
    ],
)
def test_elements_that_no_map_may_hold_are_refused(make: Callable[[], dict[str, Any]], expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        make()
