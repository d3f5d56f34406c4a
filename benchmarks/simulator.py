"""Speed of the simulator with scenario logic and expert, over whole rollouts on one core.

A measurement executes one nominal rollout of every scenario type on a spread of routes, construction of the
world included, recording and writing excluded. Maps and compiled kernels are loaded before the clock starts.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

from benchmarks.row import Row
from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.scenarios.registry import SCENARIOS
from branchdrive_reference.simulation.rollout import Run, run
from branchdrive_reference.world.body import Behaviour

__all__ = ["Rollouts", "measure_ticks_per_s", "rows"]

_SEED = 7


def _num_driving(executed: Run) -> int:
    """Vehicles and cycles that drove, the ego among them."""
    bodies = executed.log.bodies[0]
    return int(((bodies["behaviour"] == Behaviour.FOLLOWING) | (bodies["behaviour"] == Behaviour.DRIVEN)).sum())


class Rollouts:
    """The rollouts of a measurement, executed once when they are made, so that everything is loaded.

    Attributes:
        num_ticks: Ticks of all rollouts.
        num_vehicles: Mean number of vehicles and cycles that drive in a world, the ego among them.
    """

    def __init__(self, num_rollouts: int) -> None:
        self._specs = [plan_group(_SEED, index).spec for index in range(num_rollouts)]
        self._policy = load_action_bank().nominal
        executed = [run(spec, self._policy) for spec in self._specs]
        self.num_ticks = sum(one.log.num_ticks for one in executed)
        self.num_vehicles = statistics.mean(_num_driving(one) for one in executed)

    def ticks_per_s(self) -> float:
        """Ticks per process second of executing every rollout once."""
        begin_s = time.process_time()
        for spec in self._specs:
            run(spec, self._policy)
        return self.num_ticks / (time.process_time() - begin_s)


def measure_ticks_per_s(*, num_rollouts: int = len(SCENARIOS), repeats: int = 5) -> float:
    """Median over `repeats` of the ticks per process second of `num_rollouts` nominal rollouts."""
    rollouts = Rollouts(num_rollouts)
    return statistics.median(rollouts.ticks_per_s() for _ in range(repeats))


def rows() -> Iterator[Row]:
    """Speed against the budget."""
    yield Row("simulator + expert, one core", f"{measure_ticks_per_s():,.0f} ticks/s", ">= 5,000 ticks/s")
