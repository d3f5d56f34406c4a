"""Recorded columns: exactly the declared ones, in declared ranges, and recomputing from each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, branch_of, intervention_of, nominal_of

from branchdrive.contract.columns import TABLES
from branchdrive_reference.simulation.record import ACTOR_RANGE_M, Record, record
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.world.body import EGO

RUNS = [nominal_of(name) for name in SCENARIO_NAMES] + [
    intervention_of("HardBrakeRoute", "accelerate_0.80"),
    intervention_of("PedestrianCrossing", "steer_right_0.15"),
    intervention_of("ParkedObstacle", "steer_left_0.05"),
]
RECORDS = [record(run) for run in RUNS]
each_record = pytest.mark.parametrize(("run", "recorded"), list(zip(RUNS, RECORDS, strict=True)))
FILLED_BY_COLLECTOR = {
    "rollout_id", "group_id", "role", "attempt", "protocol_variant", "action_key", "nominal_rollout_id", "repetition",
    "branch_tick", "branch_frame", "num_ticks", "num_observations", "simulator_version", "collector_version",
    "provenance",
}  # fmt: skip


@each_record
def test_tables_have_the_declared_columns(run: Run, recorded: Record) -> None:
    for name in ("controls", "observations", "actors", "evidence"):
        columns = getattr(recorded, name)
        declared = {column.name for column in TABLES[name].columns} - {"rollout_id"}
        assert set(columns) == declared
        assert len({len(values) for values in columns.values()}) == 1
    declared = {column.name for column in TABLES["rollouts"].columns}
    trigger = {name for name in declared if name.startswith("trigger_")}
    assert set(recorded.fields) == declared - FILLED_BY_COLLECTOR - trigger


@each_record
def test_values_lie_in_the_declared_ranges(run: Run, recorded: Record) -> None:
    for name in ("controls", "observations", "actors", "evidence"):
        for column in TABLES[name].columns:
            if column.min is not None or column.max is not None:
                values = np.ma.compressed(getattr(recorded, name)[column.name])
                assert (values >= (-math.inf if column.min is None else column.min)).all(), column.name
                assert (values <= (math.inf if column.max is None else column.max)).all(), column.name


@each_record
def test_policy_columns_are_masked_off_the_active_window(run: Run, recorded: Record) -> None:
    for column in ("nominal_steer", "intended_throttle"):
        assert (np.ma.getmaskarray(recorded.controls[column]) == ~run.active).all()


@each_record
def test_intended_equals_applied(run: Run, recorded: Record) -> None:
    for actuator in ("steer", "throttle", "brake"):
        intended = recorded.controls[f"intended_{actuator}"]
        assert (intended.compressed() == recorded.controls[f"applied_{actuator}"][run.active]).all()


@each_record
def test_actors_are_those_in_range(run: Run, recorded: Record) -> None:
    bodies = run.log.bodies
    ego = bodies[:, EGO]
    for index in range(1, bodies.shape[1]):
        distance = np.hypot(bodies["x_m"][:, index] - ego["x_m"], bodies["y_m"][:, index] - ego["y_m"])
        rows = recorded.actors["actor_id"] == index
        assert (recorded.actors["tick"][rows] == np.flatnonzero(distance <= ACTOR_RANGE_M) * 5).all()
        assert len(set(recorded.actors["actor_class"][rows])) <= 1


@each_record
def test_target_points_lie_ahead_on_the_route(run: Run, recorded: Record) -> None:
    columns = recorded.observations
    route_x, route_y = np.array(recorded.fields["route_x_m"]), np.array(recorded.fields["route_y_m"])
    cos, sin = np.cos(columns["yaw_rad"].astype(float)), np.sin(columns["yaw_rad"].astype(float))
    px, py = columns["target_point_1_x_m"].astype(float), columns["target_point_1_y_m"].astype(float)
    x, y = columns["x_m"] + cos * px - sin * py, columns["y_m"] + sin * px + cos * py
    nearest = np.hypot(x[:, None] - route_x, y[:, None] - route_y).min(axis=1)
    assert nearest.max() < 0.6
    on_route = np.abs(columns["route_offset_m"]) < 0.5
    aligned = np.abs(columns["route_heading_error_rad"]) < 0.2
    assert (px[on_route & aligned] > 0).all()


def test_route_columns_of_a_nominal_drive() -> None:
    recorded = record(nominal_of("HardBrakeRoute")).observations
    assert (np.diff(recorded["route_progress_m"]) > -1e-3).all()
    assert np.abs(recorded["route_offset_m"]).max() < 1.0
    assert set(recorded["command"]) <= {"left", "right", "straight", "follow"}
    assert recorded["vehicle_hazard"].any()
    assert not recorded["traffic_light_hazard"].any()


def test_hazards_name_their_cause() -> None:
    recorded = record(nominal_of("PedestrianCrossing")).observations
    frame = branch_of("PedestrianCrossing").branch_frame
    assert recorded["pedestrian_hazard"][frame + 1 : frame + 6].any()
    assert not recorded["pedestrian_hazard"][: frame + 1].any()


def test_a_crash_is_an_event_and_a_result() -> None:
    rollout = intervention_of("HardBrakeRoute", "accelerate_0.80")
    recorded = record(rollout)
    assert recorded.fields["result_num_vehicle_collisions"] >= 1
    first = np.flatnonzero(recorded.evidence["collision"])[0]
    assert recorded.evidence["separation_m"][first] < 0.5
    assert recorded.observations["tick"][-1] > recorded.observations["tick"][first] + 20
    assert recorded.fields["status"] == "complete"


def test_leaving_the_road_is_counted() -> None:
    recorded = record(intervention_of("PedestrianCrossing", "steer_right_0.15"))
    off = ~recorded.evidence["on_road"]
    assert off.any()
    assert recorded.fields["result_num_off_road_infractions"] >= 1
    assert all(lane is None for lane in recorded.evidence["lane_id"][off])
