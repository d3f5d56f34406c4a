"""What rules on images count as examined: what they compared, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import NOMINAL, SHARD_1, judged, new_draft
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.semantic_map import add_semantic_map

from branchdrive.contract.semantic_bev import SemanticChannel

VEHICLE = np.uint8(SemanticChannel.OTHER_VEHICLE)


def examined(draft: Draft, folder: Path, rule: str) -> int:
    (tally,) = (tally for tally in judged(draft, folder).tallies if tally.rule_id == rule)
    return tally.examined


@pytest.mark.parametrize(("tick", "findings"), [(BRANCH_TICK, 1), (0, 0)])
def test_other_vehicles_are_compared_where_all_actors_are_recorded(tick: int, findings: int, tmp_path: Path) -> None:
    draft = new_draft("media")
    add_semantic_map(draft, vehicles=lambda pixels: pixels | np.roll(pixels & VEHICLE, 20, axis=1), tick=tick)
    (tally,) = (tally for tally in judged(draft, tmp_path).tallies if tally.rule_id == "BD-FRM-009")
    assert (tally.examined, tally.num_findings) == (1, findings)


@pytest.mark.parametrize("rule", ["BD-FRM-009", "BD-FRM-012"])
def test_a_map_between_observations_is_not_compared(rule: str, tmp_path: Path) -> None:
    draft = new_draft("media")
    add_semantic_map(draft)
    draft.set("frames", "tick", BRANCH_TICK + 1, camera="bev")
    assert examined(draft, tmp_path, rule) == 0


def test_without_a_route_that_is_whole_nothing_says_where_it_is(tmp_path: Path) -> None:
    draft = new_draft("media")
    add_semantic_map(draft)
    draft.set("rollouts", "route_y_m", [0.0], rollout_id=NOMINAL)
    assert examined(draft, tmp_path, "BD-FRM-012") == 0


def test_an_attempt_with_maps_alone_has_no_images_that_follow_the_drive(tmp_path: Path) -> None:
    draft = new_draft("media")
    whole = examined(draft, tmp_path / "whole", "BD-FRM-010")
    draft.drop("frames", rollout_id=NOMINAL)
    add_semantic_map(draft)
    assert examined(draft, tmp_path / "maps", "BD-FRM-010") == whole - 1


@pytest.mark.parametrize("tables", [["frames"], None])
def test_a_shard_without_rows_is_judged_beside_a_good_one(tables: list[str] | None, tmp_path: Path) -> None:
    draft = new_draft("media")
    add_semantic_map(draft)
    for name in tables or list(draft.tables[SHARD_1]):
        draft.map_table(name, lambda rows: rows.slice(0, 0), folder=SHARD_1)
    report = judged(draft, tmp_path)
    assert [tally.rule_id for tally in report.tallies if tally.errors] == []
    (maps,) = (tally for tally in report.tallies if tally.rule_id == "BD-FRM-009")
    assert (maps.examined, maps.num_findings) == (1, 0)
