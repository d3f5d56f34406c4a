"""In how many attempts of a shard a relation of motion is broken, in how many there is a contact, and how many lack.

One attempt is forgiven what a contact explains; that nearly all break a relation is explained by no contact. So
these counts look at every observation, whatever is recorded of contacts. Source: spec/07-rules.md#response.
"""

from __future__ import annotations

import numpy as np

from branchdrive.contract.mismatch import Mask
from branchdrive.raw.motion.contact import touches
from branchdrive.raw.motion.residual import RELATIONS
from branchdrive.raw.motion.tracks import actor_displacements
from branchdrive.raw.shard_view import ShardView

__all__ = ["broken_relations", "num_in_contact", "num_missing_attempts"]


@np.errstate(all="ignore")  # what overflows is beyond any bound
def broken_relations(view: ShardView, subjects: Mask) -> dict[str, tuple[int, int]]:
    """Attempts that break a relation, and those in which it can be compared, by the rule that judges it.

    Args:
        view: The shard.
        subjects: Attempts to count ``[rollouts]``.
    """
    found = {}
    for rule_id, relations in RELATIONS.items():
        judged = [view.cached(relation) for relation in relations]
        broken, compared = (
            subjects & view.observations.by_rollout(np.logical_or.reduce(marks)).any
            for marks in ([each.is_broken for each in judged], [each.is_compared for each in judged])
        )
        found[rule_id] = int(broken.sum()), int(compared.sum())
    if "actors" in view:
        steps = view.cached(actor_displacements)
        rows = (steps.row[steps.residual_m > steps.most_m], steps.row)
        broken, compared = (view.stream("actors").with_rows(each) & subjects for each in rows)
        found["BD-ACT-004"] = int(broken.sum()), int(compared.sum())
    return found


def num_in_contact(view: ShardView, subjects: Mask) -> tuple[int, int]:
    """Attempts with a contact, and those with evidence at all, among `subjects` ``[rollouts]``."""
    if "evidence" not in view:
        return 0, 0
    evidence = view.stream("evidence")
    there = subjects & (evidence.stop > evidence.start)
    return int((there & view.observations.by_rollout(view.cached(touches)).any).sum()), int(there.sum())


def num_missing_attempts(view: ShardView) -> int:
    """Attempts that are not recorded though a later one of the same group, role, action and variant is."""
    columns = ("group_id", "role", "action_key", "protocol_variant")
    numbers: dict[tuple[str, ...], set[int]] = {}
    for *key, number in zip(*(view.rollouts[name] for name in (*columns, "attempt")), strict=True):
        numbers.setdefault(tuple(map(str, key)), set()).add(int(number))
    return sum(max(max(known) - len(known), 0) for known in numbers.values())
