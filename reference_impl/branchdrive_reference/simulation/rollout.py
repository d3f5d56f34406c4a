"""One rollout: a world driven by a policy from tick 0 to its end.

The expert's command is rounded to float32 before anything uses it, and the vehicle is driven with
the very float32 values that are recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.trigger import Branch, ExpertTrace
from branchdrive.contract.policy import Command, Policy
from branchdrive.errors import UsageError
from branchdrive_reference.expert.control import Cause
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.ending import Ending, EndingRule
from branchdrive_reference.simulation.log import Logger, RolloutLog
from branchdrive_reference.simulation.spec import WorldSpec
from branchdrive_reference.simulation.world import World

__all__ = ["Passage", "Run", "find_branch", "run"]


@dataclass(frozen=True, eq=False)
class Run:
    """A rollout that was executed.

    Attributes:
        spec: What its world was made from.
        policy: The policy it executed.
        branch_tick: Where the policy took over; ``None`` if it never did.
        nominal: Stored nominal commands, float32 ``[nominal ticks, 3]``; ``None`` without a branch.
        log: What was logged.
        ending: How it ended.
        hazard_tick: Tick at which the scenario's hazard became active; -1 if it never did.
    """

    spec: WorldSpec
    policy: Policy
    branch_tick: int | None
    nominal: NDArray[np.float32] | None
    log: RolloutLog
    ending: Ending
    hazard_tick: int

    def __repr__(self) -> str:
        key, ticks = self.policy.key, self.log.num_ticks
        return f"Run({key!r}, {self.spec}, {ticks} ticks, {self.ending.completion})"

    @property
    def active(self) -> NDArray[np.bool_]:
        """Whether the policy drives, ``[ticks]``."""
        ticks = np.arange(self.log.num_ticks)
        if self.branch_tick is None:
            return np.zeros(len(ticks), np.bool_)
        return (ticks >= self.branch_tick) & (ticks < self.branch_tick + self.policy.duration_ticks)


class Passage:
    """A rollout under way: the expert thinks on the present tick, and a command takes the world to the next.

    Args:
        spec: The world.
        branch_tick: Where an intervention takes over; ``None`` where none does.
        nominal_ticks: Length of the nominal rollout that it belongs to.
    """

    def __init__(self, spec: WorldSpec, *, branch_tick: int | None = None, nominal_ticks: int | None = None) -> None:
        self._world = World(spec)
        self._rule = EndingRule(spec.timeout_ticks, branch_tick, nominal_ticks)
        self._logger = Logger(self._rule.max_ticks, len(self._world.bodies))
        self._ending: Ending | None = None

    @property
    def tick(self) -> int:
        """Ticks that were executed."""
        return self._world.tick

    def think(self) -> Command | None:
        """The expert's command of the present tick, float32, as recorded; ``None`` where the rollout is over."""
        self._world.think()
        self._ending = self._rule.check(self._world)
        return None if self._ending is not None else Command(*self._logger.begin_tick(self._world))

    def act(self, command: Command) -> None:
        """Drive the ego with a command for one tick, after `think`."""
        applied = np.asarray(command, np.float32)
        self._world.act(*applied.tolist())
        self._logger.end_tick(self._world, applied)

    def run(self, policy: Policy, branch_tick: int | None, nominal: NDArray[np.float32] | None) -> Run:
        """What was executed so far; before its end with the present tick, whose command is still 0.

        Args:
            policy: The policy that it is recorded under.
            branch_tick: Where the policy took over.
            nominal: Stored nominal commands, float32 ``[nominal ticks, 3]``.
        """
        is_over = self._ending is not None
        log = self._logger.finish(self._world.tick + (not is_over))
        ending = self._ending or Ending("timeout", "under way", "under way")
        return Run(self._world.spec, policy, branch_tick, nominal, log, ending, self._world.scene.hazard_tick)


def run(
    spec: WorldSpec,
    policy: Policy,
    *,
    branch_tick: int | None = None,
    nominal: NDArray[np.float32] | None = None,
) -> Run:
    """Execute a policy from tick 0: the online expert, then the policy while active, then the expert.

    Args:
        spec: The world.
        policy: The nominal policy, or an intervention.
        branch_tick: Where an intervention takes over.
        nominal: Applied commands of the nominal rollout, float32 ``[ticks, 3]``, for an intervention.

    Raises:
        UsageError: An intervention lacks its branch tick or nominal commands, or the nominal
            rollout ends before the intervention does.
    """
    if policy.is_nominal:
        branch_tick = nominal = None
    elif branch_tick is None or nominal is None or len(nominal) < branch_tick + policy.duration_ticks:
        raise UsageError(f"policy {policy.key!r} needs a branch tick and nominal commands up to its end")
    passage = Passage(spec, branch_tick=branch_tick, nominal_ticks=None if nominal is None else len(nominal))
    while (command := passage.think()) is not None:
        if branch_tick is not None and nominal is not None:
            since_branch = passage.tick - branch_tick
            if 0 <= since_branch < policy.duration_ticks:
                command = policy.command(command, Command(*nominal[passage.tick]))
        passage.act(command)
    return passage.run(policy, branch_tick, nominal)


def find_branch(nominal: Run) -> Branch | None:
    """Where the scenario's trigger places the branch in a completed nominal rollout."""
    log = nominal.log
    reacting = log.cause != Cause.CRUISE
    trace = ExpertTrace(log.expert[:, 1], log.expert[:, 2], log.lane_shift_m, reacting, nominal.hazard_tick)
    return SCENARIOS[nominal.spec.scenario_type].trigger.evaluate(trace)
