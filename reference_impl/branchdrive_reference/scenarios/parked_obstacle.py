"""ParkedObstacle: a vehicle or container stands in the ego's lane; the expert passes it or waits behind it."""

from __future__ import annotations

from branchdrive_reference.noise import Purpose, choice, uniform_between
from branchdrive_reference.scenarios.population import CAR, VAN
from branchdrive_reference.scenarios.scenario import Scene
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import Signal, Trigger
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Body, Kind, Size

__all__ = ["ParkedObstacle"]

CONTAINER = Size(4.0, 1.8, 1.6, 6000.0)
_OBSTACLES = ((Kind.VEHICLE, CAR), (Kind.VEHICLE, VAN), (Kind.STATIC, CONTAINER))
_SIGHT_M = 60.0


class ParkedObstacle:
    """See the module; the hazard is active once the obstacle is in sight."""

    name = "ParkedObstacle"
    traffic_ahead = True
    trigger = Trigger(
        "parked-obstacle-onset 1",
        (Signal("lane_shift", 0.10), Signal("throttle_release", 0.02), Signal("brake", 0.05)),
    )

    def bodies(self, stage: Stage) -> list[Body]:
        """The obstacle, a little to the right of the lane's centre and slightly askew."""
        kind, size = _OBSTACLES[choice(len(_OBSTACLES), stage.seed, Purpose.SCENARIO_VARIANT)]
        offset_m = uniform_between(-0.7, -0.1, stage.seed, Purpose.SCENARIO_PLACE)
        turn_rad = uniform_between(-0.06, 0.06, stage.seed, Purpose.SCENARIO_STRENGTH)
        return [stage.standing(kind, size, stage.site_m, offset_m, turn_rad=turn_rad)]

    def update(self, scene: Scene, _tick: int) -> bool:
        """Nothing moves."""
        return bool(scene.stage.site_m - scene.feet["arc_m"][EGO_TRACK, EGO] < _SIGHT_M)
