"""Semantic views of the reference world agree with what is recorded beside them."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.collect.kept_collection import kept_collection

from branchdrive import validate
from branchdrive_reference.rendering.dataset import render_dataset
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import cameras_of


def test_a_rendered_group_shows_the_recorded_vehicles_road_and_route(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MediaPlan, "offsets", (-75, 0, 50))
    root = kept_collection(tmp_path / "collected", num_groups=1, seed=5)
    rendered = render_dataset(root, MediaPlan(cameras_of(("semantic_bev",))), output=tmp_path / "rendered")
    report = validate(rendered.root, select=["BD-FRM-009", "BD-FRM-012"])
    tallies = [tally for tally in report.tallies if tally.rule_id in ("BD-FRM-009", "BD-FRM-012")]
    assert [tally.status for tally in tallies] == ["pass", "pass"]
    assert {tally.examined for tally in tallies} == {rendered.num_images}
    assert rendered.num_images > 30
