"""When a rollout ends, and what that says about its route.

Rollouts end at observation ticks, so that the last observation and the controls after it stay
together. No rollout ends on its own before its intervention is over and a margin has passed; only
the route timeout can cut it off earlier, and then the attempt is partial.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive_reference.scenarios.trigger import MARGIN_TICKS
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO

__all__ = ["Completion", "Ending", "EndingRule"]

Completion: TypeAlias = Literal["completed", "timeout", "blocked", "deviated"]

_RECOVERY_TICKS = 100
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
        self._limit_ticks = None if nominal_ticks is None else nominal_ticks + _RECOVERY_TICKS
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
