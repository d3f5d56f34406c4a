"""Neighbours against all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from branchdrive.driving.neighbour import Points, neighbours
from branchdrive.driving.surface import TooLargeError, Work


@pytest.mark.parametrize("reach_m", [0.5, 4.0, 30.0])
def test_they_are_the_pairs_of_a_town_within_the_reach(reach_m: float) -> None:
    random = np.random.default_rng(5)
    points, others = (
        Points(random.integers(0, 2, count), *random.uniform(-40.0, 40.0, (2, count))) for count in (300, 400)
    )
    away_m = np.hypot(*(one[:, None] - other for one, other in zip(points[1:], others[1:], strict=True)))
    expected = np.argwhere((away_m <= reach_m) & (points.town[:, None] == others.town))
    found = np.concatenate([np.stack(pair, axis=1) for pair in neighbours(points, others, reach_m, Work(10**6))])
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, expected.tolist()))


def test_a_crowd_is_not_looked_through() -> None:
    crowd = Points(np.zeros(1000, np.int64), np.zeros(1000), np.zeros(1000))
    with pytest.raises(TooLargeError, match="more than 999,999 pairs"):
        list(neighbours(crowd, crowd, 1.0, Work(999_999)))


def test_nobody_has_no_neighbour() -> None:
    nobody = Points(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    assert not any(len(point) for point, _ in neighbours(nobody, nobody, 1.0, Work(0)))
