"""Base datasets of conformance cases: what each is written from, and names of registered cases."""

from __future__ import annotations

import re
from pathlib import Path
from typing import cast

from tests.mutation import BOUNDARIES, MUTANTS, Boundary, Draft, Mutant, new_draft
from tests.validator.engine.rules.case import Base

from branchdrive.contract.resources import SPEC_VERSION

__all__ = ["BASES", "BASE_OF", "CASES", "case_name", "draft_of", "file_name"]

ROOT = Path(__file__).resolve().parents[1]
CASES = ROOT / "conformance_tests" / "cases" / f"v{SPEC_VERSION}"

BASES: dict[str, tuple[str, str | None, str]] = {
    "raw": ("full", None, "three groups with actors and risk evidence"),
    "raw-drives": ("drives", "raw", "three groups of drives and their nominal rollouts"),
    "raw-media": ("media", "raw", "the same with camera frames"),
    "raw-map": ("map", "raw", "the same with a map"),
    "raw-bare": ("bare", "raw", "the same without actors and risk evidence"),
    "raw-exact": ("BD-RPN-001/exact_replays", "raw", "the same with replays that are exact, as is declared"),
    "raw-exact-media": (
        "BD-RPN-006/images_of_exact_replays",
        "raw-media",
        "the same with camera frames and with exact replays",
    ),
    "raw-prompt": (
        "BD-RSP-014/images_that_show_the_first_response",
        "raw-media",
        "the same with exact replays and with camera frames that show what the policy does",
    ),
    "raw-driven": (
        "BD-RSP-016/vehicle_that_drives",
        "raw-bare",
        "groups whose ego vehicle moves as the declared one does",
    ),
    "raw-replayed": ("BD-RPN-001/nothing_is_declared", "raw", "three groups of replays that are not exact"),
    "raw-window": ("BD-WIN-002/branch_without_a_predecessor", "raw", "three groups, one that branches too early"),
    "raw-policies": ("BD-CTL-010/window_beyond_the_end_of_the_nominal", "raw", "one group of other policies"),
    "raw-near": ("BD-ACT-006/rows_up_to_thirty_metres", "raw", "three groups with actors up to a distance"),
    "raw-axle": ("BD-RSP-007/pose_of_the_front_axle", "raw-driven", "groups with the pose of another point"),
    "raw-crab": ("BD-RSP-007/actors_that_crab_a_little", "raw", "three groups with actors that turn aside"),
    "raw-bent": (
        "BD-RTE-005/command_before_a_bend_to_the_other_side",
        "raw-bare",
        "groups without actors, one of them on a route that bends",
    ),
    "raw-early": ("BD-TIC-003/earliest_branch", "raw", "three groups, one with the earliest branch there is"),
    "raw-four": ("BD-RSP-002/group_on_another_road", "raw-bare", "four groups without actors"),
    "raw-place": ("BD-RSP-015/group_in_another_place", "raw", "three groups, one that repeats another elsewhere"),
    "release": ("release", None, "a release in place: raw layer with media, all derived layers, an audit of leakage"),
    "release-raw": ("detached", "release", "the raw dataset beside a detached release"),
    "release-detached": ("alone", "release", "a release without its raw layer"),
    "release-noisy": ("BD-FID-008/noisy_group_called_valid", "release", "a release with a group that is not valid"),
    "release-ineligible": (
        "BD-QUA-006/group_with_two_seeds_called_eligible",
        "release",
        "a release with a group that is not eligible",
    ),
    "release-repeated": (
        "BD-SPL-007/group_that_repeats_another_within_its_partition",
        "release",
        "a release of another split",
    ),
    "release-near": ("BD-SPL-007/near_duplicate_let_through", "release", "a release with a near duplicate"),
    "release-coded": (
        "BD-LKG-017/target_speed_that_names_another_action_in_six_groups",
        "release-detached",
        "a release of sixty groups without its raw layer",
    ),
    "release-benchmark": ("benchmark", "release", "a release in place with a benchmark"),
    "release-baselines": (
        "BD-BMK-012/results_with_baselines",
        "release-benchmark",
        "a release with a benchmark that has baselines",
    ),
    "release-endings": (
        "BD-MOD-022/release_that_tells_how_drives_end",
        "release",
        "a release that tells how drives end",
    ),
    "release-objects": (
        "BD-MOD-023/release_that_tells_what_sensors_see",
        "release",
        "a release that tells what sensors see of others",
    ),
    "release-outcomes": (
        "BD-BMK-001/outcomes_of_selections_are_declared",
        "release-benchmark",
        "a release with a benchmark that declares outcomes of selections",
    ),
    "release-outcomes-endings": (
        "BD-BMK-012/endings_of_selections",
        "release-outcomes",
        "the same of a release that tells how drives end",
    ),
}
"""Base datasets: the draft or registered limit that each is written from, the base that its files are stored against,
and what it is."""

BASE_OF: dict[Base, str] = {
    "full": "raw", "drives": "raw-drives", "media": "raw-media", "map": "raw-map", "bare": "raw-bare",
    "release": "release", "detached": "release-detached", "alone": "release-detached", "benchmark": "release-benchmark",
}  # fmt: skip


def draft_of(source: str) -> Draft:
    """A new draft of a kind, or of a registered limit."""
    if not source.startswith("BD-"):
        return new_draft(cast(Base, source))
    (case,) = (case for case in (*MUTANTS, *BOUNDARIES) if case_name(case) == source)
    draft = new_draft(case.base)
    case.edit(draft)
    return draft


def case_name(case: Mutant | Boundary) -> str:
    """Name of a registered case among the conformance cases."""
    return f"{case.rule if isinstance(case, Mutant) else case.rules[0]}/{file_name(case.name)}"


def file_name(name: str) -> str:
    """A name as files have it."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
