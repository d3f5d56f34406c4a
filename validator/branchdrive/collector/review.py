"""Whether the nominal rollout of a group is worth the replays of its bank."""

from __future__ import annotations

from typing import TYPE_CHECKING

from branchdrive.collector.report import GroupReport
from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.rollout import check_rollout
from branchdrive.raw.rollout import Rollout

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["review_nominal"]


def review_nominal(
    nominal: Rollout, descriptor: Descriptor, report: GroupReport, *, unfound: str, town_map: pa.Table | None
) -> bool:
    """Note in a group's report why its nominal rollout is not worth replays, and what is recommended.

    A rule that costs the group its qualification, or the dataset its validity, refuses the rollout. A recommendation
    is a note: what it recommends may be as intended, and the validator says it again.

    Args:
        nominal: The nominal rollout, complete or not.
        descriptor: The dataset's descriptor.
        report: Report of the group.
        unfound: What is said of a complete rollout in which the trigger found no branch.
        town_map: Rows of the table ``map`` of its town; ``None`` where the dataset has no maps.

    Returns:
        Whether replays are worth spending.
    """
    if nominal.record["status"] != "complete":
        report.unbranched_because = str(nominal.record["status_reason"])
    elif nominal.branch_tick is None:
        report.unbranched_because = unfound
    else:
        findings = check_rollout(nominal, descriptor, town_map=town_map)
        refused = [finding for finding in findings if not finding.is_recommendation]
        report.refused_because = f"{refused[0].rule} {refused[0].message}" if refused else ""
        report.note = "; ".join(f"{f.rule} {f.message}" for f in findings if f.is_recommendation)
    return not (report.unbranched_because or report.refused_because)
