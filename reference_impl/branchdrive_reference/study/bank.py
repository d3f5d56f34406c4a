"""The good bank of one group: the attempts that stand for its policies, counted by `study` and drawn by `draw`."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import UsageError
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import ROLLOUTS, Rollout
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.candidate import choose_candidates, good_attempts
from branchdrive_reference.study.label import label, labels

__all__ = ["good_bank"]

_READ = ("controls", "observations", "evidence")
"""Streams by which an attempt is judged, where the dataset claims them."""


def good_bank(group: BranchGroup, descriptor: Descriptor) -> tuple[Rollout, ...]:
    """The good attempt of every policy, in the order of the action bank.

    Args:
        group: The group with all its attempts.
        descriptor: Of the dataset that holds the group.

    Raises:
        UsageError: Some policy has no good attempt.
    """
    view = _view(group, descriptor)
    with np.errstate(all="ignore"):
        (chosen,) = choose_candidates(view, good_attempts(view))
    keys = descriptor.action_bank.keys
    lacking = [key for key, row in zip(keys, chosen, strict=True) if row < 0]
    if lacking:
        nominal = descriptor.action_bank.nominal.key
        whose = f"good nominal attempt {nominal!r}" if nominal in lacking else f"good attempt of {labels(lacking)}"
        raise UsageError(
            f"group '{label(group.group_id)}' has no {whose}: one that is complete, holds every window around a "
            "branch and intervenes as its policy says"
        )
    return tuple(group.rollouts[row] for row in chosen)


def _view(group: BranchGroup, descriptor: Descriptor) -> ShardView:
    """The group alone as a shard, its rollouts in the group's order."""
    records = pa.Table.from_pylist([rollout.record for rollout in group.rollouts], schema=table_schema(ROLLOUTS))
    claimed = [name for name in _READ if name in descriptor.tables]
    distinct = {rollout.rollout_id: rollout for rollout in group.rollouts}.values()
    streams = {name: pa.concat_tables([rollout.tables[name] for rollout in distinct]) for name in claimed}
    return ShardView({ROLLOUTS: records, **streams}, descriptor)
