"""The simulator with its expert against highway-env, side by side.

Both run at 20 Hz with about as many driving vehicles on one core, ours whole nominal rollouts, theirs
``highway-v0`` with kinematics observation and an ego that its intelligent driver model drives, so that it lasts.
Building a world is inside both clocks. Both report process time, in turns, as medians.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from benchmarks.row import Row
from benchmarks.simulator import Rollouts
from branchdrive.contract.timing import TICK_S
from branchdrive.runtime.environment import install_command
from branchdrive_reference.scenarios.registry import SCENARIOS

__all__ = ["INSTALL", "Comparison", "compare", "rows"]

INSTALL = install_command("bench")
_SEED = 7
_IDLE = 1
_WHAT = "simulator + expert / highway-env, one core"
_BAR = ">= 25x"


@dataclass(frozen=True)
class Comparison:
    """Medians over repeats, and how many vehicles drove on either side, the egos among them."""

    ours_ticks_per_s: float
    theirs_ticks_per_s: float
    our_vehicles: float
    their_vehicles: float

    @property
    def ratio(self) -> float:
        """How many times faster ours is."""
        return self.ours_ticks_per_s / self.theirs_ticks_per_s


class _Highway:
    """A highway with a fixed number of vehicles.

    Raises:
        ModuleNotFoundError: highway-env is not installed.
    """

    def __init__(self, num_vehicles: int) -> None:
        import gymnasium
        import highway_env  # noqa: F401  registers the environments

        frequency = round(1 / TICK_S)
        config = {
            "observation": {"type": "Kinematics"},
            "simulation_frequency": frequency,
            "policy_frequency": frequency,
            "vehicles_count": num_vehicles - 1,  # beside the ego
            "duration": 1_000_000,
        }
        self._env: Any = gymnasium.make("highway-v0", config=config)
        self._counts: list[int] = []

    @property
    def num_vehicles(self) -> float:
        """Mean number of vehicles on the road in all ticks so far."""
        return statistics.mean(self._counts)

    def ticks_per_s(self, num_ticks: int) -> float:
        """Ticks per process second of `num_ticks` ticks from a fresh start."""
        begin_s = time.process_time()
        self._reset()
        for _ in range(num_ticks):
            *_, terminated, truncated, _ = self._env.step(_IDLE)
            self._counts.append(len(self._env.unwrapped.road.vehicles))
            if terminated or truncated:
                self._reset()
        return num_ticks / (time.process_time() - begin_s)

    def _reset(self) -> None:
        from highway_env.vehicle.behavior import IDMVehicle

        self._env.reset(seed=_SEED)
        world = self._env.unwrapped
        driver = IDMVehicle.create_from(world.vehicle)
        world.road.vehicles[world.road.vehicles.index(world.vehicle)] = driver
        world.vehicle = driver


def compare(*, num_rollouts: int = len(SCENARIOS), num_ticks: int = 600, repeats: int = 5) -> Comparison:
    """Run both sides in turns.

    Args:
        num_rollouts: Rollouts of ours in every repeat.
        num_ticks: Ticks of theirs in every repeat.
        repeats: Repeats of either side.

    Raises:
        ModuleNotFoundError: highway-env is not installed.
    """
    rollouts = Rollouts(num_rollouts)
    highway = _Highway(round(rollouts.num_vehicles))
    highway.ticks_per_s(1)
    speeds = [(rollouts.ticks_per_s(), highway.ticks_per_s(num_ticks)) for _ in range(repeats)]
    ours, theirs = (statistics.median(side) for side in zip(*speeds, strict=True))
    return Comparison(ours, theirs, rollouts.num_vehicles, highway.num_vehicles)


def rows() -> Iterator[Row]:
    """The ratio against its bar, or how to install what it takes."""
    try:
        found = compare()
    except ModuleNotFoundError as error:
        yield Row(_WHAT, f"not measured, {error.name} is not installed: {INSTALL}", _BAR)
        return
    vehicles = f"{found.our_vehicles:.1f} against {found.their_vehicles:.1f} driving vehicles, 20 Hz"
    speeds = f"{found.ours_ticks_per_s:,.0f} / {found.theirs_ticks_per_s:,.0f} ticks/s = {found.ratio:.0f}x"
    yield Row(f"{_WHAT}\n{vehicles}", speeds, _BAR)
