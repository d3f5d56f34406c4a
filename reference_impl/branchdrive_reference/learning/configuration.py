"""Configurations of models and of their training: frozen values that are JSON and have a digest.

A model is a composition: encoders of what the context holds, an encoder of the candidate actions, and one fusion.
What a configuration leaves out is not in its record, so that a new kind of encoder changes no digest of a model
without it. A model without any encoder predicts the training mean.

========  ===================  ==========  =============
model     reads                parameters  paper (M)
========  ===================  ==========  =============
M0        nothing              0           0
M1        actions              202,424     0.202
M2        histories            399,800     0.398
M3        histories, actions   553,784     0.553
========  ===================  ==========  =============

Source: paper IV-B (optimiser, schedule, loss, batch size, seeds); widths, learning rate and weight decay are this
project's choice, widths so that the numbers of parameters are near the paper's.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any

from pydantic import TypeAdapter, ValidationError

from branchdrive.contract.document import dump_json
from branchdrive.derive.feature import InputContract
from branchdrive.errors import DatasetError

__all__ = [
    "CONFIGURATIONS",
    "MODEL_VERSION",
    "SEEDS",
    "ActionConfig",
    "Configuration",
    "HistoryConfig",
    "ModelConfig",
    "TrainingConfig",
]

MODEL_VERSION = "0.1.0"
"""Changes whenever the same configuration, seed and release would give other weights or predictions."""

SEEDS = (11, 23, 37)
"""Seeds of every trained model."""


@dataclass(frozen=True)
class HistoryConfig:
    """Encoder of state and control histories.

    Attributes:
        step_width: Width of an embedded step.
        state_width: Width of the recurrence over observations.
        controls_width: Width of the recurrence over controls.
    """

    step_width: int = 128
    state_width: int = 192
    controls_width: int = 128


@dataclass(frozen=True)
class ActionConfig:
    """Encoder of a candidate action.

    Attributes:
        hidden_width: Width of its hidden layer.
        width: Width of the encoding.
    """

    hidden_width: int = 192
    width: int = 384


@dataclass(frozen=True)
class ModelConfig:
    """A model.

    Attributes:
        name: ``M0`` and so on.
        contract: Input contract under which it reads, by value.
        history: Encoder of histories, ``None`` for a model that reads none.
        action: Encoder of actions, ``None`` for a model that makes one prediction for the whole bank.
        fusion_width: Width of the fusion from which the outcome is read.
    """

    name: str
    contract: str = InputContract.SENSOR.value
    history: HistoryConfig | None = None
    action: ActionConfig | None = None
    fusion_width: int = 192

    @property
    def is_trained(self) -> bool:
        """Whether there are weights to train."""
        return self.history is not None or self.action is not None


@dataclass(frozen=True)
class TrainingConfig:
    """Training of a model.

    Attributes:
        batch_groups: Branch groups of a batch, each with its whole bank.
        learning_rate: Largest rate, after the warm-up.
        weight_decay: Of AdamW, on all weights.
        warmup_epochs: Epochs in which the rate rises linearly.
        max_epochs: Epochs at most; where the cosine ends.
        patience: Epochs without a lesser validation loss after which training ends.
        huber_delta: Where the loss of normalised scalars turns from square to linear.
        smooth_l1_beta: The same for normalised trajectories.
        heading_weight: Weight of the deviation of (sin, cos) from unit norm.
    """

    batch_groups: int = 64
    learning_rate: float = 5e-4
    weight_decay: float = 1e-2
    warmup_epochs: int = 5
    max_epochs: int = 150
    patience: int = 20
    huber_delta: float = 1.0
    smooth_l1_beta: float = 1.0
    heading_weight: float = 0.05

    def learning_rate_at(self, epoch: int) -> float:
        """Rate of the epoch ``e = 1, 2, ...``, with ``w`` epochs of warm-up and ``E`` at most.

        ``rate * e / w`` up to ``w``, then ``rate * (1 + cos(pi (e - w) / (E - w + 1))) / 2``, above 0 to the end.
        """
        if epoch <= self.warmup_epochs:
            return self.learning_rate * epoch / self.warmup_epochs
        done = (epoch - self.warmup_epochs) / (self.max_epochs - self.warmup_epochs + 1)
        return self.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))


@dataclass(frozen=True)
class Configuration:
    """A model and its training."""

    model: ModelConfig
    training: TrainingConfig = field(default_factory=TrainingConfig)

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds to train with; a model without weights is the same for all and has the seed 0."""
        return SEEDS if self.model.is_trained else (0,)

    @property
    def record(self) -> dict[str, Any]:
        """The configuration as JSON data, without what is left out."""
        return {"model": _present(asdict(self.model)), "training": _present(asdict(self.training))}

    @property
    def digest(self) -> str:
        """SHA-256 of the canonical bytes of the record, hexadecimal."""
        return hashlib.sha256(dump_json(self.record)).hexdigest()

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Configuration:
        """The configuration of a record.

        Raises:
            DatasetError: The record is not exactly that of a configuration.
        """
        try:
            found = _ADAPTER.validate_json(dump_json(record), strict=True)
        except (TypeError, ValueError, ValidationError) as error:
            raise DatasetError(f"no model configuration: {str(error).splitlines()[0]}") from error
        if dump_json(found.record) != dump_json(record):
            raise DatasetError("no model configuration: it has unknown entries or lacks some")
        return found


_ADAPTER = TypeAdapter(Configuration)


def _present(record: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in record.items() if value is not None}


CONFIGURATIONS: Mapping[str, Configuration] = MappingProxyType(
    {
        model.name: Configuration(model)
        for model in (
            ModelConfig("M0"),
            ModelConfig("M1", action=ActionConfig()),
            ModelConfig("M2", history=HistoryConfig()),
            ModelConfig("M3", history=HistoryConfig(), action=ActionConfig()),
        )
    }
)
"""The configurations of the structured models, by name."""
