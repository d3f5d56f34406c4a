"""Spec limits: how much a reader of an untrusted dataset must accept, how far a world may be off, what is noise.

Source: spec/09-security.md, spec/05-raw-streams.md#bounds, spec/11-fidelity.md#thresholds; values in
`schemas/v0.1/limits.json`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from branchdrive.contract.resources import load_resource

__all__ = ["Bounds", "Limits", "physical_bounds", "spec_limits", "threshold_floors"]


@dataclass(frozen=True)
class Limits:
    """Upper bounds; sizes in bytes, `limits.json` says what each one bounds."""

    max_files: int
    max_repeated_bytes: int
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
    max_image_pixels: int
    max_image_scans: int
    max_image_parts: int
    max_range_rows: int
    max_shard_pixels: int
    max_media_bytes: int
    max_shard_rollouts: int
    max_route_vertices: int
    max_map_squares: int
    max_map_pairs: int
    max_footer_items: int
    max_footer_string_bytes: int
    max_worker_bytes: int
    max_dataset_worker_bytes: int


@cache
def spec_limits() -> Limits:
    """The limits of the implemented spec version."""
    declared = load_resource("limits.json")["limits"]
    return Limits(**{name: int(limit["value"]) for name, limit in declared.items()})


@dataclass(frozen=True)
class Bounds:
    """Bounds within which recorded columns agree; `limits.json` says what each one bounds, and why."""

    route_tolerance_m: float
    route_tolerance_rad: float
    displacement_m: float
    displacement_share: float
    turn_rad: float
    acceleration_mps2: float
    same_centre_m: float
    contact_observations: float
    contact_reach_m: float
    rest_observations: float
    gap_margin_m: float
    road_user_mps2: float
    edge_m: float
    trigger_delay_ticks: float
    signal: float
    route_fraction: float
    route_end_m: float
    wall_margin_m: float
    route_distance_m: float
    bev_px: float
    bev_share: float
    bev_route_m: float
    sign_m: float
    meeting_m: float
    stop_line_m: float
    bev_light_m: float
    bev_junction_m: float
    deviated_m: float
    moved_m: float
    filled_m: float
    copy_m: float
    history_m: float
    history_mps: float
    driving_mps: float
    heeding_mps: float
    body_m: float
    pedestrian_m: float
    cycle_m: float
    vehicle_length_m: float
    vehicle_section_m: float
    narrow_vehicle_m: float
    wide_vehicle_m: float


@cache
def physical_bounds() -> Bounds:
    """The bounds of the implemented spec version."""
    declared = load_resource("limits.json")["bounds"]
    return Bounds(**{name: float(bound["value"]) for name, bound in declared.items()})


@cache
def threshold_floors() -> Mapping[str, float]:
    """Least threshold of every variable of replay fidelity, in its unit: a smaller discrepancy is numerical noise."""
    declared = load_resource("limits.json")["floors"]
    return MappingProxyType({name: float(floor["value"]) for name, floor in declared.items()})
