"""Strips and areas against shapely, a second implementation."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from branchdrive.driving.surface import Areas, Strips, TooLargeError

RANDOM = np.random.default_rng(3)


def _excess(strips: Strips, town: np.ndarray, x: np.ndarray, y: np.ndarray, num_strips: int) -> np.ndarray:
    """Least excess of each point over each strip, infinite where no pair was found ``[points, strips]``."""
    least = np.full((len(x), num_strips), np.inf)
    for point, strip, excess_m, _ in strips.near(town, x, y):
        np.minimum.at(least, (point, strip), excess_m)
    return least


def test_points_in_strips_of_one_width_are_those_of_a_buffer() -> None:
    x, y = RANDOM.uniform(-1e3, 1e3, (2, 60))
    lengths = np.array([2, 3, 5, 20, 30])
    strips = Strips(np.zeros(5, np.int64), lengths, x, y, np.full(60, 3.5), slack_m=0.05)
    points = RANDOM.uniform(-1e3, 1e3, (2, 20_000))
    least = _excess(strips, np.zeros(20_000, np.int64), *points, 5)
    for strip, (stop, length) in enumerate(zip(np.cumsum(lengths), lengths, strict=True)):
        line = shapely.LineString(np.stack([x, y], axis=1)[stop - length : stop])
        excess = shapely.distance(line, shapely.points(*points)) - 1.75
        assert ((least[:, strip] <= 0.05) == (excess <= 0.05)).all()
        found = least[:, strip] <= 0.05
        assert least[found, strip] == pytest.approx(excess[found], abs=1e-9)


def test_widths_are_linear_between_vertices() -> None:
    strips = Strips(np.zeros(1, np.int64), np.array([2]), np.array([0.0, 10.0]), np.zeros(2), np.array([2.0, 6.0]),
                    slack_m=0.0)  # fmt: skip
    ((_, _, excess_m, is_end),) = strips.near(np.zeros(3, np.int64), np.array([0.0, 5.0, 10.0]), np.full(3, 1.0))
    assert excess_m.reshape(3, -1).min(axis=1).tolist() == [0.0, -1.0, -2.0]
    assert is_end.reshape(3, -1)[:, 0].tolist() == [True, False, True]


def test_strips_of_another_town_are_far_away() -> None:
    strips = Strips(np.zeros(1, np.int64), np.array([2]), np.array([0.0, 10.0]), np.zeros(2), np.ones(2), slack_m=0.0)
    least = _excess(strips, np.array([0, 1]), np.full(2, 5.0), np.zeros(2), 1)
    assert least[:, 0].tolist() == [-0.5, np.inf]


def test_strips_without_end_are_refused() -> None:
    ends = np.array([-1e7, 1e7])
    with pytest.raises(TooLargeError):
        Strips(np.zeros(1, np.int64), np.array([2]), ends, ends, np.full(2, 100.0), slack_m=0.0)


def test_no_strips_hold_nothing() -> None:
    none = np.zeros(0)
    strips = Strips(np.zeros(0, np.int64), np.zeros(0, np.int64), none, none, none, slack_m=0.0)
    assert not list(strips.near(np.zeros(1, np.int64), np.zeros(1), np.zeros(1)))


def test_areas_are_polygons() -> None:
    turn = np.sort(RANDOM.uniform(0, 2 * np.pi, 40))
    reach = RANDOM.uniform(5.0, 30.0, 40)
    outline = np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
    points = RANDOM.uniform(-32.0, 32.0, (2, 20_000))
    areas = Areas(np.zeros(1, np.int64), (outline,))
    parts = list(areas.near(np.zeros(20_000, np.int64), *points, slack_m=0.05))
    rows, excess_m = (np.concatenate(values) for values in zip(*parts, strict=True))
    polygon = shapely.Polygon(outline)
    inside = shapely.contains_xy(polygon, *points)
    assert set(np.flatnonzero(inside)) <= set(rows.tolist())
    assert ((excess_m < 0) == inside[rows]).all()
    distance = shapely.distance(polygon.exterior, shapely.points(*points[:, rows]))
    assert np.abs(excess_m) == pytest.approx(distance, abs=1e-9)
