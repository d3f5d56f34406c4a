"""Loss of a decision: how well predictions tell the candidates of one context apart.

With the targets ``y`` that utility weighs, their predictions ``y^``, and quantiles of the training targets, ``d`` and
``d^`` are their desirabilities and ``u``, ``u^`` utilities under a preference, as in `branchdrive.driving.utility`::

    contrast  mean over groups, candidates and weighed targets of ((d^_a - mean_b d^_b) - (d_a - mean_b d_b))^2
    regret    mean over groups and preferences of sum_a p_a (max u - u_a) / (max u - min u),  p = softmax(u^ / T)
    loss      contrast_weight * contrast + regret_weight * regret

The contrast is half the mean square error of differences between all pairs of candidates, nominal among them. It is
in units of utility, so what lies beyond the quantiles and decides nothing costs nothing; the loss of outcomes still
sees it. A group takes part where every candidate has a utility, as it does in rankings.

Source: this project's choice; expected regret of a soft choice is a policy's loss under full information.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import RANGE, REVERSED, WEIGHED, fit_scale
from branchdrive_reference.learning.configuration import DecisionConfig

__all__ = ["DecisionLoss"]

_COLUMNS = [[target.name for target in TARGETS].index(name) for name in WEIGHED]


class DecisionLoss:
    """The loss under some quantiles.

    Args:
        config: Weights of its parts, and preferences.
        scalars: Normalised training targets, which give the quantiles, ``[N, A, 6]``.
        mask: Their availability, ``[N, A, 6]``.
    """

    def __init__(self, config: DecisionConfig, scalars: Tensor, mask: Tensor) -> None:
        self._config = config
        scale = fit_scale(Targets(scalars.double().cpu().numpy(), mask.cpu().numpy()))
        span = np.maximum(scale.q95 - scale.q05, RANGE)
        sign = np.where(REVERSED, -1.0, 1.0)
        worst = np.where(REVERSED, scale.q95, scale.q05)
        weights = np.array([preference.profile.weights for preference in config.preferences.values()])
        self._worst, self._slope, self._weights = (
            torch.from_numpy(np.nan_to_num(values)).to(scalars) for values in (worst, sign / span, weights)
        )

    def __call__(self, predicted: Tensor, scalars: Tensor, mask: Tensor) -> Tensor:
        """The loss of a batch.

        Args:
            predicted: Normalised predictions, ``[B, A, 6]``.
            scalars: Normalised targets, finite, ``[B, A, 6]``.
            mask: Their availability, ``[B, A, 6]``.
        """
        is_ranked = mask[..., _COLUMNS].all(2).all(1)
        found, wanted = self._desirability(predicted[is_ranked]), self._desirability(scalars[is_ranked])
        num_groups = max(len(wanted), 1)
        apart = (found - found.mean(1, keepdim=True)) - (wanted - wanted.mean(1, keepdim=True))
        contrast = (apart**2).mean((1, 2)).sum() / num_groups
        utilities = wanted @ self._weights.T
        best, worst = utilities.amax(1), utilities.amin(1)
        chosen = torch.softmax((found @ self._weights.T) / self._config.temperature, dim=1)
        lost, span = best - (chosen * utilities).sum(1), best - worst
        regret = torch.where(span > RANGE, lost / span.clamp(min=RANGE), 0.0).mean(1).sum() / num_groups
        return self._config.contrast_weight * contrast + self._config.regret_weight * regret

    def _desirability(self, scalars: Tensor) -> Tensor:
        """``[B, A, 5]`` in ``[0, 1]``."""
        return ((scalars[..., _COLUMNS] - self._worst) * self._slope).clamp(0.0, 1.0)
