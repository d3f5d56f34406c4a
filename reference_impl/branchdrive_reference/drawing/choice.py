"""Which groups of a dataset are drawn: one of each scenario type, or those that are named."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from branchdrive.contract.columns import PATTERNS
from branchdrive.dataset.reader import Dataset
from branchdrive.errors import UsageError

__all__ = ["choose_groups", "named_groups"]

_COLUMNS = ("group_id", "role", "status", "action_key", "scenario_type", "branch_tick")


def _is_whole(attempts: list[dict[str, Any]], keys: frozenset[str]) -> bool:
    """Whether a group has a branch and a complete attempt of every candidate."""
    complete = {
        attempt["action_key"]
        for attempt in attempts
        if attempt["status"] == "complete"
        and attempt["branch_tick"] is not None
        and attempt["role"] != "nominal_replay"
    }
    return keys <= complete


def choose_groups(dataset: Dataset, scenarios: Sequence[str] = ()) -> list[str]:
    """The first complete, branched group of each scenario type, in the order of the dataset.

    Args:
        dataset: Where to look; only its rollouts tables are read.
        scenarios: The types that are wanted; none for all.

    Raises:
        UsageError: The dataset lacks a wanted type, or has no complete group of it.
    """
    attempts: dict[str, list[dict[str, Any]]] = {}
    for row in dataset.rollouts().select(_COLUMNS).to_pylist():
        attempts.setdefault(row["group_id"], []).append(row)
    keys = frozenset(dataset.descriptor.action_bank.keys)
    found: dict[str, str] = {}
    present = sorted({rows[0]["scenario_type"] for rows in attempts.values()})
    for group_id in dataset.groups:
        rows = attempts[group_id]
        if rows[0]["scenario_type"] not in found and _is_whole(rows, keys):
            found[rows[0]["scenario_type"]] = group_id
    for name in scenarios:
        if name not in present:
            raise UsageError(f"no scenario type {name!r} in {dataset.root}; it has {present}")
        if name not in found:
            raise UsageError(f"{dataset.root} has no complete, branched group of scenario type {name!r}")
    if not found:
        raise UsageError(f"{dataset.root} has no complete, branched group to draw")
    return [group_id for name, group_id in found.items() if not scenarios or name in scenarios]


def named_groups(dataset: Dataset, names: Sequence[str]) -> list[str]:
    """The named groups, each once.

    Raises:
        UsageError: The dataset lacks one, or a name cannot be a file's.
    """
    for name in names:
        if name not in dataset.groups:
            raise UsageError(f"no group {name!r} among the {len(dataset.groups)} groups of {dataset.root}")
        if not re.match(PATTERNS["id"], name):
            raise UsageError(f"group {name!r} has an id that the format does not allow; no picture is named after it")
    return list(dict.fromkeys(names))
