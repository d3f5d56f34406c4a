"""Training one model with one seed, from a release to a checkpoint.

All tensors of training and validation are in memory. An epoch takes the training groups in an order that seed and
epoch decide, in batches of whole groups. After it the validation loss decides which weights are kept, and ends the
training when it has not fallen for `patience` epochs. No other partition is read. There is no augmentation.

The state is written every few seconds, and before an interruption is passed on: the same call goes on from there and
comes to the same weights, bit for bit, on the same machine.

Source: paper, "Research Questions and Experimental Protocol".
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from branchdrive.driving.feature import InputContract
from branchdrive.errors import UsageError
from branchdrive.formats.durable import delete
from branchdrive.formats.place import Place
from branchdrive.model.normalisation import Scaling
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.runtime.progress import unwatched
from branchdrive_reference.learning.adam import AdamW
from branchdrive_reference.learning.checkpoint import (
    Checkpoint,
    Curve,
    checkpoint_path,
    environment,
    read_checkpoint,
    write_checkpoint,
)
from branchdrive_reference.learning.configuration import Configuration, TrainingConfig
from branchdrive_reference.learning.decision import DecisionLoss
from branchdrive_reference.learning.execution import deterministic, open_device
from branchdrive_reference.learning.groups import BranchGroupDataset
from branchdrive_reference.learning.image_inputs import image_encoders
from branchdrive_reference.learning.loss import loss_terms
from branchdrive_reference.learning.network import MeanNetwork, OutcomeNetwork, build_network, initialise
from branchdrive_reference.learning.provenance import Provenance, provenance
from branchdrive_reference.learning.stream import BATCHES, stream
from branchdrive_reference.learning.training_state import TrainingState, read_state, state_path, write_state
from branchdrive_reference.learning.trees import TreesNetwork

__all__ = ["EpochReport", "train_model", "training_data"]

SAVE_EVERY_S = 10.0
"""Seconds between two states on disk, and an epoch at most: what a killed training loses. A state takes a tenth of a
second, so that it costs a hundredth of a training."""

_SHARED = ("actions",)
"""Tensors that have no axis of groups."""


class EpochReport(NamedTuple):
    """Where a training is after an epoch.

    Attributes:
        model: Name of the model.
        seed: Its seed.
        epoch: Epochs done.
        max_epochs: Epochs at most.
        train_loss: Mean over the batches of the epoch.
        val_loss: After the epoch.
        is_last: Whether training ends here.
        fold: Number of the fold that is held out; ``None`` where none is.
    """

    model: str
    seed: int
    epoch: int
    max_epochs: int
    train_loss: float
    val_loss: float
    is_last: bool = False
    fold: int | None = None


def training_data(layer: ModelLayer, configuration: Configuration) -> dict[str, dict[str, Tensor]]:
    """All that a training reads, by partition and name: normalised tensors of training and validation.

    Raises:
        UsageError: There is no training or validation group.
        DatasetError: The release cannot be read.
    """
    model = configuration.model
    contract, encoders = InputContract(model.contract), image_encoders(model)
    return {name: BranchGroupDataset(layer, name, contract, images=encoders).tensors for name in ("train", "val")}


def train_model(
    release: ModelLayer | Place,
    folder: str | Path,
    configuration: Configuration,
    *,
    seed: int,
    device: str = "cpu",
    on_epoch: Callable[[EpochReport], None] = unwatched,
    clock: Callable[[], float] = time.monotonic,
) -> Checkpoint:
    """Train, or go on where a training was interrupted, or take the checkpoint that is already there.

    Args:
        release: A release with its model layer.
        folder: Where the checkpoint is written; it is created if it is not there.
        configuration: Of the model and its training.
        seed: Of weights and batches.
        device: ``cpu``, ``cuda`` or ``auto``.
        on_epoch: Called after every epoch; what it raises is passed on once the state is written.
        clock: Seconds from any moment, by which states are written; no weight depends on it.

    Raises:
        UsageError: There is no training or validation group, no such device, the seed is none, the loss is not a
            number, or the folder holds a checkpoint of the same name that was trained otherwise.
        DatasetError: The release, or what the folder holds of the training, cannot be read.
    """
    layer = release if isinstance(release, ModelLayer) else open_model(release)
    place = open_device(device)
    data = training_data(layer, configuration)
    origin = provenance(layer, configuration, seed, data)
    num_action_features = data["train"]["actions"].shape[1] if "actions" in data["train"] else 0
    if configuration.model.reads_actions and not num_action_features:
        layer.actions()  # says that the release declares no encoding
    path = checkpoint_path(Path(folder), configuration.model.name, seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        found = read_checkpoint(path)
        if found.provenance != origin:
            raise UsageError(
                f"{path} was trained on another configuration, release or version; delete it, or choose another folder"
            )
        return found
    job = _Job(configuration, origin, environment(place), path, on_epoch, clock)
    with deterministic():
        network = build_network(configuration.model, num_action_features)
        if isinstance(network, MeanNetwork):
            parts = data["train"]
            network.fit(parts["scalars"], parts["mask"], parts["trajectory"])
            weights, curve = network.state_dict(), Curve()
        elif isinstance(network, TreesNetwork):
            network.fit(data["train"])
            weights, curve = network.state_dict(), Curve()
        else:
            initialise(network, seed=seed)
            on_device = {
                name: {key: values.to(place) for key, values in tensors.items()} for name, tensors in data.items()
            }
            loss = _Loss.of(configuration.training, on_device["train"], layer.scalings().scalars)
            state = _fit(network.to(place), on_device, loss, job)
            weights, curve = state.best, state.curve
    write_checkpoint(
        path,
        origin,
        configuration,
        num_action_features=num_action_features,
        environment=job.environment,
        curve=curve,
        weights=weights,
    )
    delete(state_path(path))
    return read_checkpoint(path)


class _Job(NamedTuple):
    """What is trained, where it goes, and who watches."""

    configuration: Configuration
    provenance: Provenance
    environment: dict[str, str]
    path: Path
    on_epoch: Callable[[EpochReport], None]
    clock: Callable[[], float]

    def write(self, state: TrainingState) -> None:
        write_state(state_path(self.path), state, self.provenance, self.environment)

    def report(self, curve: Curve) -> EpochReport:
        return EpochReport(
            self.provenance.model,
            self.provenance.seed,
            len(curve.val),
            self.configuration.training.max_epochs,
            curve.train[-1],
            curve.val[-1],
            _is_over(curve, self.configuration.training),
        )


def _fit(network: OutcomeNetwork, data: Mapping[str, Mapping[str, Tensor]], loss: _Loss, job: _Job) -> TrainingState:
    """Train from the start, or from the state on disk, to the end."""
    config, seed = job.configuration.training, job.provenance.seed
    optimizer = AdamW(network.parameters(), weight_decay=config.weight_decay, fused=True)
    state = TrainingState(network, optimizer, {}, Curve())
    if state_path(job.path).exists():
        read_state(state_path(job.path), state, job.provenance, job.environment)
    saved_s = job.clock()
    while not _is_over(state.curve, config):
        train_loss = _epoch(state, data["train"], loss, seed=seed)
        with torch.no_grad():
            val_loss = float(loss(network, data["val"]))
        if not (math.isfinite(train_loss) and math.isfinite(val_loss)):
            raise UsageError(
                f"{job.provenance.model}, seed {seed}: the loss of epoch {state.epoch + 1} is not a number; "
                f"`learning_rate` is {config.learning_rate}, take a smaller one"
            )
        state.curve = Curve((*state.curve.train, train_loss), (*state.curve.val, val_loss))
        if state.curve.best_epoch == state.epoch:
            state.keep_weights()
        if job.clock() - saved_s >= SAVE_EVERY_S:
            job.write(state)
            saved_s = job.clock()
        try:
            job.on_epoch(job.report(state.curve))
        except BaseException:
            job.write(state)
            raise
    return state


def _is_over(curve: Curve, config: TrainingConfig) -> bool:
    epoch = len(curve.val)
    return epoch >= config.max_epochs or epoch - curve.best_epoch >= config.patience


def _epoch(state: TrainingState, data: Mapping[str, Tensor], loss: _Loss, *, seed: int) -> float:
    """One pass over the training groups; the mean loss of a group."""
    config, epoch, num_groups = loss.config, state.epoch + 1, len(data["scalars"])
    learning_rate = config.learning_rate_at(epoch)
    order = torch.from_numpy(stream(seed, BATCHES, epoch).permutation(num_groups)).to(data["scalars"].device)
    total = 0.0
    for rows in order.split(config.batch_groups):
        batch = {name: values if name in _SHARED else values[rows] for name, values in data.items()}
        found = loss(state.network, batch)
        state.optimizer.descend(found, learning_rate)
        total += float(found.detach()) * len(rows)
    return total / num_groups


class _Loss(NamedTuple):
    """Loss of a network on a batch: of outcomes, and of decisions where the training has any."""

    config: TrainingConfig
    decision: DecisionLoss | None

    @classmethod
    def of(cls, config: TrainingConfig, train: Mapping[str, Tensor], scaling: Scaling) -> _Loss:
        """The loss of a training on the groups of `train`, whose targets are normalised by `scaling`."""
        if config.decision is None:
            return cls(config, None)
        return cls(config, DecisionLoss(config.decision, train["scalars"], train["mask"], scaling))

    def __call__(self, network: nn.Module, batch: Mapping[str, Tensor]) -> Tensor:
        scalars, mask = batch["scalars"], batch["mask"]
        outcome = network(batch, num_groups=scalars.shape[0], num_candidates=scalars.shape[1])
        found = loss_terms(outcome, scalars, mask, batch["trajectory"], self.config).total
        return found if self.decision is None else found + self.decision(outcome.scalars, scalars, mask)
