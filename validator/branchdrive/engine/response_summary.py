"""What the interventions of a dataset did, action by action, for its report. Source: spec/07-rules.md#response."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.response import BEFORE_BRANCH, NO_RESPONSE, Responses
from branchdrive.files.shard_facts import ShardFacts

__all__ = ["ActionResponse", "Effect", "ResponseSummary"]

_NORMAL_975 = 1.959963984540054
"""The 97.5 % quantile of the normal law."""


@dataclass(frozen=True)
class Effect:
    """Mean over groups, with a normal 95 % interval; the interval is ``None`` for fewer than two groups."""

    mean: float
    interval: tuple[float, float] | None

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Effect:
        """Effect of at least one group."""
        mean = math.fsum(values) / len(values)
        if len(values) < 2:
            return cls(mean, None)
        spread = math.sqrt(math.fsum((values - mean) ** 2) / (len(values) - 1) / len(values))
        return cls(mean, (mean - _NORMAL_975 * spread, mean + _NORMAL_975 * spread))

    def to_json(self) -> dict[str, Any]:
        """As the report schema has it."""
        return {"mean": self.mean, "interval": None if self.interval is None else list(self.interval)}


@dataclass(frozen=True)
class ActionResponse:
    """One policy against the nominal, at ``t_b + 50``.

    Attributes:
        action_key: The policy.
        num_groups: Groups with both windows complete.
        lateral_m: Lateral effect, positive to the left.
        speed_mps: Speed effect.
        num_unchanged: Groups in which nothing differs up to ``t_b + 50``.
        num_early: Groups in which a pose or speed differs before the branch already, by a bit or more.
        first_response: Median of the first observation that differs, ``j`` for that of ``t_b + 5 j``; ``None`` where
            every attempt differs before the branch already, or none differs.
    """

    action_key: str
    num_groups: int
    lateral_m: Effect
    speed_mps: Effect
    num_unchanged: int
    num_early: int
    first_response: float | None


@dataclass(frozen=True)
class ResponseSummary:
    """Responses of all actions that have any, and columns of the observations that never change.

    Attributes:
        actions: In order of the bank.
        constant: Value of every column of numbers that has one value alone.
    """

    actions: tuple[ActionResponse, ...]
    constant: Mapping[str, float]

    @classmethod
    def of(cls, shards: Sequence[ShardFacts], keys: Sequence[str]) -> ResponseSummary:
        """Summary over shards.

        Args:
            shards: All shards.
            keys: Action keys of the bank.
        """
        every = Responses.of_all(shard.responses for shard in shards)
        actions = []
        for index, key in enumerate(keys):
            here = every.policy == index
            if here.any():
                first = every.first[here]
                seen = first[(first != BEFORE_BRANCH) & (first != NO_RESPONSE)]
                median = float(np.median(seen)) if len(seen) else None
                effects = Effect.of(every.lateral_m[here]), Effect.of(every.speed_mps[here])
                unchanged, early = (int((first == value).sum()) for value in (NO_RESPONSE, BEFORE_BRANCH))
                actions.append(ActionResponse(key, len(first), *effects, unchanged, early, median))
        names = shards[0].extremes if shards else {}
        bounds = {
            name: (
                min(shard.extremes.get(name, (math.inf,))[0] for shard in shards),
                max(shard.extremes.get(name, (-math.inf,))[-1] for shard in shards),
            )
            for name in names
        }
        constant = {name: least for name, (least, most) in bounds.items() if least == most and math.isfinite(least)}
        return cls(tuple(actions), constant)

    @property
    def num_repeating(self) -> int:
        """Interventions, 0 unless all have the poses and speeds of their nominal before the branch, to the bit."""
        is_all = not any(action.num_early for action in self.actions)
        return sum(action.num_groups for action in self.actions) if is_all else 0

    def to_json(self) -> dict[str, Any]:
        """As the report schema has it."""
        return {
            "actions": [
                {
                    "action_key": action.action_key,
                    "groups": action.num_groups,
                    "lateral_m": action.lateral_m.to_json(),
                    "speed_mps": action.speed_mps.to_json(),
                    "unchanged": action.num_unchanged,
                    "first_response": action.first_response,
                }
                for action in self.actions
            ],
            "constant": dict(self.constant),
        }
