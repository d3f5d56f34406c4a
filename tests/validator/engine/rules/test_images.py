"""What rules on images count as examined: what they compared, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import NOMINAL, judged, new_draft
from tests.validator.engine.rules.cases.media import add_semantic_map
from tests.validator.engine.rules.draft import Draft


def examined(draft: Draft, folder: Path, rule: str) -> int:
    (tally,) = (tally for tally in judged(draft, folder).tallies if tally.rule_id == rule)
    return tally.examined


@pytest.mark.parametrize(("tick", "expected"), [(BRANCH_TICK, 1), (0, 0)])
def test_a_map_without_recorded_actors_is_not_compared(tick: int, expected: int, tmp_path: Path) -> None:
    draft = new_draft("media")
    add_semantic_map(draft, tick=tick)
    assert examined(draft, tmp_path, "BD-FRM-009") == expected


def test_an_attempt_with_maps_alone_has_no_images_that_follow_the_drive(tmp_path: Path) -> None:
    draft = new_draft("media")
    whole = examined(draft, tmp_path / "whole", "BD-FRM-010")
    draft.drop("frames", rollout_id=NOMINAL)
    add_semantic_map(draft)
    assert examined(draft, tmp_path / "maps", "BD-FRM-010") == whole - 1
