"""How long a selector that reads cameras takes: from all images of a window, and from those of a new observation.

Both decode and encode the images that they take. The exported selector keeps the steps of earlier observations from
one call to the next, as it does on a vehicle; the networks in plain torch begin with the whole window each time.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (latency of visual selectors);
spec/14-benchmark.md#latency.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.feature import InputContract
from branchdrive.model.features import recorded_features
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.benchmark.onnx_export import (
    CAMERA_INPUTS,
    INPUTS,
    OUTPUT,
    STEPS,
    contexts_of,
    open_selector,
)
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.image_encoder import ImageEncoder, open_encoder
from branchdrive_reference.learning.image_encoding import STREAM_OF, VIEWS
from branchdrive_reference.learning.image_inputs import mask_of
from branchdrive_reference.learning.prediction import check_release, physical
from branchdrive_reference.learning.ranker import VIEW_CAMERAS, CameraNetwork

__all__ = ["CameraContext", "camera_contexts", "exported_camera_selector", "plain_camera_selector"]

Predict = Callable[..., NDArray[Any]]
"""Targets ``[A, 6]`` in their units from the parts of a `CameraContext`."""


class CameraContext(NamedTuple):
    """A history, and what the cameras saw.

    Attributes:
        state: ``[16, 21]`` in physical units.
        controls: ``[80, 3]`` in physical units.
        window: Images of the six cameras at the 16 observations, the last one newest.
    """

    state: NDArray[np.float32]
    controls: NDArray[np.float32]
    window: Sequence[Sequence[bytes]]


def camera_contexts(release: ModelLayer, partition: str, most: int) -> list[CameraContext]:
    """The first contexts of a partition with all their images.

    Raises:
        UsageError: The release claims no surround views.
        DatasetError: An image cannot be read.
    """
    images = release.images(InputContract.SENSOR, STREAM_OF[VIEWS], partition)
    contexts = contexts_of(release, partition)
    whole = np.flatnonzero(images.available.all((1, 2)))[:most]
    size = len(VIEW_CAMERAS)
    found = []
    for group in whole.tolist():
        content = images.read_all(group)
        window = [content[size * step : size * (step + 1)] for step in range(HISTORY_OBSERVATIONS)]
        state, controls = contexts[group]
        found.append(CameraContext(state, controls, window))
    return found


def plain_camera_selector(checkpoints: Sequence[Checkpoint], layer: ModelLayer) -> Predict:
    """The mean over networks as they were trained, one seed after the other, from all images of the window.

    Raises:
        UsageError: A checkpoint was trained under another split or normalisation.
        DatasetError: The release cannot be read.
    """
    for checkpoint in checkpoints:
        check_release(checkpoint, layer)
    networks, scalings, encoder = [one.network() for one in checkpoints], layer.scalings(), _encoder(checkpoints)
    actions, is_recorded = torch.from_numpy(layer.actions()), recorded_features("state", layer.descriptor)

    def predict(state: Any, controls: Any, window: Sequence[Sequence[bytes]]) -> NDArray[Any]:
        views = encoder.encode([image for images in window for image in images])
        known = np.where(is_recorded, scalings.state.apply(state[None]), 0.0)
        inputs = {
            VIEWS: torch.from_numpy(views).unflatten(0, (1, HISTORY_OBSERVATIONS, len(VIEW_CAMERAS))),
            mask_of(VIEWS): torch.ones((1, HISTORY_OBSERVATIONS, len(VIEW_CAMERAS)), dtype=torch.bool),
            "state": torch.from_numpy(known.astype(np.float32)),
            "controls": torch.from_numpy(scalings.controls.apply(controls[None]).astype(np.float32)),
            "actions": actions,
        }
        with torch.inference_mode():
            outcomes = [network(inputs, num_groups=1, num_candidates=len(actions)) for network in networks]
        found: NDArray[np.float64] = np.mean([physical(outcome, scalings)[0][0] for outcome in outcomes], axis=0)
        return found

    return predict


def exported_camera_selector(content: bytes, checkpoints: Sequence[Checkpoint], layer: ModelLayer) -> Predict:
    """An exported selector in ONNX Runtime, from the newest observation of the window and the steps it has kept.

    Raises:
        PlatformError: The extra is not installed.
    """
    session, network, encoder = open_selector(content), CameraNetwork(checkpoints, layer), _encoder(checkpoints)
    there = np.ones(len(VIEW_CAMERAS), np.bool_)
    kept = network.blank_step()[:, None].repeat(1, HISTORY_OBSERVATIONS - 1, 1).numpy()

    def predict(state: Any, controls: Any, window: Sequence[Sequence[bytes]]) -> NDArray[Any]:
        nonlocal kept
        history = {
            name: values for name, values in zip(INPUTS, (state, controls), strict=True) if name in network.reads
        }
        seen = dict(zip(CAMERA_INPUTS, (encoder.encode(window[-1]), there, kept), strict=True))
        found, kept = session.run([OUTPUT, STEPS], seen | history)
        return np.asarray(found)

    return predict


def _encoder(checkpoints: Sequence[Checkpoint]) -> ImageEncoder:
    return open_encoder(checkpoints[0].configuration.model.images[VIEWS].encoding)
