"""Networks of several seeds as one: weights stacked, so that a step of all seeds is one batched product.

Every part takes one context and has an axis of seeds first. They are made of tensor operations with fixed shapes alone,
so that they can be traced and exported. Recurrences alone stay by themselves. Scaling is part of the networks: contexts
go in and scalars come out in their units.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from branchdrive.model.features import recorded_features
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.image_network import ImageHistoryEncoder
from branchdrive_reference.learning.network import (
    ACTION,
    HISTORY,
    OBJECTS,
    ActionEncoder,
    Decoder,
    HistoryEncoder,
)
from branchdrive_reference.learning.objects_network import ObjectsEncoder

__all__ = ["SeedHistories", "SeedObjects", "StackedDecoder", "StackedImages"]


class _Stack(nn.Module):
    """Keeps one matrix of every seed as one tensor."""

    def _keep(self, name: str, parts: Sequence[Tensor]) -> None:
        self.register_buffer(name, torch.stack(list(parts)).detach().contiguous())

    def _keep_linear(self, name: str, layers: Sequence[nn.Linear]) -> None:
        self._keep(name, [layer.weight.T for layer in layers])
        self._keep(f"{name}_bias", [layer.bias[None] for layer in layers])

    def _keep_norm(self, name: str, shift: str, layers: Sequence[nn.LayerNorm]) -> None:
        self._keep(name, [layer.weight[None] for layer in layers])
        self._keep(shift, [layer.bias[None] for layer in layers])


class _Scaled(_Stack):
    """Scales histories as a release does.

    Args:
        release: Of which only scalings are read.
        names: Histories that are scaled.
    """

    state_recorded: Tensor | None

    def __init__(self, release: ModelLayer, *names: str) -> None:
        super().__init__()
        scalings = release.scalings()
        for name in names:
            for part in ("offset", "scale", "limit"):
                self.register_buffer(f"{name}_{part}", _float32(getattr(getattr(scalings, name), part)))
        is_recorded = recorded_features("state", release.descriptor)
        self.register_buffer("state_recorded", None if is_recorded.all() else torch.from_numpy(is_recorded))

    def _scaled_state(self, state: Tensor) -> Tensor:
        known = state if self.state_recorded is None else torch.where(self.state_recorded, state, 0.0)
        return self._scaled("state", known)

    def _scaled(self, name: str, values: Tensor) -> Tensor:
        offset, scale, limit = (getattr(self, f"{name}_{part}") for part in ("offset", "scale", "limit"))
        return torch.minimum(torch.maximum((values - offset) / scale, -limit), limit)


class SeedHistories(_Scaled):
    """What ``state [16, 21]`` and ``controls [80, 3]`` add to the fusion of every seed, ``[seeds, 1, fusion width]``.

    Recurrences run one after the other: the weights of one stay in a near cache for all of its steps.

    Args:
        encoders: Of every seed.
        decoders: Of every seed.
        release: The release they were trained on; only scalings are read.
    """

    share: Tensor

    def __init__(self, encoders: Sequence[HistoryEncoder], decoders: Sequence[Decoder], release: ModelLayer) -> None:
        super().__init__(release, "state", "controls")
        self.encoders = nn.ModuleList(encoders)
        self._keep("share", [decoder.halves[HISTORY].T for decoder in decoders])

    def forward(self, state: Tensor, controls: Tensor) -> Tensor:
        """From a context in physical units."""
        scaled = self._scaled_state(state)[None], self._scaled("controls", controls)[None]
        return torch.bmm(torch.stack([encoder(*scaled) for encoder in self.encoders]), self.share)


class SeedObjects(_Scaled):
    """What objects ``[16, 32, 11]`` and their mask ``[16, 32]``, beside the state ``[16, 21]``, add to the fusion.

    See `SeedHistories`.
    """

    share: Tensor

    def __init__(self, encoders: Sequence[ObjectsEncoder], decoders: Sequence[Decoder], release: ModelLayer) -> None:
        super().__init__(release, "state")
        self.encoders = nn.ModuleList(encoders)
        self._keep("share", [decoder.halves[OBJECTS].T for decoder in decoders])

    def forward(self, state: Tensor, objects: Tensor, mask: Tensor) -> Tensor:
        """From a context in physical units, ``[seeds, 1, fusion width]``."""
        given = self._scaled_state(state)[None], objects[None], mask[None]
        return torch.bmm(torch.stack([encoder(*given) for encoder in self.encoders]), self.share)


class StackedImages(_Stack):
    """Steps of the images of one observation, and what a window of steps adds to the fusion, for every seed.

    Args:
        encoders: Of every seed.
        decoders: Of every seed.
        name: Of the input, which is that of the half of the fusion.
    """

    patch: Tensor
    patch_bias: Tensor
    image: Tensor
    image_bias: Tensor
    step: Tensor
    step_bias: Tensor
    norm: Tensor
    shift: Tensor
    window: Tensor
    window_bias: Tensor
    share: Tensor

    def __init__(self, encoders: Sequence[ImageHistoryEncoder], decoders: Sequence[Decoder], name: str) -> None:
        super().__init__()
        self.step_width = encoders[0].step_width
        self._about = encoders[0].encoding
        patches = [encoder.patch for encoder in encoders if encoder.patch is not None]
        if patches:
            self._keep_linear("patch", patches)
        for layer in ("image", "step", "window"):
            self._keep_linear(layer, [getattr(encoder, layer) for encoder in encoders])
        self._keep_norm("norm", "shift", [encoder.norm for encoder in encoders])
        self._keep("share", [decoder.halves[name].T for decoder in decoders])

    def encode_step(self, images: Tensor, mask: Tensor) -> Tensor:
        """Steps ``[seeds, step width]`` of encoded images ``[C, *encoding]`` and their mask ``[C]``."""
        num_seeds, num_cameras = self.share.shape[0], images.shape[0]
        values = (images.float() - self._about.offset) / self._about.scale
        values = values.reshape(1, -1, values.shape[-1]).expand(num_seeds, -1, -1)
        if self._about.has_patches:
            values = functional.gelu(torch.baddbmm(self.patch_bias, values, self.patch))
            values = values.reshape(num_seeds, num_cameras, -1)
        encoded = torch.where(mask[None, :, None], torch.baddbmm(self.image_bias, values, self.image), 0.0)
        step = torch.baddbmm(self.step_bias, encoded.reshape(num_seeds, 1, -1), self.step)
        return functional.gelu(_normed(step, self.norm, self.shift))[:, 0]

    def forward(self, steps: Tensor) -> Tensor:
        """What the window ``[seeds, 16, step width]``, oldest step first, adds: ``[seeds, 1, fusion width]``."""
        window = torch.baddbmm(self.window_bias, steps.reshape(steps.shape[0], 1, -1), self.window)
        return torch.bmm(functional.gelu(window), self.share)


class StackedDecoder(_Stack):
    """Mean scalars of the bank ``[A, 6]`` in their units, from what contexts add to the fusion of every seed.

    The bank is encoded when it is made.

    Args:
        decoders: Of every seed.
        banks: Encoders of actions, of every seed.
        release: The release they were trained on; only scalings and encoded actions are read.
    """

    bank: Tensor
    norm: Tensor
    shift: Tensor
    mix: Tensor
    mix_bias: Tensor
    scalars: Tensor
    scalars_bias: Tensor
    target_scale: Tensor
    target_offset: Tensor

    def __init__(self, decoders: Sequence[Decoder], banks: Sequence[ActionEncoder], release: ModelLayer) -> None:
        super().__init__()
        actions, scaling = torch.from_numpy(release.actions()), release.scalings().scalars
        is_scaled = np.isfinite(scaling.offset)
        self.register_buffer("target_scale", _float32(np.where(is_scaled, scaling.scale, 0.0)))
        self.register_buffer("target_offset", _float32(np.where(is_scaled, scaling.offset, 0.0)))
        pairs = zip(decoders, banks, strict=True)
        self._keep("bank", [decoder.share(ACTION, bank(actions)) + decoder.bias for decoder, bank in pairs])
        self._keep_norm("norm", "shift", [decoder.norm for decoder in decoders])
        self._keep_linear("mix", [decoder.mix for decoder in decoders])
        self._keep_linear("scalars", [decoder.scalars for decoder in decoders])

    def forward(self, context: Tensor) -> Tensor:
        """From the sum of what contexts add, ``[seeds, 1, fusion width]``."""
        fused = functional.gelu(_normed(context + self.bank, self.norm, self.shift))
        fused = fused + functional.gelu(torch.baddbmm(self.mix_bias, fused, self.mix))
        scalars = torch.baddbmm(self.scalars_bias, fused, self.scalars).mean(0)
        return scalars * self.target_scale + self.target_offset


def _normed(values: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    return functional.layer_norm(values, values.shape[-1:]) * weight + bias


def _float32(values: NDArray[np.float64]) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
