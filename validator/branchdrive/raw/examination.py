"""What the rules found out about a shard: which attempts and groups hold which rules, and who stands for an action.

Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.funnel import Funnel, GroupOutcome, funnel_of

__all__ = ["Examination"]


@dataclass
class Examination:
    """Outcome of the rules on one shard.

    Attributes:
        selection: Candidates of the groups.
        broken: Attempts that break a structure rule: what their rows say is not read ``[rollouts]``.
        complies: Complete attempts that violate no rule ``[rollouts]``.
        outcomes: How far each group gets ``[groups]``.
        failed: Attempts that fail each rule on rows or attempts ``[rollouts]``.
        failed_groups: Groups that fail each rule on groups ``[groups]``.
    """

    selection: Selection = field(default_factory=lambda: Selection(np.zeros((0, 0), np.int64), np.zeros(0, np.int64)))
    broken: Mask = field(default_factory=lambda: np.zeros(0, bool))
    complies: Mask = field(default_factory=lambda: np.zeros(0, bool))
    outcomes: list[GroupOutcome] = field(default_factory=list)
    failed: dict[str, Mask] = field(default_factory=dict)
    failed_groups: dict[str, Mask] = field(default_factory=dict)

    @property
    def complete_groups(self) -> NDArray[np.int64]:
        """Groups that are integrity-complete, ascending."""
        return np.flatnonzero([outcome.is_integrity_complete for outcome in self.outcomes]).astype(np.int64)

    @property
    def funnel(self) -> Funnel:
        """Groups that reach each stage."""
        return funnel_of(self.outcomes)
