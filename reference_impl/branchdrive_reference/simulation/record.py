"""Recorded columns of a rollout, by table, exactly as columns.json declares them.

Order matters: poses are rounded to their recorded width first, and what derives from them (route
state, risk evidence) is computed from the rounded values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.contact import num_contacts
from branchdrive.collector.route import route_columns
from branchdrive.contract.policy import ACTUATORS, Command
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.risk import risk_evidence
from branchdrive_reference.expert.control import Cause
from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.simulation.ending import NO_LIGHT
from branchdrive_reference.simulation.rollout import Run
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.route import Route
from branchdrive_reference.town.signal import Light
from branchdrive_reference.town.surface import town_surface
from branchdrive_reference.town.town import town
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks, route_tracks
from branchdrive_reference.world.body import EGO, Kind
from branchdrive_reference.world.vehicle import EGO_SIZE

__all__ = ["ACTOR_RANGE_M", "Columns", "Record", "record"]

ACTOR_RANGE_M = 100.0
"""Actors whose centre is this close to the ego's are recorded."""

Columns = dict[str, NDArray[Any]]
"""Columns of one table by name, without ``rollout_id``; masked where null."""

_CLASSES = np.array([kind.name.lower() for kind in Kind])
_LIGHTS = np.array([*(light.name.lower() for light in Light), None], object)
"""Recorded values by `Light`; `NO_LIGHT` is the last."""


@dataclass(frozen=True, eq=False)
class Record:
    """A recorded rollout.

    Attributes:
        controls: Control audit, one row per tick.
        observations: Ego and route state, one row per observation.
        actors: Oriented boxes, one row per actor in range and observation.
        evidence: Risk evidence, one row per observation.
        fields: Columns of the rollouts table that the world knows.
    """

    controls: Columns
    observations: Columns
    actors: Columns
    evidence: Columns
    fields: Mapping[str, Any]


def record(run: Run) -> Record:
    """The recorded columns of a rollout."""
    tables = route_tracks(run.spec.town, run.spec.route_id)
    ego = run.log.bodies[:, EGO]
    lanes, on_road = town_surface(town(run.spec.town)).under(ego["x_m"], ego["y_m"])
    observations = _observations(run, tables, lanes)
    actors = _actors(run)
    evidence = _evidence(run, tables, observations, actors) | {"lane_id": np.array(lanes, object), "on_road": on_road}
    return Record(_controls(run), observations, actors, evidence, _fields(run, tables, observations, evidence))


def _float32(values: NDArray[Any]) -> NDArray[np.float32]:
    return values.astype(np.float32)


def _yaw(bodies: NDArray[np.void]) -> NDArray[np.float32]:
    return _float32(wrap_rad(bodies["yaw_rad"]))


def _controls(run: Run) -> Columns:
    log, active = run.log, run.active
    columns: Columns = {
        "tick": np.arange(log.num_ticks, dtype=np.int32),
        "active": active,
        "source": np.where(active, "intervention", "online_expert"),
    }
    nominal, intended = np.zeros_like(log.applied), np.zeros_like(log.applied)
    if run.nominal is not None:
        nominal[active] = run.nominal[np.flatnonzero(active)]
        demanded = run.policy.command(Command(*log.expert[active].T), Command(*nominal[active].T))
        intended[active] = np.stack(demanded, axis=1)
    for index, actuator in enumerate(ACTUATORS):
        columns[f"expert_{actuator}"] = log.expert[:, index]
        columns[f"nominal_{actuator}"] = np.ma.masked_array(nominal[:, index], ~active)
        columns[f"intended_{actuator}"] = np.ma.masked_array(intended[:, index], ~active)
        columns[f"applied_{actuator}"] = log.applied[:, index]
    return columns


def _observations(run: Run, tables: RouteTracks, lanes: list[str | None]) -> Columns:
    log = run.log
    ego, vehicle, plan = log.bodies[:, EGO], log.vehicle, log.plan
    x, y, yaw = ego["x_m"].copy(), ego["y_m"].copy(), _yaw(ego)
    braking = plan["brake"] > 0
    place = route_columns(x, y, yaw, tables.route.polyline.x_m, tables.route.polyline.y_m)
    columns: Columns = {
        "tick": np.arange(len(ego), dtype=np.int32) * np.int32(OBSERVATION_STRIDE_TICKS),
        "x_m": x,
        "y_m": y,
        "yaw_rad": yaw,
        "speed_mps": vehicle["forward_mps"],
        "accel_longitudinal_mps2": vehicle["accel_longitudinal_mps2"],
        "accel_lateral_mps2": vehicle["accel_lateral_mps2"],
        "yaw_rate_radps": vehicle["yaw_rate_radps"],
        **place,
        "command": _commands(tables.route, place["route_progress_m"]),
        "speed_limit_mps": _limits(run, tables, lanes, x, y),
        "target_speed_mps": plan["target_speed_mps"],
        "vehicle_hazard": braking & np.isin(plan["cause"], (Cause.LEADER, Cause.CONFLICT, Cause.PRIORITY)),
        "pedestrian_hazard": braking & (plan["cause"] == Cause.PEDESTRIAN),
        "traffic_light_hazard": braking & (plan["cause"] == Cause.SIGNAL),
    }
    doubles = ("x_m", "y_m")
    return {
        name: _float32(values) if values.dtype == np.float64 and name not in doubles else values
        for name, values in columns.items()
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
        "yaw_rad": _yaw(near),
        **{name: _float32(near[name]) for name in ("length_m", "width_m", "height_m", "vel_x_mps", "vel_y_mps")},
    }


def _evidence(run: Run, tables: RouteTracks, observations: Columns, actors: Columns) -> Columns:
    line = tables.route.polyline
    governed = run.log.light != NO_LIGHT
    return {
        "tick": observations["tick"],
        **risk_evidence(
            observations,
            actors,
            ego_length_m=float(np.float32(EGO_SIZE.length_m)),
            ego_width_m=float(np.float32(EGO_SIZE.width_m)),
            route_x_m=line.x_m,
            route_y_m=line.y_m,
        ),
        "traffic_light_available": governed,
        "traffic_light": _LIGHTS[run.log.light],
        "collision": run.log.touched,
    }


def _fields(run: Run, tables: RouteTracks, observations: Columns, evidence: Columns) -> dict[str, Any]:
    """Identity of the context, the ego, and the route result."""
    spec, line = run.spec, tables.route.polyline
    kinds = np.repeat(run.log.bodies["kind"][0], num_contacts(run.log.touching))
    driven = float(observations["route_progress_m"].max()) / tables.route.goal_m
    on_road = evidence["on_road"]
    return {
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
        **run.policy.effective_action(),
        "status": "complete" if run.ending.partial_reason is None else "partial",
        "status_reason": run.ending.partial_reason,
        "result_completion": run.ending.completion,
        "result_termination": run.ending.termination,
        "result_route_fraction": 1.0 if run.ending.completion == "completed" else min(driven, 1.0),
        "result_num_vehicle_collisions": int(np.isin(kinds, (Kind.VEHICLE, Kind.CYCLE)).sum()),
        "result_num_pedestrian_collisions": int((kinds == Kind.PEDESTRIAN).sum()),
        "result_num_static_collisions": int((kinds == Kind.STATIC).sum()),
        "result_num_red_light_infractions": run.log.num_red_lights_run,
        "result_num_stop_sign_infractions": run.log.num_stop_signs_run,
        "result_num_off_road_infractions": int((~on_road & np.concatenate([[True], on_road[:-1]])).sum()),
    }


_COMMAND_AHEAD_M = 30.0
"""The command of a junction is given from this far before it."""


def _commands(route: Route, progress_m: Array) -> NDArray[np.str_]:
    begin_m, end_m = route.junction_m
    at_junction = (progress_m >= begin_m - _COMMAND_AHEAD_M) & (progress_m < end_m)
    return np.where(at_junction, route.turn.value, Turn.FOLLOW.value)
