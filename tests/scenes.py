"""The three scenes of the small valid dataset."""

from __future__ import annotations

from branchdrive.testing.drive import CAR_M, CONE_M, CYCLE_M, PERSON_M, InventedActor, InventedScene, Route

__all__ = ["ACTORS", "ROUTES", "SCENES"]

ROUTES = (
    Route((0.0, 0.0), 0.0),
    Route((500.0, -200.0), 2.0, radius_m=120.0),
    Route((-300.0, 800.0), -2.5),
)

ACTORS = (
    (
        InventedActor("vehicle", CAR_M, 32.0, 0.0, speed_mps=5.0),  # ahead, slower
        InventedActor("vehicle", CAR_M, 130.0, 3.5, speed_mps=-9.0),  # oncoming
        InventedActor("cycle", CYCLE_M, 6.0, -3.0, speed_mps=10.0),  # faster: parts
        InventedActor("pedestrian", PERSON_M, 75.0, -7.0, lateral_mps=0.75),  # crosses
        InventedActor("static", CONE_M, 110.0, 0.75),  # in the corridor
        InventedActor("static", CONE_M, 18.0, 6.0),  # beside it
        InventedActor("vehicle", CAR_M, -60.0, 40.0),  # recorded, never in range at first
    ),
    (
        InventedActor("vehicle", CAR_M, 45.0, 0.0, speed_mps=7.0),
        InventedActor("cycle", CYCLE_M, 20.0, 3.5, speed_mps=3.0),
        InventedActor("static", CONE_M, 120.0, -0.5),
        InventedActor("static", CONE_M, 30.0, -5.0),
        InventedActor("pedestrian", PERSON_M, 60.0, 0.0, first_tick=130, last_tick=190),  # the ego runs over its place
    ),
    (
        InventedActor("vehicle", CAR_M, 150.0, 3.5, speed_mps=-6.0, first_tick=70),
        InventedActor("cycle", CYCLE_M, 90.0, -3.0, speed_mps=9.0, first_tick=70),
        InventedActor("pedestrian", PERSON_M, 80.0, -6.0, lateral_mps=-0.5, first_tick=70),
        InventedActor("static", CONE_M, 4.0, 5.5, last_tick=60),  # the only company before tick 70, irrelevant
        InventedActor("static", CONE_M, 72.0, 0.5, first_tick=70),  # in the corridor, and the nearest
    ),
)


TOWNS = ("Town12", "Town13", "Town12")

SCENES = tuple(InventedScene(*scene) for scene in zip(ROUTES, ACTORS, TOWNS, strict=True))
