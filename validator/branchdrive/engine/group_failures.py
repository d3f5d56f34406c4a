"""What the rules of a shard find in each of its groups: how many attempts fail which, and what was found there first.

Findings of a rule are capped over the whole dataset; what tells a group why it does not qualify is kept beside them,
one finding for each group and rule, so that the reason of a group does not depend on how many others fail.
Source: spec/07-rules.md#report.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Mask, Mismatch, Stretch
from branchdrive.contract.text import printable
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_result import FirstFindings, detail_of, hint_of
from branchdrive.engine.relation import Failed, Roots, roots_of_attempts
from branchdrive.raw.funnel import GroupOutcome
from branchdrive.raw.shard_view import ShardView

__all__ = ["MAX_KEPT", "GroupFailures"]

MAX_KEPT = 1024
"""Groups of a shard of which the first finding of a rule is kept: memory is bounded whatever a shard holds."""


class GroupFailures:
    """Failures of the rules of a shard by group.

    Args:
        view: The shard.
    """

    def __init__(self, view: ShardView) -> None:
        self._view = view
        self._group, self._ids = view.group, [printable(name[:128]) for name in map(str, view.group_ids)]
        self._attempts: dict[str, Failed] = {}
        self._groups: dict[str, Mask] = {}
        self._first: dict[tuple[str | None, str], Finding] = {}

    @property
    def first(self) -> FirstFindings:
        """The first finding of each group, safe to print, and rule, as far as it is kept."""
        return MappingProxyType(self._first)

    def note_attempts(self, rule_id: str, failed: Mask, stretches: Sequence[Stretch] = ()) -> None:
        """Attempts fail a rule ``[rollouts]``, in rows of some ticks, as far as these are known."""
        if failed.any():
            self._attempts[rule_id] = Failed(failed, stretches)

    def note_groups(self, rule_id: str, failed: Mask) -> None:
        """Groups fail a rule ``[groups]``."""
        if failed.any():
            self._groups[rule_id] = failed

    def note_first(
        self, rule_id: str, check: Check, owner: NDArray[np.intp], mismatches: Callable[[Check], Iterable[Mismatch]]
    ) -> None:
        """Keep the first finding of each group.

        Args:
            rule_id: The rule.
            check: Its check.
            owner: Attempt of each bad subject, -1 where there is none, ``[bad]``.
            mismatches: Mismatches of a check with whole locations, one for each attempt, in order.
        """
        places = np.flatnonzero(owner >= 0)
        groups, first = np.unique(self._group[owner[places]], return_index=True)
        order = np.argsort(first)[:MAX_KEPT]
        # All bad rows of the first attempt of each group, so that the finding counts them.
        chosen = np.isin(owner, owner[places[first[order]]])
        found = mismatches(replace(check, bad=check.bad[chosen]))
        for group, mismatch in zip(groups[order].tolist(), found, strict=False):
            self._first.setdefault((self._ids[group], rule_id), Finding.of(rule_id, mismatch))

    def note_first_of_groups(
        self, rule_id: str, check: Check, mismatches: Callable[[Check], Iterable[Mismatch]]
    ) -> None:
        """Keep the finding of each group of a rule on groups."""
        kept = replace(check, bad=check.bad[:MAX_KEPT])
        for group, mismatch in zip(kept.bad.tolist(), mismatches(kept), strict=False):
            self._first.setdefault((self._ids[group], rule_id), Finding.of(rule_id, mismatch))

    def added_to(self, outcomes: Iterable[GroupOutcome], roots: Sequence[Roots]) -> list[GroupOutcome]:
        """The outcomes of the groups of the shard, in order, with all that each fails and what was found there.

        Args:
            outcomes: The outcomes.
            roots: Of each attempt, which of the rules that it fails others may explain, see `roots`.
        """
        num = len(self._ids)
        counts_of = {
            rule: np.bincount(self._group[failed.attempts], minlength=num) for rule, failed in self._attempts.items()
        }
        explained: list[Counter[tuple[str, tuple[str, ...]]]] = [Counter() for _ in self._ids]
        for group, found in zip(self._group.tolist(), roots, strict=True):
            explained[group].update(found.items())
        table_of: dict[str, str] = {}  # of a group beyond `MAX_KEPT` that of the last which is kept
        same: dict[object, Any] = {}  # most groups fail the same
        result = []
        for group, outcome in enumerate(outcomes):
            failed = [(rule, int(counts[group])) for rule, counts in counts_of.items() if counts[group]]
            failed += [(rule, 0) for rule, mask in self._groups.items() if mask[group]]
            follows = tuple((rule, causes, number) for (rule, causes), number in sorted(explained[group].items()))
            for rule, _ in failed:
                if first := self._first.get((self._ids[group], rule)):
                    table_of[rule] = str(first.location.get("table", ""))
            tables = tuple((rule, table_of[rule]) for rule, _ in failed if table_of.get(rule))
            detail = hint = ""
            if outcome.rules and outcome.is_branched:
                detail, hint = detail_of(outcome, self._first), hint_of(self._ids[group], self._first)
            parts = {
                "failed": tuple(failed), "follows": follows, "tables": tables, "detail": detail, "hint": hint,
            }  # fmt: skip
            result.append(replace(outcome, **{name: same.setdefault(part, part) for name, part in parts.items()}))
        return result

    def roots(self) -> list[Roots]:
        """Of each attempt, which of the rules that it fails others may explain."""
        return roots_of_attempts(self._view, self._attempts, self._groups)
