"""What a rollout leaves behind while it runs: flat arrays, written once per tick and once per observation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive_reference.expert.control import PLAN
from branchdrive_reference.simulation.ending import NO_LIGHT, LineMonitor, governing_light
from branchdrive_reference.simulation.world import World
from branchdrive_reference.world.body import BODY
from branchdrive_reference.world.vehicle import VEHICLE

__all__ = ["Logger", "RolloutLog"]


@dataclass(frozen=True, eq=False, repr=False)
class RolloutLog:
    """Arrays of one rollout.

    Attributes:
        expert: Online expert's commands, float32 ``[ticks, 3]`` in the order of the actuators.
        applied: Applied commands, float32 ``[ticks, 3]``.
        lane_shift_m: Expert's planned offset at the sighted point ``[ticks]``.
        cause: `Cause` that sets the expert's acceleration ``[ticks]``.
        bodies: `BODY` rows of every observation ``[observations, bodies]``.
        vehicle: `VEHICLE` rows ``[observations]``.
        plan: `PLAN` rows ``[observations]``: the decision of the observation's tick.
        touching: Bodies that the ego touched since the previous observation ``[observations, bodies]``.
        light: `Light` of the signal that governs the ego, `NO_LIGHT` where none does ``[observations]``.
        num_red_lights_run: Stop lines that the ego crossed at a red light.
        num_stop_signs_run: Stop lines that the ego crossed without having stopped at their stop sign.
    """

    expert: NDArray[np.float32]
    applied: NDArray[np.float32]
    lane_shift_m: NDArray[np.float64]
    cause: NDArray[np.int64]
    bodies: NDArray[np.void]
    vehicle: NDArray[np.void]
    plan: NDArray[np.void]
    touching: NDArray[np.bool_]
    light: NDArray[np.int64]
    num_red_lights_run: int
    num_stop_signs_run: int

    @property
    def num_ticks(self) -> int:
        """Ticks that were executed."""
        return len(self.applied)

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Whether the ego touched anything since the previous observation ``[observations]``."""
        return np.asarray(self.touching.any(axis=1))

    @property
    def collided(self) -> NDArray[np.bool_]:
        """Whether the ego ever touched a body, up to the last observation ``[bodies]``."""
        return np.asarray(self.touching.any(axis=0))

    def __repr__(self) -> str:
        frames, bodies = self.bodies.shape
        return f"RolloutLog({self.num_ticks} ticks, {frames} observations, {bodies} bodies)"


class Logger:
    """Fills the arrays of a rollout of at most `max_ticks` ticks."""

    def __init__(self, max_ticks: int, num_bodies: int) -> None:
        frames = -(-max_ticks // OBSERVATION_STRIDE_TICKS)
        self._expert = np.zeros((max_ticks, 3), np.float32)
        self._applied = np.zeros((max_ticks, 3), np.float32)
        self._lane_shift_m = np.zeros(max_ticks)
        self._cause = np.zeros(max_ticks, np.int64)
        self._bodies = np.zeros((frames, num_bodies), BODY)
        self._vehicle = np.zeros(frames, VEHICLE)
        self._plan = np.zeros(frames, PLAN)
        self._touched = np.zeros((frames, num_bodies), np.bool_)
        self._light = np.full(frames, NO_LIGHT, np.int64)
        self._touching = np.zeros(num_bodies, np.bool_)
        self._infractions = LineMonitor()

    def begin_tick(self, world: World) -> NDArray[np.float32]:
        """Log the expert's decision and, at an observation tick, the state it was made on.

        Returns:
            The expert's command ``[3]``, as recorded.
        """
        tick, plan = world.tick, world.plan[0]
        command: NDArray[np.float32] = self._expert[tick]
        command[:] = plan["steer"], plan["throttle"], plan["brake"]
        self._lane_shift_m[tick] = plan["sighted_offset_m"]
        self._cause[tick] = plan["cause"]
        if tick % OBSERVATION_STRIDE_TICKS == 0:
            frame = tick // OBSERVATION_STRIDE_TICKS
            self._bodies[frame] = world.bodies
            world.noise.disturb_observation(self._bodies[frame], tick)
            self._vehicle[frame] = world.vehicle[0]
            self._plan[frame] = plan
            self._touched[frame] = self._touching
            self._light[frame] = governing_light(world)
            self._touching[:] = False
        return command

    def end_tick(self, world: World, applied: NDArray[np.float32]) -> None:
        """Log what was applied and touched; call it after the world has acted."""
        self._applied[world.tick - 1] = applied
        self._infractions.watch(world)
        self._touching |= world.contacts.touching

    def finish(self, num_ticks: int) -> RolloutLog:
        """The log of the first `num_ticks` ticks."""
        frames = -(-num_ticks // OBSERVATION_STRIDE_TICKS)
        return RolloutLog(
            self._expert[:num_ticks],
            self._applied[:num_ticks],
            self._lane_shift_m[:num_ticks],
            self._cause[:num_ticks],
            self._bodies[:frames],
            self._vehicle[:frames],
            self._plan[:frames],
            self._touched[:frames],
            self._light[:frames],
            self._infractions.num_red_lights_run,
            self._infractions.num_stop_signs_run,
        )
