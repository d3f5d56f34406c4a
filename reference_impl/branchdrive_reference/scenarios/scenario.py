"""What a scenario type is: who is on stage, what they do, and which manoeuvre the expert must show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.scenarios.trigger import Trigger
from branchdrive_reference.world.body import Body

__all__ = ["FIRST_ROW", "Scenario", "Scene"]

FIRST_ROW = 1
"""Row of a scenario's first body; the ego is row 0."""


@dataclass(eq=False)
class Scene:
    """The running world, as far as a scenario may see and change it.

    Attributes:
        stage: The road and the seed.
        bodies: `BODY` rows ``[bodies]``; a scenario commands its own rows only.
        feet: `FOOT` rows ``[tracks, bodies]``.
        hazard_tick: Tick at which the hazard became active; -1 before.
    """

    stage: Stage
    bodies: NDArray[np.void]
    feet: NDArray[np.void]
    hazard_tick: int = -1


class Scenario(Protocol):
    """A scenario type, for any route of the town. Instances hold no state; what happens is in the scene."""

    @property
    def name(self) -> str:
        """Recorded scenario type, after CARLA Leaderboard names."""

    @property
    def trigger(self) -> Trigger:
        """Finds the expert's manoeuvre."""

    @property
    def traffic_ahead(self) -> bool:
        """Whether ambient traffic may drive in the ego's lane beyond the site."""

    def bodies(self, stage: Stage) -> list[Body]:
        """The scenario's bodies, from row `FIRST_ROW` on."""

    def update(self, scene: Scene, tick: int) -> bool:
        """Command the scenario's bodies for this tick; true once the hazard is active."""
