"""Every registered defect and every registered limit of the validator's rules.

A mutant is one defect in an otherwise valid dataset that one rule must find; a boundary is a shape
that rules must still accept. Each is a small function on a `Draft`, in the module of its area.
"""

from __future__ import annotations

from tests.validator.engine.rules.case import REGISTRY, Boundary, Mutant, new_draft
from tests.validator.engine.rules.cases import (
    archives,
    attempts,
    axis,
    battery,
    benchmark,
    benchmark_results,
    canonical,
    companions,
    controls,
    copies,
    counts,
    coverage,
    documents,
    evidence,
    experts,
    extents,
    features,
    fidelity,
    groups,
    histories,
    image_replays,
    keys,
    layers,
    layout,
    leakage,
    maps,
    media,
    model,
    nulls,
    places,
    quality,
    release,
    replays,
    responses,
    results,
    semantic_maps,
    split,
    tables,
    targets,
    trigger,
    values,
    windows,
    world,
)
from tests.validator.engine.rules.draft import Draft

__all__ = [
    "AREAS", "BOUNDARIES", "MUTANTS", "Boundary", "Draft", "Mutant", "new_draft",
]  # fmt: skip

AREAS = (
    layout, places, companions, documents, tables, values, nulls, keys, attempts, controls, axis, windows, evidence,
    extents, world, coverage, results, trigger, groups, media, archives, semantic_maps, maps, layers, canonical,
    quality, split, fidelity, model, targets, features, leakage, histories, battery, release, replays, responses,
    copies, experts, image_replays, benchmark, benchmark_results, counts,
)  # fmt: skip
"""Modules that define cases; the first mutant of a rule is that of the first of them that has one."""

_PLACES = {area.__name__: place for place, area in enumerate(AREAS)}

MUTANTS: tuple[Mutant, ...] = tuple(sorted(REGISTRY.mutants, key=lambda mutant: _PLACES[mutant.edit.__module__]))
"""In the order of the areas, whichever was imported first, and of their definition there."""

BOUNDARIES: tuple[Boundary, ...] = tuple(REGISTRY.boundaries)
