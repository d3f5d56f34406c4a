"""PedestrianCrossing: a pedestrian walks out in front of the ego and crosses the whole road.

It starts when the ego, at its present speed, would arrive while the pedestrian is in the ego's lane.
It starts some way behind the kerb, so that it already walks when the expert begins to react.
"""

from __future__ import annotations

from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.crossing import Crossing
from branchdrive_reference.scenarios.sizes import PEDESTRIAN
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import brake_trigger
from branchdrive_reference.world.body import Kind

__all__ = ["PedestrianCrossing"]

_WALK_OUT_S = 1.9
"""Walking time from the start to the ego's path: longer than the expert's forecast of it."""

_PATH_HALF_WIDTH_M = 2.0
_KERB_M = 0.6
_MAX_EDGE_M = 6.0
"""Pedestrians come from a side whose kerb is at most this far from the lane."""


class PedestrianCrossing(Crossing):
    """See the module; the hazard is active once the pedestrian walks."""

    name = "PedestrianCrossing"
    trigger = brake_trigger("pedestrian-crossing-onset 1")
    kind, size = Kind.PEDESTRIAN, PEDESTRIAN
    speed_mps = (1.2, 1.9)
    meeting_m = (-0.8, 0.8)

    def start_offset_m(self, stage: Stage) -> float:
        """Behind the kerb of a side that is not too far from the lane."""
        left_m, right_m = stage.edges_m()
        from_left = left_m <= _MAX_EDGE_M and choice(2, stage.seed, Purpose.SCENARIO_SIDE) == 1
        edge_m = left_m if from_left else right_m
        distance_m = max(edge_m + _KERB_M, _PATH_HALF_WIDTH_M + _WALK_OUT_S * self.draw_speed_mps(stage))
        return distance_m if from_left else -distance_m
