"""One rollout: a world driven from tick 0 by its expert, and by a policy while that is active.

The expert's command is rounded to float32 before anything uses it, and the world is driven with the very values that
are recorded. Rollouts end at saved observations, and none that has a branch ends before its intervention is over and a
margin has passed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.trigger import MARGIN_TICKS, ExpertTrace
from branchdrive.collector.world import Actor, Decision, Observation, Scene, World, WorldError
from branchdrive.contract.policy import ACTUATORS, Command, Policy
from branchdrive.contract.timing import ACTIVE_TICKS, CONTROL_HISTORY_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.route import project
from branchdrive.raw.rollout import Rollout

__all__ = ["RECOVERY_TICKS", "Drive", "Passage", "drive"]

_GOAL_M = 2.0
"""How far before the last vertex of its route a drive is completed."""

RECOVERY_TICKS = 100
"""Ticks that an intervention may take longer than the nominal rollout."""


@dataclass(eq=False)
class Drive:
    """A rollout that was executed, tick by tick.

    Attributes:
        scene: What the group shares.
        policy: The policy it executed.
        branch_tick: Where the policy took over; ``None`` without a branch.
        observations: The ego at every tick, and at the end where that is a saved observation.
        actors: Everybody else at every saved observation.
        decisions: The expert's decision, one for each observation.
        expert: The expert's commands ``[ticks, 3]``.
        applied: Applied commands ``[ticks, 3]``.
        nominal: Stored nominal commands ``[nominal ticks, 3]``; ``None`` without a branch.
        completion: Completion status of the route.
        termination: Why the rollout ended.
        partial_because: Why the attempt is only partial; empty if it is complete.
    """

    scene: Scene
    policy: Policy
    branch_tick: int | None
    nominal: NDArray[np.float32] | None
    observations: list[Observation] = field(default_factory=list)
    actors: list[list[Actor]] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    expert: list[Command] = field(default_factory=list)
    applied: list[Command] = field(default_factory=list)
    completion: Literal["completed", "timeout", "aborted"] = "timeout"
    termination: str = "out of time"
    partial_because: str = ""

    @property
    def num_ticks(self) -> int:
        """Ticks that were executed."""
        return len(self.applied)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Whether the policy drives ``[ticks]``."""
        ticks = np.arange(self.num_ticks)
        if self.branch_tick is None:
            return np.zeros(len(ticks), np.bool_)
        return (ticks >= self.branch_tick) & (ticks < self.branch_tick + self.policy.duration_ticks)

    @property
    def trace(self) -> ExpertTrace:
        """The expert along the rollout, for triggers; a branch lies where its history is complete."""
        decisions = self.decisions[: self.num_ticks]
        return ExpertTrace(
            throttle=np.array([command.throttle for command in self.expert], np.float32),
            brake=np.array([command.brake for command in self.expert], np.float32),
            lane_shift_m=np.array([decision.lane_shift_m for decision in decisions], np.float64),
            reacting=np.array([decision.is_reacting for decision in decisions], np.bool_),
            hazard_tick=CONTROL_HISTORY_TICKS + 1,
        )


def _no_frames(_: int) -> None:
    """No images are taken."""


class Passage:
    """A drive under way: the expert thinks on the present tick, and a command takes the world to the next.

    Args:
        world: The world, at tick 0 of the run's scene.
        run: What is filled; its branch and nominal commands decide when it is over at the latest.
        max_ticks: Ticks after which the route is given up.
        recovery_ticks: Ticks that an intervention may take longer than the nominal rollout.
        take_frames: Called with the tick of every saved observation, while the world is there.
    """

    def __init__(
        self,
        world: World,
        run: Drive,
        *,
        max_ticks: int,
        recovery_ticks: int = RECOVERY_TICKS,
        take_frames: Callable[[int], None] = _no_frames,
    ) -> None:
        self.run = run
        self._world, self._take_frames = world, take_frames
        self._is_over = _end_rule(run, max_ticks, recovery_ticks)
        self._expert = Command(*np.zeros(3, np.float32))

    @property
    def tick(self) -> int:
        """Ticks that were executed."""
        return self.run.num_ticks

    def think(self) -> Command | None:
        """The expert's command of the present tick, float32, as recorded; ``None`` where the drive is over.

        Raises:
            WorldError: The simulator cannot go on.
        """
        run, world, tick = self.run, self._world, self.tick
        is_saved = tick % OBSERVATION_STRIDE_TICKS == 0
        observation, actors, decision = world.observe(), world.actors() if is_saved else (), world.expert()
        if is_saved:
            self._take_frames(tick)
        run.observations.append(observation)
        run.decisions.append(decision)
        if is_saved:
            run.actors.append(list(actors))
            if self._is_over():
                return None
        self._expert = Command(*np.array([decision.steer, decision.throttle, decision.brake], np.float32))
        return self._expert

    def act(self, command: Command) -> None:
        """Drive the ego with a command for one tick, after `think`.

        Raises:
            WorldError: The simulator cannot go on.
        """
        self._world.step(command)
        self.run.expert.append(self._expert)
        self.run.applied.append(command)

    def fail(self, error: WorldError) -> None:
        """End the run where the simulator failed.

        Raises:
            WorldError: That error, before the first tick was over.
        """
        if not self.run.applied:
            raise error
        self.run.completion, self.run.termination = "aborted", "simulator failed"
        self.run.partial_because = str(error)


def drive(
    world: World,
    seed: int,
    policy: Policy,
    *,
    nominal: Rollout | None = None,
    max_ticks: int,
    take_frames: Callable[[int], None] = _no_frames,
) -> Drive:
    """Execute a policy from tick 0.

    Args:
        world: The world.
        seed: What it is reset with.
        policy: The nominal policy, or an intervention.
        nominal: The nominal rollout that the attempt replays; ``None`` for a nominal pass.
        max_ticks: Ticks after which the route is given up.
        take_frames: Called with the tick of every saved observation, while the world is there.

    Raises:
        WorldError: The simulator failed before the first tick was over.
    """
    scene = world.reset(seed)
    run = Drive(scene, policy, None, None) if nominal is None else _replay(scene, policy, nominal)
    passage = Passage(world, run, max_ticks=max_ticks, take_frames=take_frames)
    try:
        while (expert := passage.think()) is not None:
            passage.act(_command(run, run.num_ticks, expert))
    except WorldError as error:
        passage.fail(error)
    return run


def _replay(scene: Scene, policy: Policy, nominal: Rollout) -> Drive:
    applied = [nominal.column("controls", f"applied_{actuator}") for actuator in ACTUATORS]
    return Drive(scene, policy, nominal.branch_tick, np.stack(applied, axis=1))


def _command(run: Drive, tick: int, expert: Command) -> Command:
    """What drives at a tick: the policy while it is active, otherwise the expert."""
    if run.branch_tick is None or run.nominal is None:
        return expert
    if not run.branch_tick <= tick < run.branch_tick + run.policy.duration_ticks:
        return expert
    return run.policy.command(expert, Command(*run.nominal[tick]))


def _end_rule(run: Drive, max_ticks: int, recovery_ticks: int) -> Callable[[], bool]:
    """Whether the rollout ends at the present saved observation, and how."""
    route_x, route_y = (np.asarray(values, np.float64) for values in (run.scene.route_x_m, run.scene.route_y_m))
    goal_m = float(np.hypot(np.diff(route_x), np.diff(route_y)).sum()) - _GOAL_M
    required = 0 if run.branch_tick is None else run.branch_tick + ACTIVE_TICKS + MARGIN_TICKS
    limit = max_ticks if run.nominal is None else max(required, min(max_ticks, len(run.nominal) + recovery_ticks))

    def is_over() -> bool:
        if run.num_ticks < required:
            return False
        ego = run.observations[-1]
        if project(np.array([ego.x_m]), np.array([ego.y_m]), route_x, route_y).progress_m[0] >= goal_m:
            run.completion, run.termination = "completed", "end of route"
            return True
        return run.num_ticks >= limit

    return is_over
