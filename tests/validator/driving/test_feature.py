"""Features and input contracts: what is admitted, what is refused, and the order of the profiles."""

from __future__ import annotations

import dataclasses
import json

import pytest
from tests.each import each

from branchdrive.contract.columns import TABLES
from branchdrive.driving.feature import MIXED_PROFILE, SENSOR_PROFILE, Feature, InputContract, InputProfile
from branchdrive.errors import UsageError

EVERY_COLUMN = [(table.name, column.name, column.track) for table in TABLES.values() for column in table.columns]
ADMITTED = {
    InputContract.SENSOR: {"sensor"},
    InputContract.OBJECTS: {"sensor", "objects"},
    InputContract.MIXED: {"sensor", "mixed"},
    InputContract.PRIVILEGED: {"sensor", "mixed", "privileged"},
}
APPLIED = {("controls", f"applied_{actuator}") for actuator in ("steer", "throttle", "brake")}


@pytest.mark.parametrize("contract", InputContract)
def test_a_contract_admits_its_tracks_and_the_applied_controls_and_nothing_else(contract: InputContract) -> None:
    assert set(contract.tracks) == ADMITTED[contract]
    assert len(EVERY_COLUMN) > 80
    for table, column, track in EVERY_COLUMN:
        if track in ADMITTED[contract] or (table, column) in APPLIED:
            assert contract.admit(table, column) is TABLES[table][column]
        else:
            with pytest.raises(UsageError, match=f"`{table}.{column}` is of track '{track}'"):
                contract.admit(table, column)


@pytest.mark.parametrize("place", [("observations", "velocity"), ("sensors", "x_m")])
def test_a_column_that_nobody_declared_is_refused(place: tuple[str, str]) -> None:
    with pytest.raises(UsageError, match=r"is declared in columns\.json"):
        InputContract.PRIVILEGED.admit(*place)


def test_the_sensor_profile_has_the_21_variables_in_their_order() -> None:
    assert [feature.name for feature in SENSOR_PROFILE.state] == [
        "rel_x_m", "rel_y_m", "rel_sin_yaw", "rel_cos_yaw", "speed_mps",
        "mean_accel_longitudinal_mps2", "mean_accel_lateral_mps2", "mean_yaw_rate_radps",
        "speed_limit_mps", "route_offset_m", "route_heading_error_rad",
        "target_point_1_x_m", "target_point_1_y_m", "target_point_2_x_m", "target_point_2_y_m",
        "command_left", "command_right", "command_straight",
        "command_follow", "command_change_left", "command_change_right",
    ]  # fmt: skip
    assert [feature.name for feature in SENSOR_PROFILE.controls] == ["steer", "throttle", "brake"]
    assert {feature.track for feature in SENSOR_PROFILE.state} == {"sensor"}


def test_the_mixed_profile_adds_what_the_expert_computes() -> None:
    assert MIXED_PROFILE.state[:21] == SENSOR_PROFILE.state
    expert = MIXED_PROFILE.state[21:]
    assert [feature.name for feature in expert] == [
        "target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard"
    ]  # fmt: skip
    assert {feature.track for feature in expert} == {"mixed"}


def test_one_hots_and_flags_are_not_normalised_and_all_else_is() -> None:
    kept = [feature.name for feature in (*MIXED_PROFILE.state, *MIXED_PROFILE.controls) if not feature.normalised]
    assert len(kept) == 9
    assert all(name.startswith("command_") or name.endswith("_hazard") for name in kept)


def test_names_units_and_frames_of_copied_columns_are_those_of_the_columns() -> None:
    for feature in MIXED_PROFILE.state:
        if feature.columns == (feature.name,):
            column = TABLES["observations"][feature.name]
            assert (feature.unit, feature.frame, feature.track) == (column.unit, column.frame, column.track)


def test_source_columns_are_listed_once() -> None:
    assert SENSOR_PROFILE.state_columns == (
        "x_m", "y_m", "yaw_rad", "speed_mps", "speed_limit_mps", "route_offset_m", "route_heading_error_rad",
        "target_point_1_x_m", "target_point_1_y_m", "target_point_2_x_m", "target_point_2_y_m", "command",
    )  # fmt: skip
    assert SENSOR_PROFILE.control_columns == ("applied_steer", "applied_throttle", "applied_brake")


def test_a_feature_is_data() -> None:
    records = json.loads(json.dumps([feature.record for feature in SENSOR_PROFILE.state]))
    assert records[0] == {
        "name": "rel_x_m",
        "unit": "m",
        "frame": "branch",
        "track": "sensor",
        "columns": ["observations.x_m", "observations.y_m", "observations.yaw_rad"],
        "normalised": True,
        "description": "Ego centre, x, relative to the pose at the branch.",
    }


def test_a_feature_is_as_restricted_as_its_most_restricted_column() -> None:
    feature = Feature("gap", "observations", ("speed_mps", "target_speed_mps"), "Speed below the target.")
    assert feature.track == "mixed"
    assert InputProfile("wider", InputContract.MIXED, (feature,)).state_columns == ("speed_mps", "target_speed_mps")
    with pytest.raises(UsageError, match=r"`observations.target_speed_mps` is of track 'mixed'"):
        InputProfile("sensor", InputContract.SENSOR, (feature,))


SPEED = Feature("speed_mps", "observations", ("speed_mps",), "Speed.")
REFUSED = {
    "mixed in sensor": ((*SENSOR_PROFILE.state, *MIXED_PROFILE.state[21:]), (), "of track 'mixed'"),
    "identifier": ((Feature("tick", "observations", ("tick",), "Tick."),), (), "of track 'audit'"),
    "expert command": ((), (Feature("steer", "controls", ("expert_steer",), "Steer."),), "of track 'audit'"),
    "evidence": ((Feature("gap", "evidence", ("separation_m",), "Gap."),), (), "expected columns of `observations`"),
    "state among controls": ((), (SPEED,), "expected columns of `controls`"),
    "no source": ((Feature("one", "observations", (), "One."),), (), "expected columns of `observations`"),
    "two names": ((SPEED, SPEED), (), "have one name"),
    "unknown": ((Feature("speed", "observations", ("speed",), "Speed."),), (), "is declared in columns.json"),
    "joint control": (
        (),
        (Feature("pedals", "controls", ("applied_throttle", "applied_brake"), "Pedals."),),
        "a control is one column",
    ),
}


@each("case", REFUSED)
def test_a_profile_cannot_be_built_around_what_its_contract_refuses(case: str) -> None:
    state, controls, message = REFUSED[case]
    with pytest.raises(UsageError, match=message):
        InputProfile("mine", InputContract.SENSOR, state, controls)


def test_a_profile_cannot_be_changed_into_one_that_its_contract_refuses() -> None:
    with pytest.raises(UsageError, match="of track 'mixed'"):
        dataclasses.replace(SENSOR_PROFILE, state=MIXED_PROFILE.state)
    with pytest.raises(dataclasses.FrozenInstanceError):
        SENSOR_PROFILE.state = MIXED_PROFILE.state  # type: ignore[misc]


def test_a_contract_is_named() -> None:
    assert InputContract.named("mixed") is InputContract.named(InputContract.MIXED) is InputContract.MIXED
    with pytest.raises(UsageError, match="no input contract 'all'; there are sensor, objects, mixed, privileged"):
        InputContract.named("all")
