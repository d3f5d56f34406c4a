"""What a network predicts."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

__all__ = ["Outcome"]


class Outcome(NamedTuple):
    """Normalised predictions: `scalars` ``[B, A, 6]`` and `trajectories` ``[B, A, 10, 5]``."""

    scalars: Tensor
    trajectories: Tensor
