"""When a rollout ends, and what that says about its route.

Rollouts end at observation ticks, so that the last observation and the controls after it stay
together. No rollout ends on its own before its intervention is over and a margin has passed; only
the route timeout can cut it off earlier, and then the attempt is partial.

The line before a junction: which light governs the ego there, and whether it was crossed as it should be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from branchdrive.collector.trigger import MARGIN_TICKS
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO
from branchdrive_reference.world.priority import AT_LINE_M, STOPPED_MPS

__all__ = ["NO_LIGHT", "RECOVERY_TICKS", "Completion", "Ending", "EndingRule", "LineMonitor", "governing_light"]

Completion: TypeAlias = Literal["completed", "timeout", "blocked", "deviated"]

RECOVERY_TICKS = 100
"""Ticks that an intervention may take longer than the nominal rollout."""

_BLOCKED_TICKS = 400
_STANDSTILL_MPS = 0.05
_DEVIATED_M = 30.0


@dataclass(frozen=True)
class Ending:
    """How a rollout ended.

    Attributes:
        completion: Completion status of the route.
        termination: Why the rollout ended.
        partial_reason: Why the attempt is only partial, ``None`` if it is complete.
    """

    completion: Completion
    termination: str
    partial_reason: str | None = None


class EndingRule:
    """Watches one rollout.

    Args:
        timeout_ticks: Route timeout of the specification.
        branch_tick: Branch of an intervention, ``None`` for nominal rollouts and replays.
        nominal_ticks: Length of the nominal rollout that an intervention belongs to.
    """

    def __init__(self, timeout_ticks: int, branch_tick: int | None, nominal_ticks: int | None) -> None:
        self._timeout_ticks = timeout_ticks
        self._required_ticks = 0 if branch_tick is None else branch_tick + ACTIVE_TICKS + MARGIN_TICKS
        self._limit_ticks = None if nominal_ticks is None else nominal_ticks + RECOVERY_TICKS
        self._standing_ticks = 0

    @property
    def max_ticks(self) -> int:
        """No rollout has more ticks: the first observation tick at or after the timeout."""
        return -(-self._timeout_ticks // OBSERVATION_STRIDE_TICKS) * OBSERVATION_STRIDE_TICKS

    def check(self, world: World) -> Ending | None:
        """The ending, if the rollout ends before the present tick is executed; call it once a tick."""
        tick = world.tick
        standing = abs(world.bodies["speed_mps"][EGO]) < _STANDSTILL_MPS
        self._standing_ticks = self._standing_ticks + 1 if standing else 0
        if tick % OBSERVATION_STRIDE_TICKS:
            return None
        foot = world.feet[EGO_TRACK, EGO]
        is_early = tick < self._required_ticks
        if foot["arc_m"] >= world.tables.route.goal_m and not is_early:
            return Ending("completed", "route completed")
        if tick >= self._timeout_ticks:
            unfinished = is_early or self._limit_ticks is None
            reason = f"the simulator gave up at tick {tick}, before the rollout was finished"
            return Ending("timeout", "route timeout", reason if unfinished else None)
        if is_early:
            return None
        if self._standing_ticks >= _BLOCKED_TICKS:
            return Ending("blocked", "ego blocked")
        if abs(foot["offset_m"]) > _DEVIATED_M:
            return Ending("deviated", "route left")
        if self._limit_ticks is not None and tick >= self._limit_ticks:
            return Ending("timeout", "recovery time over")
        return None


NO_LIGHT = -1
"""No signal governs the ego."""

_GOVERNED_M = 80.0


def _to_line_m(world: World) -> float:
    """Way of the ego's front to the line of its route; infinite where there is none."""
    ego = world.feet[EGO_TRACK, EGO]
    return float(world.tables.tracks["stop_m"][EGO_TRACK] - ego["arc_m"] - ego["half_length_m"])


def governing_light(world: World) -> int:
    """`Light` that governs the ego: of the signal at most 80 m ahead, until the ego's front is at its line."""
    group = int(world.tables.tracks["group"][EGO_TRACK])
    if group == NO_GROUP or not 0.0 <= _to_line_m(world) <= _GOVERNED_M:
        return NO_LIGHT
    return int(world.lights[group])


class LineMonitor:
    """Counts crossings of the line before the junction that signal or sign forbid.

    The front's distance to the line is compared between decisions; the light of the moment decides.
    """

    def __init__(self) -> None:
        self.num_red_lights_run = 0
        self.num_stop_signs_run = 0
        self._before_m = math.nan
        self._stopped = False

    def watch(self, world: World) -> None:
        """Note the present tick; call it once a tick, before the world's tracks are updated for the next."""
        gap_m = _to_line_m(world)
        if math.isinf(gap_m):
            return
        track = world.tables.tracks[EGO_TRACK]
        speed = abs(float(world.feet["speed_mps"][EGO_TRACK, EGO]))
        if speed < STOPPED_MPS and 0.0 <= gap_m < AT_LINE_M:
            self._stopped = True
        if self._before_m >= 0.0 > gap_m:
            red = track["group"] != NO_GROUP and world.lights[track["group"]] == Light.RED
            self.num_red_lights_run += bool(red)
            self.num_stop_signs_run += bool(track["stop_sign"] and not self._stopped)
        self._before_m = gap_m
