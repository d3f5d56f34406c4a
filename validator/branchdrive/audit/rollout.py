"""Checks of one rollout at a time, for collectors: does it comply, before twelve replays are spent on it?

The same rules as for datasets, on a shard that holds only the rollout and its nominal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from branchdrive.audit.check import ROLLOUT_RULES, SHARD_RULES
from branchdrive.audit.examine import examine
from branchdrive.audit.finding import Finding
from branchdrive.audit.view import ShardView
from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.errors import BranchDriveError

if TYPE_CHECKING:
    from branchdrive.dataset.rollout import Rollout

__all__ = ["check_rollout", "check_rollout_structure"]

_NEEDS_NOMINAL = frozenset({"BD-KEY-005", "BD-CTL-010", "BD-TRG-002"})
"""Rules that cannot be judged where the nominal rollout is not at hand."""


def check_rollout_structure(
    record: Mapping[str, Any], tables: Mapping[str, pa.Table], descriptor: Descriptor
) -> list[Finding]:
    """Structure findings of one attempt; what needs other attempts is left to the validator.

    Args:
        record: The row of the rollouts table.
        tables: The streams of the attempt with their declared schemas.
        descriptor: Descriptor of the dataset that is being written.
    """
    return _findings([(record, tables)], descriptor, frozenset(SHARD_RULES) - _NEEDS_NOMINAL)


def check_rollout(rollout: Rollout, descriptor: Descriptor, *, nominal: Rollout | None = None) -> list[Finding]:
    """Everything that keeps a finished attempt from qualifying; empty if it complies.

    Args:
        rollout: The attempt, complete or not; an attempt that is not complete has one finding that says so.
        descriptor: Descriptor of its dataset.
        nominal: The nominal rollout it was executed against. Without it, comparisons with the
            nominal are left out.
    """
    attempts = [(rollout.record, rollout.tables)]
    selected = frozenset(SHARD_RULES) | frozenset(ROLLOUT_RULES)
    if nominal is not None and nominal.rollout_id != rollout.rollout_id:
        attempts.append((nominal.record, nominal.tables))
    elif rollout.record["role"] != "nominal":
        selected -= _NEEDS_NOMINAL
    own = rollout.rollout_id
    return [f for f in _findings(attempts, descriptor, selected) if f.location.get("rollout_id", own) == own]


def _findings(
    attempts: Sequence[tuple[Mapping[str, Any], Mapping[str, pa.Table]]],
    descriptor: Descriptor,
    selected: frozenset[str],
) -> list[Finding]:
    records = pa.Table.from_pylist([dict(record) for record, _ in attempts], schema=table_schema("rollouts"))
    streams = {
        name: pa.concat_tables([tables[name] for _, tables in attempts])
        for name in descriptor.tables
        if name in attempts[0][1]
    }
    examination = examine(ShardView({"rollouts": records, **streams}, descriptor), selected)
    errors = [message for tally in examination.tallies.values() for message in tally.errors]
    if errors:
        raise BranchDriveError(f"a rule failed on this rollout, which is a bug of the validator:\n{errors[0]}")
    return [finding for tally in examination.tallies.values() for finding in tally.findings]
