"""A world: one specification, simulated tick by tick.

Within a tick the order is fixed: the scenario acts, every body's position on the tracks is updated,
the expert decides, the caller applies a command, traffic chooses its motion, contacts are resolved.
"""

from __future__ import annotations

import numpy as np

from branchdrive_reference.expert.control import PLAN
from branchdrive_reference.expert.decision import decide
from branchdrive_reference.noise import Purpose, uniform_between
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.population import populate
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.scenarios.scenario import Scene
from branchdrive_reference.simulation.replay_noise import ReplayNoise
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.signal import ENVIRONMENTS, light_of
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks, route_tracks
from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind, body_table
from branchdrive_reference.world.contact import ContactSpace
from branchdrive_reference.world.corridor import FOOT, find_feet, update_feet
from branchdrive_reference.world.motion import finish_motion, plan_motion
from branchdrive_reference.world.traffic import advance_traffic
from branchdrive_reference.world.vehicle import EGO_SIZE, VEHICLE

__all__ = ["World"]


class World:
    """The state of one rollout.

    Attributes:
        spec: What the world was made from.
        tables: Route and tracks.
        tick: Ticks simulated so far.
        bodies: `BODY` rows ``[bodies]``; the ego is row 0.
        vehicle: `VEHICLE` row of the ego.
        plan: `PLAN` row: the expert's memory and its decision after `think`.
        feet: `FOOT` rows ``[tracks, bodies]``.
        scene: What the scenario sees.
        noise: What makes a replay differ.
        lights: `Light` of each signal group ``[2]``.
        contacts: The physics.
    """

    def __init__(self, spec: WorldSpec) -> None:
        self.spec = spec
        self.tables: RouteTracks = route_tracks(spec.town, spec.route_id)
        self.tick = 0
        self.scenario = SCENARIOS[spec.scenario_type]
        self._grip = ENVIRONMENTS[spec.environment].grip
        road = EmptyRoad(self.tables, spec.seed)
        cast = self.scenario.bodies(road)
        self.bodies = body_table([_ego(road), *cast, *populate(road, self.scenario.ambient, cast)])
        self.noise = ReplayNoise.of(spec)
        self.noise.disturb_start(self.bodies, self.tables)
        self.vehicle = np.zeros(1, VEHICLE)
        self.vehicle["forward_mps"] = self.bodies["speed_mps"][EGO]
        self.plan = np.zeros(1, PLAN)
        self.feet = np.zeros((len(self.tables.tracks), len(self.bodies)), FOOT)
        find_feet(self.feet, self.bodies, self.tables.vertices, self.tables.tracks)
        self.scene = Scene(road, self.bodies, self.feet)
        self.lights = np.zeros(2, np.int64)
        self._signal_offset = self.scenario.signal_offset(road)
        self._goals = np.zeros((len(self.bodies), 3))
        self.contacts = ContactSpace(self.bodies)

    def think(self) -> None:
        """Let the scenario and the expert decide on the present state."""
        tables = self.tables
        for group in range(len(self.lights)):
            self.lights[group] = light_of(group, self.tick, self._signal_offset)
        update_feet(self.feet, self.bodies, tables.vertices, tables.tracks)
        if self.scenario.update(self.scene, self.tick) and self.scene.hazard_tick < 0:
            self.scene.hazard_tick = self.tick
        decide(
            self.plan[0], self.bodies, self.feet, tables.vertices, tables.tracks, tables.conflicts, self.lights
        )  # fmt: skip
        self.noise.disturb_command(self.plan[0], self.tick)

    def act(self, steer: float, throttle: float, brake: float) -> None:
        """Drive the ego with a command, steering positive to the right, for one tick."""
        contacts, tables = self.contacts, self.tables
        advance_traffic(
            self.bodies, self.feet, tables.vertices, tables.tracks, tables.conflicts, self.lights,
            self._goals, self.spec.seed, self.tick,
        )  # fmt: skip
        planned = plan_motion(self.bodies, self.vehicle[0], contacts.motion, steer, throttle, brake, self._grip)
        contacts.step()
        finish_motion(self.bodies, self.vehicle[0], contacts.motion, self._goals, contacts.hit, *planned)
        self.tick += 1


def _ego(road: EmptyRoad) -> Body:
    share = uniform_between(0.9, 1.0, road.seed, Purpose.EGO_SPEED)
    ego = road.vehicle(EGO_SIZE, START_M, EGO_TRACK, speed_mps=share * road.advisory_mps(START_M))
    return Body(Kind.VEHICLE, Behaviour.DRIVEN, EGO_SIZE, ego.x_m, ego.y_m, ego.yaw_rad, ego.speed_mps)
