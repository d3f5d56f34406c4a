"""Bounds on gap and time to collision: never above what the boxes give, and close enough to be of use."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes, PairBounds, pair_bounds
from branchdrive.driving.risk import PairRisk, pair_risk

Array = NDArray[np.float64]

# Multiples of a quarter meet, touch and tie often; any others do not.
places = st.one_of(st.integers(-80, 80).map(lambda n: n / 4), st.floats(-60, 60))
extents = st.one_of(st.integers(1, 40).map(lambda n: n / 4), st.floats(1e-3, 30))
angles = st.one_of(st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, np.pi / 4]), st.floats(-np.pi, np.pi))
speeds = st.one_of(st.sampled_from([0.0, 0.1, 0.1 + 1e-9, -0.1, 10.0]), st.floats(-30, 30))
scenes = st.lists(
    st.tuples(*[places, places, angles, extents, extents] * 2, speeds, speeds, speeds), min_size=1, max_size=30
)


def judged(scene: list[tuple[float, ...]]) -> tuple[PairBounds, PairRisk]:
    """Bounds and outcome of pairs given as ego box, actor box, ego speed and actor velocity."""
    columns = np.array(scene).T
    ego, actors = Boxes(*columns[:5]), Boxes(*columns[5:10])
    speed, vel_x, vel_y = columns[10:]
    none, every = np.zeros(len(scene), bool), np.arange(len(scene))
    pairs = pair_risk(ego, speed, actors, vel_x, vel_y, every, none, none, every, np.full(len(scene), -np.inf))
    bounds = pair_bounds(
        actors.x_m - ego.x_m,
        actors.y_m - ego.y_m,
        (np.hypot(ego.length_m, ego.width_m) + np.hypot(actors.length_m, actors.width_m)) / 2,
        vel_x - speed * np.cos(ego.yaw_rad),
        vel_y - speed * np.sin(ego.yaw_rad),
    )
    return bounds, pairs


def ttc_s(pairs: PairRisk) -> Array:
    """Gap over closing speed wherever it closes at all, 0 on overlap."""
    found = np.where(pairs.gap_m == 0, 0.0, np.inf)
    return np.divide(pairs.gap_m, pairs.closing_mps, out=found, where=(pairs.gap_m > 0) & (pairs.closing_mps > 1e-9))


@given(scenes)
def test_bounds_never_exceed_what_they_bound(scene: list[tuple[float, ...]]) -> None:
    bounds, pairs = judged(scene)
    assert (bounds.gap_m <= pairs.gap_m).all()
    assert not (bounds.ttc_s > ttc_s(pairs)).any()  # NaN bounds nothing


def test_bounds_are_met_by_points_on_a_collision_course() -> None:
    # Boxes of 2 mm, 30 m apart, 15 m/s of closing speed.
    bounds, _ = judged([(0, 0, 0, 1e-3, 1e-3, 30, 0, 0, 1e-3, 1e-3, 10, -5, 0)])
    np.testing.assert_allclose((bounds.gap_m[0], bounds.ttc_s[0]), (30, 2), rtol=1e-3)


def test_what_recedes_never_closes() -> None:
    bounds, _ = judged([(0, 0, 0, 4, 2, 30, 0, 0, 4, 2, 10, 20, 0)])
    assert bounds.ttc_s[0] == np.inf


def test_what_may_overlap_is_not_bounded() -> None:
    bounds, _ = judged([(0, 0, 0, 4, 2, 1, 1, 0, 4, 2, 0, 0, 0)])
    assert bounds.gap_m[0] < 0
    assert not bounds.ttc_s[0] > 0


def test_no_number_bounds_nothing() -> None:
    nan, one = np.array([np.nan]), np.ones(1)
    assert np.isnan(pair_bounds(nan, one, one, one, one).gap_m[0])
    assert not pair_bounds(10 * one, one, one, nan, one).ttc_s[0] > 0
