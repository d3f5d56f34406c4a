"""PedestrianCrossing: a pedestrian walks out in front of the ego and crosses the whole carriageway.

It starts when the ego, at its present speed, would arrive while the pedestrian is in the ego's lane.
It starts some way behind the kerb, so that it already walks when the expert begins to react.
"""

from __future__ import annotations

import math

from branchdrive_reference.noise import Purpose, choice, uniform_between
from branchdrive_reference.scenarios.population import PEDESTRIAN
from branchdrive_reference.scenarios.scenario import FIRST_ROW, Scene
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import Signal, Trigger
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind

__all__ = ["PedestrianCrossing"]

_WALK_OUT_S = 1.9
"""Walking time from the start to the ego's path: longer than the expert's forecast of it."""

_PATH_HALF_WIDTH_M = 2.0
_KERB_M = 0.6
_MAX_EDGE_M = 6.0
"""Pedestrians come from a side whose kerb is at most this far from the lane."""


def _walk_mps(stage: Stage) -> float:
    return uniform_between(1.2, 1.9, stage.seed, Purpose.SCENARIO_SPEED)


def _start_offset_m(stage: Stage) -> float:
    """Signed offset from the route at which the pedestrian waits."""
    left_m, right_m = stage.edges_m()
    from_left = left_m <= _MAX_EDGE_M and choice(2, stage.seed, Purpose.SCENARIO_VARIANT) == 1
    edge_m = left_m if from_left else right_m
    distance_m = max(edge_m + _KERB_M, _PATH_HALF_WIDTH_M + _WALK_OUT_S * _walk_mps(stage))
    return distance_m if from_left else -distance_m


class PedestrianCrossing:
    """See the module; the hazard is active once the pedestrian walks."""

    name = "PedestrianCrossing"
    traffic_ahead = True
    trigger = Trigger("pedestrian-crossing-onset 1", (Signal("throttle_release", 0.02), Signal("brake", 0.05)))

    def bodies(self, stage: Stage) -> list[Body]:
        """The pedestrian, facing the road."""
        offset_m = _start_offset_m(stage)
        turn_rad = math.copysign(math.pi / 2, -offset_m)
        return [stage.standing(Kind.PEDESTRIAN, PEDESTRIAN, stage.site_m, offset_m, turn_rad=turn_rad)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Start walking in time to be at the meeting point when the ego arrives."""
        if scene.hazard_tick >= 0:
            return True
        stage = scene.stage
        walk, start_m = _walk_mps(stage), abs(_start_offset_m(stage))
        meeting_m = uniform_between(-0.8, 0.8, stage.seed, Purpose.SCENARIO_TIMING)
        ego = scene.feet[EGO_TRACK, EGO]
        way_m = stage.site_m - ego["arc_m"] - ego["half_length_m"]
        if way_m > max(ego["speed_mps"], 1.0) * (start_m - meeting_m) / walk:
            return False
        left_m, right_m = stage.edges_m()
        pedestrian = scene.bodies[FIRST_ROW]
        pedestrian["behaviour"], pedestrian["speed_mps"] = Behaviour.WALKING, walk
        pedestrian["travel_m"] = start_m + (right_m if _start_offset_m(stage) > 0 else left_m) + _KERB_M
        return True
