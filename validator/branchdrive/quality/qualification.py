"""Compliance and completeness of a shard's attempts, and how far each of its groups gets.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/10-layers.md#quality.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OFFSETS,
    HISTORY_OFFSETS,
    PREDECESSOR_OFFSET,
)
from branchdrive.raw.funnel import STAGES
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import EVIDENCE_OFFSETS
from branchdrive.tables.frame import Values
from branchdrive.tables.view import StreamView

if TYPE_CHECKING:
    from branchdrive.raw.examination import Examination

__all__ = ["attempt_quality", "first_attempts", "group_quality", "nominal_replays"]

Mask = NDArray[np.bool_]

_STAGE_COLUMNS = {
    "exact_bank": "bank",
    "controls_valid": "controls",
    "integrity_complete": "integrity",
    "eligible": "eligibility",
}
"""Stage of the funnel that each flag of the table `group_quality` stands for."""


def attempt_quality(view: ShardView, examination: Examination) -> dict[str, Values]:
    """Quality of every attempt, ``[rollouts]``."""
    failed = [(rule_id, examination.failed[rule_id]) for rule_id in CATALOGUE if rule_id in examination.failed]
    failed_rules = [" ".join(rule_id for rule_id, mask in failed if mask[i]) for i in range(view.num_rollouts)]
    fails = np.array([bool(rules) for rules in failed_rules], bool)
    branched = view.branched
    windows = {
        "missing_history_controls": _missing(view, "controls", range(-CONTROL_HISTORY_TICKS, 0)),
        "missing_history_observations": _missing(view, "observations", (PREDECESSOR_OFFSET, *HISTORY_OFFSETS)),
        "missing_future_controls": _missing(view, "controls", range(ACTIVE_TICKS + 1)),
        "missing_future_observations": _missing(view, "observations", FUTURE_OFFSETS),
        "missing_evidence": _missing(view, "evidence", EVIDENCE_OFFSETS),
    }
    return {
        "rollout_id": np.array(view.rollout_ids, object),
        "group_id": view.rollouts["group_id"],
        "compliant": ~fails,
        "fails": fails,
        "failed_rules": np.ma.masked_array(np.array(failed_rules, object), ~fails),
        "has_branch": branched,
        **{name: np.ma.masked_array(count, ~branched) for name, count in windows.items()},
        **{
            f"has_{name}": _has_rows(view, table)
            for name, table in (("actors", "actors"), ("evidence", "evidence"), ("media", "frames"))
        },
    }


def _missing(view: ShardView, table: str, offsets: range | tuple[int, ...]) -> NDArray[np.int32]:
    """Rows of the window that each attempt lacks; 0 where the table is not claimed."""
    if table not in view:
        return np.zeros(view.num_rollouts, np.int32)
    stream: StreamView = view.stream(table)
    every = np.arange(view.num_rollouts)[:, None]
    absent = stream.find(every, view.branch_tick[:, None] + np.asarray(offsets)) < 0
    return np.where(view.branched, absent.sum(axis=1), 0).astype(np.int32)


def _has_rows(view: ShardView, table: str) -> Mask:
    if table not in view:
        return np.zeros(view.num_rollouts, bool)
    stream = view.stream(table)
    return np.asarray(stream.stop > stream.start)


def nominal_replays(view: ShardView, examination: Examination) -> NDArray[np.int64]:
    """Nominal replays that comply and were executed against the chosen nominal of their group."""
    own = view.nominal == examination.selection.nominal[view.group]
    return np.flatnonzero(view.role("nominal_replay") & examination.complies & own & view.complete)


def group_quality(view: ShardView, examination: Examination) -> dict[str, Values]:
    """Quality of every group ``[groups]``, as far as one shard decides the table `group_quality`."""
    stages = list(STAGES)
    reached = np.array(
        [len(stages) if s.lost_at is None else stages.index(s.lost_at) for s in examination.outcomes], np.int64
    )
    lost_rules = [" ".join(rule for rule in CATALOGUE if rule in s.rules) for s in examination.outcomes]
    lost = reached < len(stages)
    first = first_attempts(view, examination)
    replays = view.group[nominal_replays(view, examination)]
    return {
        "group_id": np.array(view.group_ids, object),
        **{column: view.rollouts[column][first] for column in ("scenario_type", "town", "route_id")},
        **{column: reached > stages.index(stage) for column, stage in _STAGE_COLUMNS.items()},
        "lost": lost,
        "lost_rules": np.ma.masked_array(np.array(lost_rules, object), ~lost),
        "num_nominal_replays": np.bincount(replays, minlength=len(view.group_ids)).astype(np.int32),
    }


def first_attempts(view: ShardView, examination: Examination) -> NDArray[np.int64]:
    """The attempt that describes each group ``[groups]``: its chosen nominal, else the one of the first identity."""
    by_id = sorted(range(view.num_rollouts), key=lambda i: view.rollout_ids[i], reverse=True)
    first = np.zeros(len(view.group_ids), np.int64)
    for i in by_id:
        first[view.group[i]] = i
    nominal = examination.selection.nominal
    return np.where(nominal >= 0, nominal, first)
