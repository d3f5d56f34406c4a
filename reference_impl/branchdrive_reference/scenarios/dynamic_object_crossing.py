"""DynamicObjectCrossing: a child comes out fast from behind a container beside the road."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.crossing import Crossing
from branchdrive_reference.scenarios.sizes import CHILD, CONTAINER
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import brake_trigger
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LaneSide, RoadClass
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.world.body import Body, Kind

__all__ = ["DynamicObjectCrossing"]

_RUN_OUT_S = 1.8
_BESIDE_M, _BEFORE_M = 1.4, 3.4
_HIDDEN_SHARE = 0.86
"""Where an ego that comes from far sees the container before who runs, as a share of the way to the road's middle."""


class DynamicObjectCrossing(Crossing):
    """See the module; the hazard is active once it runs."""

    name = "DynamicObjectCrossing"
    trigger = brake_trigger("dynamic-object-onset 1")
    kind, size = Kind.PEDESTRIAN, CHILD
    speed_mps = (2.2, 3.2)
    meeting_m = (-0.6, 1.0)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A street or rural road whose right side is close."""
        lane = route.site_lane
        on_road = route.place is Place.ROAD and lane.road_class in (RoadClass.STREET, RoadClass.RURAL)
        return on_road and lane.right is LaneSide.NOTHING

    def start_offset_m(self, stage: Stage) -> float:
        """To the right, far enough for a run-up."""
        return -max(stage.edges_m()[1] + 1.0, _RUN_OUT_S * self.draw_speed_mps(stage))

    def bodies(self, stage: Stage) -> list[Body]:
        """Who runs, and what hides it."""
        aside_m = max(stage.edges_m()[1] + _BESIDE_M, _HIDDEN_SHARE * abs(self.start_offset_m(stage)))
        before_m = _BEFORE_M + 0.5 * choice(3, stage.seed, Purpose.SCENARIO_GAP)
        hides = stage.standing(Kind.STATIC, CONTAINER, self.place_m(stage) - before_m, -aside_m)
        return [*super().bodies(stage), hides]
