"""Recorded columns of a rollout, as columns.json declares them.

Order matters: poses are rounded to their recorded width first, and what derives from them (route state, risk evidence)
is computed from the rounded values. Yaw rate and accelerations are those of the tick before, 0 at tick 0.

Source: spec/05-raw-streams.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.contact import num_contacts
from branchdrive.collector.drive import Drive
from branchdrive.collector.route import route_columns
from branchdrive.collector.town import Element, under
from branchdrive.collector.world import Actor, Observation
from branchdrive.contract.columns import TABLES
from branchdrive.contract.policy import ACTUATORS
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.risk import risk_evidence
from branchdrive.errors import UsageError

__all__ = ["Columns", "Record", "record"]

Columns = dict[str, Any]
"""Columns of one table by name, without ``rollout_id``: arrays, or lists where values are missing."""

_DTYPES: Mapping[str, Any] = {
    "string": object, "bool": np.bool_, "int32": np.int32, "int64": np.int64, "float32": np.float32,
    "float64": np.float64,
}  # fmt: skip

_EGO = ("x_m", "y_m", "yaw_rad", "speed_mps")
_RATES = ("yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2")
_KNOWN = ("speed_limit_mps", "command")
_OF_EXPERT = ("target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")

_COUNTED = {"vehicle": "vehicle", "cycle": "vehicle", "pedestrian": "pedestrian", "static": "static"}
"""Kind of a collision by the class of the actor."""


@dataclass(frozen=True, eq=False)
class Record:
    """A recorded rollout.

    Attributes:
        controls: Control audit, one row per tick.
        observations: Ego and route state, one row per saved observation.
        actors: Oriented boxes; empty where the stream is not claimed.
        evidence: Risk evidence, one row per saved observation; empty where the stream is not claimed.
        fields: Columns of the rollouts table that the drive decides.
    """

    controls: Columns
    observations: Columns
    actors: Columns
    evidence: Columns
    fields: Columns


def record(run: Drive, *, has_evidence: bool = True, town: Sequence[Element] | None = None) -> Record:
    """The recorded columns of a rollout.

    Args:
        run: The rollout.
        has_evidence: Whether actors and evidence are claimed.
        town: Elements of the map, which say of the ego's lane, road and speed limit what the world leaves open.

    Raises:
        UsageError: The world has a contact with an actor that it does not list, or does not say whether the ego is on
            the road where evidence is claimed.
    """
    if town is not None:
        run = replace(run, observations=_placed(run, town))
    observations, contacts = _observations(run), _contacts(run)
    actors = _actors(run.actors, observations["tick"]) if has_evidence else {}
    evidence = _evidence(run, observations, actors, contacts) if has_evidence else {}
    return Record(_controls(run), observations, actors, evidence, _fields(run, observations, contacts))


def _column(table: str, name: str, values: Sequence[Any]) -> Any:
    """Values of a column in its declared type; a list where some are missing."""
    if any(value is None for value in values):
        return list(values)
    return np.array(values, _DTYPES[TABLES[table][name].type])


def _placed(run: Drive, town: Sequence[Element]) -> list[Observation]:
    """The observations, the saved ones with what the map says of their places."""
    saved, placed = _saved(run), list(run.observations)
    ground = under(town, *(np.array([getattr(ego, name) for ego in saved], np.float64) for name in ("x_m", "y_m")))
    for index, ego in enumerate(saved):
        lane_id, on_road, limit = ground.lane_id[index], bool(ground.on_road[index]), ground.speed_limit_mps[index]
        placed[index * OBSERVATION_STRIDE_TICKS] = replace(
            ego,
            lane_id=lane_id if ego.lane_id is None else ego.lane_id,
            on_road=on_road if ego.on_road is None else ego.on_road,
            speed_limit_mps=limit if ego.speed_limit_mps is None else ego.speed_limit_mps,
        )
    return placed


def _saved(run: Drive) -> list[Observation]:
    return run.observations[::OBSERVATION_STRIDE_TICKS]


def _controls(run: Drive) -> Columns:
    active = run.active
    columns: Columns = {
        "tick": np.arange(run.num_ticks, dtype=np.int32),
        "active": active,
        "source": np.where(active, "intervention", "online_expert"),
    }
    expert, applied = (np.array(commands, np.float32).reshape(-1, 3) for commands in (run.expert, run.applied))
    stored = np.zeros_like(applied)
    if run.nominal is not None:
        stored[active] = run.nominal[np.flatnonzero(active)]
    for index, actuator in enumerate(ACTUATORS):
        columns[f"expert_{actuator}"], columns[f"applied_{actuator}"] = expert[:, index], applied[:, index]
        columns[f"nominal_{actuator}"] = np.ma.masked_array(stored[:, index], ~active)
        columns[f"intended_{actuator}"] = np.ma.masked_array(applied[:, index], ~active)
    return columns


def _observations(run: Drive) -> Columns:
    saved, decisions = _saved(run), run.decisions[::OBSERVATION_STRIDE_TICKS]
    wrapped = {name: np.array([getattr(ego, name) for ego in saved], np.float64) for name in _EGO}
    wrapped["yaw_rad"] = wrap_rad(wrapped["yaw_rad"])
    columns: Columns = {"tick": np.arange(len(saved), dtype=np.int32) * np.int32(OBSERVATION_STRIDE_TICKS)}
    columns |= {name: _column("observations", name, values.tolist()) for name, values in wrapped.items()}
    route = (np.asarray(values, np.float64) for values in (run.scene.route_x_m, run.scene.route_y_m))
    derived = route_columns(columns["x_m"], columns["y_m"], columns["yaw_rad"], *route) | _rates(run)
    columns |= {name: values.astype(np.float32) for name, values in derived.items()}
    for name in _KNOWN:
        columns[name] = _column("observations", name, [getattr(ego, name) for ego in saved])
    for name in _OF_EXPERT:
        columns[name] = _column("observations", name, [getattr(decision, name) for decision in decisions])
    return columns


def _rates(run: Drive) -> Columns:
    """Yaw rate and accelerations over the last tick at saved observations, 0 at tick 0."""
    yaw, speed = (np.array([getattr(ego, name) for ego in run.observations]) for name in ("yaw_rad", "speed_mps"))
    yaw_rate = np.diff(yaw, prepend=yaw[:1])
    yaw_rate = wrap_rad(yaw_rate) / TICK_S
    longitudinal = np.diff(speed, prepend=speed[:1]) / TICK_S
    derived = dict(zip(_RATES, (yaw_rate, longitudinal, speed * yaw_rate), strict=True))
    columns = {}
    for name, values in derived.items():
        own = [getattr(ego, name) for ego in run.observations]
        chosen = np.array([value if given is None else given for given, value in zip(own, values, strict=True)])
        chosen[0] = 0.0
        columns[name] = chosen[::OBSERVATION_STRIDE_TICKS]
    return columns


def _actors(present: Sequence[Iterable[Actor]], ticks: NDArray[np.int32]) -> Columns:
    rows = [(tick, actor) for tick, actors in zip(ticks, present, strict=True) for actor in actors]
    columns: Columns = {"tick": np.array([tick for tick, _ in rows], np.int32)}
    for name in (field.name for field in fields(Actor)):
        values = [getattr(actor, name) for _, actor in rows]
        columns[name] = _column("actors", name, wrap_rad(values).tolist() if name == "yaw_rad" else values)
    return columns


def _contacts(run: Drive) -> list[dict[int, str]]:
    """Actors that were touched after the saved observation before, with their kinds, at every saved observation."""
    kinds: dict[int, str] = {}
    touched: list[dict[int, str]] = []
    for index, present in enumerate(run.actors):
        kinds |= {actor.actor_id: _COUNTED[actor.actor_class] for actor in present}
        last = index * OBSERVATION_STRIDE_TICKS
        since = run.observations[max(0, last - OBSERVATION_STRIDE_TICKS + 1) : last + 1]
        ids = {actor_id for ego in since for actor_id in ego.contacts}
        if unknown := sorted(ids - kinds.keys()):
            raise UsageError(f"`observe` reports contact with {unknown} at tick {last}, and `actors` never listed them")
        touched.append({actor_id: kinds[actor_id] for actor_id in sorted(ids)})
    return touched


def _evidence(run: Drive, observations: Columns, actors: Columns, contacts: list[dict[int, str]]) -> Columns:
    saved, scene = _saved(run), run.scene
    lights = [ego.traffic_light for ego in saved]
    if any(ego.on_road is None for ego in saved):
        raise UsageError("`observe` does not say whether the ego is `on_road`, which evidence needs")
    return {
        "tick": observations["tick"],
        **risk_evidence(
            observations,
            actors,
            ego_length_m=float(np.float32(scene.ego_length_m)),
            ego_width_m=float(np.float32(scene.ego_width_m)),
            route_x_m=np.asarray(scene.route_x_m, np.float64),
            route_y_m=np.asarray(scene.route_y_m, np.float64),
        ),
        "lane_id": [ego.lane_id for ego in saved],
        "on_road": np.array([ego.on_road for ego in saved], np.bool_),
        "collision": np.array([bool(touched) for touched in contacts], np.bool_),
        "traffic_light_available": np.array([light is not None for light in lights], np.bool_),
        "traffic_light": lights,
    }


def _fields(run: Drive, observations: Columns, contacts: list[dict[int, str]]) -> Columns:
    scene, off_road = run.scene, [ego.on_road is False for ego in _saved(run)]
    length_m = float(np.hypot(np.diff(scene.route_x_m), np.diff(scene.route_y_m)).sum())
    met = {actor_id: kind for touched in contacts for actor_id, kind in touched.items()}
    touching = np.array([[actor_id in touched for actor_id in met] for touched in contacts], bool)
    hit = dict(zip(met, num_contacts(touching.reshape(len(contacts), len(met))).tolist(), strict=True))
    driven = 1.0 if run.completion == "completed" else float(observations["route_progress_m"].max()) / length_m
    return {
        **{field.name: getattr(scene, field.name) for field in fields(scene)},
        "route_x_m": [float(x) for x in scene.route_x_m],
        "route_y_m": [float(y) for y in scene.route_y_m],
        **run.policy.effective_action(),
        "status": "partial" if run.partial_because else "complete",
        "status_reason": run.partial_because or None,
        "result_completion": run.completion,
        "result_termination": run.termination,
        "result_route_fraction": min(driven, 1.0),
        **{
            f"result_num_{kind}_collisions": sum(count for actor_id, count in hit.items() if met[actor_id] == kind)
            for kind in ("vehicle", "pedestrian", "static")
        },
        "result_num_off_road_infractions": sum(
            is_off and not was_off for was_off, is_off in pairwise([False, *off_road])
        ),
    }
