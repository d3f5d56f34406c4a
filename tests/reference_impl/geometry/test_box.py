"""Box overlap against shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.validator.driving.oracle import polygon

from branchdrive_reference.geometry.box import boxes_overlap, half_extent_along, wrap


def test_overlap_agrees_with_shapely() -> None:
    random = np.random.default_rng(3)
    low, high = [-4, -4, -4, 0.3, 0.3], [4, 4, 4, 6, 3]
    first, second = random.uniform(low, high, (2000, 5)), random.uniform(low, high, (2000, 5))
    found = [boxes_overlap(*a, *b) for a, b in zip(first, second, strict=True)]
    truth = [shapely.intersects(polygon(*a), polygon(*b)) for a, b in zip(first, second, strict=True)]
    assert found == truth
    assert 200 < sum(truth) < 1800


@pytest.mark.parametrize(("angle_rad", "expected_m"), [(0.0, 2.0), (math.pi / 2, 0.5), (math.pi, 2.0)])
def test_half_extent_along_the_axes(angle_rad: float, expected_m: float) -> None:
    assert half_extent_along(angle_rad, 4.0, 1.0) == pytest.approx(expected_m)


@pytest.mark.parametrize(
    ("angle_rad", "expected_rad"), [(0.5, 0.5), (3 * math.pi / 2, -math.pi / 2), (-7.0, -7.0 + 2 * math.pi)]
)
def test_wrap(angle_rad: float, expected_rad: float) -> None:
    assert wrap(angle_rad) == pytest.approx(expected_rad)
