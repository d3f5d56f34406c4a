"""Route clusters: resampling against analytic polylines, clusters against scipy's components."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from branchdrive.driving.route_cluster import CLUSTER_POINTS, CLUSTER_RMS_M, resample_polyline, route_clusters


def line(offset_m: float, length_m: float = 100.0) -> Any:
    return resample_polyline([0.0, length_m], [offset_m, offset_m])


def test_a_line_is_resampled_evenly_whatever_its_vertices() -> None:
    expected = np.stack([np.linspace(0, 90, CLUSTER_POINTS), np.full(CLUSTER_POINTS, 2.0)], axis=1)
    for x in ([0, 90], [0, 1, 1, 88, 90], np.linspace(0, 90, 700)):
        np.testing.assert_allclose(resample_polyline(x, np.full(len(x), 2.0)), expected, atol=1e-9)


def test_a_corner_is_resampled_by_arc_length() -> None:
    found = resample_polyline([0, 3, 3], [0, 0, 1], num_points=5)
    np.testing.assert_allclose(found, [[0, 0], [1, 0], [2, 0], [3, 0], [3, 1]], atol=1e-12)


@pytest.mark.parametrize("vertices", [1, 3])
def test_a_route_without_length_is_a_point(vertices: int) -> None:
    found = resample_polyline([4.0] * vertices, [5.0] * vertices)
    assert found.shape == (CLUSTER_POINTS, 2)
    assert (found == [4, 5]).all()


@pytest.mark.parametrize(("x", "y"), [([], []), ([1.0, 2.0], [1.0]), ([[1.0]], [[2.0]])])
def test_what_is_no_polyline_is_refused(x: Any, y: Any) -> None:
    with pytest.raises(ValueError, match="a polyline has vertices"):
        resample_polyline(x, y)


@pytest.mark.parametrize(("apart_m", "num_clusters"), [(0, 1), (1.99, 1), (2.0, 2), (2.01, 2)])
def test_parallel_routes_are_close_below_the_limit(apart_m: float, num_clusters: int) -> None:
    assert CLUSTER_RMS_M == 2
    labels = route_clusters(["a", "a"], [line(0), line(apart_m)])
    assert labels.tolist() == [0, num_clusters - 1]


def test_a_route_driven_backwards_is_another() -> None:
    assert route_clusters(["a", "a"], [line(0), line(0)[::-1]]).tolist() == [0, 1]


def test_a_chain_of_close_routes_is_one_cluster_and_towns_stay_apart() -> None:
    towns = ["a", "b", "a", "a", "b", "a"]
    offsets = [0.0, 0.0, 3.0, 1.5, 50.0, 4.5]
    assert route_clusters(towns, [line(offset) for offset in offsets]).tolist() == [0, 1, 0, 0, 2, 0]


def test_a_route_that_is_no_number_is_alone() -> None:
    lost = np.full((CLUSTER_POINTS, 2), np.nan)
    assert route_clusters(["a"] * 4, [lost, line(0), lost, line(1)]).tolist() == [0, 1, 2, 1]


def test_a_route_without_an_end_is_alone() -> None:
    endless = np.where(np.arange(CLUSTER_POINTS)[:, None] == 3, np.inf, line(0))
    assert route_clusters(["a"] * 4, [endless, line(0), endless, line(1)]).tolist() == [0, 1, 2, 1]


def test_routes_far_from_the_origin_are_compared_like_others() -> None:
    far = np.array([1e9, -1e9])
    assert route_clusters(["a"] * 3, [line(0) + far, line(1) + far, line(3) + far]).tolist() == [0, 0, 1]


def test_no_routes_have_no_clusters() -> None:
    assert route_clusters([], np.empty((0, CLUSTER_POINTS, 2))).tolist() == []


def test_towns_must_match_the_routes() -> None:
    with pytest.raises(ValueError, match="1 towns do not match"):
        route_clusters(["a"], [line(0), line(1)])


@given(st.integers(0, 10_000), st.integers(1, 60), st.floats(0.5, 40), st.floats(0, 2))
def test_clusters_are_the_components_of_the_close_routes(
    seed: int, num_routes: int, spread_m: float, noise_m: float
) -> None:
    rng = np.random.default_rng(seed)
    offsets = rng.uniform(-spread_m, spread_m, (num_routes, 1, 2))
    routes = line(0)[None] + offsets + rng.normal(0, noise_m, (num_routes, CLUSTER_POINTS, 2))
    routes = routes[rng.integers(num_routes, size=num_routes)]  # some are driven more than once
    towns = rng.choice(["a", "b"], num_routes).tolist()
    apart = np.sqrt(np.square(routes[:, None] - routes[None]).sum(axis=3).mean(axis=2))
    close = (apart < CLUSTER_RMS_M) & (np.array(towns)[:, None] == np.array(towns))
    _, expected = connected_components(close, directed=False)
    found = route_clusters(towns, routes)
    assert list(dict.fromkeys(found.tolist())) == list(range(found.max() + 1))
    assert ((found[:, None] == found) == (expected[:, None] == expected)).all()


def test_parallel_routes_at_the_limit_are_not_close_in_any_direction() -> None:
    along, zero = np.linspace(0.0, 300.0, 7), np.zeros(7)
    found = []
    for angle in np.linspace(0.0, 6.0, 50):
        cos, sin = np.cos(angle), np.sin(angle)
        routes = [
            resample_polyline(cos * along - sin * (zero + side), sin * along + cos * (zero + side))
            for side in (0.0, 2.0)
        ]
        found.append(route_clusters(["town"] * 2, np.stack(routes)).tolist())
    assert found == [[0, 1]] * 50
