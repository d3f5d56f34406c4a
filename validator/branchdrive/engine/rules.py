"""Every module of rules; importing this one binds each rule of the catalogue to its function."""

from importlib import import_module

_OF_RAW_ROWS = (
    "keys", "nulls", "values", "ticks", "status", "controls", "evidence", "groups", "responses", "replays",
    "image_replays", "media", "images", "maps", "route", "motion", "tracks", "coverage", "extents", "results",
    "infractions",
)  # fmt: skip

_NAMES = (
    "files.rules", *(f"raw.rules.{name}" for name in _OF_RAW_ROWS), "layers.rules", "canonical.rules",
    "quality.rules.qualification", "quality.rules.split", "quality.rules.fidelity", "model.rules.inputs",
    "model.rules.near_duplicate", "leakage.rules.audit", "leakage.rules.structural", "benchmark.protocol.rules",
    "benchmark.prediction.rules", "benchmark.rules", "benchmark.latency", "card.rules",
)  # fmt: skip

RULE_MODULES = tuple(import_module(f"branchdrive.{name}") for name in _NAMES)
"""Modules of rules, in order of the layers: `rules` of a room, or the modules in it where they are several."""
