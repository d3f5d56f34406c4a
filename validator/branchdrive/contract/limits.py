"""Spec limits: how much of anything a reader of an untrusted dataset must accept.

Source: spec/09-security.md; values in `schemas/v0.1/limits.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from branchdrive.contract.resources import load_resource

__all__ = ["Limits", "spec_limits"]


@dataclass(frozen=True)
class Limits:
    """Upper bounds; sizes in bytes, `limits.json` says what each one bounds."""

    max_files: int
    max_depth: int
    max_path_bytes: int
    max_document_bytes: int
    max_document_depth: int
    max_manifest_bytes: int
    max_ignore_bytes: int
    max_ignore_patterns: int
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
