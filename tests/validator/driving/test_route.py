"""Distance from boxes to route polylines: against shapely and at edge cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.validator.driving.oracle import boxes, polygons

from branchdrive.driving.box import Boxes
from branchdrive.driving.route import polyline_box_distance_m

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
