"""Recorded columns of a rollout that was driven in a world.

Yaw rate and accelerations are those of the tick before, 0 at tick 0.

Source: spec/05-raw-streams.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.drive import Drive
from branchdrive.collector.recording import Columns, Record, Recording, column, pose_columns
from branchdrive.collector.town import Element, under
from branchdrive.collector.world import Actor, Observation
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.angle import wrap_rad
from branchdrive.errors import UsageError

__all__ = ["record"]

_RATES = ("yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2")
_OF_EGO = ("speed_mps", "speed_limit_mps", "command")
_OF_EXPERT = ("target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")


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
    scene, saved, (classes, touching) = run.scene, _saved(run), _contacts(run)
    if has_evidence and any(ego.on_road is None for ego in saved):
        raise UsageError("`observe` does not say whether the ego is `on_road`, which evidence needs")
    expert, applied = (np.array(commands, np.float32).reshape(-1, 3) for commands in (run.expert, run.applied))
    return Recording(
        policy=run.policy,
        active=run.active,
        nominal=run.nominal,
        expert=expert,
        applied=applied,
        scene={field.name: getattr(scene, field.name) for field in fields(scene)}
        | {name: [float(value) for value in getattr(scene, name)] for name in ("route_x_m", "route_y_m")},
        observations=_observations(run),
        actors=_actors(run.actors) if has_evidence else None,
        lane_id=[ego.lane_id for ego in saved],
        on_road=[ego.on_road for ego in saved],
        traffic_light=[ego.traffic_light for ego in saved],
        classes=classes,
        touching=touching,
        completion=run.completion,
        termination=run.termination,
        partial_because=run.partial_because,
        goal_m=float(np.hypot(np.diff(scene.route_x_m), np.diff(scene.route_y_m)).sum()),
    ).record()


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


def _observations(run: Drive) -> Columns:
    saved, decisions = _saved(run), run.decisions[::OBSERVATION_STRIDE_TICKS]
    x_m, y_m, yaw_rad = ([getattr(ego, name) for ego in saved] for name in ("x_m", "y_m", "yaw_rad"))
    return {
        **pose_columns(x_m, y_m, yaw_rad, run.scene.route_x_m, run.scene.route_y_m),
        **{name: [getattr(ego, name) for ego in saved] for name in _OF_EGO},
        **_rates(run),
        **{name: [getattr(decision, name) for decision in decisions] for name in _OF_EXPERT},
    }


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


def _actors(present: Sequence[Iterable[Actor]]) -> Columns:
    rows = [(index * OBSERVATION_STRIDE_TICKS, actor) for index, actors in enumerate(present) for actor in actors]
    columns: Columns = {"tick": np.array([tick for tick, _ in rows], np.int32)}
    for name in (field.name for field in fields(Actor)):
        values = [getattr(actor, name) for _, actor in rows]
        columns[name] = column("actors", name, wrap_rad(values).tolist() if name == "yaw_rad" else values)
    return columns


def _contacts(run: Drive) -> tuple[list[str], NDArray[np.bool_]]:
    """Classes of the touched actors, and when each was, as `Recording` has it ``[observations, actors]``."""
    classes: dict[int, str] = {}
    touched: list[dict[int, str]] = []
    for index, present in enumerate(run.actors):
        classes |= {actor.actor_id: actor.actor_class for actor in present}
        last = index * OBSERVATION_STRIDE_TICKS
        since = run.observations[max(0, last - OBSERVATION_STRIDE_TICKS + 1) : last + 1]
        ids = {actor_id for ego in since for actor_id in ego.contacts}
        if unknown := sorted(ids - classes.keys()):
            raise UsageError(f"`observe` reports contact with {unknown} at tick {last}, and `actors` never listed them")
        touched.append({actor_id: classes[actor_id] for actor_id in ids})
    met = {actor_id: kind for seen in touched for actor_id, kind in seen.items()}
    touching = np.array([[actor_id in seen for actor_id in met] for seen in touched], np.bool_)
    return list(met.values()), touching.reshape(len(touched), len(met))
