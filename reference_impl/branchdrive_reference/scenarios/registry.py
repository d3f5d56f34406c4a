"""Every scenario type by name, and the routes on which it can be staged."""

from __future__ import annotations

from functools import cache
from types import MappingProxyType

from branchdrive_reference.scenarios.blocked_intersection import BlockedIntersection
from branchdrive_reference.scenarios.crossing import (
    DynamicObjectCrossing,
    ParkingCrossingPedestrian,
    PedestrianCrossing,
)
from branchdrive_reference.scenarios.cut_in import HighwayCutIn, ParkingCutIn, StaticCutIn
from branchdrive_reference.scenarios.hard_brake_route import HardBrakeRoute
from branchdrive_reference.scenarios.hazard_at_side_lane import HazardAtSideLane, HazardAtSideLaneTwoWays
from branchdrive_reference.scenarios.junction_turn import (
    NonSignalizedJunctionLeftTurn,
    NonSignalizedJunctionRightTurn,
    SignalizedJunctionLeftTurn,
    VanillaNonSignalizedTurnEncounterStopsign,
    VanillaSignalizedTurnEncounterRedLight,
)
from branchdrive_reference.scenarios.merge import EnterActorFlow, MergerIntoSlowTraffic
from branchdrive_reference.scenarios.opposite_vehicle import (
    OppositeVehicleRunningRedLight,
    OppositeVehicleTakingPriority,
)
from branchdrive_reference.scenarios.scenario import Scenario
from branchdrive_reference.scenarios.standing_obstacle import (
    Accident,
    AccidentTwoWays,
    ConstructionObstacle,
    ConstructionObstacleTwoWays,
    ParkedObstacle,
    ParkedObstacleTwoWays,
)
from branchdrive_reference.scenarios.vehicle_turning_route import (
    CrossingBicycleFlow,
    VehicleTurningRoute,
    VehicleTurningRoutePedestrian,
)
from branchdrive_reference.scenarios.yield_to_emergency_vehicle import YieldToEmergencyVehicle
from branchdrive_reference.town.route import Route, town_routes
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["SCENARIOS", "scenario_routes"]

_ALL: tuple[Scenario, ...] = (
    Accident(),
    AccidentTwoWays(),
    BlockedIntersection(),
    ConstructionObstacle(),
    ConstructionObstacleTwoWays(),
    CrossingBicycleFlow(),
    DynamicObjectCrossing(),
    EnterActorFlow(),
    HardBrakeRoute(),
    HazardAtSideLane(),
    HazardAtSideLaneTwoWays(),
    HighwayCutIn(),
    MergerIntoSlowTraffic(),
    NonSignalizedJunctionLeftTurn(),
    NonSignalizedJunctionRightTurn(),
    OppositeVehicleRunningRedLight(),
    OppositeVehicleTakingPriority(),
    ParkedObstacle(),
    ParkedObstacleTwoWays(),
    ParkingCrossingPedestrian(),
    ParkingCutIn(),
    PedestrianCrossing(),
    SignalizedJunctionLeftTurn(),
    StaticCutIn(),
    VanillaNonSignalizedTurnEncounterStopsign(),
    VanillaSignalizedTurnEncounterRedLight(),
    VehicleTurningRoute(),
    VehicleTurningRoutePedestrian(),
    YieldToEmergencyVehicle(),
)

SCENARIOS = MappingProxyType({scenario.name: scenario for scenario in _ALL})
"""Registered scenario types, in a fixed order."""


@cache
def scenario_routes(name: str) -> tuple[Route, ...]:
    """Routes of all towns on which a scenario type can be staged, in a fixed order."""
    return tuple(
        route
        for network in map(town, TOWN_NAMES)
        for route in town_routes(network).values()
        if SCENARIOS[name].fits(route, network.junctions.get(route.junction))
    )
