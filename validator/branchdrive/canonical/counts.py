"""The document of the canonical layer: the raw layer it comes from, and counts that add up.

Source: paper V-B (population table, note); spec/10-layers.md#source.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.tables.frame import Frame

__all__ = ["source_counts"]


def source_counts(records: Frame, attempts: Frame) -> dict[str, Any]:
    """Counts of the tables `records` and `attempts`, as the document `source.json` states them."""
    kinds = Counter(records["kind"][records["present"]].tolist())
    states, dispositions = Counter(records["state"].tolist()), Counter(attempts["disposition"].tolist())
    return {
        "num_groups": len(set(records["group_id"].tolist())),
        "num_attempts": len(attempts["rollout_id"]),
        "records": {**{k: kinds[k] for k in LAYER_TABLES["records"]["kind"].values}, "missing": states["missing"]},
        "states": {word: states[word] for word in LAYER_TABLES["records"]["state"].values},
        "dispositions": {word: dispositions[word] for word in LAYER_TABLES["attempts"]["disposition"].values},
    }
