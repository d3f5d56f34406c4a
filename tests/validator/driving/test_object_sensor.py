"""The sensor model of objects: against geometry of another library, and on pictures that can be drawn on paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity

from branchdrive.driving.object_sensor import (
    EXTENT_SD,
    MAX_OBJECTS,
    NUM_VARIATES,
    POSITION_SD_M,
    VELOCITY_SD_MPS,
    YAW_SD_RAD,
    Bodies,
    in_sight,
    measured,
    nearest,
)


def bodies(*places: tuple[float, float, float, float, float]) -> Bodies:
    """Bodies at rest: centre, heading, length, width."""
    dx, dy, yaw, length, width = np.array(places, np.float64).reshape(-1, 5).T
    return Bodies(dx, dy, yaw, length, width, np.zeros(len(dx)), np.zeros(len(dx)))


def seen(found: Bodies) -> list[bool]:
    number = len(found.dx_m)
    answer: list[bool] = in_sight(found, np.zeros(number, np.int64), np.arange(number), 1).tolist()
    return answer


CAR_AHEAD = (10.0, 0.0, 0.0, 4.0, 2.0)


@pytest.mark.parametrize(
    ("other", "is_seen"),
    [
        ((20.0, 0.0, 0.0, 4.0, 2.0), False),  # behind a car, and no wider than its shadow
        ((20.0, 0.0, 0.0, 4.0, 6.0), True),  # corners reach out of the shadow
        ((20.0, 4.0, 0.0, 4.0, 2.0), True),  # in the next lane
        ((-10.0, 0.0, 0.0, 4.0, 2.0), True),  # sensors look back, too
        ((10.0, 2.0, 0.0, 4.0, 2.0), True),  # beside it, side by side
        ((10.0, 0.0, math.pi / 4, 0.4, 0.4), False),  # within its box
    ],
)
def test_a_box_hides_what_lies_in_its_shadow(other: tuple[float, ...], is_seen: bool) -> None:
    assert seen(bodies(CAR_AHEAD, other)) == [True, is_seen]  # type: ignore[arg-type]


def test_a_way_that_touches_a_box_is_free() -> None:
    """The line to the centre of the second runs along a side of the first, and those to its corners through it."""
    assert seen(bodies((10.0, 1.0, 0.0, 4.0, 2.0), (20.0, 0.0, 0.0, 1e-9, 1e-9))) == [True, True]
    assert seen(bodies((10.0, 0.999, 0.0, 4.0, 2.0), (20.0, 0.0, 0.0, 1e-9, 1e-9))) == [True, False]


def test_moments_do_not_hide_one_another() -> None:
    both = bodies(CAR_AHEAD, (20.0, 0.0, 0.0, 4.0, 2.0))
    assert in_sight(both, np.array([0, 1]), np.array([0, 0]), 3).tolist() == [True, True]
    assert in_sight(bodies(), np.zeros(0, np.int64), np.zeros(0, np.int64), 4).tolist() == []


def test_sight_is_that_of_polygons_and_lines() -> None:
    """Ways of another library's geometry, on crowded places; ways that come within a hair of a box decide nothing."""
    rng, told = np.random.default_rng(5), [0, 0]
    for _ in range(40):
        number = int(rng.integers(2, 12))
        drawn = np.column_stack(
            [rng.uniform(-25, 25, (number, 2)), rng.uniform(-4, 4, number), rng.uniform(0.5, 9, (number, 2))]
        )
        found = seen(bodies(*map(tuple, drawn)))  # type: ignore[arg-type]
        boxes = [
            affinity.translate(affinity.rotate(shapely.box(-a / 2, -b / 2, a / 2, b / 2), yaw, use_radians=True), x, y)
            for x, y, yaw, a, b in drawn.tolist()
        ]
        for one, (box, answer) in enumerate(zip(boxes, found, strict=True)):
            points = [box.centroid.coords[0], *box.exterior.coords[:4]]
            ways = [shapely.LineString([(0, 0), point]) for point in points]
            others = [other for place, other in enumerate(boxes) if place != one]
            through = [max((way.intersection(other).length for other in others), default=0.0) for way in ways]
            if any(0 < length < 1e-6 for length in through):
                continue
            assert answer == any(length == 0 for length in through)
            told[answer] += 1
    assert min(told) > 30


def test_the_nearest_in_range_are_kept_by_distance_and_then_by_identity() -> None:
    found = bodies((50, 0, 0, 1, 1), (30, 40, 0, 1, 1), (0, -3, 0, 1, 1), (50.001, 0, 0, 1, 1), (1, 0, 0, 1, 1))
    rows, rank = nearest(found, np.array([0, 0, 0, 0, 1]), np.array([7, 2, 9, 1, 5]))
    assert rows.tolist() == [2, 1, 0, 4]
    assert rank.tolist() == [0, 1, 2, 0]
    many = bodies(*((float(i), 0.0, 0.0, 1.0, 1.0) for i in range(40, 0, -1)))
    rows, rank = nearest(many, np.zeros(40, np.int64), np.arange(40))
    assert many.dx_m[rows].tolist() == [*range(1, MAX_OBJECTS + 1)]


def test_without_noise_a_measurement_is_the_body_in_the_frame_of_the_ego() -> None:
    """The ego faces north: what lies north of it is ahead, and what drives west drives to its left."""
    body = Bodies(*(np.array([value]) for value in (0.0, 10.0, math.pi, 4.0, 2.0, -3.0, 0.0)))
    found = measured(body, np.array([math.pi / 2]), np.zeros((1, NUM_VARIATES)))
    expected = Bodies(*(np.array([value]) for value in (10.0, 0.0, math.pi / 2, 4.0, 2.0, 0.0, 3.0)))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize(
    ("variate", "field", "change"),
    [
        (0, "dx_m", POSITION_SD_M), (1, "dy_m", POSITION_SD_M), (2, "vel_x_mps", VELOCITY_SD_MPS),
        (3, "vel_y_mps", VELOCITY_SD_MPS), (4, "yaw_rad", YAW_SD_RAD), (5, "length_m", 4.0 * EXTENT_SD),
        (6, "width_m", 2.0 * EXTENT_SD),
    ],
)  # fmt: skip
def test_each_variate_moves_one_quantity(variate: int, field: str, change: float) -> None:
    body = Bodies(*(np.array([value]) for value in (5.0, 1.0, 0.1, 4.0, 2.0, 3.0, 0.5)))
    variates = np.zeros((1, NUM_VARIATES))
    still = measured(body, np.array([0.3]), variates)
    variates[0, variate] = 1.0
    moved: Any = measured(body, np.array([0.3]), variates)
    for name, one, other in zip(Bodies._fields, moved, still, strict=True):
        np.testing.assert_allclose(one - other, change if name == field else 0.0, atol=1e-12)
