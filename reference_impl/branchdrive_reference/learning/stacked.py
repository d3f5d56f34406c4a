"""Networks of several seeds as one: weights stacked, so that a step of all seeds is one batched product.

Every part takes one context and has an axis of seeds first. They are made of tensor operations with fixed shapes alone,
so that they can be traced and exported. A lane is one recurrence of one seed; the lanes of a seed stand together, that
of the state first. Narrower lanes are padded with zeros, which keep their part of the state at 0. Scaling is part of
the networks: contexts go in and scalars come out in their units.

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
from branchdrive.model.normalisation_document import Scalings
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.image_network import ImageHistoryEncoder
from branchdrive_reference.learning.network import (
    ACTION,
    HISTORY,
    STEP_CONTROLS,
    ActionEncoder,
    Decoder,
    HistoryEncoder,
    SequenceEncoder,
)

__all__ = ["StackedDecoder", "StackedHistory", "StackedImages"]


class _Stack(nn.Module):
    """Keeps one matrix of every lane or seed as one tensor."""

    def _keep(self, name: str, parts: Sequence[Tensor]) -> None:
        self.register_buffer(name, torch.stack(list(parts)).detach().contiguous())

    def _keep_linear(self, name: str, layers: Sequence[nn.Linear]) -> None:
        self._keep(name, [layer.weight.T for layer in layers])
        self._keep(f"{name}_bias", [layer.bias[None] for layer in layers])

    def _keep_norm(self, name: str, shift: str, layers: Sequence[nn.LayerNorm]) -> None:
        self._keep(name, [layer.weight[None] for layer in layers])
        self._keep(shift, [layer.bias[None] for layer in layers])


class StackedHistory(_Stack):
    """What ``state [16, 21]`` and ``controls [80, 3]`` add to the fusion of every seed, ``[seeds, 1, fusion width]``.

    Args:
        encoders: Of every seed.
        decoders: Of every seed.
        release: The release they were trained on; only scalings are read.
    """

    state_recorded: Tensor | None
    embed: Tensor
    embed_bias: Tensor
    embed_norm: Tensor
    embed_shift: Tensor
    input: Tensor
    input_bias: Tensor
    recurrence: Tensor
    recurrence_bias: Tensor
    history: Tensor

    def __init__(self, encoders: Sequence[HistoryEncoder], decoders: Sequence[Decoder], release: ModelLayer) -> None:
        super().__init__()
        lanes = [lane for encoder in encoders for lane in (encoder.state, encoder.controls)]
        self._num_seeds = len(encoders)
        self._width = max(lane.recur.hidden_size for lane in lanes)
        self._features = max(lane.embed.in_features for lane in lanes)
        self._keep_scalings(release.scalings())
        is_recorded = recorded_features("state", release.descriptor)
        self.register_buffer("state_recorded", None if is_recorded.all() else torch.from_numpy(is_recorded))
        self._keep_lanes(lanes)
        widths = [lane.recur.hidden_size for lane in lanes[:2]]
        self._keep(
            "history",
            [
                torch.cat([_padded(part, self._width) for part in decoder.halves[HISTORY].T.split(widths)])
                for decoder in decoders
            ],
        )

    def forward(self, state: Tensor, controls: Tensor) -> Tensor:
        """From a context in physical units."""
        known = state if self.state_recorded is None else torch.where(self.state_recorded, state, 0.0)
        scaled = self._scaled("state", known), self._scaled("controls", controls).reshape(-1, STEP_CONTROLS)
        rows = torch.stack([functional.pad(part, (0, self._features - part.shape[1])) for part in scaled])
        rows = rows.repeat(self._num_seeds, 1, 1)
        steps = _normed(torch.baddbmm(self.embed_bias, rows, self.embed), self.embed_norm, self.embed_shift)
        driven = torch.baddbmm(self.input_bias, functional.gelu(steps), self.input)
        last = torch.zeros_like(driven[:, :1, : self._width])
        for step in driven.split(1, dim=1):
            last = self._next(step, last)
        return torch.bmm(last.reshape(self._num_seeds, 1, -1), self.history)

    def _next(self, driven: Tensor, last: Tensor) -> Tensor:
        """One step of a gated recurrence, reset and update gates first."""
        recurred = torch.baddbmm(self.recurrence_bias, last, self.recurrence)
        gates = 2 * self._width
        reset, update = torch.sigmoid(driven[..., :gates] + recurred[..., :gates]).chunk(2, dim=2)
        fresh = torch.tanh(driven[..., gates:] + reset * recurred[..., gates:])
        return torch.lerp(fresh, last, update)

    def _scaled(self, name: str, values: Tensor) -> Tensor:
        offset, scale, limit = (getattr(self, f"{name}_{part}") for part in ("offset", "scale", "limit"))
        return torch.minimum(torch.maximum((values - offset) / scale, -limit), limit)

    def _keep_scalings(self, scalings: Scalings) -> None:
        for name, scaling in (("state", scalings.state), ("controls", scalings.controls)):
            for part in ("offset", "scale", "limit"):
                self.register_buffer(f"{name}_{part}", _float32(getattr(scaling, part)))

    def _keep_lanes(self, lanes: Sequence[SequenceEncoder]) -> None:
        width = self._width
        self._keep("embed", [_padded(lane.embed.weight.T, self._features) for lane in lanes])
        self._keep("embed_bias", [lane.embed.bias[None] for lane in lanes])
        self._keep_norm("embed_norm", "embed_shift", [lane.norm for lane in lanes])
        for name, kind in (("input", "ih"), ("recurrence", "hh")):
            weights = [_gates(getattr(lane.recur, f"weight_{kind}_l0").T, width) for lane in lanes]
            self._keep(name, weights if kind == "ih" else [_padded(weight, width) for weight in weights])
            self._keep(f"{name}_bias", [_gates(getattr(lane.recur, f"bias_{kind}_l0")[None], width) for lane in lanes])


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


def _padded(matrix: Tensor, num_rows: int) -> Tensor:
    """With rows of zeros below."""
    return functional.pad(matrix, (0, 0, 0, num_rows - matrix.shape[0]))


def _gates(matrix: Tensor, width: int) -> Tensor:
    """Each of the three gates' columns with columns of zeros behind."""
    return torch.cat([functional.pad(gate, (0, width - gate.shape[1])) for gate in matrix.chunk(3, dim=1)], dim=1)


def _float32(values: NDArray[np.float64]) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
