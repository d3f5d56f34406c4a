"""Canonical records of a shard, and what became of each of its attempts.

Source: paper, "Release Structure" (canonical manifest layer); spec/10-layers.md#canonical.

The document of the canonical layer: the raw layer it comes from, and counts that add up.

Source: paper, "Research Questions and Experimental Protocol" (population table, note); spec/10-layers.md#source.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.frame import Values

if TYPE_CHECKING:
    from branchdrive.raw.examination import Examination
from collections import Counter
from collections.abc import Mapping, Sequence

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.tables.frame import Frame

__all__ = ["attempts", "policy_columns", "records", "source_counts", "sum_of_counts"]

_COPIED = (
    "attempt", "protocol_variant", "scenario_type", "town", "route_id", "seed", "repetition", "provenance",
)  # fmt: skip
"""Columns of a record that are those of its attempt."""


def policy_columns(bank: ActionBank) -> dict[str, NDArray[Any]]:
    """Control semantics of every policy ``[policies]``, by column of the records."""
    policies = bank.policies
    return {
        "action_key": np.array([policy.key for policy in policies], object),
        "family": np.array([policy.family for policy in policies], object),
        "magnitude": np.array([policy.magnitude for policy in policies], np.float64),
        "duration_ticks": np.array([policy.duration_ticks for policy in policies], np.int32),
        **{
            f"{actuator}_rule": np.array([getattr(policy, actuator).rule for policy in policies], object)
            for actuator in ("steer", "throttle", "brake")
        },
        "recovery": np.array([policy.recovery for policy in policies], object),
    }


def records(view: ShardView, examination: Examination) -> dict[str, Values]:
    """One record per group and policy, ``[groups * policies]``."""
    selection, bank = examination.selection, view.descriptor.action_bank
    num_groups, num_policies = selection.chosen.shape
    chosen = selection.chosen.ravel()
    there = chosen >= 0
    at = np.where(there, chosen, 0)
    is_nominal = np.tile(np.arange(num_policies) == bank.nominal_index, num_groups)
    branched = there & view.branched[at]
    state = np.where(
        there, np.where(examination.complies[at] & _own_nominal(view, examination), "selected", "ineligible"), "missing"
    )
    ids = np.array([*view.rollout_ids, ""], object)
    rollouts = view.rollouts

    def copied(column: str, present: NDArray[np.bool_]) -> Values:
        return np.ma.masked_array(rollouts[column][at], ~present)

    nominal = view.nominal[at]
    return {
        "group_id": np.repeat(np.array(view.group_ids, object), num_policies),
        **{name: np.tile(values, num_groups) for name, values in policy_columns(bank).items()},
        "kind": np.where(is_nominal, "nominal_link", "physical").astype(object),
        "state": state.astype(object),
        "present": there,
        "rollout_id": np.ma.masked_array(ids[at], ~there),
        "nominal_rollout_id": np.ma.masked_array(ids[nominal], ~there),
        **{column: copied(column, there) for column in _COPIED},
        "branched": branched,
        **{column: copied(column, branched) for column in ("branch_tick", "branch_frame")},
        "shard": np.ma.masked_array(np.full(len(at), view.file_prefix, object), ~there),
    }


def _own_nominal(view: ShardView, examination: Examination) -> NDArray[np.bool_]:
    """Chosen attempts that were executed against the nominal that was chosen, ``[groups * policies]``."""
    selection = examination.selection
    used = np.where(selection.chosen >= 0, view.nominal[selection.chosen], -1)
    return np.asarray(used == selection.nominal[:, None]).ravel()


def attempts(view: ShardView, examination: Examination) -> dict[str, Values]:
    """What became of every attempt, ``[rollouts]``."""
    selection, rollouts = examination.selection, view.rollouts
    chosen = np.zeros(view.num_rollouts, bool)
    chosen[selection.chosen[selection.chosen >= 0]] = True
    own = view.nominal == selection.nominal[view.group]
    complies = examination.complies
    disposition = np.select(
        [
            ~view.complete,
            view.role("nominal_replay"),
            view.policy < 0,
            chosen & complies & own,
            chosen,
            ~complies,
            ~own & ~view.role("nominal"),
        ],
        [rollouts["status"], "replay", "outside_bank", "selected", "kept", "noncompliant", "foreign_nominal"],
        "superseded",
    )
    return {
        "rollout_id": np.array(view.rollout_ids, object),
        **{
            column: rollouts[column]
            for column in ("group_id", "role", "action_key", "attempt", "protocol_variant", "status")
        },
        "disposition": disposition.astype(object),
    }


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


def sum_of_counts(counts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts of tables whose rows are those of several, no two of which have rows of one group; exact integers."""
    return {
        name: sum_of_counts([part[name] for part in counts])
        if isinstance(value, Mapping)
        else sum(part[name] for part in counts)
        for name, value in counts[0].items()
    }
