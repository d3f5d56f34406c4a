"""Record of the metamorphic steps of a leakage audit. Source: spec/13-leakage.md#metamorphic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["MAX_NAMED", "metamorphic_document"]

MAX_NAMED = 100
"""Changed groups that are named, of each step."""


def metamorphic_document(changed: Mapping[str, Sequence[str]], num_groups: int) -> dict[str, Any]:
    """How many groups each step was taken on, how many changed, and the first of them, by step.

    Args:
        changed: Groups whose inputs a step changed, sorted, by step.
        num_groups: Groups on which every step was taken.
    """
    return {
        step: {"num_groups": num_groups, "num_changed": len(groups), "changed": list(groups[:MAX_NAMED])}
        for step, groups in changed.items()
    }
