"""AdamW by torch's function, which is quick to start.

Methods of `torch.optim.AdamW` load the compiler of torch when they are first called. That takes longer than a small
model takes to train, in every process again. The function behind them loads nothing, and comes to the same bits.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.optim.adamw import adamw

__all__ = ["AdamW"]


class AdamW:
    """The optimiser of some weights; Adam without weight decay.

    Attributes:
        moments: Its state, by the names that torch gives its parts: a tensor for every weight, in their order.
    """

    def __init__(self, weights: Iterable[nn.Parameter], *, weight_decay: float = 0.0, fused: bool = False) -> None:
        self._weights: list[Tensor] = list(weights)
        self._weight_decay = weight_decay
        self._fused = fused
        self.moments = {
            "step": [torch.zeros((), device=weight.device) for weight in self._weights],
            "exp_avg": [torch.zeros_like(weight) for weight in self._weights],
            "exp_avg_sq": [torch.zeros_like(weight) for weight in self._weights],
        }

    def descend(self, loss: Tensor, learning_rate: float) -> None:
        """One step against the gradient of a loss, to which every weight contributes."""
        for weight in self._weights:
            weight.grad = None
        loss.backward()
        with torch.no_grad():
            adamw(
                self._weights,
                [weight.grad for weight in self._weights if weight.grad is not None],
                self.moments["exp_avg"],
                self.moments["exp_avg_sq"],
                [],
                self.moments["step"],
                fused=self._fused,
                amsgrad=False,
                beta1=0.9,
                beta2=0.999,
                lr=learning_rate,
                weight_decay=self._weight_decay,
                eps=1e-8,
                maximize=False,
            )
