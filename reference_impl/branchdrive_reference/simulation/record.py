"""What a rollout of the reference world records: its log as the columns that columns.json declares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.recording import Columns, Record, Recording, pose_columns
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.driving.angle import wrap_rad
from branchdrive_reference.expert.control import Cause
from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.route import Route
from branchdrive_reference.town.signal import Light
from branchdrive_reference.town.surface import town_surface
from branchdrive_reference.town.town import town
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks, route_tracks
from branchdrive_reference.world.body import EGO, Kind
from branchdrive_reference.world.vehicle import EGO_SIZE

__all__ = ["ACTOR_RANGE_M", "record"]

ACTOR_RANGE_M = 100.0
"""Actors whose centre is this close to the ego's are recorded."""

_BOX = ("length_m", "width_m", "height_m", "vel_x_mps", "vel_y_mps")
_CLASSES = np.array([kind.name.lower() for kind in Kind])
_LIGHTS = np.array([*(light.name.lower() for light in Light), None], object)
"""Recorded values by `Light`; that of no light is the last."""


def record(run: Run) -> Record:
    """The recorded columns of a rollout."""
    spec, log, ending, tables = run.spec, run.log, run.ending, route_tracks(run.spec.town, run.spec.route_id)
    ego, line = log.bodies[:, EGO], tables.route.polyline
    lanes, on_road = town_surface(town(spec.town)).under(ego["x_m"], ego["y_m"])
    return Recording(
        policy=run.policy,
        active=run.active,
        nominal=run.nominal,
        expert=log.expert,
        applied=log.applied,
        scene={
            "scenario_type": spec.scenario_type,
            "town": spec.town,
            "route_id": spec.route_id,
            "route_x_m": line.x_m.tolist(),
            "route_y_m": line.y_m.tolist(),
            "environment": spec.environment,
            "seed": spec.seed,
            "ego_length_m": EGO_SIZE.length_m,
            "ego_width_m": EGO_SIZE.width_m,
            "ego_height_m": EGO_SIZE.height_m,
            "result_num_red_light_infractions": log.num_red_lights_run,
            "result_num_stop_sign_infractions": log.num_stop_signs_run,
        },
        observations=_observations(run, tables, lanes),
        actors=_actors(run),
        lane_id=np.array(lanes, object),
        on_road=on_road,
        traffic_light=_LIGHTS[log.light],
        classes=_CLASSES[log.bodies["kind"][0]],
        touching=log.touching,
        completion=ending.completion,
        termination=ending.termination,
        partial_because=ending.partial_reason or "",
        goal_m=tables.route.goal_m,
    ).record()


def _observations(run: Run, tables: RouteTracks, lanes: list[str | None]) -> Columns:
    ego, vehicle, plan, line = run.log.bodies[:, EGO], run.log.vehicle, run.log.plan, tables.route.polyline
    braking = plan["brake"] > 0
    pose = pose_columns(ego["x_m"], ego["y_m"], ego["yaw_rad"], line.x_m, line.y_m)
    return {
        **pose,
        "speed_mps": vehicle["forward_mps"],
        "accel_longitudinal_mps2": vehicle["accel_longitudinal_mps2"],
        "accel_lateral_mps2": vehicle["accel_lateral_mps2"],
        "yaw_rate_radps": vehicle["yaw_rate_radps"],
        "command": _commands(tables.route, pose["route_progress_m"]),
        "speed_limit_mps": _limits(run, tables, lanes, pose["x_m"], pose["y_m"]),
        "target_speed_mps": plan["target_speed_mps"],
        "vehicle_hazard": braking & np.isin(plan["cause"], (Cause.LEADER, Cause.CONFLICT, Cause.PRIORITY)),
        "pedestrian_hazard": braking & (plan["cause"] == Cause.PEDESTRIAN),
        "traffic_light_hazard": braking & (plan["cause"] == Cause.SIGNAL),
    }


def _limits(run: Run, tables: RouteTracks, lanes: list[str | None], x_m: Array, y_m: Array) -> Array:
    """Speed limit of the lane under the ego, or beside the lanes that of the route's lane."""
    of_lane = {lane_id: lane.speed_limit_mps for lane_id, lane in town(run.spec.town).lanes.items()}
    progress_m = tables.route.polyline.position(x_m, y_m).progress_m
    segment = np.searchsorted(tables.path(EGO_TRACK)["arc_m"], progress_m, side="right") - 1
    of_route = tables.limit_mps[segment].tolist()
    return np.array([of_lane.get(lane_id or "", limit) for lane_id, limit in zip(lanes, of_route, strict=True)])


def _actors(run: Run) -> Columns:
    bodies = run.log.bodies
    ego, others = bodies[:, EGO : EGO + 1], bodies[:, EGO + 1 :]
    dx, dy = others["x_m"] - ego["x_m"], others["y_m"] - ego["y_m"]
    frame, index = np.nonzero(dx * dx + dy * dy <= ACTOR_RANGE_M**2)
    near = others[frame, index]
    return {
        "tick": (frame * OBSERVATION_STRIDE_TICKS).astype(np.int32),
        "actor_id": (index + EGO + 1).astype(np.int32),
        "actor_class": _CLASSES[near["kind"]],
        "x_m": near["x_m"].copy(),
        "y_m": near["y_m"].copy(),
        "yaw_rad": wrap_rad(near["yaw_rad"]).astype(np.float32),
        **{name: near[name].astype(np.float32) for name in _BOX},
    }


_COMMAND_AHEAD_M = 30.0
"""The command of a junction is given from this far before it."""


def _commands(route: Route, progress_m: Array) -> NDArray[np.str_]:
    begin_m, end_m = route.junction_m
    at_junction = (progress_m >= begin_m - _COMMAND_AHEAD_M) & (progress_m < end_m)
    return np.where(at_junction, route.turn.value, Turn.FOLLOW.value)
