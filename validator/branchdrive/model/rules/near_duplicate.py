"""Rules on near duplicates: marked where they are left out, and none among the contexts.

Source: paper, "Evaluation Population"; spec/11-fidelity.md#split.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import place
from branchdrive.layers.view import ReleaseView
from branchdrive.model.near_duplicate import Histories, duplicates_among, judged_flags, valid_groups
from branchdrive.model.rules.inputs import context_groups
from branchdrive.quality.partition import assignment_of
from branchdrive.tables.frame import of_groups


def _valid_histories(view: ReleaseView) -> tuple[Any, ...]:
    """What the raw layer says of the histories of the core-valid groups, as `Histories` has it.

    Raises:
        ValueError: Of a core-valid group it says nothing.
    """
    groups, frames = view.frame("group_quality"), view.raw_rows
    valid = sorted(groups["group_id"][np.array(groups["core_valid"], bool)].tolist())
    if not {*valid} <= {*frames["routes"]["group_id"].tolist()}:
        raise ValueError("a core-valid group is not integrity-complete")
    state, past_controls = (of_groups(frames[name], valid) for name in ("state", "past_controls"))
    return (*Histories.of(state, past_controls, valid),)


@rule("BD-SPL-007", _valid_histories)
def near_duplicates_are_marked(view: ReleaseView) -> Iterator[Check]:
    """Core-valid groups outside of training that all but repeat a context of another partition are marked."""
    groups, frames = view.frame("group_quality"), view.raw_rows
    complete = set(frames["routes"]["group_id"].tolist())
    assignment = assignment_of(groups)
    judged = np.array(groups["core_valid"], bool)
    if not set(groups["group_id"][judged].tolist()) <= complete & assignment.keys():
        judged &= np.array([g in complete and g in assignment for g in groups["group_id"].tolist()])
    valid = valid_groups({**groups, "core_valid": judged}, assignment)
    found = duplicates_among(_histories(view, valid), assignment) if valid else None
    expected, doubtful = judged_flags(groups, valid, found, assignment)
    bad = np.flatnonzero((expected != np.asarray(groups["near_duplicate"], bool)) & ~doubtful)
    labels = {True: "a near duplicate", False: "no near duplicate"}

    def mismatch(row: int) -> Mismatch:
        where = place(view, "group_quality", groups, row, "near_duplicate")
        return Mismatch(where, labels[bool(expected[row])], labels[not expected[row]])

    yield Check(len(expected), bad, mismatch)


def _histories(view: ReleaseView, valid: list[str]) -> Histories:
    """What the raw layer says of the histories of some groups, sorted: all core-valid ones, or fewer."""
    with suppress(ValueError):  # two parts have a group, so that all rows say more
        joined = Histories.joined([Histories(*piece) for piece in view.pieces_of(_valid_histories) or ()])
        if joined.groups == valid:
            return joined
    state, past_controls = (of_groups(view.raw_rows[name], valid) for name in ("state", "past_controls"))
    return Histories.of(state, past_controls, valid)


def _context_histories(view: ReleaseView) -> tuple[Any, ...]:
    """Histories of the contexts, as `Histories` has it."""
    groups = sorted(context_groups(view))
    return (*Histories.of(view.frame("state"), view.frame("past_controls"), groups),)


@rule("BD-MOD-020", _context_histories)
def contexts_are_no_near_duplicates(view: ReleaseView) -> Iterator[Check]:
    """No context all but repeats one of another partition."""
    contexts = view.frame("contexts")
    homes = dict(zip(contexts["group_id"].tolist(), contexts["partition"].tolist(), strict=True))
    try:
        histories = view.merged(
            _context_histories, lambda pieces: Histories.joined([Histories(*piece) for piece in pieces])
        )
        found = duplicates_among(histories, homes)
    except (ValueError, DatasetError) as error:
        raise PreconditionError(f"contexts cannot be compared: {error}") from error
    groups = histories.groups
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
