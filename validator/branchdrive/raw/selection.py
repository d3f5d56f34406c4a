"""Candidates of each branch group: one attempt per policy among retries and variants.

Choose the nominal first, then each action: among complete attempts that comply, the lowest attempt
number (ties: rollout id); else the lowest complete attempt; else none. An intervention executed
against another nominal than the chosen one does not comply. No outcome is read.
Source: definitions (canonical selection); spec/07-rules.md#funnel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.raw.shard_view import ShardView

__all__ = ["Selection", "select_candidates"]


@dataclass(frozen=True)
class Selection:
    """Chosen attempts of a shard.

    Attributes:
        chosen: Attempt of each group and policy ``[groups, policies]``, index into the shard's
            rollouts, -1 where the group has no complete attempt.
        nominal: Attempt chosen as each group's nominal ``[groups]``, -1 if none.
    """

    chosen: NDArray[np.int64]
    nominal: NDArray[np.int64]


def select_candidates(view: ShardView, compliant: NDArray[np.bool_]) -> Selection:
    """Candidates of every group of the shard.

    Args:
        view: The shard.
        compliant: Attempts without any violation ``[rollouts]``.
    """
    bank = view.descriptor.action_bank
    nominal_policy = bank.nominal_index
    candidate = view.complete & ~view.role("nominal_replay") & (view.policy >= 0)
    attempt, names = view.rollouts["attempt"], view.rollout_ids
    order = sorted(np.flatnonzero(candidate), key=lambda i: (not compliant[i], attempt[i], names[i]))

    num_groups = len(view.group_ids)
    chosen = np.full((num_groups, len(bank.policies)), -1, np.int64)
    for i in order:
        if view.policy[i] == nominal_policy and chosen[view.group[i], nominal_policy] < 0:
            chosen[view.group[i], nominal_policy] = i
    nominal = chosen[:, nominal_policy].copy()
    kept: dict[tuple[int, int], tuple[bool, int, str]] = {}
    for i in order:
        group, policy = int(view.group[i]), int(view.policy[i])
        if policy == nominal_policy:
            continue
        complies = bool(compliant[i]) and view.nominal[i] == nominal[group]
        rank = (not complies, int(attempt[i]), names[i])
        if (group, policy) not in kept or rank < kept[group, policy]:
            kept[group, policy] = rank
            chosen[group, policy] = i
    return Selection(chosen, nominal)
