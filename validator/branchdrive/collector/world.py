"""What a collector asks of a simulator: a world that is reset, observed, driven by an expert, and stepped.

Everything is in the recorded frames and units (`spec/02-time-frames-units.md`): metres, radians, box centres, y to the
left. A world is deterministic if its rollouts depend on the seed and the commands alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from branchdrive.contract.policy import Command
from branchdrive.errors import BranchDriveError

__all__ = ["Actor", "CameraWorld", "Decision", "Observation", "Scene", "World", "WorldError"]


class WorldError(BranchDriveError):
    """A simulator ended a rollout before its end; a world raises it with the reason.

    What was driven is kept as a partial attempt, and the attempt is made again.
    """


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What all rollouts of a group share.

    Attributes:
        town: Name of the map.
        route_id: Identity of the route in the town.
        route_x_m: Vertices of the route in driving order, at least two.
        route_y_m: The same, y.
        environment: Name of weather and light.
        ego_length_m: Full length of the ego's box.
        ego_width_m: Full width.
        ego_height_m: Full height; ``None`` where it is unrecorded.
    """

    town: str
    route_id: str
    route_x_m: Sequence[float]
    route_y_m: Sequence[float]
    environment: str
    ego_length_m: float
    ego_width_m: float
    ego_height_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The ego at one tick, before the control of the tick acts.

    Attributes:
        x_m: Box centre.
        y_m: The same, y.
        yaw_rad: Heading, counter-clockwise; wrapped where it is recorded.
        speed_mps: Signed speed along the heading.
        on_road: Whether the centre lies on a drivable surface; needed where evidence is claimed.
        lane_id: Lane that the centre lies in; ``None`` off the lanes.
        speed_limit_mps: Speed limit of the lane; ``None`` where it is unrecorded.
        command: Navigation command; ``None`` where it is unrecorded.
        traffic_light: ``red``, ``yellow`` or ``green`` of the signal that governs the lane; ``None`` without one.
        contacts: Ids of the actors that the ego has touched since the last tick.
        accel_longitudinal_mps2: Over the last tick; from the speeds where it is ``None``, as the next two.
        accel_lateral_mps2: Positive to the left; from speed and yaw rate.
        yaw_rate_radps: Counter-clockwise; from the headings.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    on_road: bool | None = None
    lane_id: str | None = None
    speed_limit_mps: float | None = None
    command: Literal["left", "right", "straight", "follow", "change_left", "change_right"] | None = None
    traffic_light: Literal["red", "yellow", "green"] | None = None
    contacts: Collection[int] = ()
    accel_longitudinal_mps2: float | None = None
    accel_lateral_mps2: float | None = None
    yaw_rate_radps: float | None = None


@dataclass(frozen=True, kw_only=True)
class Actor:
    """One actor at one tick: its box and the velocity of the box's centre.

    Attributes:
        actor_id: Identity inside of the rollout.
        actor_class: What it is.
        x_m: Box centre.
        y_m: The same, y.
        yaw_rad: Heading, counter-clockwise; wrapped where it is recorded.
        length_m: Full extents; the height is ``None`` where it is unrecorded.
        width_m: Full width.
        height_m: Full height.
        vel_x_mps: Velocity in the world frame.
        vel_y_mps: The same, y.
    """

    actor_id: int
    actor_class: Literal["vehicle", "cycle", "pedestrian", "static"]
    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float | None = None
    vel_x_mps: float
    vel_y_mps: float


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The online expert's command at one tick, and what it had in mind.

    Attributes:
        steer: In ``[-1, 1]``, positive to the right.
        throttle: In ``[0, 1]``.
        brake: In ``[0, 1]``.
        target_speed_mps: Speed that it wants; ``None`` where it is unrecorded, as the next three.
        vehicle_hazard: Whether it brakes for a vehicle, cycle or static object.
        pedestrian_hazard: Whether it brakes for a pedestrian.
        traffic_light_hazard: Whether it brakes for a traffic light or stop sign.
        lane_shift_m: Planned offset from the route where the steering looks at, for triggers that watch it.
    """

    steer: float
    throttle: float
    brake: float
    target_speed_mps: float | None = None
    vehicle_hazard: bool | None = None
    pedestrian_hazard: bool | None = None
    traffic_light_hazard: bool | None = None
    lane_shift_m: float = 0.0

    @property
    def is_reacting(self) -> bool:
        """Whether an actor on the road makes it brake; always where it does not say."""
        hazards = (self.vehicle_hazard, self.pedestrian_hazard, self.traffic_light_hazard)
        return any(hazards) or all(hazard is None for hazard in hazards)


class World(Protocol):
    """A simulator with an ego vehicle and an expert that can drive it, at 20 ticks a second.

    At every tick it is asked for its observation, at saved ones for its actors, then for the expert's decision, and
    given the command to step with: the decision's, rounded to float32, or an intervention's instead.
    """

    def reset(self, seed: int) -> Scene:
        """Go to tick 0 of the scenario that the seed stands for: the same state whenever the seed is the same."""

    def observe(self) -> Observation:
        """The ego at the present tick."""

    def actors(self) -> Sequence[Actor]:
        """Everybody else at the present tick, at least within 50 m of the ego's box; not the ego."""

    def expert(self) -> Decision:
        """The expert's decision on the present state; asked for at every tick, also while it is overridden."""

    def step(self, command: Command) -> None:
        """Drive the ego with a command for one tick of 0.05 s, and let everybody else act.

        Raises:
            WorldError: The simulator cannot go on.
        """


class CameraWorld(World, Protocol):
    """A world with cameras, for datasets that claim media."""

    def frames(self) -> Mapping[str, bytes]:
        """Encoded images, PNG or JPEG, of every declared camera at the present tick, by the camera's name.

        Asked for at saved observations that media cover, after the expert and before the step.
        """
