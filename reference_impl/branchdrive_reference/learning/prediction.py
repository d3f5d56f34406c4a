"""Predictions of trained models for the groups of a partition, in physical units.

Weights are float32 and predictions are computed from them in float64, so that machines agree to about 1e-9. A
target that is unavailable somewhere has a prediction there all the same; one without any training value is
predicted as 0. Outcomes of the partition are not read.

Source: paper, "Training and Test Locking".
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.feature import InputContract
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.errors import UsageError
from branchdrive.formats.place import Place
from branchdrive.model.normalisation_document import Scalings
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.execution import deterministic, open_device
from branchdrive_reference.learning.groups import input_arrays
from branchdrive_reference.learning.image_inputs import image_arrays, image_encoders
from branchdrive_reference.learning.network import Outcome
from branchdrive_reference.learning.provenance import normalisation_digest

__all__ = ["Prediction", "check_release", "physical", "predict"]

Array = NDArray[np.float64]

_GROUPS_AT_ONCE = 128
"""Groups that a network takes together: with 13 candidates and a fusion of 192 numbers, 2.4 MiB for a layer."""


class Prediction(NamedTuple):
    """Predictions of one checkpoint.

    Attributes:
        model: Name of the model.
        seed: Its seed.
        groups: Ids of the groups, ``[N]``.
        candidate_order: Action keys, ``[A]``.
        scalars: ``[N, A, 6]`` in the units of `branchdrive.driving.target.TARGETS`, finite.
        trajectories: ``[N, A, 10, 5]`` in the units of `branchdrive.driving.target.TRAJECTORY`, finite.
    """

    model: str
    seed: int
    groups: tuple[str, ...]
    candidate_order: tuple[str, ...]
    scalars: Array
    trajectories: Array


def predict(
    checkpoints: Sequence[Checkpoint | str | Path],
    release: ModelLayer | Place,
    partition: str,
    *,
    variant: str | None = None,
    device: str = "cpu",
) -> list[Prediction]:
    """Predict the outcome of every candidate of every group of a partition.

    Args:
        checkpoints: Trained models, or their files.
        release: The release they were trained on.
        partition: ``train``, ``val``, ``test`` or ``calibration``.
        variant: A declared variant; the frozen population by default.
        device: ``cpu``, ``cuda`` or ``auto``.

    Returns:
        One prediction for each checkpoint, in their order.

    Raises:
        UsageError: No group is in the partition, or a checkpoint was trained under another split or normalisation.
        DatasetError: The release or a checkpoint cannot be read.
    """
    layer = release if isinstance(release, ModelLayer) else open_model(release)
    loaded = [item if isinstance(item, Checkpoint) else read_checkpoint(item) for item in checkpoints]
    place, scalings, groups = open_device(device), layer.scalings(), layer.groups(partition, variant)
    if not groups:
        raise UsageError(f"no group of the partition {partition!r} is in the variant {variant!r}")
    with deterministic(), torch.no_grad():
        return [
            Prediction(
                checkpoint.provenance.model,
                checkpoint.provenance.seed,
                groups,
                layer.candidate_order,
                *_predicted(checkpoint, layer, partition, variant, place, scalings),
            )
            for checkpoint in loaded
        ]


def check_release(checkpoint: Checkpoint, layer: ModelLayer) -> None:
    """Whether a checkpoint can predict for a release.

    Raises:
        UsageError: It was trained under another split or normalisation, or on actions of another encoding.
        DatasetError: The release cannot be read.
    """
    name = f"{checkpoint.provenance.model}, seed {checkpoint.provenance.seed},"
    if checkpoint.provenance.normalisation_digest != normalisation_digest(layer):
        raise UsageError(
            f"{layer.folder}: {name} was trained under another split or normalisation; train it on this release"
        )
    if checkpoint.configuration.model.reads_actions:
        width = layer.actions().shape[1]
        if width != checkpoint.num_action_features:
            raise UsageError(
                f"{layer.folder}: an action has {width} numbers, and {name} was trained on "
                f"{checkpoint.num_action_features}; train it on this release"
            )


def physical(outcome: Outcome, scalings: Scalings) -> tuple[Array, Array]:
    """Scalars and trajectories in their units, float64; a scalar whose scaling is unknown is 0.

    Args:
        outcome: Normalised predictions.
        scalings: Of the release.
    """
    scalars, trajectories = (values.double().cpu().numpy() for values in outcome)
    is_scaled = np.isfinite(scalings.scalars.offset)
    return (
        np.where(is_scaled, scalings.scalars.invert(scalars), 0.0),
        np.ascontiguousarray(scalings.trajectories.invert(trajectories)),
    )


def _predicted(
    checkpoint: Checkpoint,
    layer: ModelLayer,
    partition: str,
    variant: str | None,
    device: torch.device,
    scalings: Scalings,
) -> tuple[Array, Array]:
    """Scalars and trajectories in their units; see `physical`."""
    check_release(checkpoint, layer)
    network = checkpoint.network().double().to(device)
    model = checkpoint.configuration.model
    contract = InputContract(model.contract)
    arrays = input_arrays(layer, partition, contract, variant)
    arrays |= image_arrays(layer, partition, contract, image_encoders(model), variant)
    shared = {"actions": torch.from_numpy(layer.actions()).double().to(device)} if "actions" in network.reads else {}
    num_groups, num_candidates = len(layer.groups(partition, variant)), len(layer.candidate_order)
    scalars = np.empty((num_groups, num_candidates, len(TARGETS)))
    trajectories = np.empty((num_groups, num_candidates, FUTURE_OBSERVATIONS, len(TRAJECTORY)))
    for first in range(0, num_groups, _GROUPS_AT_ONCE):
        part = slice(first, min(first + _GROUPS_AT_ONCE, num_groups))
        inputs = {name: torch.from_numpy(np.array(values[part])).to(device) for name, values in arrays.items()}
        outcome: Outcome = network(inputs | shared, num_groups=part.stop - part.start, num_candidates=num_candidates)
        scalars[part], trajectories[part] = physical(outcome, scalings)
    return scalars, trajectories
