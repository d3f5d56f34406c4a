"""A collector for the vehicle models of CommonRoad: a bend with two lanes, and a car ahead that slows down or stops.

``pip install commonroad-vehicle-models`` and ``python -m examples.commonroad_models.collector build/bend --groups 4``.

The package has cars and no world: both cars are its kinematic single-track model with the parameters of a BMW 320i.
Its positions are those of the rear axle; the box is centred between the axles, for the model does not say where it is.
It has no heights, no navigation and no contacts: cars that touch go on with their mean speed, and brake.
"""

from __future__ import annotations

import sys
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks

import branchdrive as bd

CAR = parameters_vehicle2()
WHEELBASE_M, LENGTH_M, WIDTH_M = CAR.a + CAR.b, CAR.l, CAR.w
STEP_S, STEPS = 0.005, 10  # of the model, in a tick of 0.05 s
MAX_STEER_RAD, MAX_ACCEL, MAX_DECEL = 0.3, 4.0, 8.0
CRUISE_MPS, LIMIT_MPS, RADIUS_M, LANE_M = 10.0, 13.9, 400.0, 3.5
UNRECORDED = ("rollouts.ego_height_m", "actors.height_m", "observations.command")


def lane(left_m: float) -> Any:
    """Vertices of a lane that lies to the left of the route ``[2, vertices]``."""
    angle = np.arange(0.0, 240.0, 2.0) / RADIUS_M
    return (RADIUS_M - left_m) * np.sin(angle), RADIUS_M - (RADIUS_M - left_m) * np.cos(angle)


class Car:
    """The model: x and y of the rear axle, steering angle, speed, heading."""

    def __init__(self, route_m: float, speed_mps: float) -> None:
        angle = route_m / RADIUS_M
        x, y = RADIUS_M * np.sin(angle), RADIUS_M * (1 - np.cos(angle))
        self.state = np.array([x, y, 0.0, speed_mps, angle])

    @property
    def box(self) -> dict[str, float]:
        """Box centre and heading."""
        x, y, _, _, yaw = self.state
        x, y = bd.box_centre(x, y, yaw, WHEELBASE_M / 2)
        return {"x_m": x, "y_m": y, "yaw_rad": bd.Frame().yaw_rad(yaw)}

    @property
    def velocity(self) -> dict[str, float]:
        """Velocity of the box centre, which swings around the rear axle."""
        _, _, angle, speed, yaw = self.state
        vx, vy = bd.box_centre(speed * np.cos(yaw), speed * np.sin(yaw), yaw, 0.0, speed * np.tan(angle) / 2)
        return {"vel_x_mps": vx, "vel_y_mps": vy}

    @property
    def route_m(self) -> float:
        """How far along the bend the rear axle is."""
        return float(np.arctan2(self.state[0], RADIUS_M - self.state[1]) * RADIUS_M)

    def pursuit_rad(self) -> float:
        """Steering angle of pure pursuit."""
        x, y, _, speed, yaw = self.state
        angle = (self.route_m + max(4.0, 0.6 * speed)) / RADIUS_M
        aim = RADIUS_M * np.sin(angle) - x, RADIUS_M * (1 - np.cos(angle)) - y
        ahead, left = bd.to_ego_frame(*aim, yaw)
        return float(np.arctan(2 * WHEELBASE_M * left / (ahead**2 + left**2)))

    def step(self, angle_rad: float, accel_mps2: float) -> None:
        """One tick towards a steering angle; the model limits how fast, and would drive backwards."""
        for _ in range(STEPS):
            inputs = [(angle_rad - self.state[2]) / STEP_S, max(accel_mps2, -self.state[3] / STEP_S)]
            self.state += STEP_S * np.array(vehicle_dynamics_ks(self.state, inputs, CAR))


class BendWorld:
    """The ego behind a car that slows down to a speed for three seconds."""

    def __init__(self, slow_mps: float) -> None:
        self.slow_mps = slow_mps

    def reset(self, seed: int) -> bd.Scene:
        """Both cars in the bend."""
        random = np.random.default_rng(seed)
        self.ego, self.leader = Car(0.0, random.uniform(9.0, 11.0)), Car(random.uniform(25.0, 40.0), CRUISE_MPS)
        self.slow_tick = random.integers(80, 160)
        self.tick, self.is_wreck, self.contacts = 0, False, list[int]()
        x, y = lane(0.0)
        route = {"town": "Bend", "route_id": "bend", "route_x_m": x, "route_y_m": y, "environment": "none"}
        self.scene = bd.Scene(**route, ego_length_m=LENGTH_M, ego_width_m=WIDTH_M)
        return self.scene

    def observe(self) -> bd.Observation:
        """The ego; lane and limit follow from the map, rates from the poses."""
        return bd.Observation(**self.ego.box, speed_mps=self.ego.state[3], contacts=self.contacts)

    def actors(self) -> list[bd.Actor]:
        """The car ahead."""
        what: dict[str, Any] = {"actor_class": "vehicle", "length_m": LENGTH_M, "width_m": WIDTH_M}
        return [bd.Actor(actor_id=1, **what, **self.leader.box, **self.leader.velocity)]

    def expert(self) -> bd.Decision:
        """Pure pursuit at the cruising speed; brakes firmly while it closes in on the car ahead."""
        speed, ahead_m = self.ego.state[3], self.leader.route_m - self.ego.route_m
        is_hazard = bool(LENGTH_M < ahead_m < LENGTH_M + 5.0 + speed and speed > self.leader.state[3])
        target_mps = float(self.leader.state[3]) if is_hazard else CRUISE_MPS
        accel = -5.0 if is_hazard else target_mps - speed
        return bd.Decision(
            steer=float(np.clip(-self.ego.pursuit_rad() / MAX_STEER_RAD, -1, 1)),
            throttle=float(np.clip(accel / MAX_ACCEL, 0, 1)), brake=float(np.clip(-accel / MAX_DECEL, 0, 1)),
            target_speed_mps=target_mps, vehicle_hazard=is_hazard, pedestrian_hazard=False, traffic_light_hazard=False,
        )  # fmt: skip

    def step(self, command: bd.Command) -> None:
        """One tick of both cars; steering is positive to the left in the model."""
        steer, throttle, brake = map(float, command)
        is_slow = self.slow_tick <= self.tick < self.slow_tick + 60
        target_mps = self.slow_mps if is_slow else CRUISE_MPS
        accels = MAX_ACCEL * throttle - MAX_DECEL * brake, np.clip(target_mps - self.leader.state[3], -5.0, 2.0)
        self.ego.step(-MAX_STEER_RAD * steer, -MAX_DECEL if self.is_wreck else accels[0])
        self.leader.step(self.leader.pursuit_rad(), -MAX_DECEL if self.is_wreck else accels[1])
        self.contacts = bd.touched(self.scene, **self.ego.box, actors=self.actors())
        if self.contacts and not self.is_wreck:
            self.ego.state[3] = self.leader.state[3] = (self.ego.state[3] + self.leader.state[3]) / 2
        self.tick, self.is_wreck = self.tick + 1, self.is_wreck or bool(self.contacts)


WORLDS = {"LeaderSlows": partial(BendWorld, 4.0), "LeaderStops": partial(BendWorld, 0.0)}


def describe(seed: int) -> bd.Descriptor:
    """What the dataset is, and what the model does not offer."""
    limits = {"max_steer_rad": MAX_STEER_RAD, "max_accel_mps2": MAX_ACCEL, "max_decel_mps2": MAX_DECEL}
    return bd.describe(
        "commonroad-bend", seed=seed,
        simulator=("commonroad-vehicle-models", version("commonroad-vehicle-models")),
        collector=("commonroad-models-example", "1.0"),
        streams=("ego_route_state", "actor_risk_evidence", "map", "controls", "route_result"), unrecorded=UNRECORDED,
        driver=bd.Driver(kind="expert"), vehicle=bd.Vehicle(wheelbase_m=WHEELBASE_M, actuation="single_axis", **limits),
    )  # fmt: skip


def options() -> dict[str, Any]:
    """Further arguments of the collection."""
    lanes = {"right": 0.0, "left": LANE_M}
    return {"maps": {"Bend": [bd.lane_element(i, *lane(left), LANE_M, LIMIT_MPS) for i, left in lanes.items()]}}


if __name__ == "__main__":
    sys.exit(bd.collector_main(describe, WORLDS, **options()))
