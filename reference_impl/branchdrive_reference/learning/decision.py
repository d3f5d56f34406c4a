"""Loss of a decision: how well predictions tell the candidates of one context apart.

With the weights ``w`` of a preference over the targets that utility weighs, desirabilities ``d`` of outcomes and ``d^``
of predictions under quantiles of the training targets, and utilities ``u = sum w d``, ``u^ = sum w d^`` of candidates
``a``, as in `branchdrive.driving.utility`::

    contrast  mean over groups, candidates, preferences of sum w ((d^_a - mean_b d^_b) - (d_a - mean_b d_b))^2
    regret    mean over groups, preferences of sum_a p_a (max u - u_a) / (max u - min u),  p = softmax(u^ / T)
    loss      contrast_weight * contrast + regret_weight * regret

The contrast is half the mean square error of differences between all pairs of candidates, nominal among them. It is
in units of utility, so that what lies beyond the quantiles and decides nothing costs nothing; the loss of outcomes
still sees it. A group takes part where every candidate has a utility, as it does in rankings.

A preference with a near range ``R`` scores a separation of ``y`` by ``sqrt(c)`` with ``c = clip(y / R, 0, 1)``. The
slope of the root has no end at contact, so predictions are scored by ``(sqrt(c + k) - sqrt(k)) / (sqrt(1 + k) -
sqrt(k))``.

Source: this project's choice; the regret of a soft choice is the loss of a stochastic policy under full information.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import RANGE, REVERSED, WEIGHED, fit_scale
from branchdrive.model.normalisation import Scaling
from branchdrive_reference.learning.configuration import DecisionConfig

__all__ = ["DecisionLoss"]

_COLUMNS = [[target.name for target in TARGETS].index(name) for name in WEIGHED]
_SEPARATION = WEIGHED.index("min_separation_m")

_ROUNDING = 0.01
"""``k``: where the root of a predicted separation begins, as a share of the near range."""


class DecisionLoss:
    """The loss under the quantiles of a training.

    Args:
        config: Weights of its parts, and preferences.
        scalars: Normalised training targets, ``[N, A, 6]``.
        mask: Their availability, ``[N, A, 6]``.
        scaling: With which they are normalised, ``[6]``.
    """

    def __init__(self, config: DecisionConfig, scalars: Tensor, mask: Tensor, scaling: Scaling) -> None:
        self._config = config
        values = scaling.invert(scalars.double().cpu().numpy())
        quantiles = fit_scale(Targets(values, mask.cpu().numpy()))
        worst, best = (np.where(REVERSED, *ends) for ends in ((quantiles.q95, quantiles.q05), quantiles))
        span = np.where(REVERSED, -1.0, 1.0) * np.maximum(np.abs(best - worst), RANGE)
        scale, offset = scaling.scale[_COLUMNS], scaling.offset[_COLUMNS]
        near_m = np.array([preference.near_m or np.nan for preference in config.preferences.values()])
        is_near = np.isfinite(near_m)[:, None] & (np.arange(len(WEIGHED)) == _SEPARATION)

        def kept(array: NDArray[np.float64]) -> Tensor:
            return torch.from_numpy(np.nan_to_num(array)).to(scalars)

        self._slope, self._start = kept(scale / span), kept((offset - worst) / span)
        self._is_near = torch.from_numpy(is_near).to(scalars.device)
        self._near_slope, self._near_start = kept(scale[_SEPARATION] / near_m), kept(offset[_SEPARATION] / near_m)
        self._weights = kept(np.stack([preference.weights for preference in config.preferences.values()]))

    def __call__(self, predicted: Tensor, scalars: Tensor, mask: Tensor) -> Tensor:
        """The loss of a batch.

        Args:
            predicted: Normalised predictions, ``[B, A, 6]``.
            scalars: Normalised targets, finite, ``[B, A, 6]``.
            mask: Their availability, ``[B, A, 6]``.
        """
        is_ranked = mask[..., _COLUMNS].all(2).all(1)
        found = self._desirability(predicted[is_ranked], rounding=_ROUNDING)
        wanted = self._desirability(scalars[is_ranked], rounding=0.0)
        num_groups = max(len(wanted), 1)
        apart = (found - found.mean(1, keepdim=True)) - (wanted - wanted.mean(1, keepdim=True))
        contrast = (apart**2 * self._weights).sum(3).mean((1, 2)).sum() / num_groups
        scores, utilities = ((values * self._weights).sum(3) for values in (found, wanted))
        best, worst = utilities.amax(1), utilities.amin(1)
        chosen = torch.softmax(scores / self._config.temperature, dim=1)
        lost, span = best - (chosen * utilities).sum(1), best - worst
        regret = torch.where(span > RANGE, lost / span.clamp(min=RANGE), 0.0).mean(1).sum() / num_groups
        return self._config.contrast_weight * contrast + self._config.regret_weight * regret

    def _desirability(self, scalars: Tensor, *, rounding: float) -> Tensor:
        """In ``[0, 1]`` under every preference, ``[B, A, preferences, 5]``."""
        values = scalars[..., _COLUMNS]
        found = (values * self._slope + self._start).clamp(0.0, 1.0)[:, :, None]
        gap = (values[..., _SEPARATION, None] * self._near_slope + self._near_start).clamp(0.0, 1.0)
        start = rounding**0.5
        near = ((gap + rounding).sqrt() - start) / ((1.0 + rounding) ** 0.5 - start)
        return torch.where(self._is_near, near[..., None], found)
