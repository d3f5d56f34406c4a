"""Which groups are drawn."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.drawing.invented import write_invented

from branchdrive import UsageError
from branchdrive_reference.drawing.choice import choose_groups, named_groups


def test_the_first_group_of_each_type_is_chosen(tmp_path: Path) -> None:
    others = {f"g2.{key}.a1": {"scenario_type": "Merge"} for key in ("nominal",)}
    dataset = write_invented(tmp_path / "d", others)
    assert choose_groups(dataset) == ["g0", "g2"]
    assert choose_groups(dataset, ["Merge"]) == ["g2"]


@pytest.mark.parametrize(
    "change",
    [
        {"g0.brake_0.30.a1": {"status": "partial"}},
        {"g0.nominal.a1": {"status": "partial"}},
        {"g0.nominal.a1": {"branch_tick": None}},
    ],
    ids=["a candidate is partial", "the nominal rollout is partial", "no branch"],
)
def test_an_incomplete_group_is_passed_over(tmp_path: Path, change: dict[str, dict[str, object]]) -> None:
    assert choose_groups(write_invented(tmp_path / "d", change)) == ["g1"]


def test_a_type_without_complete_group_is_refused(tmp_path: Path) -> None:
    partial = {f"g{index}.nominal.a1": {"status": "partial"} for index in range(3)}
    dataset = write_invented(tmp_path / "d", partial)
    with pytest.raises(UsageError, match="no complete, branched group of scenario type 'CutIn'"):
        choose_groups(dataset, ["CutIn"])
    with pytest.raises(UsageError, match="no complete, branched group to draw"):
        choose_groups(dataset)


def test_named_groups_are_drawn_once(tmp_path: Path) -> None:
    assert named_groups(write_invented(tmp_path / "d"), ["g2", "g0", "g2"]) == ["g2", "g0"]


def test_a_group_whose_id_is_no_file_name_is_refused(tmp_path: Path) -> None:
    dataset = write_invented(tmp_path / "d", {"g0.nominal.a1": {"group_id": "../g0"}})
    with pytest.raises(UsageError, match="an id that the format does not allow"):
        named_groups(dataset, ["../g0"])
