"""What a scenario type is: where it fits, who is on road, what they do, and which manoeuvre the expert must show."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.trigger import Trigger
from branchdrive.contract.timing import TICK_S
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.route import Route
from branchdrive_reference.town.signal import NO_GROUP, green_begins
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Body

__all__ = ["FIRST_ROW", "Ambient", "Scenario", "Scene", "green_on_arrival"]

FIRST_ROW = 1
"""Row of a scenario's first body; the ego is row 0."""


_GREEN_EARLY_S = (0.5, 4.0)
_HARDEST_MPS2 = 4.0


@dataclass(frozen=True)
class Ambient:
    """Which ambient traffic a scenario leaves room for.

    Attributes:
        behind: A follower in the ego's lane.
        ahead: A vehicle in the ego's lane beyond the site.
        oncoming: Vehicles that come towards the ego on its own road.
        beside: Vehicles in the other lanes of the ego's direction, and on the lane that an entry joins.
        crossing: Vehicles from the sides of the route's junction.
        parked: Vehicles on the parking strip.
    """

    behind: bool = True
    ahead: bool = True
    oncoming: bool = True
    beside: bool = True
    crossing: bool = True
    parked: bool = True


@dataclass(eq=False)
class Scene:
    """The running world, as far as a scenario may see and change it.

    Attributes:
        road: The road and the seed.
        bodies: `BODY` rows ``[bodies]``; a scenario commands its own rows only.
        feet: `FOOT` rows ``[tracks, bodies]``.
        hazard_tick: Tick at which the hazard became active; -1 before.
    """

    road: EmptyRoad
    bodies: NDArray[np.void]
    feet: NDArray[np.void]
    hazard_tick: int = -1

    def way_to_m(self, arc_m: float) -> float:
        """Way of the ego's front to an arc length of its route."""
        ego = self.feet[EGO_TRACK, EGO]
        return float(arc_m - ego["arc_m"] - ego["half_length_m"])

    def time_to_s(self, arc_m: float) -> float:
        """Time of the ego's front to an arc length of its route, at its present speed."""
        return self.way_to_m(arc_m) / max(float(self.feet[EGO_TRACK, EGO]["speed_mps"]), 1.0)

    def command(self, row: int, accel_mps2: float) -> None:
        """Let body `row` accelerate or brake as commanded, within what a driver does."""
        self.bodies["commanded_accel_mps2"][row] = min(max(accel_mps2, -_HARDEST_MPS2), _HARDEST_MPS2)

    def since_hazard_s(self, tick: int) -> float:
        """Time since the hazard became active."""
        return (tick - self.hazard_tick) * TICK_S


class Scenario(ABC):
    """A scenario type, for every route that it fits. Instances hold no state; what happens is in the scene."""

    name: ClassVar[str]
    """Recorded scenario type, after CARLA Leaderboard names."""

    trigger: ClassVar[Trigger]
    """Finds the expert's manoeuvre."""

    ambient: ClassVar[Ambient] = Ambient()

    @abstractmethod
    def fits(self, route: Route, crossroads: Crossroads | None) -> bool:
        """Whether the scenario can be staged on a route; `crossroads` is the junction that it crosses."""

    @abstractmethod
    def bodies(self, road: EmptyRoad) -> list[Body]:
        """The scenario's bodies, from row `FIRST_ROW` on."""

    @abstractmethod
    def update(self, scene: Scene, tick: int) -> bool:
        """Command the scenario's bodies for this tick; true once the hazard is active."""

    def signal_offset(self, road: EmptyRoad) -> int:
        """Where in their cycle the signals begin: the ego comes at green, unless a scenario needs something else."""
        return green_on_arrival(road, road.draw(*_GREEN_EARLY_S, Purpose.SIGNAL_OFFSET))


def green_on_arrival(road: EmptyRoad, early_s: float) -> int:
    """Signal offset with which the ego's green begins `early_s` before the ego is at its line."""
    track = road.tables.tracks[EGO_TRACK]
    if track["group"] == NO_GROUP:
        return 0
    tick = round((road.ego_arrival_s(float(track["stop_m"])) - early_s) / TICK_S)
    return green_begins(int(track["group"]), tick)
