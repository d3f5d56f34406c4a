"""Encoder of objects around the vehicle: each by itself, beside the motion of the ego, and attention over all of them.

With objects ``x_i`` of the last observations, ``k`` heads, and the state ``s`` of the ego at the last one::

    e_i   = gelu(B gelu(norm(A [x_i, age_i, s])))
    w_ki  = exp(q_k e_i) / (1 + sum_j exp(q_k e_j))      the 1 is the weight of no object at all
    f     = gelu(W [sum_i w_1i e_i .. sum_i w_ki e_i])

The order of objects means nothing, places without one have no weight, and where there is none the sums are 0.

Source: Vaswani et al. 2017 (attention); the layers, and what features are divided by, are this project's choice.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.risk import RANGE_M
from branchdrive.model.features import OBJECT_FEATURES
from branchdrive_reference.learning.configuration import ObjectsConfig

__all__ = ["ObjectsEncoder", "object_parts"]

_NAMES = [name for name, _ in OBJECT_FEATURES]
_SIZES = {
    "x_m": RANGE_M, "y_m": RANGE_M, "length_m": 5.0, "width_m": 5.0, "vel_x_mps": 10.0, "vel_y_mps": 10.0,
}  # fmt: skip
"""What features are divided by; those of classes are 0 or 1, and a heading becomes its cosine and sine."""

_YAW = _NAMES.index("yaw_rad")
_PLACE = [_NAMES.index(name) for name in ("x_m", "y_m")]
_VELOCITY = [_NAMES.index(name) for name in ("vel_x_mps", "vel_y_mps")]
_PARTS = len(OBJECT_FEATURES) + 3


def object_parts(objects: Tensor) -> Tensor:
    """Objects ``[..., 11]`` in numbers near 1, ``[..., 14]``: with cosine and sine of headings, distance and approach.

    Approach is the speed over ground at which an object comes towards the ego's place, whatever the ego does.
    """
    scale = torch.tensor([_SIZES.get(name, 1.0) for name in _NAMES], dtype=objects.dtype, device=objects.device)
    scaled, yaw = objects / scale, objects[..., _YAW : _YAW + 1]
    x_m, y_m = (objects[..., place : place + 1] for place in _PLACE)
    v_x, v_y = (objects[..., place : place + 1] for place in _VELOCITY)
    far_m = torch.sqrt(x_m * x_m + y_m * y_m + 1e-6)
    approach = -(x_m * v_x + y_m * v_y) / far_m
    parts = [scaled[..., :_YAW], scaled[..., _YAW + 1 :], torch.cos(yaw), torch.sin(yaw)]
    return torch.cat([*parts, far_m / RANGE_M, approach / 10.0], dim=-1)


class ObjectsEncoder(nn.Module):
    """``state [B, 16, 21]``, ``objects [B, 16, 32, 11]`` and their mask ``[B, 16, 32]`` as ``[B, width]``."""

    reads = ("state", "objects", "objects_mask")

    def __init__(self, config: ObjectsConfig) -> None:
        super().__init__()
        self.width = config.width
        self._first = HISTORY_OBSERVATIONS - config.observations
        self.embed = nn.Linear(_PARTS + 1 + len(SENSOR_PROFILE.state), config.object_width)
        self.norm = nn.LayerNorm(config.object_width)
        self.mix = nn.Linear(config.object_width, config.object_width)
        self.attend = nn.Linear(config.object_width, config.heads)
        self.pool = nn.Linear(config.heads * config.object_width, config.width)

    def forward(self, state: Tensor, objects: Tensor, mask: Tensor) -> Tensor:
        """Each set by itself."""
        objects, there = objects[:, self._first :], mask[:, self._first :]
        num_groups, num_observations, num_places = there.shape
        ages = torch.arange(num_observations - 1, -1, -1, dtype=objects.dtype, device=objects.device)
        age = (ages / HISTORY_OBSERVATIONS)[None, :, None, None].expand(num_groups, -1, num_places, 1)
        ego = state[:, -1][:, None, None].expand(-1, num_observations, num_places, -1)
        parts = torch.cat([object_parts(objects), age, ego], dim=-1).flatten(1, 2)
        encoded = functional.gelu(self.mix(functional.gelu(self.norm(self.embed(parts)))))
        scores = self.attend(encoded).masked_fill(~there.flatten(1)[..., None], -math.inf)
        nothing = torch.zeros_like(scores[:, :1])
        weights = torch.softmax(torch.cat([nothing, scores], dim=1), dim=1)[:, 1:]
        pooled = (weights.transpose(1, 2) @ encoded).flatten(1)
        encoding: Tensor = functional.gelu(self.pool(pooled))
        return encoding
