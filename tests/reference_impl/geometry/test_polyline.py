"""Polylines: arc length, foot points, offsets and joins against analytic truth and shapely."""

from __future__ import annotations

import math

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from branchdrive_reference.geometry.polyline import Polyline, bezier, join

RADIUS_M = 20.0


def quarter_circle(count: int = 400) -> Polyline:
    """From (R, 0) counter-clockwise to (0, R) around the origin."""
    angle = np.linspace(0, math.pi / 2, count + 1)
    return Polyline(RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle))


def test_arc_length_of_a_circle() -> None:
    assert math.isclose(quarter_circle().length_m, RADIUS_M * math.pi / 2, rel_tol=1e-5)


def test_offset_is_positive_to_the_left() -> None:
    east = Polyline(np.array([0.0, 10.0]), np.array([0.0, 0.0]))
    place = east.position(np.array([4.0, 4.0]), np.array([2.0, -3.0]))
    assert place.offset_m.tolist() == [2.0, -3.0]
    assert place.progress_m.tolist() == [4.0, 4.0]
    assert place.heading_rad.tolist() == [0.0, 0.0]


def test_shifted_to_the_left_of_a_left_bend_is_shorter() -> None:
    inner = quarter_circle().shifted(3.5)
    assert math.isclose(inner.length_m, (RADIUS_M - 3.5) * math.pi / 2, rel_tol=1e-3)
    assert np.allclose(np.hypot(inner.x_m, inner.y_m), RADIUS_M - 3.5, atol=1e-3)


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=1, max_size=8))
def test_foot_points_agree_with_shapely(points: list[tuple[float, float]]) -> None:
    line = bezier(np.array([0.0, 15.0, 20.0, 30.0]), np.array([0.0, 0.0, 18.0, -5.0]), 40)
    truth = shapely.LineString(np.stack([line.x_m, line.y_m], axis=1))
    place = line.position(np.array([x for x, _ in points]), np.array([y for _, y in points]))
    for index, point in enumerate(points):
        assert math.isclose(abs(place.offset_m[index]), truth.distance(shapely.Point(point)), abs_tol=1e-9)
        foot = truth.interpolate(place.progress_m[index])
        assert math.isclose(foot.distance(shapely.Point(point)), abs(place.offset_m[index]), abs_tol=1e-6)


def test_cut_and_join_restore_the_line() -> None:
    line = quarter_circle(37)
    parts = [line.cut(0.0, 9.0), line.cut(9.0, 20.5), line.cut(20.5, line.length_m)]
    assert math.isclose(join(parts).length_m, line.length_m)
    assert [round(part.length_m, 9) for part in parts[:2]] == [9.0, 11.5]


def test_resampling_keeps_ends_and_spacing() -> None:
    line = quarter_circle().resampled(1.0)
    steps = np.diff(line.arc_m)
    assert (line.x_m[0], line.y_m[0]) == (RADIUS_M, 0.0)
    assert math.isclose(line.y_m[-1], RADIUS_M)
    assert 0.9 < steps.min() <= steps.max() < 1.1


def test_reversed_runs_the_other_way() -> None:
    line = quarter_circle(5)
    assert line.reversed().x_m.tolist() == line.x_m[::-1].tolist()
    assert math.isclose(line.reversed().length_m, line.length_m)
