"""The canonical bank of one group: the attempts that stand for its policies, as the canonical layer has them."""

from __future__ import annotations

import pyarrow as pa

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.examine import examine
from branchdrive.errors import UsageError
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import ROLLOUTS, Rollout
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.label import label, labels

__all__ = ["canonical_bank"]


def canonical_bank(group: BranchGroup, descriptor: Descriptor) -> tuple[Rollout, ...]:
    """The canonical attempt of every policy, in the order of the action bank; it is complete and may break rules.

    Args:
        group: The group with all its attempts.
        descriptor: Of the dataset that holds the group.

    Raises:
        UsageError: Some policy has no complete attempt.
    """
    _, examination = examine(_view(group, descriptor))
    (chosen,) = examination.selection.chosen
    keys = descriptor.action_bank.keys
    lacking = [key for key, row in zip(keys, chosen, strict=True) if row < 0]
    if lacking:
        raise UsageError(f"group '{label(group.group_id)}' has no complete attempt of {labels(lacking)}")
    return tuple(group.rollouts[row] for row in chosen)


def _view(group: BranchGroup, descriptor: Descriptor) -> ShardView:
    """The group alone as a shard, its rollouts in the group's order."""
    records = pa.Table.from_pylist([rollout.record for rollout in group.rollouts], schema=table_schema(ROLLOUTS))
    distinct = {rollout.rollout_id: rollout for rollout in group.rollouts}.values()
    streams = {
        name: pa.concat_tables([rollout.tables[name] for rollout in distinct])
        for name in descriptor.tables
        if name in group.rollouts[0].tables
    }
    return ShardView({ROLLOUTS: records, **streams}, descriptor)
