"""Modules of rules, by the layer that their rules are about; importing one binds its rules to their functions.

The rules on files and on the raw layer are bound as soon as this module is imported; those of a derived layer when a
dataset claims the layer, as a worker that judges a raw shard needs none of what they import.
"""

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from types import MappingProxyType, ModuleType

__all__ = ["RULE_MODULES", "bind_rules"]

_OF_RAW_ROWS = (
    "keys", "nulls", "values", "ticks", "status", "controls", "decisions", "evidence", "groups", "responses", "replays",
    "image_replays", "media", "images", "maps", "route", "motion", "tracks", "coverage", "extents", "results",
    "infractions",
)  # fmt: skip

RULE_MODULES: Mapping[str | None, tuple[str, ...]] = MappingProxyType(
    {
        None: ("files.rules", *(f"raw.rules.{name}" for name in _OF_RAW_ROWS)),
        "canonical": ("layers.rules", "canonical.rules", "card.rules"),
        "quality": (
            "quality.rules.qualification", "quality.rules.split", "quality.rules.fidelity",
            "model.rules.near_duplicate", "leakage.rules.audit", "leakage.rules.structural", "card.rules",
        ),
        "model": (
            "layers.rules", "model.rules.inputs", "model.rules.near_duplicate", "leakage.rules.structural",
            "leakage.rules.codes",
        ),
        "benchmark": (
            "benchmark.protocol.rules", "benchmark.prediction.rules", "benchmark.rules", "benchmark.latency",
        ),
    }
)  # fmt: skip
"""Names of modules in this package by derived layer, ``None`` for what no derived layer takes."""


@cache
def bind_rules(layer: str | None) -> tuple[ModuleType, ...]:
    """Import the modules of the rules of a layer, which binds them; returns the modules."""
    return tuple(import_module(f"branchdrive.{name}") for name in RULE_MODULES[layer])


bind_rules(None)
