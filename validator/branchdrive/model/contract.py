"""Inputs and targets of models as types: one for each input contract, none of which is another.

A function that takes `SensorInputs` cannot be handed anything that the ego vehicle could not know on the road.
No type has an identifier: rows are in the order of `ModelLayer.groups`, candidates in that of
`ModelLayer.candidate_order`.

Source: paper, "Recorded Modalities" and "Model Inputs and Targets"; spec/12-model.md#contracts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MixedInputs", "ModelTargets", "ObjectsInputs", "PrivilegedInputs", "SensorInputs"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class _Shown:
    """Shows shapes and types of its arrays instead of their values."""

    def __repr__(self) -> str:
        parts = []
        for field in fields(self):  # type: ignore[arg-type]
            values: NDArray[Any] = getattr(self, field.name)
            parts.append(f"{field.name} {values.dtype} {list(values.shape)}")
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, repr=False, eq=False)
class SensorInputs(_Shown):
    """What the ego vehicle can know on the road.

    Attributes:
        state: State history ``[N, 16, 21]``, ``t_b - 75 .. t_b``.
        controls: Controls that reached the vehicle ``[N, 80, 3]``, ``t_b - 80 .. t_b - 1``.
    """

    state: Array
    controls: Array


@dataclass(frozen=True, repr=False, eq=False)
class ObjectsInputs(_Shown):
    """`SensorInputs`, and what sensors of the vehicle tell of others.

    Attributes:
        state: State history ``[N, 16, 21]``.
        controls: Controls that reached the vehicle ``[N, 80, 3]``.
        objects: Objects of each observation ``[N, 16, 32, 11]`` float32 in their units, never normalised; features
            are those of `branchdrive.model.features.OBJECT_FEATURES`, and an unused place is 0.
        objects_available: Which places have an object ``[N, 16, 32]``, the first of each observation.
    """

    state: Array
    controls: Array
    objects: NDArray[np.float32]
    objects_available: Mask


@dataclass(frozen=True, repr=False, eq=False)
class MixedInputs(_Shown):
    """`SensorInputs`, and what the privileged expert computes.

    Attributes:
        state: State history ``[N, 16, 21]``.
        controls: Controls that reached the vehicle ``[N, 80, 3]``.
        expert: Target speed and hazard flags ``[N, 16, 4]``.
    """

    state: Array
    controls: Array
    expert: Array


@dataclass(frozen=True, repr=False, eq=False)
class PrivilegedInputs(_Shown):
    """`MixedInputs`, and privileged evidence around the vehicle.

    Attributes:
        state: State history ``[N, 16, 21]``.
        controls: Controls that reached the vehicle ``[N, 80, 3]``.
        expert: Target speed and hazard flags ``[N, 16, 4]``.
        surroundings: Evidence ``[N, 16, 11]`` in its units, never normalised; NaN where not available.
        surroundings_available: Its mask ``[N, 16, 11]``.
    """

    state: Array
    controls: Array
    expert: Array
    surroundings: Array
    surroundings_available: Mask


@dataclass(frozen=True, repr=False, eq=False)
class ModelTargets(_Shown):
    """What happened to every candidate.

    Attributes:
        scalars: Scalar targets ``[N, A, 6]``, NaN where not available.
        scalars_available: Their mask ``[N, A, 6]``.
        trajectories: Future paths ``[N, A, 10, 5]``.
    """

    scalars: Array
    scalars_available: Mask
    trajectories: Array
