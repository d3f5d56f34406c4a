"""Replays in which nothing leaks: every group a drive of its own, every replay that drive and some noise."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.replays import EGO_NAMES
from branchdrive.quality.threshold import VARIABLES

CONTROLS = ("steer", "throttle", "brake")


def replay_inputs(
    num_groups: int, *, seed: int, num_actions: int = 5, noise: float = 0.1, partitions: tuple[str, ...] | None = None
) -> ReplayInputs:
    """Replays of drives; without noise they are bit-identical."""
    rng = np.random.default_rng(seed)
    rows = (num_groups, num_actions)
    ego = rng.normal(size=(num_groups, 1, 16, len(EGO_NAMES))).cumsum(axis=2)
    controls = rng.normal(size=(num_groups, 1, 80, len(CONTROLS)))
    spread = noise * np.exp(0.3 * rng.normal(size=(num_groups, 1, 1, 1)))
    shares = rng.choice([1.0, 0.9], size=(*rows, 2), p=[0.9, 0.1]) if noise else np.ones((*rows, 2))
    return ReplayInputs(
        group_ids=tuple(f"g{index:05d}" for index in range(num_groups)),
        partitions=partitions or tuple(("train", "train", "test", "train", "val")[g % 5] for g in range(num_groups)),
        action_keys=tuple(f"action-{index}" for index in range(num_actions)),
        nominal_index=0,
        availability_names=("observations", "controls"),
        ego_names=EGO_NAMES,
        control_names=CONTROLS,
        availability=shares,
        discrepancy=np.abs(spread[..., 0] * rng.standard_t(4, size=(*rows, len(VARIABLES)))),
        ego=ego + spread * rng.normal(size=(*rows, 16, len(EGO_NAMES))),
        controls=controls + spread * rng.normal(size=(*rows, 80, len(CONTROLS))),
        has_nominal_replay=np.ones(num_groups, np.bool_),
    )


def changed(inputs: ReplayInputs, **values: Any) -> ReplayInputs:
    """The inputs with other fields."""
    return dataclasses.replace(inputs, **values)
