"""Rows of the model layer that follow from other tables: contexts and actions.

Source: paper, "Model Inputs and Targets" and "Release Structure"; spec/12-model.md#frozen.
"""

from __future__ import annotations

import numpy as np

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.encoding import encode_bank
from branchdrive.quality.population import frozen_groups
from branchdrive.tables.frame import Frame, Values, sort_rows, take

__all__ = [
    "action_rows", "context_rows",
]  # fmt: skip


def context_rows(groups: Frame, records: Frame) -> dict[str, Values]:
    """Rows of the table `contexts`: the frozen population.

    Args:
        groups: Rows of `group_quality`, complete.
        records: Rows of the table `records`.
    """
    chosen = sort_rows(take(groups, frozen_groups(groups)), ("group_id",))
    links = records["kind"] == "nominal_link"
    nominal = dict(zip(records["group_id"][links].tolist(), records["rollout_id"][links].tolist(), strict=True))
    return {
        "group_id": chosen["group_id"],
        "partition": np.ma.getdata(chosen["partition"]),
        "scenario_type": chosen["scenario_type"],
        "town": chosen["town"],
        "route_cluster": np.ma.getdata(chosen["route_cluster"]),
        "nominal_rollout_id": np.array([nominal.get(g) or "" for g in chosen["group_id"].tolist()], object),
        "extended_valid": np.asarray(chosen["extended_valid"], bool),
    }


def action_rows(bank: ActionBank, *, encoded: bool) -> dict[str, Values]:
    """Rows of the table `actions`, in presentation order.

    Args:
        bank: The action bank.
        encoded: Whether the descriptor declares the encoding `bd29`.
    """
    size = len(bank.policies)
    vectors = np.empty(size, object)
    matrix = encode_bank(bank).astype(np.float64) if encoded else np.zeros((size, 0))
    for row, vector in enumerate(matrix):
        vectors[row] = vector
    return {
        "action_key": np.array(bank.keys, object),
        "position": np.arange(size, dtype=np.int32),
        "family": np.array([policy.family for policy in bank.policies], object),
        "encoded": np.full(size, encoded),
        "encoding": np.ma.masked_array(vectors, np.full(size, not encoded)),
    }
