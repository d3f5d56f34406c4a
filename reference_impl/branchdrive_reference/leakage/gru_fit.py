"""Fit of the recurrent classifier of actions, with torch on one CPU thread.

It is fitted by Adam on cross entropy in batches of whole groups; the weights of the epoch with the least validation
loss score, in float64, so that equal rows have equal scores. One seed gives one result on one machine.

Source: this project's choice.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping

import torch
from torch import Tensor, nn

from branchdrive.leakage.classifier import SequenceScores, SequenceTask
from branchdrive.statistics.random_words import orders, words
from branchdrive_reference.leakage.gru import GruClassifier
from branchdrive_reference.learning.adam import AdamW
from branchdrive_reference.learning.execution import deterministic

__all__ = ["fitted_scores"]


def fitted_scores(numbers: GruClassifier, task: SequenceTask, *, seed: int) -> SequenceScores:
    """Log-probabilities of the rows to test by a classifier of these numbers; see `GruClassifier`."""
    with deterministic(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        train, val, test = (torch.from_numpy(part.copy()).float() for part in task)
        network = _Network(train.shape[3], numbers.hidden, train.shape[1])
        optimizer = AdamW(network.parameters())
        best, best_loss, best_epoch, epoch = network.weights(), float("inf"), 1, 0
        while epoch < numbers.max_epochs and epoch - best_epoch < numbers.patience:
            epoch += 1
            drawn = orders(words(seed, "leakage/gru/batches", 1, len(train), first_row=epoch))[0]
            for groups in torch.from_numpy(drawn).split(numbers.batch_groups):
                optimizer.descend(network.loss(train[groups]), numbers.learning_rate)
            with torch.no_grad():
                loss = float(network.loss(val))
            if loss < best_loss:
                best, best_loss, best_epoch = network.weights(), loss, epoch
        network.restore(best)
        with torch.no_grad():
            scores = network.double().log_probability(test.double())
    return SequenceScores(scores.numpy(), epoch, best_epoch)


class _Network:
    """Recurrent layer and readout."""

    def __init__(self, num_variables: int, hidden: int, num_classes: int) -> None:
        self._layers = nn.ModuleDict(
            {"recurrent": nn.GRU(num_variables, hidden, batch_first=True), "readout": nn.Linear(hidden, num_classes)}
        )

    def parameters(self) -> Iterator[nn.Parameter]:
        return self._layers.parameters()

    def weights(self) -> dict[str, Tensor]:
        return copy.deepcopy(self._layers.state_dict())

    def restore(self, weights: Mapping[str, Tensor]) -> None:
        self._layers.load_state_dict(weights)

    def double(self) -> _Network:
        self._layers.double()
        return self

    def log_probability(self, rows: Tensor) -> Tensor:
        """``[groups, actions, classes]`` of sequences ``[groups, actions, steps, variables]``."""
        _, last = self._layers["recurrent"](rows.flatten(0, 1))
        scores: Tensor = torch.log_softmax(self._layers["readout"](last[0]), dim=1)
        return scores.reshape(rows.shape[0], rows.shape[1], -1)

    def loss(self, rows: Tensor) -> Tensor:
        return -self.log_probability(rows).diagonal(dim1=1, dim2=2).mean()
