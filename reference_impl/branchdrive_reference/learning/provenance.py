"""Where weights come from: configuration, seed, and the training data under their digests.

Source: paper, "Training and Test Locking" (locked configurations and normalisation); which digests they are is this
project's choice.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from torch import Tensor

from branchdrive.benchmark.prediction.data import groups_digest
from branchdrive.contract.limits import spec_limits
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.configuration import MODEL_VERSION, Configuration

__all__ = ["Provenance", "normalisation_digest", "provenance"]

NORMALISATION_FILE = "model/normalisation.json"


@dataclass(frozen=True)
class Provenance:
    """Everything that decides the weights on one machine.

    Attributes:
        model: Name of the model.
        seed: Seed of weights and batches.
        config_digest: Of the configuration.
        split_digest: Of the split, as the normalisation has it.
        normalisation_digest: SHA-256 of the file ``model/normalisation.json``.
        data_digest: SHA-256 over the normalised tensors of training and validation, which are all that is read.
        training_groups_digest: Of the ids of the training groups.
        code_version: Version of the models' code.
    """

    model: str
    seed: int
    config_digest: str
    split_digest: str
    normalisation_digest: str
    data_digest: str
    training_groups_digest: str
    code_version: str = MODEL_VERSION

    @property
    def record(self) -> dict[str, Any]:
        """The same as JSON data."""
        return asdict(self)


def provenance(
    layer: ModelLayer, configuration: Configuration, seed: int, partitions: Mapping[str, Mapping[str, Tensor]]
) -> Provenance:
    """Provenance of weights that are trained on the tensors of `partitions`, by partition and name.

    Raises:
        DatasetError: The release cannot be read.
    """
    data = hashlib.sha256()
    for partition, tensors in sorted(partitions.items()):
        for name, values in sorted(tensors.items()):
            data.update(f"{partition} {name} {values.dtype} {list(values.shape)}\n".encode())
            data.update(values.numpy().data)
    return Provenance(
        configuration.model.name,
        seed,
        configuration.digest,
        layer.scalings().scalars.split_digest,
        normalisation_digest(layer),
        data.hexdigest(),
        groups_digest(layer.groups("train")),
    )


def normalisation_digest(layer: ModelLayer) -> str:
    """SHA-256 of the normalisation file of a release, hexadecimal.

    Raises:
        DatasetError: The file cannot be read.
    """
    content = layer.folder.read(NORMALISATION_FILE, spec_limits().max_document_bytes)
    return hashlib.sha256(content).hexdigest()
