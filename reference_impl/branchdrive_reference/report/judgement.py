"""What the rules say of a shard that is read for its pictures: whom they choose, and where each group fails which.

A report of the validator keeps the first findings of the whole dataset. Rules run here on every shard anyway, to know
the attempts that stand for the candidates, so that the first finding of every group and rule is at hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.mismatch import Mask
from branchdrive.engine.examine import examine
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_failures import GroupFailures
from branchdrive.raw.shard_view import ShardView
from branchdrive_reference.report.shard_rows import ShardRows

__all__ = ["Findings", "Judgement", "judged"]

Findings = Mapping[str, Mapping[str, Sequence[Finding]]]
"""Findings by group, safe to print, and rule."""


@dataclass(frozen=True)
class Judgement:
    """Rules on a shard.

    Attributes:
        chosen: The canonical attempt of every policy of a group, -1 for none, by group.
        failed: Attempts that fail each rule that keeps them from later ones ``[rollouts]``.
        findings: Findings of its groups: those that are kept of the shard, and the first of every group and rule.
    """

    chosen: Mapping[str, Sequence[int]]
    failed: Mapping[str, Mask]
    findings: Findings = field(default_factory=dict)


def judged(rows: ShardRows, descriptor: Descriptor) -> Judgement | None:
    """Judge a shard; ``None`` where a table of it cannot be read."""
    if not rows.is_whole:
        return None
    view = ShardView(rows.tables, descriptor)
    failures = GroupFailures(view)
    with np.errstate(all="ignore"):
        tallies, examination = examine(view, failures=failures)
    found: dict[str, dict[str, list[Finding]]] = {}
    for tally in tallies.values():
        for finding in tally.findings:
            if finding.group_id is not None:
                found.setdefault(finding.group_id, {}).setdefault(finding.rule, []).append(finding)
    for (group_id, rule_id), finding in failures.first.items():
        found.setdefault(str(group_id), {}).setdefault(rule_id, [finding])
    chosen = dict(zip(map(str, view.group_ids), examination.selection.chosen.tolist(), strict=True))
    return Judgement(chosen, examination.failed, found)
