"""The population table: the paper's numbers, partitions from integrity on, and what adds up."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.each import each
from tests.validator.quality.release import FLAGS, concat, numbered, paper_groups, paper_pairs, reaching, shuffled

from branchdrive.quality.fidelity import with_validity
from branchdrive.quality.population import STAGES, frozen_groups, population_document

PAPER = {
    "discovered": (None, 2467, None),
    "exact_bank": (None, 1751, 22763),
    "controls_valid": (None, 649, 8437),
    "integrity_complete": ((444, 95, 95), 634, 8242),
    "eligible": ((442, 95, 95), 632, 8216),
    "core_valid": ((431, 88, 87), 606, 7878),
    "extended_valid": ((427, 88, 85), 600, 7800),
    "frozen": ((431, 88, 87), 606, 7878),
}


def stages(groups: Any) -> dict[str, Any]:
    return {stage["stage"]: stage for stage in population_document(groups, num_policies=13)["stages"]}


@each("stage", PAPER)
def test_the_table_is_that_of_the_paper(stage: str) -> None:
    found = stages(paper_groups())[stage]
    groups, total, trajectories = PAPER[stage]
    by_partition = (
        None if found["groups"] is None else tuple(found["groups"][name] for name in ("train", "val", "test"))
    )
    assert (by_partition, found["total"], found["trajectories"]) == (groups, total, trajectories)


def test_validity_follows_from_the_pairs_of_the_paper() -> None:
    groups = paper_groups()
    found = with_validity(groups, paper_pairs(groups))
    assert population_document(found, num_policies=13) == population_document(groups, num_policies=13)


def test_stages_are_in_order() -> None:
    assert list(stages(paper_groups())) == list(STAGES) == list(PAPER)


def test_partitions_without_groups_are_left_out() -> None:
    groups = numbered(concat([reaching("a", 6, 3, "train"), reaching("b", 6, 1, "calibration")]))
    document = population_document(groups, num_policies=2)
    assert document["partitions"] == ["train", "calibration"]
    assert document["stages"][-1] == {
        "stage": "frozen", "title": "Frozen population", "groups": {"train": 3, "calibration": 1}, "total": 4,
        "trajectories": 8,
    }  # fmt: skip


def test_no_group_at_all() -> None:
    document = population_document(reaching("a", 0, 0), num_policies=13)
    assert document["partitions"] == []
    assert {stage["total"] for stage in document["stages"]} == {0}


def test_near_duplicates_leave_the_frozen_population_only() -> None:
    groups = paper_groups()
    groups["near_duplicate"][groups["group_id"] == "test6-0000"] = True
    found = stages(groups)
    assert found["core_valid"]["groups"]["test"] == 87
    assert found["frozen"]["groups"]["test"] == 86
    assert frozen_groups(groups).sum() == 605


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.integers(0, len(FLAGS)), st.sampled_from(["train", "val", "test"])), max_size=12),
    st.integers(0, 99),
)
def test_partitions_add_up_and_order_decides_nothing(kinds: list[tuple[int, str]], order: int) -> None:
    parts = [reaching(f"g{i}", flags, 2, name if flags > 2 else None) for i, (flags, name) in enumerate(kinds)]
    groups = concat([*parts, reaching("none", 0, 1)])
    document = population_document(groups, num_policies=13)
    assert population_document(shuffled(groups, order), num_policies=13) == document
    totals = [stage["total"] for stage in document["stages"]]
    assert totals[:7] == sorted(totals[:7], reverse=True)
    for stage in document["stages"]:
        if stage["groups"] is not None:
            assert list(stage["groups"]) == document["partitions"]
            assert sum(stage["groups"].values()) == stage["total"]
