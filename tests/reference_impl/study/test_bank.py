"""The good bank of a group is what a study counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.reference_impl.study import samples
from tests.reference_impl.study.samples import Edit, dropped, replaced, rows_at
from tests.reference_impl.study.test_faults import AGAIN, FAULTS, TWICE
from tests.synthetic import BRANCH_TICK

from branchdrive import UsageError, load_action_bank, open_dataset
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.bank import good_bank
from branchdrive_reference.study.candidate import choose_candidates, good_attempts


def test_a_bank_has_the_order_of_the_action_bank(tmp_path: Path) -> None:
    dataset = open_dataset(samples.written(tmp_path / "d"))
    for group_id in dataset.groups:
        keys = [rollout.record["action_key"] for rollout in good_bank(dataset.group(group_id), dataset.descriptor)]
        assert keys == list(load_action_bank().keys)


def test_the_second_attempt_stands_in_for_a_bad_first_one(tmp_path: Path) -> None:
    bad = {"controls": dropped(rows_at(TWICE, BRANCH_TICK))}
    for name, edits, expected in (("a", {}, TWICE), ("b", bad, AGAIN)):
        dataset = open_dataset(samples.written(tmp_path / name, edits))
        rollouts = good_bank(dataset.group("g1"), dataset.descriptor)
        assert [r.rollout_id for r in rollouts if r.record["action_key"] == "brake_0.50"] == [expected]


@pytest.mark.parametrize("name", FAULTS)
def test_a_group_alone_has_the_bank_that_it_has_in_its_shard(tmp_path: Path, name: str) -> None:
    dataset = open_dataset(samples.written(tmp_path / "d", FAULTS[name][0]))
    for shard in dataset.shards[:1]:  # where the faults are
        tables = {table: shard.decode(table) for table in ("rollouts", "controls", "observations", "evidence")}
        view = ShardView(tables, dataset.descriptor)
        with np.errstate(all="ignore"):
            chosen = choose_candidates(view, good_attempts(view))
        for group_id, rows in zip(view.group_ids, chosen, strict=True):
            group = dataset.group(group_id)
            if (rows >= 0).all():
                found = [rollout.rollout_id for rollout in good_bank(group, dataset.descriptor)]
                assert found == [view.rollout_ids[row] for row in rows]
            else:
                with pytest.raises(UsageError, match=f"group '{group_id}' has no good "):
                    good_bank(group, dataset.descriptor)


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (
            replaced("status", {"g0.brake_0.30.a1": "partial"}),
            "has no good attempt of brake_0.30: one that is complete",
        ),
        (replaced("status", {"g0.nominal.a1": "partial"}), "has no good nominal attempt 'nominal': "),
    ],
    ids=["intervention", "nominal"],
)
def test_the_lacking_policies_are_named(tmp_path: Path, edit: Edit, told: str) -> None:
    dataset = open_dataset(samples.written(tmp_path / "d", {"rollouts": edit}))
    with pytest.raises(UsageError) as caught:
        good_bank(dataset.group("g0"), dataset.descriptor)
    assert told in str(caught.value)
