"""Risk evidence: against a slow second implementation, against analytic truth, and at every cut-off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.validator.driving import oracle
from tests.validator.driving.oracle import Actor, Ego

from branchdrive.driving.risk import risk_evidence

ROUTE = [(-200.0, 0.0), (0.0, 0.0), (80.0, 0.0), (200.0, 60.0)]
CLASSES = ("vehicle", "cycle", "pedestrian", "static")
QUANTITIES = {
    "separation": ("separation_m", "separation_actor_id"),
    "ttc": ("ttc_s", "ttc_actor_id"),
    "nearest_vehicle": ("nearest_vehicle_gap_m", "nearest_vehicle_rel_speed_mps"),
    "nearest_pedestrian": ("nearest_pedestrian_gap_m",),
}
"""Masks and the columns that they govern."""

Frames = Sequence[tuple[Ego, Sequence[Actor]]]


def compute(frames: Frames, route: Sequence[tuple[float, float]] = ROUTE) -> dict[str, Any]:
    """Evidence of frames at ticks 0, 5, 10 and so on."""
    egos = [ego for ego, _ in frames]
    rows = [(5 * i, actor) for i, (_, actors) in enumerate(frames) for actor in actors]
    observations: Mapping[str, Any] = {
        "tick": np.arange(len(frames)) * 5,
        **{name: np.array([getattr(e, name) for e in egos]) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")},
    }
    names = ("actor_id", "actor_class", "x_m", "y_m", "yaw_rad", "length_m", "width_m", "vel_x_mps", "vel_y_mps")
    actors: Mapping[str, Any] = {
        "tick": np.array([tick for tick, _ in rows], np.int32),
        **{name: np.array([getattr(actor, name) for _, actor in rows]) for name in names},
    }
    extents = {(ego.length_m, ego.width_m) for ego in egos} or {(4.0, 2.0)}
    ((length_m, width_m),) = extents
    x_m, y_m = np.array(route).T
    return risk_evidence(observations, actors, ego_length_m=length_m, ego_width_m=width_m, route_x_m=x_m, route_y_m=y_m)


def reading(columns: Mapping[str, Any], row: int, quantity: str) -> tuple[Any, ...]:
    """Values of a quantity in one row, ``None`` where masked."""
    return tuple(
        None if np.ma.is_masked(columns[name][row]) else columns[name][row].item() for name in QUANTITIES[quantity]
    )


def random_frame(rng: np.random.Generator, num_actors: int) -> tuple[Ego, list[Actor]]:
    ego = Ego(*rng.uniform(-20, 20, 2), rng.uniform(-math.pi, math.pi), rng.uniform(-5, 25))
    actors = [
        Actor(
            int(actor_id),
            str(rng.choice(CLASSES)),
            *rng.uniform(-60, 60, 2),
            rng.uniform(-math.pi, math.pi),
            *rng.uniform(0.4, 12, 2),
            *rng.uniform(-15, 15, 2),
        )
        for actor_id in rng.permutation(1000)[:num_actors]
    ]
    return ego, actors


def test_evidence_is_that_of_the_slow_implementation() -> None:
    rng = np.random.default_rng(30)
    frames = [random_frame(rng, num_actors) for num_actors in rng.integers(0, 9, 250)]
    columns = compute(frames)
    seen = {quantity: set() for quantity in QUANTITIES}
    for row, (ego, actors) in enumerate(frames):
        wanted = oracle.evidence(ego, actors, ROUTE)
        assert columns["num_actors"][row] == wanted["num_actors"]
        for quantity in QUANTITIES:
            found = reading(columns, row, quantity)
            value, *rest = wanted[quantity]
            assert columns[f"{quantity}_available"][row] == (value is not None)
            seen[quantity].add(value is not None)
            if value is None:
                assert set(found) == {None}
            else:
                assert found[0] == pytest.approx(value, abs=1e-8)
                if quantity == "nearest_vehicle":
                    assert found[1] == pytest.approx(rest[1], abs=1e-5)
                else:
                    assert list(found[1:]) == rest
    assert all(seen[quantity] == {True, False} for quantity in QUANTITIES)


def one_actor(ego: Ego, actor: Actor) -> dict[str, tuple[Any, ...]]:
    """Evidence of one frame with one actor, by quantity."""
    columns = compute([(ego, [actor])])
    return {quantity: reading(columns, 0, quantity) for quantity in QUANTITIES}


def test_head_on() -> None:
    # Boxes 4 m long, centres 34 m apart: 30 m of gap, closing at 10 + 5 m/s.
    found = one_actor(Ego(speed_mps=10), Actor(7, "vehicle", 34, 0, math.pi, vel_x_mps=-5))
    assert found["separation"] == (30, 7)
    assert found["ttc"] == (2, 7)
    assert found["nearest_vehicle"] == (30, 15)
    assert found["nearest_pedestrian"] == (None,)


def test_receding() -> None:
    found = one_actor(Ego(speed_mps=10), Actor(7, "vehicle", 34, 0, vel_x_mps=20))
    assert found["separation"] == (30, 7)
    assert found["ttc"] == (None, None)
    assert found["nearest_vehicle"] == (30, -10)


def test_following_at_constant_speed() -> None:
    found = one_actor(Ego(speed_mps=13), Actor(7, "cycle", 14, 0, vel_x_mps=13))
    assert found["separation"] == (10, 7)
    assert found["ttc"] == (None, None)
    assert found["nearest_vehicle"] == (10, 0)


def test_gap_over_closing_speed_falls_by_the_time_that_passes() -> None:
    frames = [(Ego(10 * t, 0, speed_mps=10), [Actor(7, "vehicle", 40, 0)]) for t in (0.0, 0.25, 0.5, 1.0)]
    np.testing.assert_allclose(compute(frames)["ttc_s"], 3.6 - np.array([0, 0.25, 0.5, 1.0]))


def test_crossing() -> None:
    # A pedestrian ahead, walking sideways: only the ego's own motion closes the gap.
    found = one_actor(Ego(speed_mps=4), Actor(7, "pedestrian", 12.25, 0, 0, 0.5, 0.5, 0, 1.5))
    assert found["separation"] == (10, 7)
    assert found["ttc"] == (2.5, 7)
    assert found["nearest_pedestrian"] == (10,)
    assert found["nearest_vehicle"] == (None, None)


def test_closing_speed_runs_along_the_line_between_closest_points() -> None:
    # Corner to corner in the direction (0.6, 0.8), 5 m apart; the ego drives along x.
    found = one_actor(Ego(speed_mps=10), Actor(7, "vehicle", 7, 6))
    assert found["separation"] == pytest.approx((5, 7))
    assert found["nearest_vehicle"] == pytest.approx((5, 6))
    assert found["ttc"] == pytest.approx((5 / 6, 7))


def test_reversing_closes_on_what_is_behind() -> None:
    assert one_actor(Ego(speed_mps=-2), Actor(7, "vehicle", -10, 0))["ttc"] == (3, 7)


def test_velocity_follows_the_heading_of_the_ego() -> None:
    assert one_actor(Ego(yaw_rad=math.pi / 2, speed_mps=5), Actor(7, "pedestrian", 0, 13, 0, 2, 2))["ttc"] == (
        pytest.approx(2),
        7,
    )


@pytest.mark.parametrize("vel_x_mps", [-10.0, 0.0, 10.0])
def test_overlap_is_collision_now_whatever_moves(vel_x_mps: float) -> None:
    found = one_actor(Ego(speed_mps=3), Actor(7, "vehicle", 2, 0.5, 0.3, vel_x_mps=vel_x_mps))
    assert found["separation"] == (0, 7)
    assert found["ttc"] == (0, 7)
    assert found["nearest_vehicle"] == (0, 0)


def test_without_actors_everything_is_unavailable() -> None:
    columns = compute([(Ego(), []), (Ego(), [])])
    assert columns["num_actors"].tolist() == [0, 0]
    for quantity, names in QUANTITIES.items():
        assert columns[f"{quantity}_available"].tolist() == [False, False]
        assert all(np.ma.getmaskarray(columns[name]).all() for name in names)


def test_without_observations_there_are_no_rows() -> None:
    assert {len(column) for column in compute([]).values()} == {0}


def test_masks_govern_their_columns_exactly() -> None:
    rng = np.random.default_rng(31)
    columns = compute([random_frame(rng, num_actors) for num_actors in rng.integers(0, 4, 60)])
    for quantity, names in QUANTITIES.items():
        for name in names:
            np.testing.assert_array_equal(~np.ma.getmaskarray(columns[name]), columns[f"{quantity}_available"])
            assert np.isfinite(columns[name].compressed()).all()


# Cut-offs. The gap of boxes 4 m long is the distance of their centres less 4 m, exactly, in these numbers.


@pytest.mark.parametrize(
    ("centre_m", "is_in_range"),
    [(54.0, True), (np.nextafter(54.0, 60), False), (np.nextafter(54.0, 0), True), (55.0, False)],
)
def test_range_ends_at_fifty_metres_inclusive(centre_m: float, is_in_range: bool) -> None:
    for actor_class in ("vehicle", "pedestrian"):
        found = one_actor(Ego(speed_mps=10), Actor(7, actor_class, centre_m, 0))
        assert (found["separation"][0] is not None) == is_in_range
        assert (found["ttc"][0] is not None) == is_in_range
        nearest = "nearest_vehicle" if actor_class == "vehicle" else "nearest_pedestrian"
        assert (found[nearest][0] is not None) == is_in_range


def test_time_to_collision_is_never_capped() -> None:
    found = one_actor(Ego(speed_mps=np.nextafter(0.1, 1)), Actor(7, "vehicle", 54, 0))
    assert found["ttc"] == (pytest.approx(500), 7)


@pytest.mark.parametrize(
    ("speed_mps", "is_closing"), [(0.1, False), (np.nextafter(0.1, 1), True), (np.float64(np.float32(0.1)), True)]
)
def test_closing_starts_above_a_tenth_of_a_metre_per_second(speed_mps: float, is_closing: bool) -> None:
    found = one_actor(Ego(speed_mps=speed_mps), Actor(7, "vehicle", 14, 0))
    assert (found["ttc"][0] is not None) == is_closing
    assert found["separation"] == (10, 7)


@pytest.mark.parametrize(
    ("y_m", "is_relevant"),
    [(0.0, True), (2.5, True), (np.nextafter(2.5, 3), False), (-2.5, True), (-2.6, False), (10.0, False)],
)
def test_static_objects_count_in_the_corridor_only(y_m: float, is_relevant: bool) -> None:
    # Half of the ego's 2 m, 0.5 m of margin, and half of the object's 2 m.
    found = one_actor(Ego(speed_mps=5), Actor(7, "static", 20, y_m))
    assert (found["separation"][0] is not None) == is_relevant
    assert (found["ttc"][0] is not None) == is_relevant
    assert found["nearest_vehicle"] == (None, None)
    assert found["nearest_pedestrian"] == (None,)


@pytest.mark.parametrize("actor_class", ["vehicle", "cycle", "pedestrian"])
def test_what_moves_counts_outside_the_corridor_too(actor_class: str) -> None:
    assert one_actor(Ego(), Actor(7, actor_class, 20, 30))["separation"][1] == 7


def test_static_object_in_the_corridor_but_out_of_range_does_not_count() -> None:
    assert one_actor(Ego(), Actor(7, "static", 60, 0))["separation"] == (None, None)


def test_corridor_follows_the_route_and_not_the_ego() -> None:
    found = one_actor(Ego(0, 20, speed_mps=5), Actor(7, "static", 20, 0))
    assert found["separation"][1] == 7
    assert one_actor(Ego(0, 20, speed_mps=5), Actor(7, "static", 20, 20))["separation"] == (None, None)


@pytest.mark.parametrize("order", [(3, 1, 2), (1, 2, 3), (2, 3, 1)])
def test_ties_go_to_the_lowest_id(order: tuple[int, ...]) -> None:
    # Three actors with mirrored boxes have equal gaps; the closing speed tells which vehicle was taken.
    places = {1: (10.0, 6.0), 2: (10.0, -6.0), 3: (-10.0, 6.0)}
    actors = [Actor(i, "vehicle", *places[i], vel_y_mps=float(-i * places[i][1] / 6)) for i in order]
    columns = compute([(Ego(), actors)])
    assert reading(columns, 0, "separation")[1] == 1
    alone = compute([(Ego(), [actor for actor in actors if actor.actor_id == 1])])
    assert reading(columns, 0, "nearest_vehicle") == reading(alone, 0, "nearest_vehicle")


def test_times_that_tie_go_to_the_lowest_id() -> None:
    actors = [Actor(9, "vehicle", 14, 0), Actor(4, "vehicle", 24, 0, vel_x_mps=-10)]
    assert reading(compute([(Ego(speed_mps=10), actors)]), 0, "ttc") == (1, 4)


def test_separation_and_time_to_collision_may_name_different_actors() -> None:
    actors = [Actor(1, "vehicle", 0, 4), Actor(2, "vehicle", 24, 0)]
    columns = compute([(Ego(speed_mps=10), actors)])
    assert reading(columns, 0, "separation") == (2, 1)
    assert reading(columns, 0, "ttc") == (2, 2)


def test_actors_belong_to_the_observation_of_their_tick() -> None:
    frames = [(Ego(speed_mps=1), [Actor(1, "vehicle", 10.0 + 10 * i, 0)]) for i in range(3)]
    forward = compute(frames)
    np.testing.assert_array_equal(forward["separation_m"], [6, 16, 26])


def test_order_of_rows_carries_no_meaning() -> None:
    rng = np.random.default_rng(32)
    frames = [random_frame(rng, 5) for _ in range(10)]
    shuffled = [(ego, [actors[i] for i in rng.permutation(5)]) for ego, actors in frames]
    plain, other = compute(frames), compute(shuffled)
    for name, column in plain.items():
        np.testing.assert_array_equal(np.ma.filled(column, -1), np.ma.filled(other[name], -1))


def test_observations_may_come_in_any_order() -> None:
    observations = {
        "tick": np.array([10, 0, 5]), "x_m": np.zeros(3), "y_m": np.zeros(3), "yaw_rad": np.zeros(3),
        "speed_mps": np.zeros(3),
    }  # fmt: skip
    actors = {
        "tick": np.array([0, 5, 10]), "actor_id": np.array([1, 1, 1]), "actor_class": np.array(["vehicle"] * 3),
        "x_m": np.array([10.0, 20.0, 30.0]), "y_m": np.zeros(3), "yaw_rad": np.zeros(3), "length_m": np.full(3, 4.0),
        "width_m": np.full(3, 2.0), "vel_x_mps": np.zeros(3), "vel_y_mps": np.zeros(3),
    }  # fmt: skip
    route = {"route_x_m": np.array([0.0, 1.0]), "route_y_m": np.array([0.0, 0.0])}
    found = risk_evidence(observations, actors, ego_length_m=4.0, ego_width_m=2.0, **route)
    np.testing.assert_array_equal(found["separation_m"], [26, 6, 16])


@pytest.mark.parametrize("num_frames", [0, 2])
def test_an_actor_without_observation_is_refused(num_frames: int) -> None:
    frames: Frames = [(Ego(), []) for _ in range(num_frames)]
    assert compute(frames)["num_actors"].tolist() == [0] * num_frames
    observations = {name: np.zeros(num_frames) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")}
    actors = {name: np.zeros(1) for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m", "vel_x_mps", "vel_y_mps")}
    with pytest.raises(ValueError, match="every actor row needs an observation"):
        risk_evidence(
            {"tick": np.arange(num_frames) * 5, **observations},
            {"tick": np.array([3]), "actor_id": np.array([1]), "actor_class": np.array(["vehicle"]), **actors},
            ego_length_m=4.0,
            ego_width_m=2.0,
            route_x_m=np.array([0.0, 1.0]),
            route_y_m=np.array([0.0, 0.0]),
        )


@given(st.floats(-math.pi, math.pi), st.floats(-1000, 1000), st.floats(-1000, 1000), st.integers(0, 2**32 - 1))
def test_evidence_does_not_depend_on_the_world_frame(turn: float, x_m: float, y_m: float, seed: int) -> None:
    ego, actors = random_frame(np.random.default_rng(seed), 4)
    cos, sin = math.cos(turn), math.sin(turn)

    def place(x: float, y: float) -> tuple[float, float]:
        return cos * x - sin * y + x_m, sin * x + cos * y + y_m

    def moved(actor: Actor) -> Actor:
        vel_x, vel_y = actor.vel_x_mps, actor.vel_y_mps
        return Actor(
            actor.actor_id, actor.actor_class, *place(actor.x_m, actor.y_m), actor.yaw_rad + turn, actor.length_m,
            actor.width_m, cos * vel_x - sin * vel_y, sin * vel_x + cos * vel_y,
        )  # fmt: skip

    plain = compute([(ego, actors)])
    there = Ego(*place(ego.x_m, ego.y_m), ego.yaw_rad + turn, ego.speed_mps)
    other = compute([(there, [moved(actor) for actor in actors])], [place(*vertex) for vertex in ROUTE])
    for quantity in QUANTITIES:
        before, after = reading(plain, 0, quantity), reading(other, 0, quantity)
        assert [value is None for value in before] == [value is None for value in after]
        if before[0] is not None:
            assert after == pytest.approx(before, rel=1e-5, abs=1e-6)
