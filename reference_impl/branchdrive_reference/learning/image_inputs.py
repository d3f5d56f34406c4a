"""Encoded images of the groups of a partition, as inputs of models.

With ``N`` groups and ``C`` cameras of an input::

    views   [N, 16, 6, *encoding]     views_mask  [N, 16, 6]      any contract
    bev     [N, 16, 1, *encoding]     bev_mask    [N, 16, 1]      privileged contract

Where a mask is false the release has no image, and zeros stand in its place.

Source: paper, "Model Inputs and Targets"; spec/12-model.md#media.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.feature import InputContract
from branchdrive.errors import DatasetError, DecodeError, UsageError
from branchdrive.model.images import ImageHistory
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.configuration import ModelConfig
from branchdrive_reference.learning.feature_cache import FeatureCache, features_key
from branchdrive_reference.learning.image_encoder import ImageEncoder, encoding_of, open_encoder
from branchdrive_reference.learning.image_encoding import STREAM_OF

__all__ = ["image_arrays", "image_encoders", "mask_of"]


def mask_of(name: str) -> str:
    """Name of the mask of an input of images."""
    return f"{name}_mask"


def image_encoders(model: ModelConfig) -> dict[str, ImageEncoder]:
    """Encoders of the images that a model reads, by input.

    Raises:
        PlatformError: A package or weights are not on this machine.
    """
    return {name: open_encoder(images.encoding) for name, images in model.images.items()}


def image_arrays(
    layer: ModelLayer,
    partition: str,
    contract: InputContract,
    encoders: Mapping[str, ImageEncoder],
    variant: str | None = None,
) -> dict[str, NDArray[Any]]:
    """Encoded images and masks by name.

    Args:
        layer: The release, with its raw layer; encoded images are kept beside it, where it is in a folder.
        partition: ``train``, ``val``, ``test`` or ``calibration``.
        contract: What the inputs may hold.
        encoders: Encoder of every input that is wanted, by name.
        variant: A declared variant; the frozen population by default.

    Raises:
        UsageError: The contract refuses a stream, or the dataset does not claim it, or an encoder is for another input.
        DatasetError: An image cannot be read.
    """
    found: dict[str, NDArray[Any]] = {}
    cache = FeatureCache.beside(layer.folder)
    for name, encoder in encoders.items():
        if encoding_of(encoder).input != name:
            raise UsageError(f"the encoding {encoder.encoding!r} is not one of the input {name!r}")
        images = layer.images(contract, STREAM_OF[name], partition, variant=variant)
        found[name], found[mask_of(name)] = _encoded(images, encoder, cache), images.available
    return found


def _encoded(images: ImageHistory, encoder: ImageEncoder, cache: FeatureCache) -> NDArray[Any]:
    about = encoding_of(encoder)
    found = np.empty((*images.available.shape, *about.shape), about.dtype)
    for group, values in enumerate(found):
        key = features_key(encoder.digest, images.checksums[group])
        kept = cache.get(key, values.shape, about.dtype)
        if kept is None:
            values[:] = 0
            pictures = images.read_all(group)
            try:
                values[images.available[group]] = encoder.encode(pictures)
            except DecodeError as error:
                raise DatasetError(
                    f"an image of group {images.groups[group]!r} {error}; run `branchdrive-validate`"
                ) from error
            cache.put(key, values)
        else:
            values[:] = kept
    return found
