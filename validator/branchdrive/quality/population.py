"""Groups and trajectories at each stage, by partition: the paper's population table as a document.

Source: paper, "Research Questions and Experimental Protocol", table "Dataset qualification and frozen benchmark
population"; spec/10-layers.md#population.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.quality.partition import PARTITIONS
from branchdrive.quality.variants import FROZEN, members
from branchdrive.tables.frame import Frame, num_rows

__all__ = ["STAGES", "frozen_groups", "population_document"]

STAGES: Mapping[str, str] = MappingProxyType(
    {
        "discovered": "Discovered branch groups",
        "exact_bank": "Exact action banks",
        "controls_valid": "All-controls-valid banks",
        "integrity_complete": "Integrity-complete banks",
        "eligible": "Structurally eligible banks",
        "core_valid": "Core replay-valid",
        "extended_valid": "Extended replay-valid",
        "frozen": "Frozen population",
    }
)
"""Stages in order, with their titles."""

_FIRST_PARTITIONED = "integrity_complete"


def population_document(groups: Frame, *, num_policies: int) -> dict[str, Any]:
    """The document ``population.json``.

    Partitions exist from the stage `integrity_complete` on, trajectories from `exact_bank` on: one for
    every group and policy, which are no independent samples.

    Args:
        groups: Rows of `group_quality`.
        num_policies: Policies of the action bank.
    """
    homes = np.ma.filled(groups["partition"], "")
    present = [name for name in PARTITIONS if (homes == name).any()]
    stages, partitioned = [], False
    for stage, title in STAGES.items():
        partitioned |= stage == _FIRST_PARTITIONED
        reached = _reached(groups, stage)
        total = int(reached.sum())
        counts = {name: int((reached & (homes == name)).sum()) for name in present}
        stages.append(
            {
                "stage": stage,
                "title": title,
                "groups": counts if partitioned else None,
                "total": total,
                "trajectories": None if stage == "discovered" else total * num_policies,
            }
        )
    return {"num_policies": num_policies, "partitions": present, "stages": stages}


def frozen_groups(groups: Frame) -> NDArray[np.bool_]:
    """Whether each group belongs to the frozen population ``[groups]``: core-valid and no near duplicate."""
    return members(groups, FROZEN)


def _reached(groups: Frame, stage: str) -> NDArray[np.bool_]:
    if stage == "discovered":
        return np.ones(num_rows(groups), np.bool_)
    return frozen_groups(groups) if stage == "frozen" else np.asarray(groups[stage], np.bool_)
