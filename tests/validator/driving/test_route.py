"""Route polylines, distance of boxes and position of points: against shapely and at edge cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.validator.driving.oracle import boxes, polygons

from branchdrive.driving.box import Boxes
from branchdrive.driving.route import Polylines, feet_within, points_near, polyline_box_distance_m, project

NUM_BOXES = 300


def random_boxes(rng: np.random.Generator) -> Boxes:
    return Boxes(
        *rng.uniform(-40, 40, (2, NUM_BOXES)),
        rng.uniform(-math.pi, math.pi, NUM_BOXES),
        *rng.uniform(0.05, 12, (2, NUM_BOXES)),
    )


@pytest.mark.parametrize("num_vertices", [2, 3, 17])
def test_distance_is_that_of_the_shapes(num_vertices: int) -> None:
    rng = np.random.default_rng(num_vertices)
    for _ in range(8):
        these, route = random_boxes(rng), rng.uniform(-40, 40, (num_vertices, 2))
        expected = shapely.distance(polygons(these), shapely.LineString(route))
        found = polyline_box_distance_m(these, *route.T)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


STRAIGHT = (np.array([0.0, 100.0]), np.array([0.0, 0.0]))


@pytest.mark.parametrize(
    ("box", "distance_m"),
    [
        pytest.param((50, 5, 0, 4, 2), 4, id="beside"),
        pytest.param((50, 1, 0, 4, 2), 0, id="touching"),
        pytest.param((50, 0.5, 0, 4, 2), 0, id="on the route"),
        pytest.param((50, 0, math.pi / 2, 300, 1), 0, id="across, no corner near"),
        pytest.param((-5, 0, 0, 4, 2), 3, id="before the start"),
        pytest.param((105, 5, 0, 4, 2), 5, id="past the end, off to the side"),
        pytest.param((50, 0, 0, 300, 20), 0, id="around the whole route"),
    ],
)
def test_distance_is_the_analytic_one(box: tuple[float, float, float, float, float], distance_m: float) -> None:
    assert polyline_box_distance_m(boxes(box), *STRAIGHT)[0] == pytest.approx(distance_m, abs=1e-12)


def test_repeated_vertices_change_nothing() -> None:
    these = random_boxes(np.random.default_rng(5))
    x, y = np.array([0.0, 10.0, 20.0]), np.array([0.0, 3.0, -4.0])
    plain = polyline_box_distance_m(these, x, y)
    np.testing.assert_array_equal(polyline_box_distance_m(these, x.repeat(2), y.repeat(2)), plain)


def test_reversing_the_route_changes_nothing() -> None:
    these = random_boxes(np.random.default_rng(6))
    x, y = np.random.default_rng(7).uniform(-40, 40, (2, 9))
    np.testing.assert_allclose(
        polyline_box_distance_m(these, x[::-1], y[::-1]), polyline_box_distance_m(these, x, y), rtol=0, atol=1e-12
    )


def test_one_vertex_is_a_point_and_no_vertex_is_infinitely_far() -> None:
    these = boxes((0, 0, 0, 2, 2), (10, 0, 0, 2, 2))
    np.testing.assert_allclose(polyline_box_distance_m(these, np.array([4.0]), np.array([5.0])), [5, np.hypot(5, 4)])
    assert polyline_box_distance_m(these, np.zeros(0), np.zeros(0)).tolist() == [np.inf, np.inf]


def test_no_boxes_have_no_distance() -> None:
    assert polyline_box_distance_m(boxes(), *STRAIGHT).shape == (0,)


def test_many_boxes_are_measured_piece_by_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    these = random_boxes(np.random.default_rng(8))
    x, y = np.random.default_rng(9).uniform(-40, 40, (2, 9))
    at_once = polyline_box_distance_m(these, x, y)
    monkeypatch.setattr("branchdrive.driving.route._MAX_CELLS", 50)
    np.testing.assert_array_equal(polyline_box_distance_m(these, x, y), at_once)


CORNER = (np.array([0.0, 10.0, 10.0]), np.array([0.0, 0.0, 10.0]))
"""Ten metres along x, then ten to the left."""


@pytest.mark.parametrize(
    ("point", "progress_m", "offset_m", "heading_rad"),
    [
        pytest.param((4, 2), 4, 2, 0, id="to the left of a segment"),
        pytest.param((4, -2), 4, -2, 0, id="to the right of a segment"),
        pytest.param((4, 0), 4, 0, 0, id="on a segment"),
        pytest.param((-3, 4), 0, 5, 0, id="before the first vertex"),
        pytest.param((13, 14), 20, -5, math.pi / 2, id="behind the last vertex"),
        pytest.param((13, -4), 10, -5, 0, id="outside of a corner: the segment that ends there"),
        pytest.param((8, 2), 8, 2, 0, id="as near to both segments: the smaller progress"),
        pytest.param((9, 4), 14, 1, math.pi / 2, id="on the next segment"),
    ],
)
def test_position_is_the_nearest_foot(
    point: tuple[float, float], progress_m: float, offset_m: float, heading_rad: float
) -> None:
    found = project(*np.array(point, float)[:, None], *CORNER)
    assert np.concatenate(found) == pytest.approx([progress_m, offset_m, heading_rad], abs=1e-12)


def test_position_where_a_route_crosses_itself_or_comes_back_is_the_first() -> None:
    x, y = np.array([0.0, 20.0, 20.0, 10.0, 10.0]), np.array([0.0, 0.0, 10.0, 10.0, -10.0])
    assert project(np.array([10.0]), np.array([0.0]), x, y).progress_m.tolist() == [10.0]
    back_x, back_y = np.array([0.0, 20.0, 0.0]), np.zeros(3)
    assert project(np.array([5.0]), np.array([1.0]), back_x, back_y).progress_m.tolist() == [5.0]


@pytest.mark.parametrize("num_vertices", [2, 11, 12, 60])
def test_position_agrees_with_shapely(num_vertices: int) -> None:
    rng = np.random.default_rng(num_vertices)
    x, y = np.cumsum(rng.normal(1.0, 1.0, (2, num_vertices)), axis=1)
    points = rng.uniform(-20, 60, (500, 2))
    line = shapely.LineString(np.stack([x, y], axis=1))
    found = project(*points.T, x, y)
    np.testing.assert_allclose(np.abs(found.offset_m), shapely.distance(line, shapely.points(points)), atol=1e-9)
    feet = shapely.line_interpolate_point(line, found.progress_m)
    np.testing.assert_allclose(shapely.distance(feet, shapely.points(points)), np.abs(found.offset_m), atol=1e-9)


def test_feet_within_reach_are_all_that_are_near() -> None:
    rng = np.random.default_rng(7)
    x, y = np.cumsum(rng.normal(1.0, 1.0, (2, 40)), axis=1)
    points = rng.uniform(0, 40, (200, 2))
    segments = [shapely.LineString(np.stack([x[k : k + 2], y[k : k + 2]], axis=1)) for k in range(39)]
    distance = shapely.distance(shapely.points(points)[:, None], np.array(segments)[None, :])
    reach = distance.min(axis=1) + 0.01
    point, position = feet_within(*points.T, x, y, reach)
    assert np.bincount(point, minlength=200).tolist() == (distance <= reach[:, None]).sum(axis=1).tolist()
    assert (np.abs(position.offset_m) <= reach[point]).all()


@pytest.mark.parametrize("most_cells", [1 << 20, 30])
def test_many_polylines_have_the_feet_of_each(most_cells: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, for polylines of other lengths, the first without a point, however many are looked at at once."""
    monkeypatch.setattr("branchdrive.driving.route._MAX_CELLS", most_cells)
    rng = np.random.default_rng(11)
    ways = [np.cumsum(rng.normal(1.0, 1.0, (2, length)), axis=1) for length in (4, 2, 11, 12, 40)]
    lines = [(way[0], way[1]) for way in ways]
    polyline = rng.integers(1, len(lines), 60)
    x, y, reach = *rng.uniform(0, 20, (2, 60)), rng.uniform(0, 9, 60)
    point, position = Polylines(lines).feet_within(x, y, polyline, reach)
    for i in range(60):
        _, expected = feet_within(x[[i]], y[[i]], *lines[polyline[i]], reach[[i]])
        for found, of_one in zip(position, expected, strict=True):
            assert np.array_equal(np.sort(found[point == i]), np.sort(of_one))
    assert len(point) > 60


def test_no_points_have_no_position() -> None:
    assert [len(values) for values in project(np.zeros(0), np.zeros(0), *CORNER)] == [0, 0, 0]


def parted(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Vertices of a polyline and what parts its segments, from the definition ``[points, 2]``."""
    points = []
    for i in range(len(x_m) - 1):
        pieces = math.ceil(math.hypot(x_m[i + 1] - x_m[i], y_m[i + 1] - y_m[i]))
        shares = np.arange(pieces) / pieces
        steps = ((values[i] + shares * (values[i + 1] - values[i])) for values in (x_m, y_m))
        points.append(np.stack([*steps], axis=1))
    return np.concatenate([*points, [[x_m[-1], y_m[-1]]]])


@pytest.mark.parametrize("num_vertices", [2, 3, 17])
def test_points_near_a_place_are_those_of_the_whole_polyline(num_vertices: int) -> None:
    rng = np.random.default_rng(num_vertices)
    for _ in range(20):
        route, place, reach_m = rng.uniform(-40, 40, (2, num_vertices)), rng.uniform(-60, 60, 2), rng.uniform(1, 50)
        expected = parted(*route)
        found = np.stack(points_near(*place, *route, reach_m, most=1000), axis=1)
        distance_m = np.hypot(*(expected - place).T)
        order = [int(np.argmin(np.hypot(*(expected - point).T))) for point in found]
        np.testing.assert_allclose(found, expected[order], atol=1e-9)
        assert order == sorted(set(order))
        assert {*np.flatnonzero(distance_m <= reach_m)} <= {*order}


def test_no_more_points_are_given_than_one_too_many() -> None:
    line = np.array([-1e6, 1e6]), np.array([0.0, 1.0])
    assert len(points_near(0.0, 0.0, *line, 100.0, most=1000)[0]) == 202
    assert len(points_near(0.0, 0.0, *line, 100.0, most=50)[0]) == 51
