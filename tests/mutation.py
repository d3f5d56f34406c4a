"""Every registered defect and every registered limit of the validator's rules.

A mutant is one defect in an otherwise valid dataset that one rule must find; a boundary is a shape
that rules must still accept. Each is a small function on a `Draft`, in a module called as that of its rule.
"""

from __future__ import annotations

from importlib import import_module

from tests.validator.engine.rules.case import REGISTRY, Boundary, Mutant, new_draft
from tests.validator.engine.rules.draft import Draft

__all__ = [
    "AREAS", "BOUNDARIES", "MUTANTS", "Boundary", "Draft", "Mutant", "new_draft",
]  # fmt: skip

_NAMES = (
    "files_layout", "files_places", "files_companions", "files_documents", "files_tables", "values", "nulls",
    "keys", "status", "ticks", "controls", "controls_effective", "controls_axis", "ticks_windows", "evidence",
    "extents", "route", "motion", "tracks", "coverage", "results", "infractions", "ticks_trigger", "groups",
    "media", "images", "media_archives", "images_semantic_maps", "maps", "maps_lanes", "layers", "layers_contents",
    "canonical",
    "quality_qualification", "quality_split", "quality_fidelity", "model_inputs", "model_inputs_targets",
    "model_inputs_features", "model_near_duplicate", "leakage_audit", "leakage_structural", "leakage_codes",
    "leakage_audit_battery", "card", "model_inputs_endings", "model_inputs_objects", "replays", "responses",
    "responses_effects",
    "responses_copies", "groups_outcomes", "responses_experts", "image_replays", "responses_images", "decisions",
    "responses_clock", "benchmark", "benchmark_results", "layers_model_and_benchmark",
)  # fmt: skip

AREAS = tuple(import_module(f"tests.validator.engine.rules.cases.{name}") for name in _NAMES)
"""Modules that define cases; the first mutant of a rule is that of the first of them that has one."""

_PLACES = {area.__name__: place for place, area in enumerate(AREAS)}

MUTANTS: tuple[Mutant, ...] = tuple(sorted(REGISTRY.mutants, key=lambda mutant: _PLACES[mutant.edit.__module__]))
"""In the order of the areas, whichever was imported first, and of their definition there."""

BOUNDARIES: tuple[Boundary, ...] = tuple(
    sorted(REGISTRY.boundaries, key=lambda boundary: _PLACES[boundary.edit.__module__])
)
