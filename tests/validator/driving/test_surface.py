"""Strips and areas against shapely, a second implementation."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from branchdrive.contract.limits import spec_limits
from branchdrive.driving.surface import Areas, Strips, TooLargeError, Work

SQUARES, PAIRS = spec_limits().max_map_squares, spec_limits().max_map_pairs

RANDOM = np.random.default_rng(3)


def _excess(strips: Strips, town: np.ndarray, x: np.ndarray, y: np.ndarray, num_strips: int) -> np.ndarray:
    """Least excess of each point over each strip, infinite where no pair was found ``[points, strips]``."""
    least = np.full((len(x), num_strips), np.inf)
    for point, strip, excess_m, _ in strips.near(town, x, y, Work(PAIRS)):
        np.minimum.at(least, (point, strip), excess_m)
    return least


def test_points_in_strips_of_one_width_are_those_of_a_buffer() -> None:
    x, y = RANDOM.uniform(-1e3, 1e3, (2, 60))
    lengths = np.array([2, 3, 5, 20, 30])
    strips = Strips(np.zeros(5, np.int64), lengths, x, y, np.full(60, 3.5), slack_m=0.05, most_squares=SQUARES)
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
                    slack_m=0.0, most_squares=SQUARES)  # fmt: skip
    ((_, _, excess_m, is_end),) = strips.near(
        np.zeros(3, np.int64), np.array([0.0, 5.0, 10.0]), np.full(3, 1.0), Work(PAIRS)
    )
    assert excess_m.reshape(3, -1).min(axis=1).tolist() == [0.0, -1.0, -2.0]
    assert is_end.reshape(3, -1)[:, 0].tolist() == [True, False, True]


def test_strips_of_another_town_are_far_away() -> None:
    strips = Strips(
        np.zeros(1, np.int64),
        np.array([2]),
        np.array([0.0, 10.0]),
        np.zeros(2),
        np.ones(2),
        slack_m=0.0,
        most_squares=SQUARES,
    )
    least = _excess(strips, np.array([0, 1]), np.full(2, 5.0), np.zeros(2), 1)
    assert least[:, 0].tolist() == [-0.5, np.inf]


def test_strips_without_end_are_refused() -> None:
    ends = np.array([-1e7, 1e7])
    with pytest.raises(TooLargeError):
        Strips(np.zeros(1, np.int64), np.array([2]), ends, ends, np.full(2, 100.0), slack_m=0.0, most_squares=SQUARES)


def test_no_strips_hold_nothing() -> None:
    none = np.zeros(0)
    strips = Strips(np.zeros(0, np.int64), np.zeros(0, np.int64), none, none, none, slack_m=0.0, most_squares=SQUARES)
    assert not list(strips.near(np.zeros(1, np.int64), np.zeros(1), np.zeros(1), Work(PAIRS)))


def test_areas_are_polygons() -> None:
    turn = np.sort(RANDOM.uniform(0, 2 * np.pi, 40))
    reach = RANDOM.uniform(5.0, 30.0, 40)
    outline = np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
    points = RANDOM.uniform(-32.0, 32.0, (2, 20_000))
    areas = Areas(np.zeros(1, np.int64), (outline,))
    parts = list(areas.near(np.zeros(20_000, np.int64), *points, Work(PAIRS), slack_m=0.05))
    rows, excess_m = (np.concatenate(values) for values in zip(*parts, strict=True))
    polygon = shapely.Polygon(outline)
    inside = shapely.contains_xy(polygon, *points)
    assert set(np.flatnonzero(inside)) <= set(rows.tolist())
    assert ((excess_m < 0) == inside[rows]).all()
    distance = shapely.distance(polygon.exterior, shapely.points(*points[:, rows]))
    assert np.abs(excess_m) == pytest.approx(distance, abs=1e-9)


def test_pairs_end_where_there_are_more_than_may_be_compared() -> None:
    x, none = np.arange(9.0), np.zeros(3, np.int64)
    strips = Strips(np.zeros(1, np.int64), np.array([9]), x, np.zeros(9), np.ones(9), slack_m=0.0, most_squares=SQUARES)
    num_pairs = sum(len(point) for point, *_ in strips.near(none, np.full(3, 2.0), np.zeros(3), Work(PAIRS)))
    assert list(strips.near(none, np.full(3, 2.0), np.zeros(3), Work(num_pairs)))
    with pytest.raises(TooLargeError, match=f"more than {num_pairs - 1} pairs"):
        list(strips.near(none, np.full(3, 2.0), np.zeros(3), Work(num_pairs - 1)))

    outline = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    areas = Areas(np.zeros(2, np.int64), (outline, outline + 100.0))
    num_pairs = 3 + 3 * len(outline)
    assert len(list(areas.near(none, np.ones(3), np.ones(3), Work(num_pairs), slack_m=0.0))) == 1
    with pytest.raises(TooLargeError):
        list(areas.near(none, np.ones(3), np.ones(3), Work(num_pairs - 1), slack_m=0.0))
