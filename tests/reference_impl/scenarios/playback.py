"""Playback: the nominal rollout of a world with everything that a log leaves out, at every observation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from tests.reference_impl.simulation.worlds import spec_of

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.route import Route
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks
from branchdrive_reference.world.body import EGO

FRAME_S = OBSERVATION_STRIDE_TICKS * TICK_S
PLAYED = range(4)
"""Worlds of a scenario type that its own tests look at."""


@dataclass(frozen=True, eq=False)
class Playback:
    """The nominal rollout of one world.

    Attributes:
        road: The road and the seed.
        cast: Rows of the scenario's own bodies.
        bodies: `BODY` rows ``[frames, bodies]``.
        feet: `FOOT` rows ``[frames, tracks, bodies]``.
        lights: `Light` of each signal group ``[frames, 2]``.
        plan: `PLAN` rows ``[frames]``.
        hazard: Frame in which the hazard is active for the first time.
    """

    road: EmptyRoad
    cast: range
    bodies: NDArray[np.void]
    feet: NDArray[np.void]
    lights: NDArray[np.int64]
    plan: NDArray[np.void]
    hazard: int

    @property
    def tables(self) -> RouteTracks:
        return self.road.tables

    @property
    def route(self) -> Route:
        return self.road.tables.route

    @property
    def ego(self) -> NDArray[np.void]:
        """The ego's feet on its route ``[frames]``."""
        return self.along_route(EGO)

    def along_route(self, row: int) -> NDArray[np.void]:
        """The feet of a body on the ego's route ``[frames]``."""
        return self.feet[:, EGO_TRACK, row]

    def on_own_track(self, row: int) -> NDArray[np.void]:
        """The feet of a body on the track that it follows ``[frames]``."""
        return self.feet[:, int(self.bodies["track"][0, row]), row]

    def passing(self, row: int) -> NDArray[np.bool_]:
        """When the ego is beside a body, seen along the route ``[frames]``."""
        ego, other = self.ego, self.along_route(row)
        return np.abs(ego["arc_m"] - other["arc_m"]) < ego["half_length_m"] + other["half_length_m"]


@cache
def playback(scenario: str, number: int) -> Playback:
    """World `number` of a scenario type, driven by the expert."""
    spec = spec_of(scenario, number)
    world = World(spec)
    frames = []
    while world.tick < spec.timeout_ticks:
        world.think()
        if world.tick % OBSERVATION_STRIDE_TICKS == 0:
            frames.append((world.bodies.copy(), world.feet.copy(), world.lights.copy(), world.plan[0].copy()))
            if world.feet[EGO_TRACK, EGO]["arc_m"] >= world.tables.route.goal_m:
                break
        plan = world.plan[0]
        world.act(float(plan["steer"]), float(plan["throttle"]), float(plan["brake"]))
    road = world.scene.road
    cast = range(EGO + 1, EGO + 1 + len(world.scenario.bodies(road)))
    hazard = -(-world.scene.hazard_tick // OBSERVATION_STRIDE_TICKS)
    bodies, feet, lights, plans = (np.array(values) for values in zip(*frames, strict=True))
    return Playback(road, cast, bodies, feet, lights, plans, hazard)
