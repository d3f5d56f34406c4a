"""Ranking the action bank from one context by the history-and-action models of several seeds, as one network.

Weights of the seeds are stacked, and both recurrences of every seed run side by side, so that a step of all is one
batched product; narrower ones are padded with zeros, which keep their part of the state at 0. The bank is encoded
when the ranker is made. Scaling is part of the network: contexts go in and scalars come out in their units.
The prediction is the mean over seeds, and only scalars are computed, which are all that utility needs.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (outcome-derived selection, latency of the
structured selector); stacking is this project's choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor, nn
from torch.nn import functional

from branchdrive.driving.target import Targets
from branchdrive.driving.utility import Profile, Scale, utility
from branchdrive.errors import UsageError
from branchdrive.model.features import recorded_features
from branchdrive.model.normalisation_document import Scalings
from branchdrive.model.reader import ModelLayer
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.network import (
    ACTION,
    HISTORY,
    STEP_CONTROLS,
    ActionEncoder,
    Decoder,
    HistoryEncoder,
    OutcomeNetwork,
    SequenceEncoder,
)
from branchdrive_reference.learning.prediction import check_release

__all__ = ["BankNetwork", "BankRanker", "Ranking"]

Array = NDArray[np.float64]


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

    def __call__(self, state: ArrayLike, controls: ArrayLike) -> Ranking:
        """Rank from one context.

        Args:
            state: ``[16, 21]`` in physical units.
            controls: ``[80, 3]`` in physical units.
        """
        context = (torch.from_numpy(np.array(values, np.float32)) for values in (state, controls))
        with torch.inference_mode():
            scalars = self.network(*context).numpy().astype(np.float64)
        utilities = utility(Targets(scalars, np.ones(scalars.shape, np.bool_)), self._scale, self._profile)
        return Ranking(np.argsort(-utilities, kind="stable"), utilities, scalars)


class BankNetwork(nn.Module):
    """Mean predicted scalars of the bank: ``state [16, 21]`` and ``controls [80, 3]`` to ``[A, 6]``, in their units.

    It is made of tensor operations with fixed shapes alone, so that it can be traced and exported. A lane is one
    recurrence of one seed; the lanes of a seed stand together, that of the state first.
    See `BankRanker` for arguments and errors.
    """

    bank: Tensor
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
    norm: Tensor
    shift: Tensor
    mix: Tensor
    mix_bias: Tensor
    scalars: Tensor
    scalars_bias: Tensor
    target_scale: Tensor
    target_offset: Tensor

    def __init__(self, checkpoints: Sequence[Checkpoint], release: ModelLayer) -> None:
        super().__init__()
        networks = [_network(checkpoint, release) for checkpoint in checkpoints]
        if len({checkpoint.configuration.digest for checkpoint in checkpoints}) != 1:
            raise UsageError(f"{len(checkpoints)} checkpoints are not seeds of one configuration")
        encoders, decoders = [encoder for encoder, _, _ in networks], [decoder for _, _, decoder in networks]
        lanes = [lane for encoder in encoders for lane in (encoder.state, encoder.controls)]
        self._width = max(lane.recur.hidden_size for lane in lanes)
        self._features = max(lane.embed.in_features for lane in lanes)
        self._keep_scalings(release.scalings())
        is_recorded = recorded_features("state", release.descriptor)
        self.register_buffer("state_recorded", None if is_recorded.all() else torch.from_numpy(is_recorded))
        actions = torch.from_numpy(release.actions())
        with torch.no_grad():
            self._keep_lanes(lanes)
            self._keep("bank", [decoder.share(ACTION, bank(actions)) + decoder.bias for _, bank, decoder in networks])
            self._keep_decoders(decoders, [lane.recur.hidden_size for lane in lanes[:2]])

    def forward(self, state: Tensor, controls: Tensor) -> Tensor:
        """From a context in physical units."""
        known = state if self.state_recorded is None else torch.where(self.state_recorded, state, 0.0)
        scaled = self._scaled("state", known), self._scaled("controls", controls).reshape(-1, STEP_CONTROLS)
        rows = torch.stack([functional.pad(part, (0, self._features - part.shape[1])) for part in scaled])
        rows = rows.repeat(self.bank.shape[0], 1, 1)
        steps = _normed(torch.baddbmm(self.embed_bias, rows, self.embed), self.embed_norm, self.embed_shift)
        driven = torch.baddbmm(self.input_bias, functional.gelu(steps), self.input)
        last = torch.zeros_like(driven[:, :1, : self._width])
        for step in driven.split(1, dim=1):
            last = self._next(step, last)
        both = last.reshape(self.bank.shape[0], 1, -1)
        total = torch.bmm(both, self.history) + self.bank
        fused = functional.gelu(_normed(total, self.norm, self.shift))
        fused = fused + functional.gelu(torch.baddbmm(self.mix_bias, fused, self.mix))
        scalars = torch.baddbmm(self.scalars_bias, fused, self.scalars).mean(0)
        return scalars * self.target_scale + self.target_offset

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
        is_scaled = np.isfinite(scalings.scalars.offset)
        self.register_buffer("target_scale", _float32(np.where(is_scaled, scalings.scalars.scale, 0.0)))
        self.register_buffer("target_offset", _float32(np.where(is_scaled, scalings.scalars.offset, 0.0)))

    def _keep_lanes(self, lanes: Sequence[SequenceEncoder]) -> None:
        width = self._width
        self._keep("embed", [_padded(lane.embed.weight.T, self._features) for lane in lanes])
        self._keep("embed_bias", [lane.embed.bias[None] for lane in lanes])
        self._keep("embed_norm", [lane.norm.weight[None] for lane in lanes])
        self._keep("embed_shift", [lane.norm.bias[None] for lane in lanes])
        for name, kind in (("input", "ih"), ("recurrence", "hh")):
            weights = [_gates(getattr(lane.recur, f"weight_{kind}_l0").T, width) for lane in lanes]
            self._keep(name, weights if kind == "ih" else [_padded(weight, width) for weight in weights])
            self._keep(f"{name}_bias", [_gates(getattr(lane.recur, f"bias_{kind}_l0")[None], width) for lane in lanes])

    def _keep_decoders(self, decoders: Sequence[Decoder], widths: Sequence[int]) -> None:
        self._keep(
            "history",
            [
                torch.cat([_padded(part, self._width) for part in decoder.halves[HISTORY].T.split(list(widths))])
                for decoder in decoders
            ],
        )
        self._keep("norm", [decoder.norm.weight[None] for decoder in decoders])
        self._keep("shift", [decoder.norm.bias[None] for decoder in decoders])
        for name in ("mix", "scalars"):
            layers = [getattr(decoder, name) for decoder in decoders]
            self._keep(name, [layer.weight.T for layer in layers])
            self._keep(f"{name}_bias", [layer.bias[None] for layer in layers])

    def _keep(self, name: str, parts: Sequence[Tensor]) -> None:
        """Keep one matrix of every lane or seed as one tensor."""
        self.register_buffer(name, torch.stack(list(parts)).detach().contiguous())


def _network(checkpoint: Checkpoint, release: ModelLayer) -> tuple[HistoryEncoder, ActionEncoder, Decoder]:
    check_release(checkpoint, release)
    network = checkpoint.network()
    if isinstance(network, OutcomeNetwork) and network.bank is not None:
        encoders = dict(network.contexts.items())
        history = encoders.pop(HISTORY, None)
        if isinstance(history, HistoryEncoder) and not encoders:
            return history, network.bank, network.decoder
    raise UsageError(f"{checkpoint.provenance.model} is no model of histories and actions alone")


def _normed(values: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    return functional.layer_norm(values, values.shape[-1:]) * weight + bias


def _padded(matrix: Tensor, num_rows: int) -> Tensor:
    """With rows of zeros below."""
    return functional.pad(matrix, (0, 0, 0, num_rows - matrix.shape[0]))


def _gates(matrix: Tensor, width: int) -> Tensor:
    """Each of the three gates' columns with columns of zeros behind."""
    return torch.cat([functional.pad(gate, (0, width - gate.shape[1])) for gate in matrix.chunk(3, dim=1)], dim=1)


def _float32(values: Array) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
