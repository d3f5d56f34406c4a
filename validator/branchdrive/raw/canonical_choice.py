"""Candidates of each branch group: one attempt per policy among retries and variants.

Attempt numbers are counted per protocol variant, so a group takes its candidates from one variant, its home. In a
variant the nominal is chosen first, then each action: among complete attempts that comply, the lowest attempt
number (ties: rollout id); else the lowest complete attempt; else none. An intervention executed against another
nominal than the chosen one does not comply. Home is the variant with a nominal in which most policies comply, then
most have an attempt, then the first name. What home lacks altogether is taken from other variants, and
``BD-GRP-007`` tells. No outcome is read.
Source: definitions (canonical selection); spec/07-rules.md#canonical-choice.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    roles = view.role("nominal") | view.role("intervention")
    candidate = np.flatnonzero(view.complete & roles & (view.policy >= 0)).tolist()
    attempt, names = view.rollouts["attempt"], view.rollout_ids
    order = sorted(candidate, key=lambda i: (not compliant[i], attempt[i], names[i]))
    codes, texts = view.rollouts.categories("protocol_variant")
    variants = sorted(set(texts))
    variant = np.array([*(variants.index(text) for text in texts), -1], np.int64)[codes]
    if len(variants) < 2:
        return _choose(view, compliant, order, view.group, np.ones(len(codes), bool))
    pair = view.group * len(variants) + variant
    there, dense = np.unique(pair, return_inverse=True)
    alone = _choose(view, compliant, order, dense, np.ones(len(codes), bool))
    chosen, nominal = alone.chosen, alone.nominal
    complies = (chosen >= 0) & compliant[chosen] & (view.nominal[chosen] == nominal[:, None])
    group_of, variant_of = np.divmod(there, len(variants))
    best = np.lexsort(
        (variant_of, -(chosen >= 0).sum(axis=1), -complies.sum(axis=1), nominal < 0, group_of)
    )  # by the last key first
    home = np.full(len(view.group_ids), -1, np.int64)
    groups, first = np.unique(group_of[best], return_index=True)
    home[groups] = variant_of[best][first]
    at_home = variant == home[view.group]
    return _choose(view, compliant, sorted(order, key=lambda i: not at_home[i]), view.group, at_home)


def _choose(
    view: ShardView,
    compliant: NDArray[np.bool_],
    order: Sequence[int],
    group: NDArray[np.int64],
    at_home: NDArray[np.bool_],
) -> Selection:
    """Choice among the attempts `order`, most wanted first, in groups of the numbers ``group`` ``[rollouts]``."""
    nominal_policy = view.descriptor.action_bank.nominal_index
    chosen = np.full((int(group.max(initial=-1)) + 1, len(view.descriptor.action_bank.policies)), -1, np.int64)
    for i in order:
        if view.policy[i] == nominal_policy and chosen[group[i], nominal_policy] < 0:
            chosen[group[i], nominal_policy] = i
    nominal = chosen[:, nominal_policy].copy()
    complies = compliant & (view.nominal == nominal[group])
    attempt, names = view.rollouts["attempt"], view.rollout_ids
    kept: dict[tuple[int, int], tuple[bool, bool, int, str]] = {}
    for i in order:
        place = (int(group[i]), int(view.policy[i]))
        rank = (not at_home[i], not complies[i], int(attempt[i]), names[i])
        if place[1] != nominal_policy and (place not in kept or rank < kept[place]):
            kept[place] = rank
            chosen[place] = i
    return Selection(chosen, nominal)
