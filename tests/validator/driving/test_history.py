"""Histories: against analytic motion, a plain second implementation, and rigid motions of the world."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.columns import TABLES
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.feature import MIXED_PROFILE, SENSOR_PROFILE, Feature, InputContract, InputProfile
from branchdrive.driving.history import CONTROL_WINDOW, STATE_WINDOW, HistoryInput, control_history, state_history
from branchdrive.errors import UsageError

Array = np.ndarray[Any, np.dtype[np.float64]]

TIME_S = np.arange(-16, 1) * 0.25
COMMANDS = TABLES["observations"]["command"].values
PLAIN = ("speed_limit_mps", "route_offset_m", "route_heading_error_rad", "target_point_1_x_m",
         "target_point_1_y_m", "target_point_2_x_m", "target_point_2_y_m")  # fmt: skip


def drive(x: Any, y: Any, yaw: Any, speed: Any, **others: Any) -> dict[str, Any]:
    """Columns of the sensor profile for one group."""
    given = {"x_m": x, "y_m": y, "yaw_rad": yaw, "speed_mps": speed, "command": "follow"}
    given |= {**dict.fromkeys(PLAIN, 0.0), **others}
    return {name: np.broadcast_to(np.asarray(values), 17)[None] for name, values in given.items()}


def state(columns: dict[str, Any], profile: InputProfile = SENSOR_PROFILE) -> HistoryInput:
    num_groups = len(columns["x_m"])
    branch_tick = 100 + 5 * np.arange(num_groups)
    tick = branch_tick[:, None] + np.array(STATE_WINDOW)
    return state_history(profile, columns, tick=tick, branch_tick=branch_tick)


def named(columns: dict[str, Any], profile: InputProfile = SENSOR_PROFILE) -> dict[str, Array]:
    """Features of the only group, by name."""
    found = state(columns, profile)
    assert found.available.all()
    return dict(zip([feature.name for feature in profile.state], found.values[0].T, strict=True))


def test_the_windows_end_at_the_branch_and_before_it() -> None:
    assert list(STATE_WINDOW) == list(range(-80, 1, 5))
    assert list(CONTROL_WINDOW) == list(range(-80, 0))


def test_a_straight_drive_comes_from_behind() -> None:
    heading = 2.5
    found = named(drive(7 + 8 * TIME_S * math.cos(heading), -3 + 8 * TIME_S * math.sin(heading), heading, 8))
    np.testing.assert_allclose(found["rel_x_m"], 8 * TIME_S[1:], atol=1e-12)
    for name, value in {"rel_y_m": 0, "rel_sin_yaw": 0, "rel_cos_yaw": 1, "speed_mps": 8,
                        "mean_accel_longitudinal_mps2": 0, "mean_accel_lateral_mps2": 0,
                        "mean_yaw_rate_radps": 0}.items():  # fmt: skip
        np.testing.assert_allclose(found[name], value, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("rate", [0.4, -0.4, 1.5])
def test_a_circle_has_a_steady_yaw_rate_and_no_longitudinal_acceleration(rate: float) -> None:
    speed, heading = 6.0, 3.0  # the heading passes pi
    yaw = heading + rate * TIME_S
    x, y = speed / rate * np.sin(yaw), -speed / rate * np.cos(yaw)
    found = named(drive(x, y, wrap_rad(yaw), speed))
    along = rate * TIME_S[1:]
    np.testing.assert_allclose(found["rel_x_m"], speed / rate * np.sin(along), atol=1e-12)
    np.testing.assert_allclose(found["rel_y_m"], speed / rate * (1 - np.cos(along)), atol=1e-12)
    np.testing.assert_allclose(found["rel_sin_yaw"], np.sin(along), atol=1e-12)
    np.testing.assert_allclose(found["rel_cos_yaw"], np.cos(along), atol=1e-12)
    np.testing.assert_allclose(found["mean_yaw_rate_radps"], rate, atol=1e-12)
    np.testing.assert_allclose(found["mean_accel_longitudinal_mps2"], 0, atol=1e-12)
    chord = 2 * speed * math.sin(rate * 0.125) / 0.25
    np.testing.assert_allclose(found["mean_accel_lateral_mps2"], chord, rtol=1e-12)
    assert chord == pytest.approx(speed * rate, rel=0.01)


def test_steady_braking_has_its_deceleration_in_every_row() -> None:
    found = named(drive(0, 0, 0.3, 10 - 2 * (TIME_S + 4)))
    np.testing.assert_allclose(found["mean_accel_longitudinal_mps2"], -2, atol=1e-12)
    np.testing.assert_allclose(found["mean_accel_lateral_mps2"], 0, atol=1e-12)


def test_the_predecessor_enters_the_differences_of_the_first_row_and_nothing_else() -> None:
    columns = drive(TIME_S, 0, 0, 5, command="left")
    before = state(columns).values
    for name, values in columns.items():
        columns[name] = values.copy()
        columns[name][0, 0] = "right" if name == "command" else 1.0
    after = state(columns).values
    row, feature = np.nonzero(before[0] != after[0])
    names = {SENSOR_PROFILE.state[place].name for place in feature}
    assert set(row.tolist()) == {0}
    assert names == {"mean_accel_longitudinal_mps2", "mean_accel_lateral_mps2", "mean_yaw_rate_radps"}


def test_recorded_values_are_those_of_the_sixteen_observations() -> None:
    values = {name: np.arange(17) + 100 * place for place, name in enumerate(PLAIN)}
    found = named(drive(0, 0, 0, 0, **values))
    for name, expected in values.items():
        assert (found[name] == expected[1:]).all()


def test_the_command_is_a_one_hot() -> None:
    commands = [COMMANDS[place % 6] for place in range(17)]
    found = named(drive(0, 0, 0, 0, command=commands))
    one_hot = np.stack([found[f"command_{value}"] for value in COMMANDS], axis=1)
    assert (one_hot == np.eye(6)[[place % 6 for place in range(1, 17)]]).all()


def test_the_mixed_profile_adds_speed_and_flags() -> None:
    hazards = dict.fromkeys(("vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard"), np.arange(17) % 2 == 0)
    columns = drive(0, 0, 0, 0, target_speed_mps=np.arange(17.0), **hazards)
    found = named(columns, MIXED_PROFILE)
    assert len(found) == 25
    assert found["target_speed_mps"].tolist() == list(range(1, 17))
    assert found["vehicle_hazard"].tolist() == [0.0, 1.0] * 8


POSES = st.tuples(
    st.floats(-500, 500), st.floats(-500, 500), st.floats(-3.1, 3.1), st.floats(-5, 40), st.sampled_from(COMMANDS)
)


def oracle(rows: list[tuple[float, float, float, float, str]], plain: list[float]) -> list[list[float]]:
    """The 21 variables with complex numbers, one row at a time."""
    xb, yb, yaw_b, _, _ = rows[-1]
    unit = complex(math.cos(yaw_b), math.sin(yaw_b))
    found = []
    for (_, _, yaw_0, v_0, _), (x, y, yaw, v, command) in pairwise(rows):
        place = complex(x - xb, y - yb) / unit
        turn = math.remainder(yaw - yaw_0, 2 * math.pi)
        middle = yaw_0 + turn / 2
        change = complex(v * math.cos(yaw) - v_0 * math.cos(yaw_0), v * math.sin(yaw) - v_0 * math.sin(yaw_0))
        accel = change / complex(math.cos(middle), math.sin(middle)) / 0.25
        one_hot = [float(command == value) for value in COMMANDS]
        found.append([place.real, place.imag, math.sin(yaw - yaw_b), math.cos(yaw - yaw_b), v,
                      accel.real, accel.imag, turn / 0.25, *plain, *one_hot])  # fmt: skip
    return found


@given(st.lists(st.lists(POSES, min_size=17, max_size=17), min_size=1, max_size=3), st.integers(0, 1000))
def test_the_plain_definition_agrees(groups: list[list[tuple[float, float, float, float, str]]], seed: int) -> None:
    plain = np.random.default_rng(seed).normal(size=7).tolist()
    fields = ("x_m", "y_m", "yaw_rad", "speed_mps", "command")
    columns: dict[str, Any] = {
        name: [[row[place] for row in rows] for rows in groups] for place, name in enumerate(fields)
    }
    columns |= {name: np.full((len(groups), 17), value) for name, value in zip(PLAIN, plain, strict=True)}
    found = state(columns)
    assert found.available.all()
    np.testing.assert_allclose(found.values, [oracle(rows, plain) for rows in groups], rtol=1e-9, atol=1e-9)


@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_a_rigid_motion_of_the_world_changes_nothing(seed: int, turn: float, x_m: float, y_m: float) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.normal(0, 30, (2, 17))
    yaw, speed = np.cumsum(rng.normal(0, 0.2, 17)), rng.uniform(0, 20, 17)
    moved_x, moved_y = x_m + math.cos(turn) * x - math.sin(turn) * y, y_m + math.sin(turn) * x + math.cos(turn) * y
    before = state(drive(x, y, wrap_rad(yaw), speed)).values
    after = state(drive(moved_x, moved_y, wrap_rad(yaw + turn), speed)).values
    np.testing.assert_allclose(after, before, atol=1e-8)


@given(st.integers(0, 1000))
def test_the_accelerations_are_those_of_the_targets(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw, speed = wrap_rad(np.cumsum(rng.normal(0, 0.5, 17))), rng.uniform(-5, 20, 17)
    found = named(drive(0, 0, yaw, speed))
    velocity = speed * np.exp(1j * yaw)
    norm = np.hypot(found["mean_accel_longitudinal_mps2"], found["mean_accel_lateral_mps2"])
    np.testing.assert_allclose(norm, np.abs(np.diff(velocity)) / 0.25, atol=1e-9)


def test_groups_do_not_see_each_other() -> None:
    columns = [drive(TIME_S * place, 1, 0.1 * place, place, command="right") for place in range(3)]
    together = state({name: np.concatenate([one[name] for one in columns]) for name in columns[0]})
    for place, one in enumerate(columns):
        assert (together.values[place] == state(one).values[0]).all()


@pytest.mark.parametrize(
    ("name", "row", "lost"),
    [("x_m", 5, {4}), ("x_m", 16, set(range(16))), ("yaw_rad", 5, {4, 5}), ("speed_mps", 0, {0}),
     ("x_m", 0, set()), ("route_offset_m", 16, {15})],
)  # fmt: skip
def test_a_row_without_all_its_values_is_unavailable(name: str, row: int, lost: set[int]) -> None:
    columns = drive(0, 0, 0, 5)
    columns[name] = columns[name].astype(float)
    columns[name][0, row] = np.nan
    found = state(columns)
    assert set(np.flatnonzero(~found.available[0]).tolist()) == lost
    assert (np.isnan(found.values) == ~found.available[..., None]).all()


def test_a_command_that_is_none_makes_its_row_unavailable() -> None:
    columns = drive(0, 0, 0, 5, command=["follow"] * 8 + ["u_turn"] + ["follow"] * 8)
    assert np.flatnonzero(~state(columns).available[0]).tolist() == [7]


def test_no_groups_have_empty_histories() -> None:
    columns = {name: np.empty((0, 17)) for name in SENSOR_PROFILE.state_columns}
    found = state_history(SENSOR_PROFILE, columns, tick=np.empty((0, 17), int), branch_tick=[])
    assert found.values.shape == (0, 16, 21)


def controls(offset: int = 0, **others: Any) -> HistoryInput:
    steps = np.arange(80.0)
    columns = {"applied_steer": [steps], "applied_throttle": [steps + 100], "applied_brake": [steps + 200], **others}
    return control_history(SENSOR_PROFILE, columns, tick=[np.arange(20, 100) + offset], branch_tick=[100])


def test_controls_are_those_that_were_applied_before_the_branch() -> None:
    found = controls()
    assert found.values.shape == (1, 80, 3)
    assert (found.values[0] == np.arange(80)[:, None] + [0, 100, 200]).all()
    assert found.available.all()


@pytest.mark.parametrize("offset", [1, -1, 5])
def test_a_control_of_the_branch_or_after_cannot_enter(offset: int) -> None:
    with pytest.raises(
        ValueError, match=rf"group 0, row 0: tick {20 + offset}, expected 20; .* t_b-80 .. t_b-1 in order"
    ):
        controls(offset)


def test_an_observation_after_the_branch_cannot_enter() -> None:
    tick = 100 + np.array([STATE_WINDOW, STATE_WINDOW])
    tick[1, 16] = 105
    columns = {name: np.concatenate([values, values]) for name, values in drive(0, 0, 0, 0).items()}
    with pytest.raises(ValueError, match=r"group 1, row 16: tick 105, expected 100; the window is t_b-80 .. t_b\+0"):
        state_history(SENSOR_PROFILE, columns, tick=tick, branch_tick=[100, 100])


def test_columns_that_the_profile_did_not_ask_for_are_refused() -> None:
    with pytest.raises(UsageError, match=r"not admitted \['target_speed_mps'\], missing \[\]"):
        state(drive(0, 0, 0, 0, target_speed_mps=3))
    with pytest.raises(UsageError, match=r"not admitted \['expert_steer'\], missing \[\]"):
        controls(expert_steer=[np.zeros(80)])
    with pytest.raises(UsageError, match=r"not admitted \[\], missing \['target_speed_mps', 'vehicle_hazard'"):
        state({**drive(0, 0, 0, 0), "pedestrian_hazard": 0, "traffic_light_hazard": 0}, MIXED_PROFILE)


@pytest.mark.parametrize(
    "feature",
    [
        Feature("rel_x_m", "observations", ("x_m",), "A position that hides two of its sources."),
        Feature("speed_squared", "observations", ("speed_mps",), "A feature that nobody can compute."),
    ],
)
def test_a_formula_reads_only_the_columns_that_its_feature_declares(feature: Feature) -> None:
    profile = InputProfile("mine", InputContract.SENSOR, (feature, *SENSOR_PROFILE.state[1:]))
    with pytest.raises(UsageError, match=f"the formula of the feature `{feature.name}` reads the column"):
        state(drive(0, 0, 0, 0), profile)


def test_shapes_must_match() -> None:
    with pytest.raises(ValueError, match=r"`x_m` has shape \[1, 16\], not \[1, 17\]"):
        state({**drive(0, 0, 0, 0), "x_m": np.zeros((1, 16))})
    with pytest.raises(ValueError, match=r"`tick` has shape \[1, 16\] and `branch_tick` \[1\]"):
        state_history(SENSOR_PROFILE, drive(0, 0, 0, 0), tick=np.zeros((1, 16)), branch_tick=[100])
