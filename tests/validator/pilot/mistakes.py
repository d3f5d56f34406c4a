"""Mistakes of collectors as worlds around a world: what each makes of one and the same drive.

A mistake is planted where a collector makes it, between the simulator and what is recorded, so that one definition
serves all worlds. What a simulator gives has another frame, unit or time than it should; commands reach it otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import branchdrive as bd
from branchdrive.contract.timing import TICK_S
from branchdrive.driving.angle import wrap_rad

Element = Mapping[str, Any]


class Planted:
    """A world as it is; mistakes override what they get wrong."""

    def __init__(self, make: Callable[[], bd.World]) -> None:
        self.world = make()

    def reset(self, seed: int) -> bd.Scene:
        return self.world.reset(seed)

    def observe(self) -> bd.Observation:
        return self.world.observe()

    def actors(self) -> Sequence[bd.Actor]:
        return self.world.actors()

    def expert(self) -> bd.Decision:
        return self.world.expert()

    def step(self, command: bd.Command) -> None:
        self.world.step(command)

    @staticmethod
    def element(element: Element) -> Element:
        """An element of a map as the collector with the mistake writes it."""
        return element


def moved(ego: bd.Observation, ticks: int) -> bd.Observation:
    """The ego so many ticks later, or earlier, at constant velocity."""
    way_m = ego.speed_mps * ticks * TICK_S
    return replace(ego, x_m=ego.x_m + way_m * math.cos(ego.yaw_rad), y_m=ego.y_m + way_m * math.sin(ego.yaw_rad))


def drifted(actor: bd.Actor, ticks: int) -> bd.Actor:
    """An actor so many ticks later, or earlier, at constant velocity."""
    time_s = ticks * TICK_S
    return replace(actor, x_m=actor.x_m + actor.vel_x_mps * time_s, y_m=actor.y_m + actor.vel_y_mps * time_s)


class SpeedInKmh(Planted):
    """The ego's speed in km/h."""

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        return replace(ego, speed_mps=3.6 * ego.speed_mps)


class ActorsInKmh(Planted):
    """Velocities of actors in km/h."""

    def actors(self) -> Sequence[bd.Actor]:
        return [replace(a, vel_x_mps=3.6 * a.vel_x_mps, vel_y_mps=3.6 * a.vel_y_mps) for a in self.world.actors()]


class Degrees(Planted):
    """Headings in degrees."""

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        return replace(ego, yaw_rad=math.degrees(wrap_rad(ego.yaw_rad)))

    def actors(self) -> Sequence[bd.Actor]:
        return [replace(actor, yaw_rad=math.degrees(wrap_rad(actor.yaw_rad))) for actor in self.world.actors()]


class Compass(Planted):
    """Headings clockwise from the y axis."""

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        return replace(ego, yaw_rad=math.pi / 2 - ego.yaw_rad)

    def actors(self) -> Sequence[bd.Actor]:
        return [replace(actor, yaw_rad=math.pi / 2 - actor.yaw_rad) for actor in self.world.actors()]


class MirroredHeading(Planted):
    """Headings clockwise, positions as they should be."""

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        return replace(ego, yaw_rad=-ego.yaw_rad)

    def actors(self) -> Sequence[bd.Actor]:
        return [replace(actor, yaw_rad=-actor.yaw_rad) for actor in self.world.actors()]


class MirroredSteering(Planted):
    """Steering is positive to the left."""

    def expert(self) -> bd.Decision:
        decision = self.world.expert()
        return replace(decision, steer=-decision.steer)

    def step(self, command: bd.Command) -> None:
        self.world.step(command._replace(steer=-command.steer))


class MirroredWorld(Planted):
    """A left-handed simulator, recorded as it is."""

    def reset(self, seed: int) -> bd.Scene:
        scene = self.world.reset(seed)
        return replace(scene, route_y_m=[-y for y in scene.route_y_m])

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        given = {name: getattr(ego, name) for name in ("yaw_rate_radps", "accel_lateral_mps2")}
        mirrored = {name: None if value is None else -value for name, value in given.items()}
        return replace(ego, y_m=-ego.y_m, yaw_rad=-ego.yaw_rad, **mirrored)

    def actors(self) -> Sequence[bd.Actor]:
        return [
            replace(actor, y_m=-actor.y_m, yaw_rad=-actor.yaw_rad, vel_y_mps=-actor.vel_y_mps)
            for actor in self.world.actors()
        ]

    @staticmethod
    def element(element: Element) -> Element:
        return {**element, "y_m": [-y for y in element["y_m"]]}


class SwappedPedals(Planted):
    """Throttle is recorded as brake, and brake as throttle."""

    def expert(self) -> bd.Decision:
        decision = self.world.expert()
        return replace(decision, throttle=decision.brake, brake=decision.throttle)

    def step(self, command: bd.Command) -> None:
        self.world.step(command._replace(throttle=command.brake, brake=command.throttle))


class LateCommands(Planted):
    """The simulator gets a command one tick after it was given."""

    def reset(self, seed: int) -> bd.Scene:
        self.waiting: bd.Command | None = None
        return self.world.reset(seed)

    def step(self, command: bd.Command) -> None:
        self.world.step(command if self.waiting is None else self.waiting)
        self.waiting = command


class LateObservations(Planted):
    """What is recorded at a tick is the state of `TICKS` before it."""

    TICKS = 5

    def reset(self, seed: int) -> bd.Scene:
        self.past: list[tuple[bd.Observation, list[bd.Actor]]] = []
        return self.world.reset(seed)

    def observe(self) -> bd.Observation:
        self.past.append((self.world.observe(), list(self.world.actors())))
        place = len(self.past) - 1 - self.TICKS
        return self.past[place][0] if place >= 0 else moved(self.past[0][0], place)

    def actors(self) -> Sequence[bd.Actor]:
        place = len(self.past) - 1 - self.TICKS
        return self.past[place][1] if place >= 0 else [drifted(actor, place) for actor in self.past[0][1]]


class LateByATick(LateObservations):
    """What is recorded at a tick is the state of the tick before it."""

    TICKS = 1


class EarlyObservations(Planted):
    """What is recorded at a tick is the state of `TICKS` after it: rows are filled when the world is there.

    At the end of a rollout, where the world does not get there, they are filled with constant velocity.
    """

    TICKS = 5

    def reset(self, seed: int) -> bd.Scene:
        self.rows: list[bd.Observation] = []
        self.others: dict[int, list[bd.Actor]] = {}
        return self.world.reset(seed)

    def observe(self) -> bd.Observation:
        present, tick = self.world.observe(), len(self.rows)
        if tick >= self.TICKS:
            _fill(self.rows[tick - self.TICKS], present)
        if (waiting := self.others.get(tick - self.TICKS)) is not None:
            here = {actor.actor_id: actor for actor in self.world.actors()}
            for actor in waiting:
                _fill(actor, here.get(actor.actor_id, actor))
        self.rows.append(moved(present, self.TICKS))
        for ahead, row in enumerate(self.rows[-self.TICKS :], 1):
            _fill(row, moved(present, ahead))
        return self.rows[-1]

    def actors(self) -> Sequence[bd.Actor]:
        self.others[len(self.rows) - 1] = found = [drifted(actor, self.TICKS) for actor in self.world.actors()]
        return found


class EarlyByATick(EarlyObservations):
    """What is recorded at a tick is the state behind its step."""

    TICKS = 1


def _fill(row: Any, other: Any) -> None:
    """Give a frozen row the values of another one."""
    for name, value in vars(other).items():
        object.__setattr__(row, name, value)


class HalfExtents(Planted):
    """Boxes from their centre to their sides."""

    def reset(self, seed: int) -> bd.Scene:
        return _halved(self.world.reset(seed), "ego_")

    def actors(self) -> Sequence[bd.Actor]:
        return [_halved(actor) for actor in self.world.actors()]


def _halved(box: Any, prefix: str = "") -> Any:
    sides = (f"{prefix}{side}_m" for side in ("length", "width", "height"))
    return replace(box, **{side: None if (size := getattr(box, side)) is None else size / 2 for side in sides})


class RearAxle(Planted):
    """The ego's position is that of its rear axle, behind the centre of its box."""

    AHEAD_M = 1.4

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        x, y = bd.box_centre(ego.x_m, ego.y_m, ego.yaw_rad, -self.AHEAD_M)
        return replace(ego, x_m=x, y_m=y)


class YawRateSign(Planted):
    """The yaw rate is clockwise, the heading is not."""

    def reset(self, seed: int) -> bd.Scene:
        self.yaw_rad: float | None = None
        return self.world.reset(seed)

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        turned = 0.0 if self.yaw_rad is None else float(wrap_rad(ego.yaw_rad - self.yaw_rad))
        self.yaw_rad = ego.yaw_rad
        return replace(ego, yaw_rate_radps=-turned / TICK_S)


class YawRateInDegrees(YawRateSign):
    """The yaw rate is in degrees per second."""

    def observe(self) -> bd.Observation:
        ego = super().observe()
        return replace(ego, yaw_rate_radps=-math.degrees(ego.yaw_rate_radps or 0.0))


class KeptState(Planted):
    """The wheels of a rollout are trimmed by what is left of those before it."""

    num_rollouts = 0

    def reset(self, seed: int) -> bd.Scene:
        self.num_rollouts += 1
        return self.world.reset(seed)

    def step(self, command: bd.Command) -> None:
        self.world.step(command._replace(steer=command.steer + 0.002 * (self.num_rollouts % 3)))


class IgnoredCommands(Planted):
    """The simulator's own driver goes on, whatever is commanded."""

    def expert(self) -> bd.Decision:
        self.decision = self.world.expert()
        return self.decision

    def step(self, command: bd.Command) -> None:
        own = self.decision
        self.world.step(bd.Command(own.steer, own.throttle, own.brake))


class LongTicks(Planted):
    """A tick is `FACTOR` times as long as it should be: so much further does everybody get at the speed that they have.

    Motion is that of a world that is larger by the factor, and so are rates that follow from neighbouring ticks.
    """

    FACTOR = 1.05

    def reset(self, seed: int) -> bd.Scene:
        scene = self.world.reset(seed)
        x, y = ([self.FACTOR * value for value in values] for values in (scene.route_x_m, scene.route_y_m))
        return replace(scene, route_x_m=x, route_y_m=y)

    def observe(self) -> bd.Observation:
        ego = self.world.observe()
        return replace(ego, x_m=self.FACTOR * ego.x_m, y_m=self.FACTOR * ego.y_m)

    def actors(self) -> Sequence[bd.Actor]:
        return [replace(a, x_m=self.FACTOR * a.x_m, y_m=self.FACTOR * a.y_m) for a in self.world.actors()]

    @classmethod
    def element(cls, element: Element) -> Element:
        return {**element, **{name: [cls.FACTOR * v for v in element[name]] for name in ("x_m", "y_m", "width_m")}}


class TenHertz(LongTicks):
    """A simulator at 10 Hz whose ticks are recorded as 20 Hz."""

    FACTOR = 2.0


class ConstantTarget(Planted):
    """A target speed that nobody computed."""

    def expert(self) -> bd.Decision:
        return replace(self.world.expert(), target_speed_mps=10.0)
