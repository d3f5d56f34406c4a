"""Which groups of a dataset are drawn: one of each scenario type, all of them, or those that are named."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

import pyarrow as pa

from branchdrive.contract.text import similar
from branchdrive.errors import UsageError
from branchdrive.raw.reader import Dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive_reference.study.label import label, labels

__all__ = ["named_groups", "wanted_groups"]

_COLUMNS = ("group_id", "role", "scenario_type")


def wanted_groups(dataset: Dataset, scenarios: Sequence[str] = ()) -> dict[str, str]:
    """Scenario type of every group of the wanted types, drawable or not, in the order of the dataset.

    Args:
        dataset: Where to look; only its rollouts tables are read, one shard after the other.
        scenarios: The types that are wanted; none for all.

    Raises:
        UsageError: The dataset has no group or lacks a wanted type, or its text cannot be unpacked safely.
        DatasetError: A table cannot be read.
    """
    types: dict[str, str] = {}
    names: dict[str, str] = {}  # one object for each name, however many groups have it
    for shard in dataset.shards:
        for group_id, name in _types(shard.decode(ROLLOUTS).select(_COLUMNS)).items():
            types[group_id] = names.setdefault(name, name)
    if not types:
        raise UsageError(f"{str(dataset.store)!r} has no branch group to draw")
    present = sorted(set(types.values()))
    for name in scenarios:
        if name not in present:
            raise UsageError(_unknown_type(name, present))
    return {group_id: name for group_id, name in types.items() if not scenarios or name in scenarios}


def _types(rollouts: pa.Table) -> dict[str, str]:
    """Scenario type of each group: that of its first nominal, else that of its first attempt."""
    types: dict[str, str] = {}
    nominals: dict[str, str] = {}
    for row in rollouts.to_pylist():
        types.setdefault(row["group_id"], row["scenario_type"])
        if row["role"] == "nominal":
            nominals.setdefault(row["group_id"], row["scenario_type"])
    return types | nominals


def _unknown_type(name: str, present: Sequence[str]) -> str:
    """What is said of a scenario type that the dataset lacks."""
    by_folded = {other.casefold(): other for other in present}
    similar = get_close_matches(name.casefold(), by_folded, n=1)
    hint = f"did you mean {label(by_folded[similar[0]])}? " if similar else ""
    return f"unknown scenario type '{label(name)}'; {hint}choose from {labels(present)}"


def named_groups(dataset: Dataset, names: Sequence[str]) -> list[str]:
    """The named groups, each once.

    Raises:
        UsageError: The dataset lacks one, or its text cannot be unpacked safely.
    """
    present = wanted_groups(dataset)
    for name in names:
        if name not in present:
            near = [label(each) for each in similar(name, present)]
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise UsageError(
                f"no group '{label(name)}' among the {len(present):,} groups of {str(dataset.store)!r}{hint}"
            )
    return list(dict.fromkeys(names))
