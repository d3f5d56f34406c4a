"""A collector for highway-env: three of its scenes, an expert that brakes late, its roads as maps.

``python -m examples.highway_env.collector build/highway --groups 20 --jobs 2``, with ``pip install highway-env``.

Its frame has y to the right and angles clockwise, and its positions are box centres. A command becomes its two
controls: ``steering = MAX_STEER_RAD * steer``, and ``acceleration = MAX_ACCEL * throttle - MAX_DECEL * brake``. It has
no heights and no pedestrians, lights or navigation. A wreck does not heed commands.
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
from branchdrive.contract.descriptor import Driver
from branchdrive.contract.descriptor import Vehicle as Actuation

TICK_S, LENGTH_M, WIDTH_M = 0.05, Vehicle.LENGTH, Vehicle.WIDTH
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
SETTINGS = {
    "HighwayLeader": Setting("highway-v0", (("0", "1"),), 30.0, 420.0, config=HIGHWAY),
    "HighwayMerge": Setting("merge-v1", (("a", "b"), ("b", "c"), ("c", "d")), 30.0, 430.0),
    "IntersectionCrossing": Setting(
        "intersection-v2", (("o0", "ir0"), ("ir0", "il2"), ("il2", "o2")), 8.0, 110.0, 5.0, {"initial_vehicle_count": 6}
    ),
}


def centre_line(lane: Any, begin_m: float = 0.0, end_m: float = np.inf) -> tuple[Any, Any]:
    """Vertices of a lane, 2 m apart, in the recorded frame."""
    end_m = min(end_m, lane.length)
    along = np.linspace(begin_m, end_m, max(2, round((end_m - begin_m) / 2)))
    return FRAME.vector(*np.array([lane.position(s, 0) for s in along]).T)


class HighwayWorld:
    """One scene, with an ego that is driven by throttle, brake and steering."""

    def __init__(self, name: str) -> None:
        self.name, self.setting = name, SETTINGS[name]
        self.env: Any = gymnasium.make(self.setting.env, config=dict(self.setting.config)).unwrapped

    def reset(self, seed: int) -> bd.Scene:
        """Make the scene of a seed, and the route along the lanes that the ego begins in."""
        for name, value in DEFAULTS.items():
            setattr(IDMVehicle, name, value)
        self.env.reset(seed=seed)
        self.road, planned = self.env.road, self.env.vehicle
        self.ego = Vehicle.create_from(planned)  # without the environment's own control
        self.ego.speed = self.setting.start_mps or self.ego.speed
        self.road.vehicles[self.road.vehicles.index(planned)] = self.ego
        lane_id = self.ego.lane_index[2]
        begin_m, left_m, parts = self.ego.lane.local_coordinates(self.ego.position)[0], self.setting.route_m, []
        for road in self.setting.roads:
            lanes = self.road.network.graph[road[0]][road[1]]
            lane = lanes[min(lane_id, len(lanes) - 1)]
            parts.append(np.array(centre_line(lane, begin_m, begin_m + left_m))[:, len(parts) > 0 :])
            left_m, begin_m = left_m - (lane.length - begin_m), 0.0
            if left_m <= 0:
                break
        self.x, self.y = np.concatenate(parts, axis=1)
        return bd.Scene(
            town=self.setting.env, route_id=f"{self.setting.env}-lane-{lane_id}", route_x_m=self.x, route_y_m=self.y,
            environment="none", ego_length_m=LENGTH_M, ego_width_m=WIDTH_M,
        )  # fmt: skip

    def others(self) -> list[tuple[int, Any]]:
        """Everybody and everything but the ego, with ids."""
        return [(i, o) for i, o in enumerate([*self.road.objects, *self.road.vehicles]) if o is not self.ego]

    def observe(self) -> bd.Observation:
        """The ego; lane and limit follow from the map, rates from the poses."""
        (x, y), yaw = FRAME.vector(*self.ego.position), FRAME.yaw_rad(self.ego.heading)
        rest = np.zeros(2)
        hit = [
            i for i, other in (self.others() if self.ego.crashed else ())
            if are_polygons_intersecting(self.ego.polygon(), other.polygon(), rest, rest)[0]
        ]  # fmt: skip
        return bd.Observation(x_m=x, y_m=y, yaw_rad=yaw, speed_mps=self.ego.speed, contacts=hit)

    def actors(self) -> list[bd.Actor]:
        """Vehicles and obstacles."""
        found = []
        for i, other in self.others():
            (x, y), (vx, vy) = FRAME.vector(*other.position), FRAME.vector(*other.velocity)
            kind = "vehicle" if isinstance(other, Vehicle) else "static"
            found.append(bd.Actor(
                actor_id=i, actor_class=kind, x_m=x, y_m=y, yaw_rad=FRAME.yaw_rad(other.heading),
                length_m=other.LENGTH, width_m=other.WIDTH, vel_x_mps=vx, vel_y_mps=vy,
            ))  # fmt: skip
        return found

    def expert(self) -> bd.Decision:
        """Pure pursuit of the route; cruises until its way ahead is in conflict, then brakes firmly."""
        (x, y), yaw, speed = FRAME.vector(*self.ego.position), FRAME.yaw_rad(self.ego.heading), self.ego.speed
        nearest = int(np.argmin(np.hypot(self.x - x, self.y - y)))
        aim = min(nearest + max(3, round(0.4 * speed)), len(self.x) - 1)
        ahead, left = bd.to_ego_frame(self.x[aim] - x, self.y[aim] - y, yaw)
        slip = np.arcsin(np.clip(LENGTH_M * left / max(ahead**2 + left**2, 1.0), -0.9, 0.9))
        steer = -np.arctan(2 * np.tan(slip)) / MAX_STEER_RAD
        is_hazard = self.is_in_conflict(nearest, speed)
        accel = -5.0 if is_hazard else self.setting.target_mps - speed
        return bd.Decision(
            steer=float(np.clip(steer, -1, 1)), throttle=float(np.clip(accel / MAX_ACCEL, 0, 1)),
            brake=float(np.clip(-accel / MAX_DECEL, 0, 1)) if speed > 0 else 0.0,
            target_speed_mps=0.0 if is_hazard else self.setting.target_mps,
            vehicle_hazard=is_hazard, pedestrian_hazard=False, traffic_light_hazard=False,
        )  # fmt: skip

    def is_in_conflict(self, nearest: int, speed_mps: float) -> bool:
        """Whether somebody at constant velocity comes within two metres of the ego's way in the next two seconds."""
        time_s = np.linspace(0.0, 2.0, 9)[:, None]
        index = np.minimum(nearest + np.maximum(speed_mps, 3.0) * time_s / 2, len(self.x) - 1).astype(int)
        ahead = [o for _, o in self.others() if np.dot(o.position - self.ego.position, self.ego.direction) > 0]
        if not ahead:
            return False
        (ox, oy), (vx, vy) = (
            FRAME.vector(*np.array([getattr(o, n) for o in ahead]).T) for n in ("position", "velocity")
        )
        dx, dy = ox + vx * time_s - self.x[index], oy + vy * time_s - self.y[index]
        heading = np.arctan2(*(np.gradient(line)[index] for line in (self.y, self.x)))
        along, across = bd.to_ego_frame(dx, dy, heading)
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
    world.reset(0)
    lanes = world.road.network.lanes_dict().items()
    return [
        bd.lane_element("-".join(map(str, i)), *centre_line(lane), lane.width, lane.speed_limit) for i, lane in lanes
    ]


def describe(seed: int) -> bd.Descriptor:
    """What the dataset is, and what highway-env does not offer."""
    return bd.describe(
        "highway-env", seed=seed, simulator=("highway-env", version("highway-env")), collector=("highway-example", "1.0"),
        streams=("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result"),
        unrecorded=("rollouts.ego_height_m", "actors.height_m", "observations.command"), driver=Driver(kind="expert"),
        vehicle=Actuation(
            wheelbase_m=LENGTH_M, max_steer_rad=MAX_STEER_RAD, max_accel_mps2=MAX_ACCEL, max_decel_mps2=MAX_DECEL,
            actuation="single_axis",
        ),
    )  # fmt: skip


if __name__ == "__main__":
    maps = {setting.env: town_map(name) for name, setting in SETTINGS.items()}
    sys.exit(bd.collector_main(describe, WORLDS, maps=maps, max_ticks=600))
