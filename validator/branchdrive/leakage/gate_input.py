"""Features of the leakage gate, each with the window that it was taken from.

Discrepancies and availability are one feature each; every variable of the ego history is one feature at
each of 16 observations, and every control one for each mean over 5 ticks.

Source: this project's choice.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS, OBSERVATION_STRIDE_TICKS
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.quality.threshold import VARIABLES

__all__ = ["CONTROL_SPANS", "GateFeature", "Source", "gate_features", "pooled_controls"]

Array = NDArray[np.float64]
Source = Literal["discrepancy", "ego", "controls", "availability"]

CONTROL_SPANS = tuple(
    (start, start + OBSERVATION_STRIDE_TICKS - 1)
    for start in range(-CONTROL_HISTORY_TICKS, 0, OBSERVATION_STRIDE_TICKS)
)
"""First and last offset from ``t_b`` of the controls that one mean is taken over: -80 .. -76, .. -5 .. -1."""


class GateFeature(NamedTuple):
    """One feature.

    Attributes:
        source: Array of `ReplayInputs` that it is taken from.
        name: Variable.
        offset_ticks: First and last offset from ``t_b``; None where it is of the whole window.
    """

    source: Source
    name: str
    offset_ticks: tuple[int, int] | None


def pooled_controls(inputs: ReplayInputs) -> Array:
    """Controls averaged over 5 ticks, ``[groups, actions, 16, controls]``; NaN where one of the five is missing."""
    groups, actions, _, controls = inputs.controls.shape
    spans = inputs.controls.reshape(groups, actions, len(CONTROL_SPANS), OBSERVATION_STRIDE_TICKS, controls)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(spans.mean(axis=3))


def gate_features(inputs: ReplayInputs) -> tuple[Array, tuple[GateFeature, ...]]:
    """Features of all interventions ``[groups, actions - 1, features]``, and what they are; the nominal stays out."""
    groups, actions = inputs.num_groups, len(inputs.action_keys)
    blocks = [
        inputs.discrepancy,
        inputs.ego.reshape(groups, actions, len(HISTORY_OFFSETS) * len(inputs.ego_names)),
        pooled_controls(inputs).reshape(groups, actions, len(CONTROL_SPANS) * len(inputs.control_names)),
        inputs.availability,
    ]
    features = (
        *(GateFeature("discrepancy", variable.name, None) for variable in VARIABLES),
        *(GateFeature("ego", name, (tick, tick)) for tick in HISTORY_OFFSETS for name in inputs.ego_names),
        *(GateFeature("controls", name, span) for span in CONTROL_SPANS for name in inputs.control_names),
        *(GateFeature("availability", name, None) for name in inputs.availability_names),
    )
    return np.concatenate(blocks, axis=2)[:, list(inputs.interventions)], features
