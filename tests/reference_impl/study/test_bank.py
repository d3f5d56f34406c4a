"""The canonical bank of a group is that of its shard."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.reference_impl.study import samples
from tests.reference_impl.study.samples import dropped, rows_at
from tests.reference_impl.study.test_faults import AGAIN, FAULTS, TWICE
from tests.sampling import sampled
from tests.synthetic import BRANCH_TICK

from branchdrive import UsageError, load_action_bank, open_dataset
from branchdrive.engine.examine import examine
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.bank import canonical_bank


def test_a_bank_has_the_order_of_the_action_bank(tmp_path: Path) -> None:
    dataset = open_dataset(samples.written(tmp_path / "d"))
    for group_id in dataset.groups:
        keys = [rollout.record["action_key"] for rollout in canonical_bank(dataset.group(group_id), dataset.descriptor)]
        assert keys == list(load_action_bank().keys)


def test_the_second_attempt_stands_in_for_a_bad_first_one(tmp_path: Path) -> None:
    bad = {"controls": dropped(rows_at(TWICE, BRANCH_TICK))}
    for name, edits, expected in (("a", {}, TWICE), ("b", bad, AGAIN)):
        dataset = open_dataset(samples.written(tmp_path / name, edits))
        rollouts = canonical_bank(dataset.group("g1"), dataset.descriptor)
        assert [r.rollout_id for r in rollouts if r.record["action_key"] == "brake_0.50"] == [expected]


@pytest.mark.parametrize("name", sampled(FAULTS, every=5))
def test_a_group_alone_has_the_bank_that_it_has_in_its_shard(tmp_path: Path, name: str) -> None:
    dataset = open_dataset(samples.written(tmp_path / "d", FAULTS[name][0]))
    shard = dataset.shards[0]  # where the faults are
    view = ShardView({table: shard.decode(table) for table in dataset.descriptor.tables}, dataset.descriptor)
    _, examination = examine(view)
    for group_id, rows in zip(view.group_ids, examination.selection.chosen, strict=True):
        group = dataset.group(group_id)
        if (rows >= 0).all():
            found = [rollout.rollout_id for rollout in canonical_bank(group, dataset.descriptor)]
            assert found == [view.rollout_ids[row] for row in rows]
        else:
            with pytest.raises(UsageError, match=f"group '{group_id}' has no complete attempt of "):
                canonical_bank(group, dataset.descriptor)
