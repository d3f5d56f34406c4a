"""Networks that predict the outcome of every candidate action from one context.

With histories ``h``, actions ``e_a`` and encoders ``f``, ``g``, for ``B`` groups and ``A`` candidates::

    z_ba = W_f f(h_b) + W_g g(e_a) + c        one fusion layer, split into a half for each encoder
    u    = gelu(norm(z));  v = u + gelu(M u)
    scalars = P v  [6],   trajectories = Q v  [10, 5]        normalised

Every history is encoded once and every bank once. A model without actions decodes ``[B, 1]`` and broadcasts over
the bank; one without histories decodes ``[1, A]``. An encoder of a context names the inputs that it reads and has a
width, which is all that the fusion knows about it: another one, as of images, takes its place beside the others.

The history encoder has one recurrence over the 16 observations and one over the 80 controls, which takes the five
controls between two observations as one step: a fifth of the steps, and no loss in validation.

Source: paper, "Compared Models" for what each model reads; the layers are this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from branchdrive.contract.timing import FUTURE_OBSERVATIONS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive_reference.learning.configuration import ActionConfig, HistoryConfig, ModelConfig
from branchdrive_reference.learning.image_network import ImageHistoryEncoder
from branchdrive_reference.learning.objects_network import ObjectsEncoder
from branchdrive_reference.learning.outcome import Outcome
from branchdrive_reference.learning.stream import WEIGHTS, stream
from branchdrive_reference.learning.trees import TreesNetwork

__all__ = [
    "ActionEncoder",
    "Decoder",
    "HistoryEncoder",
    "MeanNetwork",
    "Outcome",
    "OutcomeNetwork",
    "SequenceEncoder",
    "build_network",
    "initialise",
    "num_parameters",
]

NUM_TARGETS = len(TARGETS)
PATH_SHAPE = (FUTURE_OBSERVATIONS, len(TRAJECTORY))
STATE_FEATURES = len(SENSOR_PROFILE.state)
STEP_CONTROLS = OBSERVATION_STRIDE_TICKS * len(SENSOR_PROFILE.controls)

HISTORY, ACTION, OBJECTS = "history", "action", "objects"
"""Names of the halves of the fusion."""


class SequenceEncoder(nn.Module):
    """Sequences ``[B, steps, num_features]`` as the last state of a recurrence, ``[B, width]``."""

    def __init__(self, num_features: int, step_width: int, width: int) -> None:
        super().__init__()
        self.embed = nn.Linear(num_features, step_width)
        self.norm = nn.LayerNorm(step_width)
        self.recur = nn.GRU(step_width, width, batch_first=True)

    def forward(self, steps: Tensor) -> Tensor:
        """Each sequence by itself."""
        _, last = self.recur(functional.gelu(self.norm(self.embed(steps))))
        encoding: Tensor = last[0]
        return encoding


class HistoryEncoder(nn.Module):
    """Histories ``state [B, 16, 21]`` and ``controls [B, 80, 3]`` as ``[B, width]``."""

    reads = ("state", "controls")

    def __init__(self, config: HistoryConfig) -> None:
        super().__init__()
        self.width = config.state_width + config.controls_width
        self.state = SequenceEncoder(STATE_FEATURES, config.step_width, config.state_width)
        self.controls = SequenceEncoder(STEP_CONTROLS, config.step_width, config.controls_width)

    def forward(self, state: Tensor, controls: Tensor) -> Tensor:
        """Both encodings, side by side."""
        steps = controls.reshape(controls.shape[0], -1, STEP_CONTROLS)
        return torch.cat([self.state(state), self.controls(steps)], dim=1)


class ActionEncoder(nn.Module):
    """Actions ``[A, num_features]`` as ``[A, width]``."""

    def __init__(self, config: ActionConfig, num_features: int) -> None:
        super().__init__()
        self.width = config.width
        hidden = config.hidden_width
        self.layers = nn.Sequential(
            nn.Linear(num_features, hidden), nn.LayerNorm(hidden), nn.GELU(), nn.Linear(hidden, config.width), nn.GELU()
        )

    def forward(self, actions: Tensor) -> Tensor:
        """Each row by itself."""
        encoding: Tensor = self.layers(actions)
        return encoding


class Decoder(nn.Module):
    """Fusion of encodings, and the heads that read the outcome from it."""

    def __init__(self, widths: Mapping[str, int], fusion_width: int) -> None:
        super().__init__()
        width = fusion_width
        self.halves = nn.ParameterDict({name: torch.zeros(width, size) for name, size in widths.items()})
        self.bias = nn.Parameter(torch.zeros(width))
        self.norm = nn.LayerNorm(width)
        self.mix = nn.Linear(width, width)
        self.scalars = nn.Linear(width, NUM_TARGETS)
        self.trajectories = nn.Linear(width, math.prod(PATH_SHAPE))

    def share(self, name: str, encoding: Tensor) -> Tensor:
        """What an encoding adds to the fusion, ``[..., fusion width]``."""
        return functional.linear(encoding, self.halves[name])

    def fuse(self, total: Tensor) -> Tensor:
        """From the sum of the halves to what the heads read, both ``[..., fusion width]``."""
        fused = functional.gelu(self.norm(total + self.bias))
        return fused + functional.gelu(self.mix(fused))

    def forward(self, total: Tensor) -> Outcome:
        """The outcome of a sum of halves ``[B, A, fusion width]``."""
        fused = self.fuse(total)
        return Outcome(self.scalars(fused), self.trajectories(fused).unflatten(-1, PATH_SHAPE))


class OutcomeNetwork(nn.Module):
    """A model with weights: encoders of the context, an encoder of the bank, one decoder."""

    def __init__(self, config: ModelConfig, num_action_features: int) -> None:
        super().__init__()
        contexts: dict[str, HistoryEncoder | ImageHistoryEncoder | ObjectsEncoder] = {}
        if config.history is not None:
            contexts[HISTORY] = HistoryEncoder(config.history)
        contexts |= {name: ImageHistoryEncoder(images) for name, images in config.images.items()}
        if config.objects is not None:
            contexts[OBJECTS] = ObjectsEncoder(config.objects)
        self.contexts = nn.ModuleDict(contexts)
        self._reads = {name: encoder.reads for name, encoder in contexts.items()}
        self.bank = None if config.action is None else ActionEncoder(config.action, num_action_features)
        widths = {name: encoder.width for name, encoder in contexts.items()}
        if self.bank is not None:
            widths[ACTION] = self.bank.width
        self.decoder = Decoder(widths, config.fusion_width)

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the inputs."""
        context = tuple(key for keys in self._reads.values() for key in keys)
        return context if self.bank is None else (*context, "actions")

    def forward(self, inputs: Mapping[str, Tensor], *, num_groups: int, num_candidates: int) -> Outcome:
        """Normalised outcome of every candidate of every group.

        Args:
            inputs: Normalised inputs by name, those of `reads` at least: groups first, ``actions [A, features]``.
            num_groups: ``B``.
            num_candidates: ``A``.
        """
        parts = [
            self.decoder.share(name, encoder(*(inputs[key] for key in self._reads[name])))[:, None]
            for name, encoder in self.contexts.items()
        ]
        if self.bank is not None:
            parts.append(self.decoder.share(ACTION, self.bank(inputs["actions"]))[None])
        total = parts[0]
        for part in parts[1:]:
            total = total + part
        return _expanded(self.decoder(total), num_groups, num_candidates)


class MeanNetwork(nn.Module):
    """The model without weights: one outcome, the mean over all training rows, in float64."""

    scalars: Tensor
    trajectories: Tensor
    reads: tuple[str, ...] = ()

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("scalars", torch.zeros(NUM_TARGETS, dtype=torch.float64))
        self.register_buffer("trajectories", torch.zeros(PATH_SHAPE, dtype=torch.float64))

    def fit(self, scalars: Tensor, mask: Tensor, trajectories: Tensor) -> None:
        """Take means over groups and candidates; a scalar over its available values, 0 where there are none."""
        values = torch.where(mask, scalars, 0.0).double()
        self.scalars = values.sum((0, 1)) / mask.sum((0, 1)).clamp(min=1)
        self.trajectories = trajectories.double().mean((0, 1))

    def forward(self, inputs: Mapping[str, Tensor], *, num_groups: int, num_candidates: int) -> Outcome:
        """The same outcome everywhere; see `OutcomeNetwork`."""
        del inputs
        mean = Outcome(self.scalars[None, None], self.trajectories[None, None])
        return _expanded(mean, num_groups, num_candidates)


def build_network(config: ModelConfig, num_action_features: int) -> OutcomeNetwork | MeanNetwork | TreesNetwork:
    """The network of a model, its weights not yet drawn; the state of no generator of torch changes."""
    if config.trees is not None:
        return TreesNetwork(config.trees)
    if not config.is_trained:
        return MeanNetwork()
    with torch.random.fork_rng(devices=[]):
        return OutcomeNetwork(config, num_action_features)


def initialise(network: nn.Module, *, seed: int) -> None:
    """Draw weights: uniform within ``1 / sqrt(fan in)``, of a recurrence ``1 / sqrt(width)``; norms are 1 and 0.

    Raises:
        UsageError: `seed` is no seed.
    """
    rng = stream(seed, WEIGHTS)
    for module in network.modules():
        match module:
            case nn.Linear():
                drawn, fan_in = [module.weight, module.bias], module.in_features
            case nn.GRU():
                drawn, fan_in = list(module.parameters()), module.hidden_size
            case Decoder():
                halves = list(module.halves.values())
                drawn, fan_in = [*halves, module.bias], sum(half.shape[1] for half in halves)
            case _:
                continue
        for weights in drawn:
            values = rng.uniform(-1.0, 1.0, tuple(weights.shape)) / math.sqrt(fan_in)
            with torch.no_grad():
                weights.copy_(torch.from_numpy(values.astype(np.float32)))


def num_parameters(network: nn.Module) -> int:
    """Number of weights that training changes."""
    return sum(weights.numel() for weights in network.parameters())


def _expanded(outcome: Outcome, num_groups: int, num_candidates: int) -> Outcome:
    return Outcome(
        outcome.scalars.expand(num_groups, num_candidates, -1),
        outcome.trajectories.expand(num_groups, num_candidates, -1, -1),
    )
