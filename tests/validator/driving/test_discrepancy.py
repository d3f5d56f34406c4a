"""Replay fidelity: known differences, missing values, and symmetries."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.driving.discrepancy import (
    CORE,
    EXTENDED,
    NO_LIGHT,
    History,
    HistoryEvidence,
    core_discrepancy,
    extended_discrepancy,
)

FRAMES, TICKS = 16, 80


def history(seed: int = 0, drives: int = 1) -> History:
    rng = np.random.default_rng(seed)
    return History(
        *(rng.uniform(-50, 50, (drives, FRAMES)) for _ in range(2)),
        rng.uniform(-math.pi, math.pi, (drives, FRAMES)),
        rng.uniform(0, 20, (drives, FRAMES)),
        *(rng.uniform(0, 1, (drives, TICKS)).astype(np.float32) for _ in range(3)),
        rng.integers(80, 200, drives),
    )


def surroundings(seed: int = 0, drives: int = 1) -> HistoryEvidence:
    rng = np.random.default_rng(seed)
    return HistoryEvidence(
        rng.random((drives, FRAMES)) < 0.7,
        rng.uniform(0, 50, (drives, FRAMES)),
        rng.uniform(-10, 10, (drives, FRAMES)),
        rng.integers(0, 9, (drives, FRAMES)),
        rng.integers(NO_LIGHT, 3, (drives, FRAMES)),
        rng.random((drives, FRAMES)) < 0.4,
        rng.uniform(0, 50, (drives, FRAMES)),
    )


def core(replay: History, nominal: History) -> dict[str, float]:
    (values,) = core_discrepancy(replay, nominal)
    return dict(zip([variable.name for variable in CORE], values.tolist(), strict=True))


def extended(replay: HistoryEvidence, nominal: HistoryEvidence) -> dict[str, float]:
    (values,) = extended_discrepancy(replay, nominal)
    return dict(zip([variable.name for variable in EXTENDED], values.tolist(), strict=True))


def nudged(values: Any, place: int, by: float) -> Any:
    changed = np.array(values, float)
    changed[0, place] += by
    return changed


@each(
    ("name", "change", "expected"),
    [
        ("position_m", lambda h: {"x_m": nudged(h.x_m, 3, 0.3), "y_m": nudged(h.y_m, 3, -0.4)}, 0.5),
        ("position_m", lambda h: {"x_m": nudged(nudged(h.x_m, 3, 0.3), 15, 2.0)}, 2.0),
        ("heading_deg", lambda h: {"yaw_rad": nudged(h.yaw_rad, 0, 0.01)}, math.degrees(0.01)),
        ("heading_deg", lambda h: {"yaw_rad": nudged(h.yaw_rad, 0, 2 * math.pi - 0.01)}, math.degrees(0.01)),
        ("speed_mps", lambda h: {"speed_mps": nudged(h.speed_mps, 8, -0.2)}, 0.2),
        ("steer", lambda h: {"steer": nudged(h.steer, 79, 0.05)}, 0.05),
        ("throttle", lambda h: {"throttle": nudged(h.throttle, 0, -0.25)}, 0.25),
        ("brake", lambda h: {"brake": nudged(h.brake, 40, 1.0)}, 1.0),
        ("tick_offset", lambda h: {"branch_tick": h.branch_tick + 5}, 5),
        ("position_m", lambda h: {"y_m": nudged(h.y_m, 2, math.nan)}, math.inf),
        ("heading_deg", lambda h: {"yaw_rad": nudged(h.yaw_rad, 2, math.inf)}, math.inf),
        ("brake", lambda h: {"brake": nudged(h.brake, 2, math.nan)}, math.inf),
    ],
)
def test_a_difference_shows_in_its_variable_alone(name: str, change: Any, expected: float) -> None:
    nominal = history()
    found = core(nominal._replace(**change(nominal)), nominal)
    assert found.pop(name) == pytest.approx(expected)
    assert set(found.values()) == {0}


def test_a_vehicle_on_one_side_only_is_infinitely_far() -> None:
    nominal = surroundings()
    seen = nominal.vehicle_available.copy()
    seen[0, 5] = ~seen[0, 5]
    found = extended(nominal._replace(vehicle_available=seen), nominal)
    assert found == {"vehicle_gap_m": math.inf, "vehicle_rel_speed_mps": math.inf} | dict.fromkeys(list(found)[2:], 0)


def test_a_pedestrian_on_one_side_only_is_infinitely_far() -> None:
    nominal = surroundings()
    seen = nominal.pedestrian_available.copy()
    seen[0, 5] = ~seen[0, 5]
    found = extended(nominal._replace(pedestrian_available=seen), nominal)
    assert found == dict.fromkeys(list(found)[:-1], 0) | {"pedestrian_gap_m": math.inf}


def test_who_is_on_neither_side_is_equal_whatever_stands_there() -> None:
    none = np.zeros((1, FRAMES), bool)
    nobody = {"vehicle_available": none, "pedestrian_available": none}
    replay, nominal = (surroundings(seed)._replace(**nobody) for seed in (1, 2))
    found = extended(replay, nominal)
    assert (found["vehicle_gap_m"], found["vehicle_rel_speed_mps"], found["pedestrian_gap_m"]) == (0, 0, 0)


def test_what_differs_in_some_observations_counts_as_their_share() -> None:
    nominal = surroundings()
    actors, light = nominal.num_actors.copy(), nominal.traffic_light.copy()
    actors[0, :4] += 1
    light[0, 7] = 3
    found = extended(nominal._replace(num_actors=actors, traffic_light=light), nominal)
    assert list(found.values()) == [0, 0, 4 / 16, 1 / 16, 0]


def test_known_gaps_and_speeds_differ_by_their_largest_difference() -> None:
    there = np.ones((1, FRAMES), bool)
    nominal = surroundings()._replace(vehicle_available=there, pedestrian_available=there)
    replay = nominal._replace(
        vehicle_gap_m=nudged(nominal.vehicle_gap_m, 4, 1.5),
        vehicle_rel_speed_mps=nudged(nominal.vehicle_rel_speed_mps, 9, -0.5),
        pedestrian_gap_m=nudged(nominal.pedestrian_gap_m, 15, 0.25),
    )
    assert list(extended(replay, nominal).values()) == pytest.approx([1.5, 0.5, 0, 0, 0.25])


seeds = st.integers(0, 10_000)


@given(seeds, st.integers(0, 5))
def test_a_drive_does_not_differ_from_itself(seed: int, drives: int) -> None:
    assert not core_discrepancy(history(seed, drives), history(seed, drives)).any()
    assert not extended_discrepancy(surroundings(seed, drives), surroundings(seed, drives)).any()


@given(seeds, seeds, st.integers(1, 5))
def test_replay_and_nominal_are_exchangeable(a: int, b: int, drives: int) -> None:
    sides, around = ([make(seed, drives) for seed in (a, b)] for make in (history, surroundings))
    np.testing.assert_array_equal(core_discrepancy(*sides), core_discrepancy(*sides[::-1]))  # type: ignore[arg-type]
    there, back = extended_discrepancy(*around), extended_discrepancy(*around[::-1])  # type: ignore[arg-type]
    np.testing.assert_array_equal(there, back)


@given(seeds, seeds)
def test_pairs_side_by_side_differ_as_they_do_alone(a: int, b: int) -> None:
    replay, nominal = history(a, 4), history(b, 4)
    together = core_discrepancy(replay, nominal)
    for i in range(4):
        (alone,) = core_discrepancy(*(History(*(f[i : i + 1] for f in side)) for side in (replay, nominal)))
        np.testing.assert_array_equal(together[i], alone)


@each("name", History._fields)
def test_other_shapes_of_histories_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"`{name if name != 'x_m' else 'y_m'}` has shape"):
        core_discrepancy(history(drives=2)._replace(**{name: np.zeros((3, FRAMES))}), history(drives=2))


@pytest.mark.parametrize("name", HistoryEvidence._fields[1:])
def test_other_shapes_of_evidence_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"`{name}` has shape"):
        extended_discrepancy(surroundings()._replace(**{name: np.zeros((1, FRAMES + 1))}), surroundings())
