"""Spec limits: how much of anything a reader of an untrusted dataset must accept, and below what numbers tell nothing.

Source: spec/09-security.md, spec/11-fidelity.md#thresholds; values in `schemas/v0.1/limits.json`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from branchdrive.contract.resources import load_resource

__all__ = ["Limits", "spec_limits", "threshold_floors"]


@dataclass(frozen=True)
class Limits:
    """Upper bounds; sizes in bytes, `limits.json` says what each one bounds."""

    max_files: int
    max_depth: int
    max_path_bytes: int
    max_document_bytes: int
    max_document_depth: int
    max_manifest_bytes: int
    max_table_bytes: int
    max_table_rows: int
    max_table_decoded_bytes: int
    max_table_columns: int
    max_image_bytes: int
    max_media_bytes: int
    max_shard_rollouts: int
    max_route_vertices: int
    max_footer_items: int
    max_footer_string_bytes: int
    max_worker_bytes: int


@cache
def spec_limits() -> Limits:
    """The limits of the implemented spec version."""
    declared = load_resource("limits.json")["limits"]
    return Limits(**{name: int(limit["value"]) for name, limit in declared.items()})


@cache
def threshold_floors() -> Mapping[str, float]:
    """Least threshold of every variable of replay fidelity, in its unit: a smaller discrepancy is numerical noise."""
    declared = load_resource("limits.json")["floors"]
    return MappingProxyType({name: float(floor["value"]) for name, floor in declared.items()})
