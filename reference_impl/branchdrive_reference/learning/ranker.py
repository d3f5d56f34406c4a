"""Ranking the action bank from one context by models of several seeds, as one network.

The prediction is the mean over seeds, and only scalars are computed, which are all that utility needs. From cameras,
the images of an observation become one step of each seed, the last 16 steps are kept, and a new observation costs its
own images alone: ranking after it gives what ranking from all 96 images gives.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (outcome-derived selection, latency of the
structured selector); stacking and kept steps are this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor, nn

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import Profile, Scale, utility
from branchdrive.errors import UsageError
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.image_encoder import open_encoder
from branchdrive_reference.learning.image_encoding import ENCODINGS, STREAM_OF, VIEWS
from branchdrive_reference.learning.image_network import ImageHistoryEncoder
from branchdrive_reference.learning.network import (
    HISTORY,
    OBJECTS,
    ActionEncoder,
    Decoder,
    HistoryEncoder,
    OutcomeNetwork,
)
from branchdrive_reference.learning.objects_network import ObjectsEncoder
from branchdrive_reference.learning.prediction import check_release
from branchdrive_reference.learning.stacked import SeedHistories, SeedObjects, StackedDecoder, StackedImages

__all__ = [
    "BankNetwork",
    "BankRanker",
    "CameraNetwork",
    "CameraRanker",
    "Ranking",
    "StepRing",
    "can_rank",
    "reads_cameras",
]

Array = NDArray[np.float64]

VIEW_CAMERAS = STREAMS[STREAM_OF[VIEWS]].cameras
"""Cameras of an observation, in the order of their images."""


class Ranking(NamedTuple):
    """The bank from one context.

    Attributes:
        order: Candidates from the best to the worst, ties in canonical order, ``[A]``.
        utilities: Predicted utility of every candidate, ``[A]``.
        scalars: Predicted targets, mean over seeds, ``[A, 6]`` in their units.
    """

    order: NDArray[np.intp]
    utilities: Array
    scalars: Array

    @classmethod
    def of(cls, scalars: Tensor, scale: Scale, profile: Profile) -> Ranking:
        """The ranking by predicted targets ``[A, 6]``."""
        values = scalars.numpy().astype(np.float64)
        utilities = utility(Targets(values, np.ones(values.shape, np.bool_)), scale, profile)
        return cls(np.argsort(-utilities, kind="stable"), utilities, values)


class BankRanker:
    """Ranks the candidates of the bank of a release; the quickest on one thread of torch.

    Args:
        checkpoints: Models of one configuration that read histories and actions.
        release: The release they were trained on; only scalings and encoded actions are read.
        scale: Quantiles of the training targets.
        profile: What is preferred.

    Raises:
        UsageError: A model reads something else, or was trained under another split or normalisation.
        DatasetError: The release cannot be read.
    """

    def __init__(
        self, checkpoints: Sequence[Checkpoint], release: ModelLayer, *, scale: Scale, profile: Profile
    ) -> None:
        self.network = BankNetwork(checkpoints, release)
        self._scale, self._profile = scale, profile

    def __call__(
        self, state: ArrayLike, controls: ArrayLike, objects: ArrayLike | None = None, mask: ArrayLike | None = None
    ) -> Ranking:
        """Rank from one context.

        Args:
            state: ``[16, 21]`` in physical units.
            controls: ``[80, 3]`` in physical units.
            objects: ``[16, 32, 11]``, for a model that reads objects.
            mask: Which of them there are ``[16, 32]``.

        Raises:
            UsageError: The model reads objects and has none, or has some and reads none.
        """
        seen = [given for given in (objects, mask) if given is not None]
        if len(seen) != len(self.network.reads) - 2:
            raise UsageError(f"the model reads {list(self.network.reads)}; give it that and no more")
        context = _context(state, controls)
        if seen:
            context += [*_context(seen[0]), torch.from_numpy(np.array(seen[1], np.bool_))]
        with torch.inference_mode():
            return Ranking.of(self.network(*context), self._scale, self._profile)


class CameraRanker:
    """Ranks the candidates of the bank from what the cameras saw last; the quickest on one thread of torch.

    Give it every observation as it comes, a quarter of a second apart. Before the first ones, no image is there.

    Args:
        checkpoints: Models of one configuration that read surround views and actions, and histories or not.
        release: The release they were trained on; only scalings and encoded actions are read.
        scale: Quantiles of the training targets.
        profile: What is preferred.

    Raises:
        UsageError: A model reads something else, or was trained under another split or normalisation.
        DatasetError: The release cannot be read.
        PlatformError: The encoder of images is not on this machine.
    """

    def __init__(
        self, checkpoints: Sequence[Checkpoint], release: ModelLayer, *, scale: Scale, profile: Profile
    ) -> None:
        self.network = CameraNetwork(checkpoints, release)
        self._scale, self._profile = scale, profile
        self._encoder = open_encoder(self.network.encoding)
        self.reset()

    def reset(self) -> None:
        """Forget all observations."""
        with torch.inference_mode():
            self._ring = StepRing(self.network.blank_step())

    def observe(self, images: Mapping[str, bytes]) -> None:
        """Take one observation: its images by camera; a camera that is left out has none.

        Raises:
            UsageError: There is no such camera.
            DecodeError: One is no image.
        """
        if strange := sorted(images.keys() - set(VIEW_CAMERAS)):
            raise UsageError(f"no camera {strange[0]!r}; there are {', '.join(VIEW_CAMERAS)}")
        about = ENCODINGS[self.network.encoding]
        values = np.zeros((len(VIEW_CAMERAS), *about.shape), about.dtype)
        there = np.array([camera in images for camera in VIEW_CAMERAS])
        values[there] = self._encoder.encode([images[camera] for camera in VIEW_CAMERAS if camera in images])
        with torch.inference_mode():
            self._ring.push(self.network.images.encode_step(torch.from_numpy(values), torch.from_numpy(there)))

    def __call__(self, state: ArrayLike | None = None, controls: ArrayLike | None = None) -> Ranking:
        """Rank from the last 16 observations.

        Args:
            state: ``[16, 21]`` in physical units, for a model that reads histories.
            controls: ``[80, 3]`` in physical units, for a model that reads histories.

        Raises:
            UsageError: The model reads histories and has none, or has one and reads none.
        """
        given = {name: v for name, v in (("state", state), ("controls", controls)) if v is not None}
        if tuple(given) != self.network.reads:
            raise UsageError(f"the model reads {list(self.network.reads) or 'no history'}; give it that and no more")
        with torch.inference_mode():
            window, history = self._ring.window(), _context(*given.values())
            return Ranking.of(self.network.rank(window, *history), self._scale, self._profile)


class StepRing:
    """The last 16 steps of every seed, each in the place of the one before it 16 observations ago.

    Args:
        blank: The step of an observation without images, ``[seeds, step width]``.
    """

    def __init__(self, blank: Tensor) -> None:
        self._steps = blank[:, None].repeat(1, HISTORY_OBSERVATIONS, 1)
        self._oldest = 0

    def push(self, step: Tensor) -> None:
        """Put a step ``[seeds, step width]`` in the place of the oldest."""
        self._steps[:, self._oldest] = step
        self._oldest = (self._oldest + 1) % HISTORY_OBSERVATIONS

    def window(self) -> Tensor:
        """All steps, the oldest first, ``[seeds, 16, step width]``."""
        return torch.cat([self._steps[:, self._oldest :], self._steps[:, : self._oldest]], dim=1)


class BankNetwork(nn.Module):
    """Mean predicted scalars of the bank: ``state [16, 21]`` and ``controls [80, 3]`` to ``[A, 6]``, in their units.

    A model of objects takes ``objects [16, 32, 11]`` and ``objects_mask [16, 32]`` besides.
    It is made of tensor operations with fixed shapes alone, so that it can be traced and exported.
    See `BankRanker` for arguments and errors.

    Attributes:
        reads: Names of its inputs.
    """

    def __init__(self, checkpoints: Sequence[Checkpoint], release: ModelLayer) -> None:
        super().__init__()
        networks = _networks(checkpoints, release)
        if any(encoders.keys() - {OBJECTS} != {HISTORY} for encoders, _, _ in networks):
            raise UsageError(f"{checkpoints[0].provenance.model} is no model of histories, objects and actions alone")
        encoders = [found[OBJECTS] for found, _, _ in networks if OBJECTS in found]
        seen = [encoder for encoder in encoders if isinstance(encoder, ObjectsEncoder)]
        self.reads = (*HistoryEncoder.reads, *(ObjectsEncoder.reads[1:] if seen else ()))
        with torch.no_grad():
            self.history, self.decoder = _history(networks, release), _decoder(networks, release)
            decoders = [decoder for _, _, decoder in networks]
            self.objects = SeedObjects(seen, decoders, release) if seen else None

    def forward(self, state: Tensor, controls: Tensor, *seen: Tensor) -> Tensor:
        """From a context in physical units."""
        context = self.history(state, controls)
        if self.objects is not None:
            context = context + self.objects(state, *seen)
        scalars: Tensor = self.decoder(context)
        return scalars


class CameraNetwork(nn.Module):
    """Mean predicted scalars of the bank from steps of images, and from a history where the model reads one.

    It is made of tensor operations with fixed shapes alone, so that it can be traced and exported.
    See `CameraRanker` for arguments and errors.

    Attributes:
        encoding: Name of the encoding of its images.
        reads: Names of the inputs of its history.
    """

    def __init__(self, checkpoints: Sequence[Checkpoint], release: ModelLayer) -> None:
        super().__init__()
        networks = _networks(checkpoints, release)
        encoders = [found[VIEWS] for found, _, _ in networks if found.keys() - {HISTORY} == {VIEWS}]
        images = [encoder for encoder in encoders if isinstance(encoder, ImageHistoryEncoder)]
        if len(images) != len(networks):
            raise UsageError(f"{checkpoints[0].provenance.model} is no model of surround views and actions")
        has_history = HISTORY in networks[0][0]
        self.encoding = checkpoints[0].configuration.model.images[VIEWS].encoding
        self.reads = HistoryEncoder.reads if has_history else ()
        with torch.no_grad():
            self.images = StackedImages(images, [decoder for _, _, decoder in networks], VIEWS)
            self.history = _history(networks, release) if has_history else None
            self.decoder = _decoder(networks, release)

    def forward(self, views: Tensor, mask: Tensor, past: Tensor, *history: Tensor) -> tuple[Tensor, Tensor]:
        """One observation more.

        Args:
            views: Its encoded images ``[6, *encoding]``.
            mask: Which of them there are ``[6]``.
            past: Steps of the 15 observations before it, oldest first, ``[seeds, 15, step width]``.
            history: ``state [16, 21]`` and ``controls [80, 3]`` in physical units, for a model that reads them.

        Returns:
            Targets ``[A, 6]``, and the steps of the last 15 observations, which are `past` next time.
        """
        steps = torch.cat([past, self.images.encode_step(views, mask)[:, None]], dim=1)
        return self.rank(steps, *history), steps[:, 1:]

    def rank(self, steps: Tensor, *history: Tensor) -> Tensor:
        """Targets ``[A, 6]`` from the steps of a window ``[seeds, 16, step width]``, oldest first."""
        context = self.images(steps)
        if self.history is not None:
            context = context + self.history(*history)
        scalars: Tensor = self.decoder(context)
        return scalars

    def blank_step(self) -> Tensor:
        """The step of an observation without images, ``[seeds, step width]``."""
        about = ENCODINGS[self.encoding]
        views = torch.zeros((len(VIEW_CAMERAS), *about.shape))
        return self.images.encode_step(views, torch.zeros(len(VIEW_CAMERAS), dtype=torch.bool))


def reads_cameras(checkpoints: Sequence[Checkpoint]) -> bool:
    """Whether models read surround views."""
    return any(VIEWS in checkpoint.configuration.model.images for checkpoint in checkpoints)


def can_rank(checkpoints: Sequence[Checkpoint]) -> bool:
    """Whether models are networks of actions with histories, surround views or both: those that a ranker takes."""
    models = [checkpoint.configuration.model for checkpoint in checkpoints]
    return all(
        model.trees is None
        and model.action is not None
        and model.images.keys() <= {VIEWS}
        and (model.history is not None or bool(model.images))
        for model in models
    )


_Network = tuple[dict[str, nn.Module], ActionEncoder, Decoder]


def _networks(checkpoints: Sequence[Checkpoint], release: ModelLayer) -> list[_Network]:
    """Encoders of contexts by name, encoder of actions and decoder of every seed."""
    if len({checkpoint.configuration.digest for checkpoint in checkpoints}) != 1:
        raise UsageError(f"{len(checkpoints)} checkpoints are not seeds of one configuration")
    found = []
    for checkpoint in checkpoints:
        check_release(checkpoint, release)
        network = checkpoint.network()
        if not isinstance(network, OutcomeNetwork) or network.bank is None:
            raise UsageError(f"{checkpoint.provenance.model} is no model of contexts and actions")
        found.append((dict(network.contexts.items()), network.bank, network.decoder))
    return found


def _history(networks: Sequence[_Network], release: ModelLayer) -> SeedHistories:
    encoders = [encoders[HISTORY] for encoders, _, _ in networks]
    kept = [encoder for encoder in encoders if isinstance(encoder, HistoryEncoder)]
    return SeedHistories(kept, [decoder for _, _, decoder in networks], release)


def _decoder(networks: Sequence[_Network], release: ModelLayer) -> StackedDecoder:
    return StackedDecoder([decoder for _, _, decoder in networks], [bank for _, bank, _ in networks], release)


def _context(*histories: ArrayLike) -> list[Tensor]:
    return [torch.from_numpy(np.array(values, np.float32)) for values in histories]
