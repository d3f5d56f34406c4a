"""Encoder of a history of images: every image by itself, all images of an observation as a step, steps as a window.

With cameras ``c``, steps ``t`` of the 16 observations and an encoded image ``x_tc`` of patches ``x_tcp``::

    e_tc = E gelu(P x_tcp over all p)      P shared by all patches, E by all images;  E x_tc without patches
    s_t  = gelu(norm(S [e_t1 .. e_tC]))    0 in the place of an image that is not there
    f    = gelu(W [s_1 .. s_16])

A step depends on its own images alone. A driver keeps the last 16 steps, and a new observation costs one step
and one window.

Source: paper, "Compared Models" for what is read; the layers are this project's choice.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive_reference.learning.configuration import ImagesConfig
from branchdrive_reference.learning.image_encoding import ENCODINGS, STREAM_OF
from branchdrive_reference.learning.image_inputs import mask_of

__all__ = ["ImageHistoryEncoder"]

_CHUNK = 64
"""Groups that are encoded at once where no gradient is wanted, which bounds memory."""


class ImageHistoryEncoder(nn.Module):
    """Encoded images ``[B, 16, C, *encoding]`` and their mask ``[B, 16, C]`` as ``[B, width]``."""

    def __init__(self, config: ImagesConfig) -> None:
        super().__init__()
        self.encoding = about = ENCODINGS[config.encoding]
        num_cameras = len(STREAMS[STREAM_OF[about.input]].cameras)
        self.reads = (about.input, mask_of(about.input))
        self.width = config.width
        self.step_width = config.step_width
        num_features, *_ = about.shape
        self.patch: nn.Linear | None = None
        if config.patch_width is not None:
            num_patches, patch_size = about.shape
            self.patch = nn.Linear(patch_size, config.patch_width)
            num_features = num_patches * config.patch_width
        self.image = nn.Linear(num_features, config.image_width)
        self.step = nn.Linear(num_cameras * config.image_width, config.step_width)
        self.norm = nn.LayerNorm(config.step_width)
        self.window = nn.Linear(HISTORY_OBSERVATIONS * config.step_width, config.width)

    def forward(self, images: Tensor, mask: Tensor) -> Tensor:
        """Each history by itself."""
        if torch.is_grad_enabled():
            return self.encode_window(self.encode_steps(images, mask))
        parts = zip(images.split(_CHUNK), mask.split(_CHUNK), strict=True)
        return self.encode_window(torch.cat([self.encode_steps(*part) for part in parts]))

    def encode_steps(self, images: Tensor, mask: Tensor) -> Tensor:
        """Steps ``[..., step width]`` of encoded images ``[..., C, *encoding]`` and their mask ``[..., C]``."""
        values = (images.to(self.image.weight.dtype) - self.encoding.offset) / self.encoding.scale
        if self.patch is not None:
            values = functional.gelu(self.patch(values)).flatten(-2)
        encoded = torch.where(mask[..., None], self.image(values), 0.0)
        step: Tensor = functional.gelu(self.norm(self.step(encoded.flatten(-2))))
        return step

    def encode_window(self, steps: Tensor) -> Tensor:
        """Steps ``[B, 16, step width]``, from the first to the last, as ``[B, width]``."""
        return functional.gelu(self.window(steps.flatten(1)))
