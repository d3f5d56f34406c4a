"""Speed of the simulator with scenario logic and expert, over whole rollouts on one core.

A measurement executes one nominal rollout of every scenario type on a spread of routes, construction of the
world included, recording and writing excluded. Maps and compiled kernels are loaded before the clock starts.
"""

from __future__ import annotations

import statistics
import time

from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.simulation.rollout import run

__all__ = ["measure_ticks_per_s"]

_SEED = 7


def measure_ticks_per_s(*, num_rollouts: int = 24, repeats: int = 5) -> float:
    """Median over `repeats` of the ticks per process second of `num_rollouts` nominal rollouts."""
    specs = [plan_group(_SEED, index).spec for index in range(num_rollouts)]
    policy = load_action_bank().nominal
    ticks = sum(run(spec, policy).log.num_ticks for spec in specs)
    seconds = []
    for _ in range(repeats):
        begin_s = time.process_time()
        for spec in specs:
            run(spec, policy)
        seconds.append(time.process_time() - begin_s)
    return ticks / statistics.median(seconds)
