"""ParkingCrossingPedestrian: a pedestrian steps out between parked vehicles."""

from __future__ import annotations

from branchdrive_reference.scenarios.crossing import Crossing
from branchdrive_reference.scenarios.population import PARKED_OFFSET_M
from branchdrive_reference.scenarios.sizes import CAR, PEDESTRIAN, VAN
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import brake_trigger
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.route import Place, Route
from branchdrive_reference.world.body import Body, Kind

__all__ = ["ParkingCrossingPedestrian"]

_WALK_OUT_S = 1.85
_KERB_M = 0.4
_GAP_M = 0.9


class ParkingCrossingPedestrian(Crossing):
    """See the module; the hazard is active once the pedestrian walks."""

    name = "ParkingCrossingPedestrian"
    trigger = brake_trigger("parking-crossing-onset 1")
    kind, size = Kind.PEDESTRIAN, PEDESTRIAN
    speed_mps = (1.5, 2.4)
    meeting_m = (-0.5, 0.8)

    def fits(self, route: Route, _crossroads: Crossroads | None) -> bool:
        """A street with a parking strip."""
        return route.place is Place.ROAD and route.site_lane.right is LaneSide.PARKING

    def start_offset_m(self, stage: Stage) -> float:
        """On the pavement beside the strip."""
        return -max(stage.edges_m()[1] + _KERB_M, _WALK_OUT_S * self.draw_speed_mps(stage))

    def bodies(self, stage: Stage) -> list[Body]:
        """The pedestrian, and a parked vehicle on either side of its way."""
        site_m = self.place_m(stage)
        before_m = site_m - VAN.length_m / 2 - _GAP_M
        return [
            *super().bodies(stage),
            stage.standing(Kind.VEHICLE, VAN, before_m, PARKED_OFFSET_M),
            stage.standing(Kind.VEHICLE, CAR, site_m + CAR.length_m / 2 + _GAP_M, PARKED_OFFSET_M),
        ]
