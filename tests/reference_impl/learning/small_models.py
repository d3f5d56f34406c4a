"""Configurations of small models that train in moments, and the release that they are trained on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.model_release import ASSIGNMENT, OUTSIDER, make_frames, write_release
from tests.small_images import add_images

from branchdrive.benchmark.protocol.protocol import default_protocol, visual_protocol
from branchdrive_reference.learning.configuration import (
    ActionConfig,
    Configuration,
    HistoryConfig,
    ImagesConfig,
    ModelConfig,
)

__all__ = ["DECLARED", "MEAN", "SEEDS", "SMALL", "TRAINING", "VISUAL", "make_release", "make_visual_release", "small"]

DECLARED = {model.id: Configuration.of(model) for model in visual_protocol().models}
"""Configurations of the normative protocols, by name."""

SEEDS = default_protocol().models[-1].seeds
TRAINING = DECLARED["M3"].training

_HISTORY, _ACTION = HistoryConfig(step_width=6, state_width=5, controls_width=4), ActionConfig(7, 8)
_VIEWS = ImagesConfig("rgb_patches", image_width=5, step_width=6, width=7, patch_width=2)
_BEV = ImagesConfig("bev_patches", image_width=8, step_width=8, width=7, patch_width=4)
_IMAGES: dict[str, dict[str, Any]] = {
    "M4": {"views": _VIEWS, "action": _ACTION},
    "M5": {"views": _VIEWS, "history": _HISTORY, "action": _ACTION},
    "M6": {"bev": _BEV, "action": _ACTION},
}
_MODELS: dict[str, dict[str, Any]] = {
    "M1": {"action": _ACTION},
    "M2": {"history": _HISTORY},
    "M3": {"history": _HISTORY, "action": _ACTION},
    "M3r": {"history": _HISTORY, "action": _ACTION},
}


def small(name: str = "M3", **training: Any) -> Configuration:
    """A small model of a name; `training` replaces attributes of its training."""
    about = replace(DECLARED[name].training, batch_groups=2, learning_rate=3e-3, max_epochs=8)
    contract = DECLARED[name].model.contract
    return Configuration(ModelConfig(name, contract, 9, **(_MODELS | _IMAGES)[name]), replace(about, **training))


SMALL = {name: small(name) for name in _MODELS}
VISUAL = {name: small(name) for name in _IMAGES}
"""Those that read images."""

MEAN = DECLARED["M0"]


def make_release(folder: Path, seed: int = 0) -> Path:
    """A release with three training groups and one validation group."""
    return write_release(folder, make_frames(seed))


def make_visual_release(folder: Path, seed: int = 0) -> Path:
    """The same release with images."""
    partitions = {group: partition for group, partition in ASSIGNMENT.items() if group != OUTSIDER}
    return add_images(make_release(folder, seed), partitions)
