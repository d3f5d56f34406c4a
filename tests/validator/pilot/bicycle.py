"""A world of its own timing for pilots: pedals and wheels that lag, air drag, bends of its own for every seed.

Its simulator is left-handed and in degrees, gives the rear axle, and knows no heights. A tick has five steps of::

    a'     = (a_c - a) / LAG_S                          v'   = a - DRAG v^2
    angle' = clip((angle_c - angle) / LAG_S, RATE)      yaw' = v tan(angle) / L

A pedestrian steps onto the road some seconds ahead, and a cyclist comes along the other side.
"""

from __future__ import annotations

from math import cos, degrees, radians, sin, tan
from typing import Any, Literal

import numpy as np

import branchdrive as bd
from branchdrive.contract.descriptor import Collection, ReplayNoise

WHEELBASE_M, AHEAD_M, LENGTH_M, WIDTH_M = 2.8, 1.4, 4.6, 1.9
MAX_STEER_RAD, MAX_ACCEL, MAX_DECEL = 0.45, 3.5, 7.5
LAG_S, RATE_RADPS, DRAG = 0.04, 2.0, 0.0006
STEPS, STEP_S = 5, 0.01
ROUTE_M, CRUISE_MPS = 150.0, 9.0
FRAME = bd.Frame(is_left_handed=True, is_degrees=True)
EXTENTS = {"pedestrian": (0.5, 0.6), "cycle": (1.8, 0.6)}


def held(value: float, low: float, high: float) -> float:
    """A number inside of bounds."""
    return float(min(max(value, low), high))


class LaggingBicycle:
    """The ego on a bend, behind somebody who crosses."""

    def reset(self, seed: int) -> bd.Scene:
        """Both others wait; the bend is that of the seed."""
        random = np.random.default_rng(seed)
        self.radius_m = float(random.choice([-1, 1]) * random.uniform(150.0, 400.0))
        self.x, self.y, self.yaw, self.speed, self.accel, self.angle = (
            0.0,
            0.0,
            0.0,
            random.uniform(8.0, 10.0),
            0.0,
            0.0,
        )
        self.tick, self.stepping_tick = 0, int(random.integers(90, 150))
        self.crossing_m, self.contacts = float(random.uniform(75.0, 95.0)), list[int]()
        along_m = np.arange(0.0, ROUTE_M + 1, 1.0)
        x, y = FRAME.vector(*self.at(along_m, 0.0))
        route = {"town": "Bends", "route_id": f"bend-{seed}", "route_x_m": x, "route_y_m": y, "environment": "none"}
        self.scene = bd.Scene(**route, ego_length_m=LENGTH_M, ego_width_m=WIDTH_M)
        return self.scene

    def at(self, along_m: Any, right_m: Any) -> Any:
        """A place beside the bend, in the simulator's frame."""
        angle = along_m / self.radius_m
        radius_m = self.radius_m - right_m
        return radius_m * np.sin(angle), self.radius_m - radius_m * np.cos(angle)

    @property
    def along_m(self) -> float:
        """How far along the bend the rear axle is."""
        sign = np.sign(self.radius_m)
        return float(np.arctan2(sign * self.x, sign * (self.radius_m - self.y)) * self.radius_m)

    @property
    def pose(self) -> dict[str, float]:
        """Box centre and heading in the recorded frame."""
        (x, y), yaw_rad = FRAME.vector(self.x, self.y), FRAME.yaw_rad(self.yaw)
        x, y = bd.box_centre(x, y, yaw_rad, AHEAD_M)
        return {"x_m": x, "y_m": y, "yaw_rad": yaw_rad}

    def observe(self) -> bd.Observation:
        """The ego on a road of 8 m."""
        x, y = self.x, self.y
        right_m = self.radius_m - np.sign(self.radius_m) * np.hypot(x, self.radius_m - y)
        is_on = bool(abs(right_m) <= 4.0)
        return bd.Observation(
            **self.pose, speed_mps=self.speed, on_road=is_on, lane_id="road" if is_on else None,
            speed_limit_mps=13.9, contacts=self.contacts,
        )  # fmt: skip

    def actors(self) -> list[bd.Actor]:
        """A pedestrian who crosses, and a cyclist who comes along."""
        walked_m = 1.4 * 0.05 * held(self.tick - self.stepping_tick, 0, 110)
        is_walking = 0 <= self.tick - self.stepping_tick < 110
        across = self.crossing_m / self.radius_m + np.pi / 2
        ridden_m = 140.0 - 4.0 * 0.05 * self.tick
        along = ridden_m / self.radius_m + np.pi
        here = [
            ("pedestrian", self.at(self.crossing_m, -4.0 + walked_m), across, 1.4 * is_walking),
            ("cycle", self.at(ridden_m, -3.2), along, 4.0 * (1 + 3.2 / self.radius_m)),
        ]
        found = []
        for number, (kind, (x, y), heading, speed) in enumerate(here, 1):
            (x, y), (vx, vy) = FRAME.vector(x, y), FRAME.vector(speed * np.cos(heading), speed * np.sin(heading))
            yaw_rad = FRAME.yaw_rad(np.degrees(heading))
            size = {"length_m": EXTENTS[kind][0], "width_m": EXTENTS[kind][1]}
            found.append(
                bd.Actor(
                    actor_id=number, actor_class=kind, x_m=x, y_m=y, yaw_rad=yaw_rad, **size, vel_x_mps=vx, vel_y_mps=vy
                )
            )
        return found

    def expert(self) -> bd.Decision:
        """Pure pursuit; brakes for whom it would run into, and waits."""
        walked_m = 1.4 * 0.05 * (self.tick - self.stepping_tick)
        ahead_m = self.crossing_m - self.along_m
        is_near = bool(0 <= walked_m < 6.5 and 3.0 < ahead_m < 8.0 + self.speed**2 / 6.0)
        target_mps = 0.0 if is_near else CRUISE_MPS
        accel = max(-6.0, -(self.speed**2) / (2 * max(ahead_m - 6.0, 0.5))) if is_near else target_mps - self.speed
        aim = self.at(self.along_m + max(5.0, 0.7 * self.speed), 0.0)
        ahead, right = bd.to_ego_frame(aim[0] - self.x, aim[1] - self.y, np.radians(self.yaw))
        angle = np.arctan(2 * WHEELBASE_M * right / (ahead**2 + right**2))
        return bd.Decision(
            steer=held(angle / MAX_STEER_RAD, -1, 1), throttle=held(accel / MAX_ACCEL, 0, 1),
            brake=held(-accel / MAX_DECEL, 0, 1), target_speed_mps=target_mps, vehicle_hazard=False,
            pedestrian_hazard=is_near, traffic_light_hazard=False,
        )  # fmt: skip

    def step(self, command: bd.Command) -> None:
        """A tick of five steps."""
        steer, throttle, brake = map(float, command)
        wanted = MAX_ACCEL * throttle - MAX_DECEL * brake
        for _ in range(STEPS):
            self.accel += STEP_S / LAG_S * (wanted - self.accel)
            self.speed = max(0.0, self.speed + STEP_S * (self.accel - DRAG * self.speed**2))
            turn = (MAX_STEER_RAD * steer - self.angle) / LAG_S
            self.angle += STEP_S * held(turn, -RATE_RADPS, RATE_RADPS)
            self.yaw += STEP_S * degrees(self.speed * tan(self.angle) / WHEELBASE_M)
            self.x += STEP_S * self.speed * cos(radians(self.yaw))
            self.y += STEP_S * self.speed * sin(radians(self.yaw))
        self.tick += 1
        x, y = self.pose["x_m"], self.pose["y_m"]
        near = [actor for actor in self.actors() if abs(actor.x_m - x) + abs(actor.y_m - y) < 8.0]
        self.contacts = bd.touched(self.scene, **self.pose, actors=near) if near else []


class NoisyBicycle(LaggingBicycle):
    """The same, pushed a little at every tick: each rollout by draws of its own."""

    def __init__(self) -> None:
        self.noise = np.random.default_rng(5)

    def step(self, command: bd.Command) -> None:
        """A tick, and a push along and across."""
        along, across = self.noise.normal(0.0, (0.002, 0.0002))
        super().step(command)
        self.speed, self.yaw = max(0.0, self.speed + along), self.yaw + degrees(across)


def describe(seed: int, noise: Literal["exact", "natural"] = "exact") -> bd.Descriptor:
    """What the dataset is."""
    limits = {"max_steer_rad": MAX_STEER_RAD, "max_accel_mps2": MAX_ACCEL, "max_decel_mps2": MAX_DECEL}
    return bd.describe(
        "bicycle", seed=seed, simulator=("lagging-bicycle", "1"), collector=("bicycle", "1"),
        collection=Collection(seed=seed, replay_noise=ReplayNoise(kind=noise)),
        unrecorded=("rollouts.ego_height_m", "actors.height_m", "observations.command"),
        driver=bd.Driver(kind="expert"), vehicle=bd.Vehicle(wheelbase_m=WHEELBASE_M, actuation="pedals", **limits),
    )  # fmt: skip
