"""Every module of rules; importing this one binds each rule of the catalogue to its function."""

from branchdrive.benchmark import latency
from branchdrive.benchmark import rules as benchmark_rules
from branchdrive.benchmark.prediction import rules as prediction_rules
from branchdrive.benchmark.protocol import rules as protocol_rules
from branchdrive.canonical import rules as canonical_rules
from branchdrive.card import rules as card_rules
from branchdrive.files import rules as file_rules
from branchdrive.layers import rules as layer_rules
from branchdrive.leakage import rules as leakage_rules
from branchdrive.leakage import structural_rules
from branchdrive.model import near_duplicate_rules
from branchdrive.model import rules as model_rules
from branchdrive.quality import fidelity_rules, split_rules
from branchdrive.quality import rules as quality_rules
from branchdrive.raw.rules import (
    controls,
    coverage,
    evidence,
    extents,
    groups,
    images,
    infractions,
    keys,
    maps,
    media,
    motion,
    nulls,
    replays,
    responses,
    results,
    route,
    status,
    ticks,
    tracks,
    values,
)

RULE_MODULES = (
    file_rules, keys, nulls, values, ticks, status, controls, evidence, groups, responses,
    replays, media, images, maps, route, motion, tracks, coverage, extents, results, infractions,
    layer_rules, canonical_rules, quality_rules, split_rules, fidelity_rules, model_rules, near_duplicate_rules,
    leakage_rules, structural_rules, protocol_rules, prediction_rules, benchmark_rules, latency, card_rules,
)  # fmt: skip
"""Modules of rules, in order of the layers."""
