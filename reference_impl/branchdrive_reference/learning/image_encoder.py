"""Encoders of single images: from the bytes of an image to one of the declared encodings.

An encoder is frozen: the same bytes give the same array, whatever is trained. Its digest stands for what the array
depends on besides the bytes: the encoding, the library that decodes and its version, and of a network its weights and
the version of torch. The last bits of a network's features may also depend on the processor, which it leaves out.
Weights of ``resnet18`` are those that torchvision has on this machine; nothing is
ever downloaded.

Source: see `branchdrive_reference.learning.image_encoding`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from branchdrive.contract.semantic_bev import channels_of
from branchdrive.errors import DecodeError, PlatformError
from branchdrive.formats.image_codec import decode_image, decoder
from branchdrive_reference.learning.execution import deterministic
from branchdrive_reference.learning.image_encoding import ENCODINGS, Encoding

__all__ = ["BevPatches", "ImageEncoder", "ResNet18", "RgbPatches", "encoding_of", "open_encoder"]

Picture = NDArray[np.uint8]

_VERSION = 1
"""Changes whenever the same bytes would give other patches."""

_RGB_SIZE, _RGB_PATCH = (24, 48), (4, 6)
_BEV_SIZE, _BEV_PATCH = (64, 64), (8, 8)
_BEV_LEVELS = 16
"""A cell that a channel covers; a cell of 2 m has as many pixels of 0.5 m."""

_RESNET_SIZE = 224
_RESNET_WEIGHTS = "resnet18-f37072fd.pth"
_RESNET_MEAN, _RESNET_SD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class ImageEncoder(Protocol):
    """Encodes single images.

    Attributes:
        encoding: Name of the encoding that it gives.
        digest: Of what an encoded image depends on besides its bytes and the processor, hexadecimal.
    """

    encoding: str
    digest: str

    def encode(self, images: Sequence[bytes]) -> NDArray[Any]:
        """Encoded images ``[n, *shape]``, each by itself.

        Raises:
            DecodeError: One is no image.
            PlatformError: Nothing that decodes images is installed.
        """


@cache
def open_encoder(name: str) -> ImageEncoder:
    """The encoder of an encoding, by name.

    Raises:
        PlatformError: A package or the weights are not on this machine.
    """
    match name:
        case "rgb_patches":
            return RgbPatches()
        case "bev_patches":
            return BevPatches()
        case "resnet18":
            return ResNet18(*_resnet18())
        case _:
            raise KeyError(name)


class RgbPatches:
    """Means of pixels over 48 x 24 cells, cut into patches."""

    encoding = "rgb_patches"

    def __init__(self) -> None:
        self.digest = _digest(self.encoding)

    def encode(self, images: Sequence[bytes]) -> NDArray[np.uint8]:
        """Encoded images ``[n, 48, 72]``."""
        found = np.empty((len(images), *ENCODINGS[self.encoding].shape), np.uint8)
        for patches, content in zip(found, images, strict=True):
            patches[:] = _patches(_means(_rgb(content), _RGB_SIZE, 1), _RGB_PATCH)
        return found


class BevPatches:
    """Shares of 64 x 64 cells that the four binary channels cover, cut into patches."""

    encoding = "bev_patches"

    def __init__(self) -> None:
        self.digest = _digest(self.encoding)

    def encode(self, images: Sequence[bytes]) -> NDArray[np.uint8]:
        """Encoded images ``[n, 64, 256]``."""
        found = np.empty((len(images), *ENCODINGS[self.encoding].shape), np.uint8)
        for patches, content in zip(found, images, strict=True):
            channels = channels_of(_semantic(content)).astype(np.uint8)
            patches[:] = _patches(_means(channels, _BEV_SIZE, _BEV_LEVELS), _BEV_PATCH)
        return found


class ResNet18:
    """Features of a frozen ResNet-18 at 224 x 224 pixels.

    Args:
        network: From normalised pictures ``[n, 3, 224, 224]`` to features ``[n, 512]``.
        digest: Of its weights, hexadecimal.
    """

    encoding = "resnet18"

    def __init__(self, network: nn.Module, digest: str) -> None:
        self._network = network.eval().requires_grad_(requires_grad=False)
        self.digest = _digest(self.encoding, digest, f"torch {torch.__version__}")

    def encode(self, images: Sequence[bytes]) -> NDArray[np.float32]:
        """Encoded images ``[n, 512]``."""
        if not images:
            return np.empty((0, *ENCODINGS[self.encoding].shape), np.float32)
        pictures = torch.cat([self._picture(content) for content in images])
        with deterministic(), torch.inference_mode():
            found: NDArray[np.float32] = self._network(pictures).numpy()
        return found

    def _picture(self, content: bytes) -> torch.Tensor:
        pixels = torch.from_numpy(_rgb(content)).permute(2, 0, 1)[None].float() / 255.0
        size = (_RESNET_SIZE, _RESNET_SIZE)
        picture = functional.interpolate(pixels, size, mode="bilinear", antialias=True, align_corners=False)
        mean, sd = (torch.tensor(values)[None, :, None, None] for values in (_RESNET_MEAN, _RESNET_SD))
        return (picture - mean) / sd


def _digest(encoding: str, *parts: str) -> str:
    """Of an encoding, of what decodes images here, and of what else it depends on."""
    return hashlib.sha256("\n".join((f"{encoding} {_VERSION}", str(decoder()), *parts)).encode()).hexdigest()


def _resnet18() -> tuple[nn.Module, str]:
    """The network without its classes, and the digest of its weights."""
    try:
        models = import_module("torchvision.models")
    except ImportError as error:
        raise PlatformError(
            "the image encoding 'resnet18' needs the package 'torchvision': pip install torchvision"
        ) from error
    path = Path(torch.hub.get_dir()) / "checkpoints" / _RESNET_WEIGHTS
    if not path.is_file():
        raise PlatformError(
            f"the image encoding 'resnet18' needs weights at {str(path)!r}, and nothing is downloaded here; run: "
            "python -c \"import torchvision; torchvision.models.resnet18(weights='IMAGENET1K_V1')\""
        )
    network = models.resnet18(weights=None)
    network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    network.fc = nn.Identity()
    return network, hashlib.sha256(path.read_bytes()).hexdigest()


def _means(picture: Picture, size: tuple[int, int], levels: int) -> Picture:
    """Means over ``rows x columns`` cells ``[rows, columns, channels]``, times `levels`, rounded half up.

    Cells are equal, and a pixel counts in each by the part of its area that lies there. Overlaps of pixels and cells
    are whole numbers in units of ``1 / (rows * columns)`` pixel, and so are all sums: each is exact whatever its order.
    """
    (height, width, channels), (rows, columns) = picture.shape, size
    exact = np.float32 if 255 * height * width < 2**24 else np.float64
    by_row = _overlaps(height, rows, exact) @ picture.reshape(height, -1).astype(exact)
    lines = by_row.reshape(rows, width, channels).transpose(0, 2, 1).reshape(-1, width)
    across = (lines @ _overlaps(width, columns, exact).T).reshape(rows, channels, columns).transpose(0, 2, 1)
    whole = float(height * width)
    means = np.floor((2 * levels * across.astype(np.float64) + whole) / (2 * whole))
    found: Picture = means.astype(np.uint8)
    return found


@cache
def _overlaps(num_pixels: int, num_cells: int, dtype: type[np.floating[Any]]) -> NDArray[Any]:
    """How much of each pixel each of equal cells covers, ``[cells, pixels]``; a row adds up to `num_pixels`."""
    pixel, cell = np.arange(num_pixels) * num_cells, np.arange(num_cells)[:, None] * num_pixels
    found: NDArray[np.int64] = np.minimum(pixel + num_cells, cell + num_pixels) - np.maximum(pixel, cell)
    return found.clip(min=0).astype(dtype)


def _patches(picture: Picture, size: tuple[int, int]) -> Picture:
    """Patches ``[patches, height * width * channels]``, row by row."""
    (rows, columns, channels), (height, width) = picture.shape, size
    cut = picture.reshape(rows // height, height, columns // width, width, channels).transpose(0, 2, 1, 3, 4)
    return cut.reshape(-1, height * width * channels)


def _rgb(content: bytes) -> Picture:
    """Pixels of a picture ``[height, width, 3]``, of a grey one too."""
    pixels = decode_image(content)
    return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)


def _semantic(content: bytes) -> Picture:
    """Pixels of a semantic view ``[height, width]``.

    Raises:
        DecodeError: It is a picture of colours.
    """
    pixels = decode_image(content)
    if pixels.ndim != 2:
        raise DecodeError("is a picture of colours, and no semantic view")
    return pixels


def encoding_of(encoder: ImageEncoder) -> Encoding:
    """The declared encoding that an encoder gives."""
    return ENCODINGS[encoder.encoding]
