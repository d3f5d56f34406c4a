"""Configurations of models and of their training: frozen values that are JSON and have a digest.

The models of the benchmark are declared in its protocol, ``schemas/v0.1/benchmark-protocol.json``. A release brings
a protocol of its own, so what is read of one is bounded: a name that is a part of a path, widths that fit in
memory, and numbers with which a training is defined.

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
M3r       histories, actions   553,784
========  ===================  ==========  =============

M3r is M3, trained for decisions as well; M3o and M3or are the two with objects beside the history, for releases that
have them. These are no models of the paper.

Source: paper, "Research Questions and Experimental Protocol" (optimiser, schedule, loss, batch size, seeds); widths,
learning rate and weight decay are this project's choice, widths so that the numbers of parameters are near the
paper's.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError

from branchdrive.benchmark.protocol.protocol import DeclaredModel
from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.document import dump_json
from branchdrive.contract.text import printable
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.feature import InputContract
from branchdrive.driving.utility import Profile
from branchdrive.errors import DatasetError, UsageError
from branchdrive_reference.learning.image_encoding import BEV, ENCODINGS, STREAM_OF, VIEWS

__all__ = [
    "MAX_WIDTH",
    "MODEL_VERSION",
    "ActionConfig",
    "Configuration",
    "DecisionConfig",
    "HistoryConfig",
    "ImagesConfig",
    "ModelConfig",
    "ObjectsConfig",
    "PreferenceConfig",
    "TrainingConfig",
    "TreesConfig",
    "is_model_name",
]

MODEL_VERSION = "0.1.0"
"""Changes whenever the same configuration, seed and release would give other weights or predictions."""

MAX_WIDTH = 768
"""Widths up to which the state of a training stays below the size of the largest file that is read."""

MAX_PREFERENCES = 16
"""Preferences that one training may serve."""

Width = Annotated[int, Field(ge=1, le=MAX_WIDTH)]
Count = Annotated[int, Field(ge=1, le=100_000)]
Positive = Annotated[float, Field(gt=0, le=1000)]
NotNegative = Annotated[float, Field(ge=0, le=1000)]
Name = Annotated[str, Field(pattern=PATTERNS["model"])]
Share = Annotated[float, Field(ge=0, le=1)]

_MAX_PLACE = 200
_NOTHING_ELSE = ConfigDict(extra="forbid")


def _encoding_name(name: str) -> str:
    if name not in ENCODINGS:
        raise ValueError(f"no image encoding {name!r:.80}; there are {', '.join(ENCODINGS)}")
    return name


def is_model_name(text: str) -> bool:
    """Whether a text may be the name of a model, which is a part of names of files."""
    return re.fullmatch(PATTERNS["model"], text) is not None


@dataclass(frozen=True)
class HistoryConfig:
    """Encoder of state and control histories.

    Attributes:
        step_width: Width of an embedded step.
        state_width: Width of the recurrence over observations.
        controls_width: Width of the recurrence over controls.
    """

    __pydantic_config__ = _NOTHING_ELSE

    step_width: Width
    state_width: Width
    controls_width: Width


@dataclass(frozen=True)
class ActionConfig:
    """Encoder of a candidate action.

    Attributes:
        hidden_width: Width of its hidden layer.
        width: Width of the encoding.
    """

    __pydantic_config__ = _NOTHING_ELSE

    hidden_width: Width
    width: Width


@dataclass(frozen=True)
class ImagesConfig:
    """Encoder of a history of images.

    Attributes:
        encoding: What of an image is read, see `branchdrive_reference.learning.image_encoding`.
        image_width: Width of an encoded image.
        step_width: Width of all images of one observation.
        width: Width of the encoding of the history.
        patch_width: Width of an encoded patch; ``None`` for an encoding without patches.
    """

    __pydantic_config__ = _NOTHING_ELSE

    encoding: Annotated[str, AfterValidator(_encoding_name)]
    image_width: Width
    step_width: Width
    width: Width
    patch_width: Width | None = None

    def __post_init__(self) -> None:
        if ENCODINGS[self.encoding].has_patches != (self.patch_width is not None):
            raise ValueError("a `patch_width` goes with an encoding of patches, and with no other")


@dataclass(frozen=True)
class ObjectsConfig:
    """Encoder of the objects that sensors tell of, by attention.

    Attributes:
        observations: The last observations of the history whose objects are read.
        object_width: Width of an encoded object.
        heads: Ways of attending to them.
        width: Width of the encoding.
    """

    __pydantic_config__ = _NOTHING_ELSE

    observations: Annotated[int, Field(ge=1, le=HISTORY_OBSERVATIONS)]
    object_width: Width
    heads: Annotated[int, Field(ge=1, le=16)]
    width: Width


@dataclass(frozen=True)
class TreesConfig:
    """Gradient-boosted trees of every target.

    Attributes:
        iterations: Trees of a target.
        leaves: Leaves of a tree at most.
        learning_rate: Share of each tree that counts.
        min_rows: Training rows of a leaf at least.
    """

    __pydantic_config__ = _NOTHING_ELSE

    iterations: Annotated[int, Field(ge=1, le=1000)]
    leaves: Annotated[int, Field(ge=2, le=64)]
    learning_rate: Annotated[float, Field(gt=0, le=1)]
    min_rows: Count


@dataclass(frozen=True)
class ModelConfig:
    """A model.

    Attributes:
        name: ``M0`` and so on.
        contract: Input contract under which it reads, by value.
        fusion_width: Width of the fusion from which the outcome is read.
        history: Encoder of histories, ``None`` for a model that reads none.
        action: Encoder of actions, ``None`` for a model that makes one prediction for the whole bank.
        trees: Boosted trees in place of encoders, which read all inputs of the contract and actions; ``None`` for a
            network.
        views: Encoder of surround views.
        bev: Encoder of the bird's-eye view.
        objects: Encoder of objects, for the contract of that name.
    """

    __pydantic_config__ = _NOTHING_ELSE

    name: Name
    contract: Annotated[str, AfterValidator(lambda value: InputContract(value).value)]
    fusion_width: Width
    history: HistoryConfig | None = None
    action: ActionConfig | None = None
    trees: TreesConfig | None = None
    views: ImagesConfig | None = None
    bev: ImagesConfig | None = None
    objects: ObjectsConfig | None = None

    def __post_init__(self) -> None:
        if self.objects is not None and (self.trees is not None or self.contract != InputContract.OBJECTS.value):
            raise ValueError("`objects` are encoded by networks under the contract 'objects', and by no others")
        for name, images in self.images.items():
            if ENCODINGS[images.encoding].input != name:
                raise ValueError(f"the encoding {images.encoding!r} is not one of `{name}`")
            if self.trees is not None:
                raise ValueError("trees read no images")
            try:
                InputContract.named(self.contract).admit_stream(STREAM_OF[name])
            except UsageError as error:
                raise ValueError(str(error)) from None

    @property
    def images(self) -> dict[str, ImagesConfig]:
        """Encoders of images, by the name of their input."""
        return {name: images for name, images in ((VIEWS, self.views), (BEV, self.bev)) if images is not None}

    @property
    def is_trained(self) -> bool:
        """Whether there are weights to train by descent."""
        encoders = (self.history, self.action, self.objects, *self.images.values())
        return self.trees is None and any(encoder is not None for encoder in encoders)

    @property
    def reads_actions(self) -> bool:
        """Whether it tells candidates apart."""
        return self.action is not None or self.trees is not None


@dataclass(frozen=True)
class PreferenceConfig:
    """What a decision weighs, as a profile of the protocol does.

    Attributes:
        separation: Weight of separation.
        displacement: Weight of displacement.
        comfort: Weight of comfort, split evenly over its three targets.
        near_m: Range of separation that is scored, metres; ``None`` for that between its quantiles.
    """

    __pydantic_config__ = _NOTHING_ELSE

    separation: Share
    displacement: Share
    comfort: Share
    near_m: Positive | None = None

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the targets that utility weighs, ``[5]``."""
        return Profile(self.separation, self.displacement, self.comfort).weights


@dataclass(frozen=True)
class DecisionConfig:
    """Training for the choice among the candidates of a context, beside the outcome of each.

    Attributes:
        contrast_weight: Weight of how wrong the desirabilities of candidates are beside one another.
        regret_weight: Weight of the regret of a soft choice.
        temperature: Difference of utility by which the soft choice tells two candidates apart.
        preferences: By name, those whose choices are made; all weigh the same.
    """

    __pydantic_config__ = _NOTHING_ELSE

    contrast_weight: NotNegative
    regret_weight: NotNegative
    temperature: Annotated[float, Field(ge=1e-3, le=1000)]
    preferences: Annotated[dict[Name, PreferenceConfig], Field(min_length=1, max_length=MAX_PREFERENCES)]


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
        decision: Training for decisions, ``None`` for outcomes alone.
    """

    __pydantic_config__ = _NOTHING_ELSE

    batch_groups: Count
    learning_rate: Annotated[float, Field(gt=0, le=1)]
    weight_decay: Annotated[float, Field(ge=0, le=1)]
    warmup_epochs: Annotated[int, Field(ge=0, le=100_000)]
    max_epochs: Count
    patience: Count
    huber_delta: Positive
    smooth_l1_beta: NotNegative
    heading_weight: NotNegative
    decision: DecisionConfig | None = None

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

    __pydantic_config__ = _NOTHING_ELSE

    model: ModelConfig
    training: TrainingConfig

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
            DatasetError: The record is not exactly that of a configuration, or a value is out of range.
        """
        try:
            found = _ADAPTER.validate_json(dump_json(record), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False)[0]
            place = printable("".join(f"/{part}" for part in first["loc"])[:_MAX_PLACE]) or "/"
            raise DatasetError(f"not a valid model configuration: {place}: {first['msg']}") from error
        except (TypeError, ValueError) as error:
            raise DatasetError(f"not a valid model configuration: {str(error).splitlines()[0]}") from error
        if dump_json(found.record) != dump_json(record):
            raise DatasetError(
                "not a valid model configuration: expected no null, and numbers written like `64` or `1.0`"
            )
        return found

    @classmethod
    def of(cls, declared: DeclaredModel) -> Configuration:
        """The configuration of a model of a protocol.

        Raises:
            DatasetError: This software has no such configuration.
        """
        try:
            return cls.from_record(declared.configuration)
        except DatasetError as error:
            raise DatasetError(f"model {declared.id!r}: {error}") from error


_ADAPTER = TypeAdapter(Configuration)


def _present(record: dict[str, Any]) -> dict[str, Any]:
    return {
        name: _present(value) if isinstance(value, dict) else value
        for name, value in record.items()
        if value is not None
    }
