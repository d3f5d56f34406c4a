"""Sign, unit and clock of recorded motion and the place of the pose, against analytic cases."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from tests.synthetic import BRANCH_TICK
from tests.validator.raw.motion.changed import TABLES, WHEELBASE_M, changed, view_of

from branchdrive.raw.motion.calibration import calibration, calibration_between_contacts
from branchdrive.raw.motion.quantity import QUANTITIES, wrong_of_one
from branchdrive.raw.shard_view import ShardView


def _of(view: ShardView) -> dict[str, np.ndarray]:
    return {name: values[np.isfinite(values)] for name, values in calibration(view).items()}


@pytest.fixture(scope="module")
def view() -> ShardView:
    return view_of(TABLES)


def test_a_consistent_world_is_right_in_every_quantity(view: ShardView) -> None:
    """Nothing is said of the pose without axles, of pedestrians who creep and of the time of what hardly changes."""
    found = _of(view)
    del found["command"]
    assert set(found) == set(QUANTITIES) - {"pivot", "command"}
    silent = {"pedestrian_speed", "pedestrian_sense", "lateral_lead", "actor_lead"}
    for name, values in found.items():
        assert bool(len(values)) == (name not in silent)
        assert (values >= QUANTITIES[name].least).all()
        assert (values <= QUANTITIES[name].most).all()


def test_what_contacts_do_to_motion_is_left_out_between_them() -> None:
    """A blow that doubles the recorded way of an observation, and nothing else, in attempts with one contact."""
    evidence, rows = TABLES["evidence"], TABLES["observations"]
    blow = rows["tick"].to_numpy() == 50
    tables = changed("observations", x_m=rows["x_m"].to_numpy() + np.where(blow, 3.0, 0.0))
    place = evidence.schema.get_field_index("collision")
    touches = pa.array(evidence["tick"].to_numpy() == 50)
    tables["evidence"] = evidence.set_column(place, evidence.schema.field(place), touches)
    view = view_of(tables)
    assert np.nanmax(calibration(view)["step"]) > QUANTITIES["step"].most
    assert np.nanmax(calibration_between_contacts(view)["step"]) <= QUANTITIES["step"].most


def test_accelerations_have_a_sign_of_their_own_up_to_the_branch() -> None:
    """Speeds that swing, and accelerations of the contrary sign in the history, which the rest outweighs."""
    rows = TABLES["observations"]
    tick = rows["tick"].to_numpy()
    swing = 2.0 * np.cos(tick / 20.0)
    is_past = (tick >= BRANCH_TICK - 75) & (tick <= BRANCH_TICK)
    tables = changed(
        "observations",
        speed_mps=10.0 + 2.0 * np.sin(tick / 20.0),
        accel_longitudinal_mps2=np.where(is_past, -swing, 2.0 * swing),
    )
    found = calibration_between_contacts(view_of(tables))["longitudinal"]
    every, up_to_branch, from_branch_on = found[:, np.isfinite(found[0])]
    assert len(every) > 20
    np.testing.assert_allclose(up_to_branch, -1.0, atol=0.1)
    assert (every > QUANTITIES["longitudinal"].of_one[0]).all()  # type: ignore[index]
    assert np.isnan(from_branch_on).all()
    wrong = wrong_of_one("longitudinal", found)
    assert wrong.any(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize("ahead_m", [0.0, 1.0, 2.5, -0.5])
def test_the_pose_is_as_far_ahead_of_the_axle_as_it_is_moved(ahead_m: float) -> None:
    """On an arc of 1 rad/s a point swings out by its distance from the axle, and an observation is no tick."""
    rows = TABLES["observations"]
    radius_m, yaw = 5.0, (rows["tick"].to_numpy() * 0.05 + np.pi) % (2 * np.pi) - np.pi
    x = radius_m * np.sin(yaw) + ahead_m * np.cos(yaw)
    y = -radius_m * np.cos(yaw) + ahead_m * np.sin(yaw)
    tables = changed("observations", x_m=x, y_m=y, yaw_rad=yaw, speed_mps=np.full(len(yaw), radius_m))
    found = _of(view_of(tables, has_axles=True))["pivot"]
    assert len(found) > 20
    np.testing.assert_allclose(found, ahead_m * 2 * np.sin(0.125) / 0.25 / WHEELBASE_M, atol=1e-5)


def test_fast_turns_say_nothing_of_the_pose() -> None:
    rows = TABLES["observations"]
    tables = changed("observations", speed_mps=np.full(len(rows), 8.1))
    assert not len(_of(view_of(tables, has_axles=True))["pivot"])


def test_angles_and_speeds_of_actors_are_measured() -> None:
    rows, turned = TABLES["actors"], np.radians(10.0)
    time_s, heading = rows["tick"].to_numpy() * 0.05, rows["yaw_rad"].to_numpy() + turned
    speed = 1.25 * np.hypot(rows["vel_x_mps"].to_numpy(), rows["vel_y_mps"].to_numpy())
    is_walker = np.array([kind == "pedestrian" for kind in rows["actor_class"].to_pylist()])
    tables = changed(
        "actors",
        x_m=np.where(is_walker, 1.5 * time_s, rows["x_m"].to_numpy()),
        y_m=np.where(is_walker, 2.0 * time_s, rows["y_m"].to_numpy()),
        vel_x_mps=np.where(is_walker, 0.3, speed * np.cos(heading)),
        vel_y_mps=np.where(is_walker, 0.4, speed * np.sin(heading)),
    )
    found = _of(view_of(tables))
    np.testing.assert_allclose(found["actor_heading"], 10.0, atol=1e-3)
    np.testing.assert_allclose(found["actor_sense"], np.cos(turned), atol=1e-5)
    np.testing.assert_allclose(found["actor_speed"], 1.25, rtol=0.02)
    np.testing.assert_allclose(found["pedestrian_speed"], 0.2, rtol=1e-5)
