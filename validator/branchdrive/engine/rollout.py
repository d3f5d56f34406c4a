"""Checks of one rollout at a time, for collectors: does it comply, before twelve replays are spent on it?

The same rules as for datasets, on a shard that holds only the rollout and its nominal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.engine.examine import examine
from branchdrive.engine.finding import Finding
from branchdrive.errors import BranchDriveError
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard_view import ShardView

if TYPE_CHECKING:
    from branchdrive.raw.rollout import Rollout

__all__ = ["check_rollout", "check_rollout_structure"]

_CONTEXT_RULES = tuple(
    rule_id for rule_id in rules_of("group") if rule_id.startswith("BD-GRP-") and CATALOGUE[rule_id].stage
)
"""Rules on what an intervention shares with its nominal."""

_NEEDS_NOMINAL = frozenset({"BD-KEY-005", "BD-CTL-010", "BD-CTL-016", "BD-TRG-002", "BD-GRP-006"})
"""Rules that cannot be judged where the nominal rollout is not available."""


def check_rollout_structure(
    record: Mapping[str, Any], tables: Mapping[str, pa.Table], descriptor: Descriptor
) -> list[Finding]:
    """Structure findings of one attempt; what needs other attempts is left to the validator.

    Args:
        record: The row of the rollouts table.
        tables: The streams of the attempt with their declared schemas.
        descriptor: Descriptor of the dataset that is being written.
    """
    return _findings(_view([(record, tables)], descriptor), frozenset(rules_of("rows")) - _NEEDS_NOMINAL)


def check_rollout(
    rollout: Rollout, descriptor: Descriptor, *, nominal: Rollout | None = None, town_map: pa.Table | None = None
) -> list[Finding]:
    """All findings on one attempt that bear on qualifying, and recommendations; empty if it complies with every rule.

    A finding with `is_recommendation` costs neither the group nor the dataset: go on with the rollout.

    What depends on the rest of its group (the complete bank, repeated keys) is left to the validator.

    Args:
        rollout: The attempt, complete or not; an attempt that is not complete has one finding that says so.
        descriptor: Descriptor of its dataset.
        nominal: The nominal rollout it was executed against. Without it, comparisons with the
            nominal (commands, route, seed, branch and so on) are left out.
        town_map: Rows of the table ``map`` of its town; without them comparisons with the map are left out.
    """
    attempts = [(rollout.record, rollout.tables)]
    selected = frozenset(rules_of("rows", "rollout"))
    is_compared = nominal is not None and nominal.rollout_id != rollout.rollout_id
    if nominal is not None and is_compared:
        attempts.append((nominal.record, nominal.tables))
    elif rollout.record["role"] != "nominal":
        selected -= _NEEDS_NOMINAL
    view = _view(attempts, descriptor, town_map)
    own = rollout.rollout_id
    findings = [f for f in _findings(view, selected) if f.location.get("rollout_id", own) == own]
    if is_compared and rollout.record["role"] == "intervention" and len(view.group_ids) == 1:
        findings += _context_findings(view)
    return findings


def _context_findings(view: ShardView) -> list[Finding]:
    """Where an intervention, the first attempt of `view`, departs from the context of its nominal, the second."""
    pair = Selection(chosen=np.array([[1, 0]]), nominal=np.array([1]))
    checks = ((rule_id, check) for rule_id in _CONTEXT_RULES for check in RULES[rule_id](view, pair, np.array([True])))
    return [Finding.of(rule_id, check.mismatch(0)) for rule_id, check in checks if len(check.bad)]


def _view(
    attempts: Sequence[tuple[Mapping[str, Any], Mapping[str, pa.Table]]],
    descriptor: Descriptor,
    town_map: pa.Table | None = None,
) -> ShardView:
    records = pa.Table.from_pylist([dict(record) for record, _ in attempts], schema=table_schema("rollouts"))
    streams = {
        name: pa.concat_tables([tables[name] for _, tables in attempts])
        for name in descriptor.tables
        if name in attempts[0][1]
    }
    maps = {} if town_map is None else {MAP: town_map}
    return ShardView({ROLLOUTS: records, **streams, **maps}, descriptor)


def _findings(view: ShardView, selected: frozenset[str]) -> list[Finding]:
    tallies, _ = examine(view, selected)
    errors = [message for tally in tallies.values() for message in tally.errors]
    if errors:
        raise BranchDriveError(f"a rule failed on this rollout, which is a bug of the validator:\n{errors[0]}")
    return [finding for tally in tallies.values() for finding in tally.findings]
