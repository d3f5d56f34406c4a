"""Rules on near duplicates: marked where they are left out, and none among the contexts.

Source: paper, "Evaluation Population"; spec/11-fidelity.md#split.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import place
from branchdrive.layers.view import ReleaseView
from branchdrive.model.near_duplicate import duplicate_flags, duplicates_among
from branchdrive.model.rules.inputs import context_groups
from branchdrive.quality.partition import assignment_of


@rule("BD-SPL-007")
def near_duplicates_are_marked(view: ReleaseView) -> Iterator[Check]:
    """Core-valid groups outside of training that all but repeat a context of another partition are marked."""
    groups, frames = view.frame("group_quality"), view.raw_rows
    complete = set(frames["routes"]["group_id"].tolist())
    judged = np.array(groups["core_valid"], bool)
    if not set(groups["group_id"][judged].tolist()) <= complete & assignment_of(groups).keys():
        judged &= np.array([g in complete and g in assignment_of(groups) for g in groups["group_id"].tolist()])
    expected, doubtful = duplicate_flags(
        {**groups, "core_valid": judged}, frames["state"], frames["past_controls"], assignment_of(groups)
    )
    bad = np.flatnonzero((expected != np.asarray(groups["near_duplicate"], bool)) & ~doubtful)
    labels = {True: "a near duplicate", False: "no near duplicate"}

    def mismatch(row: int) -> Mismatch:
        where = place(view, "group_quality", groups, row, "near_duplicate")
        return Mismatch(where, labels[bool(expected[row])], labels[not expected[row]])

    yield Check(len(expected), bad, mismatch)


@rule("BD-MOD-020")
def contexts_are_no_near_duplicates(view: ReleaseView) -> Iterator[Check]:
    """No context all but repeats one of another partition."""
    contexts, groups = view.frame("contexts"), sorted(context_groups(view))
    homes = dict(zip(contexts["group_id"].tolist(), contexts["partition"].tolist(), strict=True))
    try:
        found = duplicates_among(view.frame("state"), view.frame("past_controls"), groups, homes)
    except (ValueError, DatasetError) as error:
        raise PreconditionError(f"contexts cannot be compared: {error}") from error
    row_of = {group: row for row, group in enumerate(contexts["group_id"].tolist())}
    wanted = f"a distance of at least {found.threshold:.3g} to other partitions"
    yield Check.of(
        found.num_examined,
        [
            Mismatch(
                place(view, "contexts", contexts, int(row_of[groups[row]])),
                wanted,
                f"{found.nearest.distance[row]:.3g} to {groups[int(found.nearest.row[row])]}",
            )
            for row in np.flatnonzero(found.flagged & ~found.doubtful).tolist()
        ],
    )
