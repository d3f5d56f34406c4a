"""State of a training between two epochs, from which it goes on to the same weights, bit for bit.

It holds the weights, the best ones so far, the moments of AdamW and the losses. Learning rate and batches are
functions of seed and epoch, so neither a schedule nor a generator has a state to keep. The file is a file of
tensors, see `branchdrive_reference.learning.tensor_file`; it is refused unless provenance and environment are those
of the training that wants to go on.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from branchdrive.errors import DatasetError
from branchdrive_reference.learning.adam import AdamW
from branchdrive_reference.learning.checkpoint import Curve
from branchdrive_reference.learning.provenance import Provenance
from branchdrive_reference.learning.tensor_file import read_tensors, write_tensors

__all__ = ["TrainingState", "read_state", "state_path", "write_state"]

FORMAT = "branchdrive-training-1"


@dataclass
class TrainingState:
    """A training in memory, on its device.

    Attributes:
        network: The network that is trained.
        optimizer: Its optimiser, of all weights in the order of the network's.
        best: Weights after the epoch of the least validation loss.
        curve: Losses so far.
    """

    network: nn.Module
    optimizer: AdamW
    best: dict[str, Tensor]
    curve: Curve

    @property
    def epoch(self) -> int:
        """Epochs that are done."""
        return len(self.curve.val)

    def keep_weights(self) -> None:
        """Make the weights the best ones."""
        self.best = {name: values.detach().clone() for name, values in self.network.state_dict().items()}


def state_path(path: Path) -> Path:
    """Where the state of the training stands that makes the checkpoint `path`."""
    return path.with_suffix(".training")


def write_state(path: Path, state: TrainingState, provenance: Provenance, environment: Mapping[str, str]) -> None:
    """Create or replace the file at once and durably."""
    tensors = {f"network.{name}": values for name, values in state.network.state_dict().items()}
    tensors |= {f"best.{name}": values for name, values in state.best.items()}
    for name, moments in state.optimizer.moments.items():
        tensors |= {f"{name}.{place}": moment for place, moment in enumerate(moments)}
    write_tensors(path, _document(state.curve, provenance, environment), tensors)


def read_state(path: Path, state: TrainingState, provenance: Provenance, environment: Mapping[str, str]) -> None:
    """Bring a fresh `state` to the state of the file.

    Raises:
        DatasetError: The file cannot be read, or is not of this training.
    """
    file = read_tensors(path)
    try:
        curve = Curve.from_record(file.document["curve"])
        if file.document != _document(curve, provenance, environment):
            raise DatasetError(
                "it belongs to another configuration, release, version or device; delete it to start again"
            )
        state.network.load_state_dict(_part(file.tensors, "network"))
        state.best = _part(file.tensors, "best")
        if state.best.keys() != state.network.state_dict().keys():
            raise DatasetError("its best weights do not fit the model; delete it to start again")
        for name, moments in state.optimizer.moments.items():
            found = _part(file.tensors, name)
            for place, moment in enumerate(moments):
                moment.copy_(found[str(place)])
    except (AttributeError, LookupError, RuntimeError, TypeError, ValueError, DatasetError) as error:
        raise DatasetError(f"{path}: training cannot be resumed from it: {str(error).splitlines()[0]}") from error
    state.curve = curve


def _document(curve: Curve, provenance: Provenance, environment: Mapping[str, str]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "provenance": provenance.record,
        "environment": dict(environment),
        "curve": curve.record,
    }


def _part(tensors: Mapping[str, Tensor], name: str) -> dict[str, Tensor]:
    prefix = f"{name}."
    return {key.removeprefix(prefix): values for key, values in tensors.items() if key.startswith(prefix)}
