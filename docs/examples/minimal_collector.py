"""A minimal collector: branch groups from a simulator of one's own, recorded so that they qualify.

Copy this file and put your simulator in the place of `StraightRoad`; `branchdrive init NAME` makes a package of it.
Three things are easy to get wrong (`spec/02-time-frames-units.md`):

* SI units and radians, x forward, y left, yaw counter-clockwise, poses of box centres. Steering is
  the one exception: a positive command steers to the *right*. `bd.Frame` and `bd.box_centre` convert.
* An observation is the state before the command of its tick acts.
* A world depends on seed and commands alone: whatever is random in it is drawn from the seed.

Run it with ``python docs/examples/minimal_collector.py build/straight-road``.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import branchdrive as bd

TICK_S = 0.05  # a step of the world; finer steps of a simulator within it are fine
ROUTE_M = 200.0
NUM_ROADS, ROAD_GAP_M = 40, 100.0
EGO_BOX = {"ego_length_m": 4.5, "ego_width_m": 2.0, "ego_height_m": 1.5}  # full extents
PARKED_CAR = bd.Actor(
    actor_id=1, actor_class="vehicle", x_m=100.0, y_m=-2.25, yaw_rad=0.0, length_m=4.5, width_m=2.0, height_m=1.5,
    vel_x_mps=0.0, vel_y_mps=0.0,
)  # fmt: skip


class StraightRoad:
    """The simulator: an ego vehicle on a straight road along x, and a car parked half in its lane.

    The seed chooses among forty roads. Groups of one road are one cluster of routes, which a release never divides
    between train, val and test: a collection wants many routes.
    """

    def reset(self, seed: int) -> bd.Scene:
        """Go to tick 0 of the scenario that the seed stands for; what all rollouts of a group share."""
        random = np.random.default_rng(seed)
        speed_mps, parked_x_m, beside_m = random.uniform((7.0, 90.0, -2.5), (9.0, 120.0, -2.25))
        road = int(random.integers(NUM_ROADS))
        self.road_y_m = ROAD_GAP_M * road
        self.x_m, self.y_m, self.yaw_rad, self.speed_mps = 0.0, self.road_y_m, 0.0, speed_mps
        self.parked = replace(PARKED_CAR, x_m=parked_x_m, y_m=self.road_y_m + beside_m)
        route_y_m = [self.road_y_m, self.road_y_m]
        route = {"route_id": f"road-{road}", "route_x_m": [0.0, ROUTE_M], "route_y_m": route_y_m}
        return bd.Scene(town="StraightRoad", environment="ClearNoon", **route, **EGO_BOX)

    def observe(self) -> bd.Observation:
        """The ego at the present tick; rates of change and the place on the route are derived from it."""
        is_touching = abs(self.parked.x_m - self.x_m) < 4.5 and abs(self.parked.y_m - self.y_m) < 2.0
        is_on = abs(self.y_m - self.road_y_m) <= 5.25
        return bd.Observation(
            x_m=self.x_m, y_m=self.y_m, yaw_rad=self.yaw_rad, speed_mps=self.speed_mps, on_road=is_on,
            lane_id=f"lane-{self.road_y_m:.0f}" if is_on else None,  # None is null: unavailable, no stand-in value
            speed_limit_mps=13.5, command="follow", contacts=[self.parked.actor_id] if is_touching else [],
        )  # fmt: skip

    def actors(self) -> list[bd.Actor]:
        """Everybody else, at least within 50 m."""
        return [self.parked]

    def expert(self) -> bd.Decision:
        """The online expert's decision on the present state; asked for at every tick, also while it is overridden."""
        is_near = -5.0 < self.parked.x_m - self.x_m < 12.0
        target_mps = 3.0 if is_near else 8.0
        missing_mps = target_mps - self.speed_mps
        return bd.Decision(
            # too far to the left: steer to the right
            steer=float(np.clip(0.1 * (self.y_m - self.road_y_m) + 0.5 * self.yaw_rad, -1, 1)),
            throttle=float(np.clip(0.5 * missing_mps, 0, 1)), brake=float(np.clip(-0.5 * missing_mps, 0, 1)),
            target_speed_mps=target_mps, vehicle_hazard=is_near, pedestrian_hazard=False, traffic_light_hazard=False,
        )  # fmt: skip

    def step(self, command: bd.Command) -> None:
        """Apply one command for one tick."""
        steer, throttle, brake = map(float, command)
        self.speed_mps = max(0.0, self.speed_mps + (3.0 * throttle - 6.0 * brake) * TICK_S)
        self.yaw_rad -= 0.13 * steer * self.speed_mps * TICK_S  # to the right is clockwise: the sign turns here
        self.x_m += self.speed_mps * np.cos(self.yaw_rad) * TICK_S
        self.y_m += self.speed_mps * np.sin(self.yaw_rad) * TICK_S


def describe(seed: int) -> bd.Descriptor:
    """What the dataset is; a stream that it claims is there in every attempt."""
    return bd.describe("minimal", seed=seed, simulator=("straight-road", "1.0"), collector=("minimal-collector", "1.0"))


WORLDS = {"ParkedObstacle": StraightRoad}  # by scenario type


if __name__ == "__main__":
    sys.exit(bd.collector_main(describe, WORLDS))
