"""The synthetic release shows every situation that a release must explain, and is what the builder makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests import synthetic_release
from tests.synthetic_release import LOST, MOVED, NEAR_DUPLICATE, NOISY, NUM_GROUPS, SEED, TWINS
from tests.validator.engine.rules.case import new_draft
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.release import (
    LEAKAGE,
    POPULATION,
    SOURCE,
    STEPS,
    THRESHOLDS,
    ReleaseDraft,
    release_draft,
)

from branchdrive.contract.companion import CROISSANT_FILE
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.quality.population import STAGES
from branchdrive.release.builder import build_release
from branchdrive.release.stage import BuildOptions


@pytest.fixture(scope="module")
def release() -> ReleaseDraft:
    return release_draft()


def flags(d: ReleaseDraft, column: str) -> dict[str, bool]:
    groups = d.frame("group_quality")
    return dict(zip(groups["group_id"].tolist(), groups[column].tolist(), strict=True))


def test_a_group_is_lost_at_each_stage(release: ReleaseDraft) -> None:
    columns = {"bank": "exact_bank", "controls": "controls_valid", "integrity": "integrity_complete"}
    for stage, column in {**columns, "eligibility": "eligible"}.items():
        before = [name for name in STAGES if name not in ("discovered", "frozen")]
        assert not flags(release, column)[LOST[stage]]
        assert all(flags(release, name)[LOST[stage]] for name in before[: before.index(column)])
    totals = [stage["total"] for stage in release.documents[POPULATION]["stages"]]
    assert totals == [NUM_GROUPS, 20, 19, 18, 17, 16, 15, 15]


def test_every_disposition_that_a_valid_raw_layer_can_have_is_there(release: ReleaseDraft) -> None:
    counts = release.documents[SOURCE]["dispositions"]
    assert {word for word, count in counts.items() if not count} == {"outside_bank"}
    assert min(release.documents[SOURCE]["states"].values()) > 0


def test_groups_stand_where_their_names_say(release: ReleaseDraft) -> None:
    homes = flags(release, "partition")
    assert [homes[group] for group in (*NEAR_DUPLICATE, MOVED, *NOISY)] == [
        "train", "test", "val", "train", "train", "val",
    ]  # fmt: skip
    assert [group for group, flag in flags(release, "near_duplicate").items() if flag] == [NEAR_DUPLICATE[1]]
    clusters = flags(release, "route_cluster")
    assert [group for group in clusters if list(clusters.values()).count(clusters[group]) == 2 and homes[group]] == [
        *TWINS
    ]
    core, extended = flags(release, "core_valid"), flags(release, "extended_valid")
    assert [group for group in core if flags(release, "eligible")[group] and not core[group]] == ["g16"]
    assert [group for group in core if core[group] and not extended[group]] == [MOVED]


def test_replays_differ_a_little(release: ReleaseDraft) -> None:
    pairs = release.frame("pairs")
    for name in ("position_m", "heading_deg", "speed_mps", "steer", "throttle", "vehicle_gap_m"):
        assert len(np.unique(np.ma.compressed(pairs[name]))) > 5
    assert {True, False} == set(pairs["core_pass"].tolist()) == set(pairs["extended_pass"].tolist())
    judged = [v for v in release.documents[THRESHOLDS]["variables"] if v["judged"]]
    assert len(judged) == 11


def test_gate_can_fail_and_passes(release: ReleaseDraft) -> None:
    gate = release.documents[LEAKAGE]["gate"]
    assert gate["verdict"] == "pass"
    alpha, permutations = (release.documents[LEAKAGE]["protocol"]["gate"][k] for k in ("alpha", "num_permutations"))
    assert len(gate["tests"]) / (permutations + 1) <= alpha


def test_nothing_follows_otherwise_from_an_untouched_release(release: ReleaseDraft) -> None:
    again = release_draft()
    again.reseal(next(iter(STEPS)))
    assert again.documents == release.documents
    assert again.texts == release.texts
    assert all(rows.equals(release.tables[f][name]) for f in again.tables for name, rows in again.tables[f].items())


def test_builder_makes_the_same_release(release: ReleaseDraft, tmp_path: Path) -> None:
    """To the byte, but for the descriptor, and the audit of leakage, which takes its own protocol and classifier."""
    raw = Draft(synthetic_release.raw_tables(), synthetic_release.raw_descriptor()).write(tmp_path / "raw")
    stages = ("canonical", "quality", "model")
    build_release(raw, stages=stages, options=BuildOptions(seed=SEED))
    draft = release_draft()
    del draft.documents[LEAKAGE]
    draft.add_filtering()
    draft.reseal("card")
    expected = draft.write(tmp_path / "release")
    files = [path.relative_to(expected) for path in expected.rglob("*") if path.is_file()]
    made = {path.relative_to(raw) for path in raw.rglob("*") if path.is_file()} - {Path(CROISSANT_FILE)}
    assert sorted(files) == sorted(made)
    apart = {str(path) for path in files if (raw / path).read_bytes() != (expected / path).read_bytes()}
    assert apart == {DESCRIPTOR_FILE, MANIFEST_FILE}


def test_rebuilding_gives_the_same_layers(release: ReleaseDraft) -> None:
    draft = release_draft()
    draft.rebuild()
    del (before := release_draft().documents)[LEAKAGE]
    assert draft.documents == before
    assert all(rows.equals(release.tables[f][name]) for f in draft.tables for name, rows in draft.tables[f].items())


def test_drafts_share_nothing_that_an_edit_changes() -> None:
    first = new_draft("release")
    first.set("state", "speed_mps", 0.0, group_id="g0")
    first.documents[POPULATION]["stages"].clear()
    second = new_draft("release")
    assert 0.0 not in second.take("state", group_id="g0")["speed_mps"].to_pylist()
    assert second.documents[POPULATION]["stages"]
