"""Replay noise: what makes an executed replay differ from its nominal, as it does where a simulator is not exact.

Every replay draws a scale of its own, ``strength * exp(n / 2)``, and with it

* traffic: where its drivers start (0.08 m) and how fast they want to be (0.4 %);
* the ego's start: along its lane (0.05 m) and its speed (0.3 %);
* controllers: the expert's steering (0.0008), throttle and brake (2 % of themselves), held for a quarter second;
* sensor timing: observations are taken early or late (2 ms), so every pose is off by its velocity times that; speeds
  are not.

The figures are standard deviations at scale 1; all draws are pure functions of the world's seed and the replay's key.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose, integer, normal
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.town.track import RouteTracks
from branchdrive_reference.world.body import EGO, Behaviour

__all__ = ["ReplayNoise"]

_SCALE_SPREAD = 0.5
_TRAFFIC_M, _TRAFFIC_SHARE = 0.08, 0.004
_EGO_M, _EGO_SHARE = 0.05, 0.003
_STEER, _PEDAL_SHARE = 0.0008, 0.02
_SENSOR_S = 0.002


@dataclass(frozen=True)
class ReplayNoise:
    """The noise of one replay.

    Attributes:
        key: Seed of its draws.
        scale: Strength times the replay's own factor; 0 changes nothing.
    """

    key: int
    scale: float

    @classmethod
    def of(cls, spec: WorldSpec) -> ReplayNoise:
        """The noise that a specification asks for; that of a nominal pass has scale 0."""
        key = integer(spec.seed, Purpose.REPLAY_KEY, spec.replay)
        if spec.replay == 0 or spec.replay_noise == 0.0:
            return cls(key, 0.0)
        return cls(key, spec.replay_noise * math.exp(_SCALE_SPREAD * normal(key, Purpose.REPLAY_SCALE)))

    def disturb_start(self, bodies: NDArray[np.void], tables: RouteTracks) -> None:
        """Change the `BODY` rows of a world before its first tick."""
        if self.scale == 0.0:
            return
        for index, body in enumerate(bodies):
            if body["behaviour"] == Behaviour.FOLLOWING:
                body["arc_m"] += self.scale * _TRAFFIC_M * normal(self.key, Purpose.REPLAY_TRAFFIC, index)
                body["eagerness"] *= 1.0 + self.scale * _TRAFFIC_SHARE * normal(
                    self.key, Purpose.REPLAY_TRAFFIC, index, 1
                )
                path = tables.path(int(body["track"]))
                body["x_m"], body["y_m"], body["yaw_rad"] = interpolate(path, body["arc_m"], body["offset_m"])
                body["vel_x_mps"] = body["speed_mps"] * math.cos(body["yaw_rad"])
                body["vel_y_mps"] = body["speed_mps"] * math.sin(body["yaw_rad"])
        ego = bodies[EGO]
        ahead_m = self.scale * _EGO_M * normal(self.key, Purpose.REPLAY_EGO)
        share = 1.0 + self.scale * _EGO_SHARE * normal(self.key, Purpose.REPLAY_EGO, 1)
        ego["x_m"] += ahead_m * math.cos(ego["yaw_rad"])
        ego["y_m"] += ahead_m * math.sin(ego["yaw_rad"])
        for name in ("speed_mps", "vel_x_mps", "vel_y_mps"):
            ego[name] *= share

    def disturb_command(self, plan: np.void, tick: int) -> None:
        """Change the expert's command in a `PLAN` row."""
        if self.scale == 0.0:
            return
        hold_index = tick // OBSERVATION_STRIDE_TICKS
        steer = plan["steer"] + self.scale * _STEER * normal(self.key, Purpose.REPLAY_CONTROL, 0, hold_index)
        share = max(1.0 + self.scale * _PEDAL_SHARE * normal(self.key, Purpose.REPLAY_CONTROL, 1, hold_index), 0.0)
        plan["steer"] = min(max(steer, -1.0), 1.0)
        for pedal in ("throttle", "brake"):
            plan[pedal] = min(plan[pedal] * share, 1.0)

    def disturb_observation(self, bodies: NDArray[np.void], tick: int) -> None:
        """Move the poses of observed `BODY` rows to when they were really taken."""
        if self.scale == 0.0:
            return
        late_s = self.scale * _SENSOR_S * normal(self.key, Purpose.REPLAY_SENSOR, 0, tick)
        bodies["x_m"] += late_s * bodies["vel_x_mps"]
        bodies["y_m"] += late_s * bodies["vel_y_mps"]
        bodies["yaw_rad"] += late_s * bodies["yaw_rate_radps"]
