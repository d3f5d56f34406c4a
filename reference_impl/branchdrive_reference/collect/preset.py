"""Presets of a collection: how many groups, how noisy, with which faults.

`paper` leaves a funnel of the paper's shape; docs/decisions/0012-faults-as-declared-rates.md derives
its rates. Source: paper V-A, table of the population.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from branchdrive_reference.collect.fault import Fault

__all__ = ["FAULT_PRESETS", "PRESETS", "Preset"]


@dataclass(frozen=True)
class Preset:
    """Defaults of a collection.

    Attributes:
        num_groups: Branch groups.
        replay_noise: Strength of the noise of replays.
        faults: Rates of injected faults by name.
    """

    num_groups: int
    replay_noise: float = 0.0
    faults: Mapping[str, float] = field(default_factory=dict)


PRESETS: Mapping[str, Preset] = {
    "demo": Preset(num_groups=29),
    "benchmark": Preset(
        num_groups=1_000,
        replay_noise=1.0,
        faults={
            Fault.PARTIAL: 0.008,
            Fault.QUARANTINED: 0.002,
            Fault.EARLY_BRANCH: 0.001,
            Fault.LATE_BRANCH: 0.001,
            Fault.WRONG_DURATION: 0.001,
            Fault.TRUNCATED_LOG: 0.0005,
            Fault.DROPPED_FRAME: 0.0005,
            Fault.UNRETRIED: 0.05,
            Fault.DUPLICATE: 0.01,
            Fault.ABANDONED: 0.03,
            Fault.SEED_DISAGREEMENT: 0.003,
            Fault.ONLINE_STEERING: 0.05,
        },
    ),
    "paper": Preset(
        num_groups=2_467,
        replay_noise=1.0,
        faults={
            Fault.PARTIAL: 0.013,
            Fault.QUARANTINED: 0.004,
            Fault.EARLY_BRANCH: 0.01,
            Fault.LATE_BRANCH: 0.01,
            Fault.WRONG_DURATION: 0.017,
            Fault.TRUNCATED_LOG: 0.005,
            Fault.DROPPED_FRAME: 0.002,
            Fault.UNRETRIED: 0.2,
            Fault.DUPLICATE: 0.014,
            Fault.ABANDONED: 0.242,
            Fault.SEED_DISAGREEMENT: 0.0032,
            Fault.ONLINE_STEERING: 0.388,
        },
    ),
}
"""Presets by name."""

FAULT_PRESETS: Mapping[str, Mapping[str, float]] = {
    name: preset.faults for name, preset in PRESETS.items() if preset.faults
}
"""Rates of the presets that have any, by the preset's name."""
