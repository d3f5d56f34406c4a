"""Recorded columns: exactly the declared ones, in declared ranges, and recomputing from each other."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import shapely
from tests.each import each
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, branch_of, intervention_of, nominal_of

from branchdrive.collector.recording import Record
from branchdrive.contract.columns import TABLES, TICK_TABLES
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive_reference.simulation.record import ACTOR_RANGE_M, record
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.town import town
from branchdrive_reference.town.track import route_tracks
from branchdrive_reference.world.body import EGO


@cache
def records() -> list[tuple[Run, Record]]:
    """A run of every scenario type and three interventions, with what is recorded of them."""
    runs = [nominal_of(name) for name in SCENARIO_NAMES] + [
        intervention_of("HardBrakeRoute", "accelerate_0.80"),
        intervention_of("PedestrianCrossing", "steer_right_0.15"),
        intervention_of("ParkedObstacle", "steer_left_0.05"),
    ]
    return [(run, record(run)) for run in runs]


each_record = each(("run", "recorded"), records)
FILLED_BY_COLLECTOR = {
    "rollout_id", "group_id", "role", "attempt", "protocol_variant", "action_key", "nominal_rollout_id", "repetition",
    "branch_tick", "branch_frame", "num_ticks", "num_observations", "simulator_version", "collector_version",
    "provenance",
}  # fmt: skip


@each_record
def test_tables_have_the_declared_columns(run: Run, recorded: Record) -> None:
    for name in TICK_TABLES:
        columns = getattr(recorded, name)
        declared = {column.name for column in TABLES[name].columns} - {"rollout_id"}
        assert set(columns) == declared
        assert len({len(values) for values in columns.values()}) == 1
    declared = {column.name for column in TABLES["rollouts"].columns}
    trigger = {name for name in declared if name.startswith("trigger_")}
    assert set(recorded.fields) == declared - FILLED_BY_COLLECTOR - trigger


@each_record
def test_values_lie_in_the_declared_ranges(run: Run, recorded: Record) -> None:
    for name in TICK_TABLES:
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


@pytest.mark.parametrize("scenario", ["EnterActorFlow", "MergerIntoSlowTraffic"])
def test_merges_are_commanded_as_a_lane_change(scenario: str) -> None:
    """From some way before the entry moves over until it has joined."""
    run = nominal_of(scenario)
    route = route_tracks(run.spec.town, run.spec.route_id).route
    recorded = record(run).observations
    changes = recorded["command"] == "change_left"
    progress_m = recorded["route_progress_m"]
    assert set(recorded["command"]) == {"follow", "change_left"}
    assert changes[(progress_m > route.junction_m[0]) & (progress_m < route.junction_m[1])].all()
    assert progress_m[changes].max() < route.junction_m[1]
    assert progress_m[changes].min() > route.junction_m[0] - 50.0


@each_record
def test_turns_are_commanded_at_their_junction(run: Run, recorded: Record) -> None:
    route = route_tracks(run.spec.town, run.spec.route_id).route
    command, progress_m = recorded.observations["command"], recorded.observations["route_progress_m"]
    inside = (progress_m > route.junction_m[0]) & (progress_m < route.junction_m[1])
    assert (command[inside] == route.turn.value).all()
    assert (command[progress_m > route.junction_m[1]] == "follow").all()
    assert set(command) <= {"follow", route.turn.value}


@each_record
def test_route_columns_recompute_by_shapely(run: Run, recorded: Record) -> None:
    columns = recorded.observations
    line = shapely.LineString(np.transpose([recorded.fields["route_x_m"], recorded.fields["route_y_m"]]))
    points = shapely.points(columns["x_m"], columns["y_m"])
    assert np.abs(columns["route_offset_m"]) == pytest.approx(shapely.distance(line, points), abs=1e-4)
    feet = shapely.line_interpolate_point(line, columns["route_progress_m"].astype(float))
    assert shapely.distance(feet, points) == pytest.approx(shapely.distance(line, points), abs=1e-3)


@each_record
def test_speed_limits_are_those_of_the_lane(run: Run, recorded: Record) -> None:
    """Away from the ends of the route's lanes, and from junctions."""
    chain = {lane.lane_id: lane for lane in route_tracks(run.spec.town, run.spec.route_id).route.chain}
    columns, checked = recorded.observations, 0
    for frame, lane_id in enumerate(recorded.evidence["lane_id"]):
        if lane_id in chain and chain[lane_id].turn is Turn.FOLLOW:
            lane = chain[lane_id]
            foot = lane.centre.position(columns["x_m"][[frame]], columns["y_m"][[frame]])
            if 2.0 < foot.progress_m[0] < lane.centre.length_m - 2.0 and abs(columns["route_offset_m"][frame]) < 1.0:
                assert columns["speed_limit_mps"][frame] == np.float32(lane.speed_limit_mps)
                checked += 1
    assert checked


@each_record
def test_the_recorded_lane_is_under_the_ego(run: Run, recorded: Record) -> None:
    lanes = town(run.spec.town).lanes
    for lane_id, x, y in zip(
        recorded.evidence["lane_id"], recorded.observations["x_m"], recorded.observations["y_m"], strict=True
    ):
        if lane_id is not None:
            away_m = np.abs(lanes[lane_id].centre.position(np.array([x]), np.array([y])).offset_m[0])
            assert away_m <= 0.5 * lanes[lane_id].width_m + 1e-6


@each_record
def test_hazards_are_braked_for_and_have_one_cause(run: Run, recorded: Record) -> None:
    flags = [recorded.observations[f"{name}_hazard"] for name in ("vehicle", "pedestrian", "traffic_light")]
    assert np.sum(flags, axis=0).max() <= 1
    braking = recorded.controls["expert_brake"][::OBSERVATION_STRIDE_TICKS] > 0
    assert not (np.any(flags, axis=0) & ~braking).any()


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
    """Wherever a steer to the right leaves it; not every road is narrow enough."""
    left = 0
    for scenario in SCENARIO_NAMES:
        recorded = record(intervention_of(scenario, "steer_right_0.15"))
        on_road = recorded.evidence["on_road"]
        exits = int((on_road[:-1] & ~on_road[1:]).sum())
        assert recorded.fields["result_num_off_road_infractions"] == exits
        assert all(lane is None for lane in recorded.evidence["lane_id"][~on_road])
        left += exits
    assert left
