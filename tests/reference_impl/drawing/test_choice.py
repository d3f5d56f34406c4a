"""Which groups are drawn."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.drawing.invented import write_invented

from branchdrive import UsageError
from branchdrive_reference.drawing.choice import named_groups, wanted_groups


def test_groups_are_wanted_by_the_type_of_their_nominal(tmp_path: Path) -> None:
    dataset = write_invented(tmp_path / "d", {"g2.nominal.a1": {"scenario_type": "Merge"}})
    assert wanted_groups(dataset) == {"g0": "CutIn", "g1": "CutIn", "g2": "Merge"}
    assert wanted_groups(dataset, ["Merge"]) == {"g2": "Merge"}


def test_a_group_without_nominal_has_the_type_of_its_first_attempt(tmp_path: Path) -> None:
    changed = {"g1.nominal.a1": {"role": "nominal_replay"}, "g1.accelerate_0.30.a1": {"scenario_type": "Merge"}}
    dataset = write_invented(tmp_path / "d", changed)
    assert wanted_groups(dataset)["g1"] == "Merge"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Mergr", "unknown scenario type 'Mergr'; did you mean Merge? choose from CutIn, Merge"),
        ("cutin", "unknown scenario type 'cutin'; did you mean CutIn? choose from CutIn, Merge"),
        ("Parade", "unknown scenario type 'Parade'; choose from CutIn, Merge"),
    ],
)
def test_an_unknown_type_is_told_with_what_there_is(tmp_path: Path, name: str, told: str) -> None:
    dataset = write_invented(tmp_path / "d", {"g2.nominal.a1": {"scenario_type": "Merge"}})
    with pytest.raises(UsageError) as caught:
        wanted_groups(dataset, [name])
    assert str(caught.value) == told


def test_named_groups_are_drawn_once(tmp_path: Path) -> None:
    assert named_groups(write_invented(tmp_path / "d"), ["g2", "g0", "g2"]) == ["g2", "g0"]


def test_a_group_that_nobody_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no group 'g\\x1b' among the 3 groups"):
        named_groups(write_invented(tmp_path / "d"), ["g0", "g\x1b"])
