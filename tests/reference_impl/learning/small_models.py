"""Configurations of small models that train in moments, and the release that they are trained on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.model_release import make_frames, write_release

from branchdrive.benchmark.protocol import default_protocol
from branchdrive_reference.learning.configuration import (
    ActionConfig,
    Configuration,
    HistoryConfig,
    ModelConfig,
)

__all__ = ["DECLARED", "MEAN", "SEEDS", "SMALL", "TRAINING", "make_release", "small"]

DECLARED = {model.id: Configuration.of(model) for model in default_protocol().models}
"""Configurations of the normative protocol, by name."""

SEEDS = default_protocol().models[-1].seeds
TRAINING = DECLARED["M3"].training

_HISTORY, _ACTION = HistoryConfig(step_width=6, state_width=5, controls_width=4), ActionConfig(7, 8)
_MODELS: dict[str, dict[str, Any]] = {
    "M1": {"action": _ACTION},
    "M2": {"history": _HISTORY},
    "M3": {"history": _HISTORY, "action": _ACTION},
    "M3r": {"history": _HISTORY, "action": _ACTION},
}


def small(name: str = "M3", **training: Any) -> Configuration:
    """A small model of a name; `training` replaces attributes of its training."""
    about = replace(DECLARED[name].training, batch_groups=2, learning_rate=3e-3, max_epochs=8)
    return Configuration(ModelConfig(name, "sensor", 9, **_MODELS[name]), replace(about, **training))


SMALL = {name: small(name) for name in _MODELS}
MEAN = DECLARED["M0"]


def make_release(folder: Path, seed: int = 0) -> Path:
    """A release with three training groups and one validation group."""
    return write_release(folder, make_frames(seed))
