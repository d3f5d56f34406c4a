"""Loss of a predicted outcome, on normalised targets.

With ``n_t`` the available values of target ``t`` in the batch and ``T`` the targets that have any::

    scalars       mean over t in T of (sum of huber(error) over available values / n_t)
    trajectories  mean of smooth_l1(error) over groups, candidates, steps and components
    heading       weight * mean of (|(sin, cos)| - 1)^2
    loss          their sum

What is unavailable enters neither loss nor gradient.

Source: paper, "Research Questions and Experimental Protocol", which adds "target-wise masked Huber loss" to the other
two and leaves open whether targets are added or averaged. The mean is the choice of this protocol: scalars and
trajectories then weigh alike whatever the number of targets; the sum weighs scalars six times as much, which on
validation gains nothing for them and loses a fifth on paths (docs/benchmark.md#loss).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from branchdrive.driving.target import TRAJECTORY
from branchdrive_reference.learning.configuration import TrainingConfig
from branchdrive_reference.learning.network import Outcome

__all__ = ["LossTerms", "loss_terms"]

_SIN, _COS = TRAJECTORY.index("sin_yaw"), TRAJECTORY.index("cos_yaw")

_SQUARE_FLOOR = 1e-12
"""Added to a squared norm: the root of 0 has no gradient."""


class LossTerms(NamedTuple):
    """Terms of the loss, each a number with a gradient; the heading term is weighted."""

    scalars: Tensor
    trajectories: Tensor
    heading: Tensor

    @property
    def total(self) -> Tensor:
        """Their sum."""
        return self.scalars + self.trajectories + self.heading


def loss_terms(
    outcome: Outcome, scalars: Tensor, mask: Tensor, trajectories: Tensor, config: TrainingConfig
) -> LossTerms:
    """Loss of an outcome against normalised targets.

    Args:
        outcome: Predictions.
        scalars: ``[B, A, 6]``, finite; what stands where `mask` is false does not matter.
        mask: Availability of the scalars, ``[B, A, 6]``.
        trajectories: ``[B, A, 10, 5]``.
        config: Shapes and weight of the terms.
    """
    errors = functional.huber_loss(outcome.scalars, scalars, reduction="none", delta=config.huber_delta)
    counts = mask.sum((0, 1))
    by_target = torch.where(mask, errors, 0.0).sum((0, 1)) / counts.clamp(min=1)
    norm = torch.sqrt(outcome.trajectories[..., _SIN] ** 2 + outcome.trajectories[..., _COS] ** 2 + _SQUARE_FLOOR)
    return LossTerms(
        by_target.sum() / (counts > 0).sum().clamp(min=1),
        functional.smooth_l1_loss(outcome.trajectories, trajectories, beta=config.smooth_l1_beta),
        config.heading_weight * ((norm - 1.0) ** 2).mean(),
    )
