"""Encodings of single images that models read: their shapes, types and streams.

What a model learns of images begins at one of these arrays, which no training changes, so that each image is decoded
and encoded once, whatever is trained on it.

===============  =======================================================  ==================
encoding         what it gives                                            shape, type
===============  =======================================================  ==================
``rgb_patches``  the picture at 48 x 24 cells, cut into 8 x 6 patches     ``[48, 72]`` uint8
``bev_patches``  four binary channels at 64 x 64 cells of 2 m, as shares  ``[64, 256]`` uint8
                 of a cell from 0 to 16, cut into 8 x 8 patches
``resnet18``     features of a frozen ResNet-18 before its classes        ``[512]`` float32
===============  =======================================================  ==================

The first two are means over equal cells, in which a pixel on a border counts by the part of its area that lies in the
cell; sums are whole numbers, and means are rounded half up, so that every machine has the same. Patches run row by row,
and so do the numbers of a patch, channels last.

Source: paper, "Research Questions and Experimental Protocol" (frozen ResNet-18); patches are those of vision
transformers (Dosovitskiy et al., ICLR 2021), their sizes this project's choice (docs/decisions/0025-image-encoder.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["BEV", "ENCODINGS", "STREAM_OF", "VIEWS", "Encoding"]

VIEWS, BEV = "views", "bev"
"""Names of the inputs: six surround views, and the semantic bird's-eye view."""

STREAM_OF: Mapping[str, str] = MappingProxyType({VIEWS: "rgb_surround", BEV: "semantic_bev"})
"""Stream of the images of every input."""


@dataclass(frozen=True)
class Encoding:
    """One encoding.

    Attributes:
        input: The input whose images it encodes.
        shape: Of an encoded image: patches and numbers of a patch, or one vector.
        dtype: Type of its numbers.
        offset: Subtracted before a network reads them.
        scale: By which they are divided then.
    """

    input: str
    shape: tuple[int, ...]
    dtype: str
    offset: float = 0.0
    scale: float = 1.0

    @property
    def has_patches(self) -> bool:
        """Whether an image is several patches, and no single vector."""
        return len(self.shape) == 2


ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        "rgb_patches": Encoding(VIEWS, (48, 72), "uint8", 128.0, 64.0),
        "bev_patches": Encoding(BEV, (64, 256), "uint8", 0.0, 16.0),
        "resnet18": Encoding(VIEWS, (512,), "float32"),
    }
)
"""Encodings by name."""
