"""Checkpoints: weights of a trained model with their provenance, configuration and losses.

A checkpoint is a file of tensors, see `branchdrive_reference.learning.tensor_file`. It is accepted only if its
tensors are exactly those of the network of its configuration, all finite, and its provenance is of this
configuration and of this version of the code. Two runs of one provenance on one machine write the same bytes.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from branchdrive.contract.text import printable
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.store import Store
from branchdrive_reference.learning.configuration import MODEL_VERSION, Configuration, is_model_name
from branchdrive_reference.learning.network import MeanNetwork, OutcomeNetwork, build_network
from branchdrive_reference.learning.provenance import Provenance
from branchdrive_reference.learning.tensor_file import read_tensors, write_tensors
from branchdrive_reference.learning.trees import TreesNetwork

__all__ = [
    "MAX_ACTION_FEATURES",
    "Checkpoint",
    "Curve",
    "checkpoint_path",
    "environment",
    "read_checkpoint",
    "write_checkpoint",
]

FORMAT = "branchdrive-checkpoint-1"

MAX_ACTION_FEATURES = 4096
"""Width of the largest encoding of an action."""

_MAX_REASON = 300
_FIELDS = {"format", "provenance", "configuration", "num_action_features", "environment", "curve"}


@dataclass(frozen=True)
class Curve:
    """How training went; a model without weights has an empty one.

    Attributes:
        train: Loss of every epoch, mean over its batches by groups, before each step.
        val: Validation loss after every epoch.
    """

    train: tuple[float, ...] = ()
    val: tuple[float, ...] = ()

    @property
    def best_epoch(self) -> int:
        """Epoch of the least validation loss, the first of them, from 1; 0 without epochs."""
        return 1 + self.val.index(min(self.val)) if self.val else 0

    @property
    def record(self) -> dict[str, list[float]]:
        """The same as JSON data."""
        return {"train": list(self.train), "val": list(self.val)}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Curve:
        """The curve of a record.

        Raises:
            ValueError: It is no record of a curve.
        """
        train, val = (tuple(record[name]) for name in ("train", "val"))
        if len(record) != 2 or len(train) != len(val) or not all(type(loss) is float for loss in (*train, *val)):
            raise ValueError("its curve is no pair of equally many losses")
        return cls(train, val)


@dataclass(frozen=True)
class Checkpoint:
    """A trained model.

    Attributes:
        provenance: Where the weights come from.
        configuration: Of the model and its training.
        num_action_features: Width of an encoded action.
        environment: Version of torch and kind of device that trained.
        curve: How training went.
        weights: State of the network, by name.
        sha256: Of the file that it was read from, hexadecimal.
    """

    provenance: Provenance
    configuration: Configuration
    num_action_features: int
    environment: Mapping[str, str]
    curve: Curve
    weights: Mapping[str, Tensor]
    sha256: str

    def network(self) -> OutcomeNetwork | MeanNetwork | TreesNetwork:
        """The network with these weights, not to be trained further."""
        network = build_network(self.configuration.model, self.num_action_features)
        network.load_state_dict(dict(self.weights))
        return network.eval().requires_grad_(requires_grad=False)

    def __repr__(self) -> str:
        return f"Checkpoint({self.provenance.model}, seed {self.provenance.seed}, epoch {self.curve.best_epoch})"


def checkpoint_path(folder: Path, model: str, seed: int) -> Path:
    """Where the checkpoint of a model and a seed stands in a folder, and never outside of it.

    Raises:
        UsageError: `model` is not a name of a model, which has no separator of paths.
    """
    if not is_model_name(model):
        raise UsageError(f"{model!r} is not a name of a model; use up to 64 letters, digits, dots, dashes, underscores")
    return folder / f"{model}-seed{seed}.safetensors"


def environment(device: torch.device) -> dict[str, str]:
    """What the last bits of weights depend on besides their provenance, as JSON data."""
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
    return {"torch": str(torch.__version__), "device": name}


def write_checkpoint(
    path: Path,
    provenance: Provenance,
    configuration: Configuration,
    *,
    num_action_features: int,
    environment: Mapping[str, str],
    curve: Curve,
    weights: Mapping[str, Tensor],
) -> None:
    """Create or replace a checkpoint at once and durably; see `Checkpoint` for the arguments."""
    document = {
        "format": FORMAT,
        "provenance": provenance.record,
        "configuration": configuration.record,
        "num_action_features": num_action_features,
        "environment": dict(environment),
        "curve": curve.record,
    }
    write_tensors(path, document, weights)


def read_checkpoint(path: str | Path, *, sha256: str | None = None, store: Store | None = None) -> Checkpoint:
    """Read a checkpoint.

    Args:
        path: The file.
        sha256: Digest that the file must have, as a lock has it.
        store: The place that the path is relative to; this machine by default.

    Raises:
        DatasetError: It cannot be read, is not a checkpoint or another one than the digest says, or does not fit its
            configuration or this version of the code.
    """
    path = Path(path)
    file = read_tensors(path, store)
    if sha256 is not None and file.sha256 != sha256:
        raise DatasetError(f"{path}: has the SHA-256 {file.sha256}, expected {sha256}; it was replaced")
    document = file.document
    if set(document) != _FIELDS or document["format"] != FORMAT:
        raise DatasetError(f"{path}: is not a checkpoint of the format {FORMAT!r}")
    try:
        configuration = Configuration.from_record(document["configuration"])
        origin = _provenance(document["provenance"], configuration)
        curve = Curve.from_record(document["curve"])
        num_action_features = _num_action_features(document["num_action_features"], configuration)
        about = dict(document["environment"])
        _check_weights(file.tensors, configuration, num_action_features)
    except (AttributeError, KeyError, OverflowError, RuntimeError, TypeError, ValueError, DatasetError) as error:
        raise DatasetError(f"{path}: {printable(str(error)[:_MAX_REASON])}") from error
    return Checkpoint(origin, configuration, num_action_features, about, curve, file.tensors, file.sha256)


def _provenance(record: Mapping[str, Any], configuration: Configuration) -> Provenance:
    found = Provenance(**record)
    for name, value in found.record.items():
        if type(value) is not (int if name == "seed" else str):
            raise DatasetError(f"its `{name}` is {value!r:.80}")
    expected = {
        "model": configuration.model.name,
        "config_digest": configuration.digest,
        "code_version": MODEL_VERSION,
    }
    for name, value in expected.items():
        if record[name] != value:
            raise DatasetError(f"its `{name}` is {record[name]!r}, expected {value!r}; train it again")
    return found


def _num_action_features(value: Any, configuration: Configuration) -> int:
    least = 1 if configuration.model.reads_actions else 0
    if type(value) is not int or not least <= value <= MAX_ACTION_FEATURES:
        raise DatasetError(f"its `num_action_features` is {value!r:.80}, not in {least} .. {MAX_ACTION_FEATURES}")
    return value


def _check_weights(tensors: Mapping[str, Tensor], configuration: Configuration, num_action_features: int) -> None:
    with torch.device("meta"):  # shapes alone, whatever widths the file claims
        expected = build_network(configuration.model, num_action_features).state_dict()
    if tensors.keys() != expected.keys():
        odd = sorted(tensors.keys() ^ expected.keys())[0]
        raise DatasetError(f"its tensors are not those of its model: {odd!r} is missing or too many")
    for name, values in tensors.items():
        wanted = expected[name]
        if values.shape != wanted.shape or values.dtype != wanted.dtype:
            found = f"{values.dtype} {list(values.shape)}"
            raise DatasetError(f"its tensor {name!r} is {found}, expected {wanted.dtype} {list(wanted.shape)}")
        if not np.isfinite(values.numpy()).all():  # torch would wake all threads for each
            raise DatasetError(f"its tensor {name!r} holds a value that is not a number")
