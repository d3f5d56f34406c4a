"""A collector for highway-env: three of its scenes, an expert that brakes late, its roads as maps.

``python -m examples.highway_env.collector build/highway --groups 20 --jobs 2``, with ``pip install highway-env``.

Its frame has y to the right and angles clockwise, and its positions are box centres. A command becomes its two
controls: ``steering = MAX_STEER_RAD * steer``, and ``acceleration = MAX_ACCEL * throttle - MAX_DECEL * brake``. It has
no heights, no navigation, no pedestrians and no lights. A wreck does not heed commands.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from typing import Any

import gymnasium
import highway_env  # noqa: F401  registers the environments
import numpy as np
from highway_env.utils import are_polygons_intersecting
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

import branchdrive as bd

TICK_S, VERTEX_M, LENGTH_M, WIDTH_M = 0.05, 2.0, Vehicle.LENGTH, Vehicle.WIDTH
MAX_STEER_RAD, MAX_ACCEL, MAX_DECEL = 0.15, 5.0, 8.0
FRAME = bd.Frame(is_left_handed=True)
ADJUSTED = ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN")
DEFAULTS = {name: getattr(IDMVehicle, name) for name in ADJUSTED}  # the intersection changes them for everybody


@dataclass(frozen=True)
class Setting:
    """A scene of highway-env: its environment, the roads of the ego's route, and how the ego drives."""

    env: str
    roads: tuple[tuple[str, str], ...]
    target_mps: float
    route_m: float
    start_mps: float | None = None
    config: Mapping[str, Any] = field(default_factory=dict)


HIGHWAY = {"lanes_count": 3, "vehicles_count": 12, "ego_spacing": 3}
CROSSING = (("o0", "ir0"), ("ir0", "il2"), ("il2", "o2"))
SETTINGS = {
    "HighwayLeader": Setting("highway-v0", (("0", "1"),), 30.0, 420.0, config=HIGHWAY),
    "HighwayMerge": Setting("merge-v1", (("a", "b"), ("b", "c"), ("c", "d")), 30.0, 430.0),
    "IntersectionCrossing": Setting("intersection-v2", CROSSING, 8.0, 110.0, 5.0, {"initial_vehicle_count": 6}),
}


def centre_line(lane: Any) -> Any:
    """Vertices of a lane in the recorded frame ``[2, vertices]``."""
    along_m = np.linspace(0.0, lane.length, max(2, round(lane.length / VERTEX_M)))
    return np.array(FRAME.vector(*np.array([lane.position(s, 0) for s in along_m]).T))


def grown(thing: Any) -> Any:
    """Its outline with 5 cm more at the ends: at a contact, bodies are moved apart until rounding decides."""
    return thing.position + 1.02 * (thing.polygon() - thing.position)


class HighwayWorld:
    """One scene, with an ego that is driven by steering, throttle and brake."""

    def __init__(self, name: str) -> None:
        self.setting = SETTINGS[name]
        self.env: Any = gymnasium.make(self.setting.env, config=dict(self.setting.config)).unwrapped

    def reset(self, seed: int) -> bd.Scene:
        """Make the scene of a seed, and the route ahead along the lanes that the ego begins in."""
        for name, value in DEFAULTS.items():
            setattr(IDMVehicle, name, value)
        self.env.reset(seed=seed)
        self.road, planned = self.env.road, self.env.vehicle
        self.ego = Vehicle.create_from(planned)  # without the environment's own control
        self.ego.speed = self.setting.start_mps or self.ego.speed
        self.road.vehicles[self.road.vehicles.index(planned)] = self.ego
        roads = [self.road.network.graph[begin][end] for begin, end in self.setting.roads]
        lane_id = self.ego.lane_index[2]
        x, y = np.concatenate([centre_line(lanes[lane_id])[:, 1:] for lanes in roads], axis=1)
        here = self.pose(self.ego)
        begin = int(np.argmin(np.hypot(x - here["x_m"], y - here["y_m"])))
        ahead = slice(begin, begin + round(self.setting.route_m / VERTEX_M))
        self.x, self.y = x[ahead], y[ahead]
        return bd.Scene(
            town=self.setting.env, route_id=f"lane-{lane_id}", route_x_m=self.x, route_y_m=self.y,
            environment="none", ego_length_m=LENGTH_M, ego_width_m=WIDTH_M,
        )  # fmt: skip

    def others(self) -> list[tuple[int, Any]]:
        """Everybody and everything but the ego, with ids."""
        return [(i, o) for i, o in enumerate([*self.road.objects, *self.road.vehicles]) if o is not self.ego]

    def pose(self, thing: Any) -> dict[str, float]:
        """Box centre and heading in the recorded frame."""
        x, y = FRAME.vector(*thing.position)
        return {"x_m": x, "y_m": y, "yaw_rad": FRAME.yaw_rad(thing.heading)}

    def observe(self) -> bd.Observation:
        """The ego; lane and limit follow from the map, rates from the poses."""
        near = [(i, grown(other)) for i, other in self.others()] if self.ego.crashed else []
        hit = [i for i, box in near if are_polygons_intersecting(grown(self.ego), box, np.zeros(2), np.zeros(2))[0]]
        return bd.Observation(**self.pose(self.ego), speed_mps=self.ego.speed, contacts=hit)

    def actors(self) -> list[bd.Actor]:
        """Vehicles and obstacles."""
        found = []
        for i, other in self.others():
            kind, (vx, vy) = "vehicle" if isinstance(other, Vehicle) else "static", FRAME.vector(*other.velocity)
            box = {"length_m": other.LENGTH, "width_m": other.WIDTH, "vel_x_mps": vx, "vel_y_mps": vy}
            found.append(bd.Actor(actor_id=i, actor_class=kind, **self.pose(other), **box))
        return found

    def expert(self) -> bd.Decision:
        """Pure pursuit of the route at the target speed; brakes firmly while its way ahead is in conflict."""
        speed, (x, y) = self.ego.speed, FRAME.vector(*self.ego.position)
        nearest = int(np.argmin(np.hypot(self.x - x, self.y - y)))
        aim = min(nearest + max(3, round(0.4 * speed)), len(self.x) - 1)
        ahead, left = bd.to_ego_frame(self.x[aim] - x, self.y[aim] - y, FRAME.yaw_rad(self.ego.heading))
        slip_rad = np.arcsin(np.clip(LENGTH_M * left / max(ahead**2 + left**2, 1.0), -0.9, 0.9))
        is_hazard = self.is_in_conflict(nearest, speed)
        target_mps = 0.0 if is_hazard else self.setting.target_mps
        accel = -5.0 * (speed > 0) if is_hazard else target_mps - speed
        return bd.Decision(
            steer=float(np.clip(-np.arctan(2 * np.tan(slip_rad)) / MAX_STEER_RAD, -1, 1)),
            throttle=float(np.clip(accel / MAX_ACCEL, 0, 1)), brake=float(np.clip(-accel / MAX_DECEL, 0, 1)),
            target_speed_mps=target_mps, vehicle_hazard=is_hazard, pedestrian_hazard=False, traffic_light_hazard=False,
        )  # fmt: skip

    def is_in_conflict(self, nearest: int, speed_mps: float) -> bool:
        """Whether somebody at constant velocity gets into the ego's way within the next two seconds."""
        time_s = np.linspace(0.0, 2.0, 9)[:, None]
        index = np.minimum(nearest + max(speed_mps, 3.0) * time_s / VERTEX_M, len(self.x) - 1).astype(int)
        ahead = [o for _, o in self.others() if np.dot(o.position - self.ego.position, self.ego.direction) > 0]
        position, velocity = (np.array([getattr(o, name) for o in ahead]) for name in ("position", "velocity"))
        (ox, oy), (vx, vy) = (FRAME.vector(*values.reshape(-1, 2).T) for values in (position, velocity))
        heading = np.arctan2(np.gradient(self.y)[index], np.gradient(self.x)[index])
        along, across = bd.to_ego_frame(ox + vx * time_s - self.x[index], oy + vy * time_s - self.y[index], heading)
        return bool(np.any((np.abs(along) < LENGTH_M + 2.0) & (np.abs(across) < WIDTH_M + 0.5)))

    def step(self, command: bd.Command) -> None:
        """One tick; the environment's own step would observe and reward, and let vehicles appear."""
        steer, throttle, brake = map(float, command)
        accel = max(MAX_ACCEL * throttle - MAX_DECEL * brake, -self.ego.speed / TICK_S)  # no reverse gear
        self.ego.act({"steering": MAX_STEER_RAD * steer, "acceleration": accel})
        self.road.act()
        self.road.step(TICK_S)


WORLDS = {name: partial(HighwayWorld, name) for name in SETTINGS}


def town_map(name: str) -> list[dict[str, Any]]:
    """The lanes of a scene."""
    world = HighwayWorld(name)
    lanes = world.env.road.network.lanes_dict().items()
    return [bd.lane_element("-".join(map(str, i)), *centre_line(o), o.width, o.speed_limit) for i, o in lanes]


def describe(seed: int) -> bd.Descriptor:
    """What the dataset is, and what highway-env does not offer."""
    limits = {"max_steer_rad": MAX_STEER_RAD, "max_accel_mps2": MAX_ACCEL, "max_decel_mps2": MAX_DECEL}
    return bd.describe(
        "highway-env", seed=seed,
        simulator=("highway-env", version("highway-env")), collector=("highway-env-example", "1.0"),
        streams=("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result"),
        unrecorded=("rollouts.ego_height_m", "actors.height_m", "observations.command"),
        driver=bd.Driver(kind="expert"), vehicle=bd.Vehicle(wheelbase_m=LENGTH_M, actuation="single_axis", **limits),
    )  # fmt: skip


def options() -> dict[str, Any]:
    """Further arguments of the collection."""
    return {"maps": {setting.env: town_map(name) for name, setting in SETTINGS.items()}, "max_ticks": 600}


if __name__ == "__main__":
    sys.exit(bd.collector_main(describe, WORLDS, **options()))
