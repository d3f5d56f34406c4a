"""Every scenario type by name."""

from __future__ import annotations

from types import MappingProxyType

from branchdrive_reference.scenarios.hard_brake_route import HardBrakeRoute
from branchdrive_reference.scenarios.parked_obstacle import ParkedObstacle
from branchdrive_reference.scenarios.pedestrian_crossing import PedestrianCrossing
from branchdrive_reference.scenarios.scenario import Scenario

__all__ = ["SCENARIOS"]

_ALL: tuple[Scenario, ...] = (ParkedObstacle(), HardBrakeRoute(), PedestrianCrossing())

SCENARIOS = MappingProxyType({scenario.name: scenario for scenario in _ALL})
"""Registered scenario types, in a fixed order."""
