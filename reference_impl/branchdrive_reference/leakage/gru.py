"""Recurrent classifier of actions for the paper's battery, with torch on one CPU thread.

A GRU reads the sequence of a replay, and a linear layer turns its last state into log-probabilities of the
actions. It is fitted by Adam on cross entropy in batches of whole groups; the weights of the epoch with the
least validation loss score, in float64, so that equal rows have equal scores. One seed gives one result on
one machine.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" for the kind; sizes are this project's choice.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from branchdrive.leakage.classifier import SequenceScores, SequenceTask
from branchdrive.statistics.random_words import orders, words
from branchdrive_reference.learning.adam import AdamW
from branchdrive_reference.learning.execution import deterministic

__all__ = ["GruClassifier", "gru"]


@dataclass(frozen=True)
class GruClassifier:
    """A sequence classifier.

    Attributes:
        hidden: Width of the recurrent state.
        batch_groups: Groups of a batch.
        learning_rate: Of Adam.
        max_epochs: Epochs at most, at least 1.
        patience: Epochs without a lesser validation loss after which training ends.
    """

    hidden: int = 24
    batch_groups: int = 16
    learning_rate: float = 1e-3
    max_epochs: int = 30
    patience: int = 5

    @property
    def settings(self) -> Mapping[str, int | float | str]:
        """Everything that is fixed before data are seen."""
        return {"name": "gru", "torch": str(torch.__version__), **asdict(self)}

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        """Log-probabilities of the rows to test.

        Args:
            task: Standardised sequences, each partition with at least one group.
            seed: Of weights and batches, below 2**64.
        """
        with deterministic(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            train, val, test = (torch.from_numpy(part.copy()).float() for part in task)
            network = _Network(train.shape[3], self.hidden, train.shape[1])
            optimizer = AdamW(network.parameters())
            best, best_loss, best_epoch, epoch = network.weights(), float("inf"), 1, 0
            while epoch < self.max_epochs and epoch - best_epoch < self.patience:
                epoch += 1
                drawn = orders(words(seed, "leakage/gru/batches", 1, len(train), first_row=epoch))[0]
                for groups in torch.from_numpy(drawn).split(self.batch_groups):
                    optimizer.descend(network.loss(train[groups]), self.learning_rate)
                with torch.no_grad():
                    loss = float(network.loss(val))
                if loss < best_loss:
                    best, best_loss, best_epoch = network.weights(), loss, epoch
            network.restore(best)
            with torch.no_grad():
                scores = network.double().log_probability(test.double())
        return SequenceScores(scores.numpy(), epoch, best_epoch)


gru = GruClassifier()
"""The classifier as the audit finds it."""


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
