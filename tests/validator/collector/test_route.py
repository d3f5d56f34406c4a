"""Route columns on lines where they are known, and target points on the route in the ego's frame."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive import route_columns, to_ego_frame

CORNER_X, CORNER_Y = np.array([0.0, 100.0, 100.0]), np.array([0.0, 0.0, 50.0])


def at(x_m: float, y_m: float, yaw_rad: float) -> dict[str, float]:
    one = [np.array([value]) for value in (x_m, y_m, yaw_rad)]
    return {name: float(values[0]) for name, values in route_columns(*one, CORNER_X, CORNER_Y).items()}


def test_on_a_straight_line() -> None:
    columns = at(10.0, 2.0, 0.1)
    assert columns["route_progress_m"] == pytest.approx(10.0)
    assert columns["route_offset_m"] == pytest.approx(2.0)
    assert columns["route_heading_error_rad"] == pytest.approx(0.1)


def test_targets_lie_at_multiples_of_twenty_metres_at_least_four_ahead() -> None:
    points = [at(x, 0.0, 0.0)["target_point_1_x_m"] + x for x in (0.0, 15.9, 16.1, 36.0)]
    assert points == pytest.approx([20.0, 20.0, 40.0, 40.0])
    assert at(0.0, 0.0, 0.0)["target_point_2_x_m"] == pytest.approx(40.0)


def test_behind_a_corner_targets_are_seen_along_the_new_heading() -> None:
    columns = at(100.0, 10.0, np.pi / 2)
    assert (columns["target_point_1_x_m"], columns["target_point_1_y_m"]) == pytest.approx((10.0, 0.0))
    assert (columns["target_point_2_x_m"], columns["target_point_2_y_m"]) == pytest.approx((30.0, 0.0))


def test_at_the_end_targets_are_the_last_vertex() -> None:
    columns = at(100.0, 49.0, np.pi / 2)
    assert [columns[f"target_point_{number}_x_m"] for number in (1, 2)] == pytest.approx([1.0, 1.0])


def test_what_is_to_the_left_is_positive() -> None:
    ahead, left = to_ego_frame([0.0], [3.0], [0.0])
    assert (ahead[0], left[0]) == pytest.approx((0.0, 3.0))
