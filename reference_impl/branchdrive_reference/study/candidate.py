"""Candidates of every branch group: one good attempt per policy. A bank with one of every policy is a good bank.

Good is an attempt that is complete, holds every canonical window and intervenes exactly as long as
its policy says. Of several the lowest attempt number counts, ties by rollout id; the nominal is
chosen first, and an intervention must name it and share its branch tick. No outcome is read, and no
command is compared: that is the validator's work.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.study.window import active_as_declared, windows_are_whole

__all__ = ["choose_candidates", "good_attempts", "have_complete_attempts"]

Index = NDArray[np.int64]


def good_attempts(view: ShardView) -> NDArray[np.bool_]:
    """Attempts of any role that can stand for their policy, ``[rollouts]``."""
    return view.complete & windows_are_whole(view) & active_as_declared(view)


def choose_candidates(view: ShardView, good: NDArray[np.bool_]) -> Index:
    """Chosen attempt of every group and policy ``[groups, policies]``, index into the rollouts; -1 if none."""
    bank = view.descriptor.action_bank
    nominal_policy = bank.nominal_index
    chosen = np.full((len(view.group_ids), len(bank.policies)), -1, np.int64)
    attempt, names = view.rollouts["attempt"], view.rollout_ids
    is_nominal, is_intervention = _candidates_by_role(view)
    for role in (is_nominal, is_intervention):
        for i in sorted(np.flatnonzero(good & role), key=lambda i: (attempt[i], names[i])):
            group, policy = view.group[i], view.policy[i]
            nominal = chosen[group, nominal_policy]
            belongs = is_nominal[i] or (
                nominal >= 0 and view.nominal[i] == nominal and view.branch_tick[i] == view.branch_tick[nominal]
            )
            if belongs and chosen[group, policy] < 0:
                chosen[group, policy] = i
    return chosen


def have_complete_attempts(view: ShardView) -> NDArray[np.bool_]:
    """Groups with a complete attempt of every policy, good or not, ``[groups]``."""
    found = np.zeros((len(view.group_ids), len(view.descriptor.action_bank.policies)), bool)
    is_nominal, is_intervention = _candidates_by_role(view)
    rows = np.flatnonzero(view.complete & (is_nominal | is_intervention))
    found[view.group[rows], view.policy[rows]] = True
    return np.asarray(found.all(axis=1))


def _candidates_by_role(view: ShardView) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Nominals that follow the nominal policy and interventions that follow another one, each ``[rollouts]``."""
    nominal_policy = view.descriptor.action_bank.nominal_index
    is_nominal = view.role("nominal") & (view.policy == nominal_policy)
    is_intervention = view.role("intervention") & (view.policy >= 0) & (view.policy != nominal_policy)
    return is_nominal, is_intervention
