"""Documents and flags of all rows at once, of the pieces that builders and rules merge."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.model.near_duplicate import DuplicateFlags, Histories, duplicates_among, judged_flags, valid_groups
from branchdrive.quality.fidelity import (
    fitting_groups,
    largest_of,
    passing_counts,
    retention_document_of,
    threshold_document_of,
)
from branchdrive.quality.filtering import FilterFigures, filtering_document_of, mean_share, shares_above
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.replay_frames import FRAMED
from branchdrive.statistics.split import split_digest
from branchdrive.tables.frame import Frame, of_groups


def threshold_document(pairs: Frame, groups: Frame) -> dict[str, Any]:
    """The document ``thresholds.json`` of rows of `pairs` and of `group_quality` with partitions."""
    assignment = assignment_of(groups)
    fitted_on = fitting_groups(groups, assignment)
    return threshold_document_of([largest_of(pairs, fitted_on)], split_digest(assignment))


def retention_document(
    pairs: Frame, groups: Frame, *, thresholds_digest: str, split_digest: str, seed: int
) -> dict[str, Any]:
    """The document ``retention.json`` of rows with flags."""
    assignment = assignment_of(groups)
    counts = passing_counts(pairs, list(assignment)).values
    digests = {"thresholds_digest": thresholds_digest, "split_digest": split_digest}
    return retention_document_of(counts, list(assignment.values()), **digests, seed=seed)


def filtering_document(pairs: Frame, groups: Frame, frames: Frame, thresholds: Mapping[str, Any]) -> dict[str, Any]:
    """The document ``filtering.json`` of pairs and what `replay_frames.frame_columns` says of each, in any order."""
    assignment = assignment_of(groups)
    training = fitting_groups(groups, assignment)
    above = shares_above(pairs, frames, training)
    figures = FilterFigures.of(pairs, frames, above, training, sorted(assignment), thresholds)
    means = [mean_share(above[:, i]) for i in range(len(FRAMED))]
    return filtering_document_of([figures], means, thresholds, split_digest(assignment))


def duplicate_flags(groups: Frame, state: Frame, past_controls: Frame, assignment: Mapping[str, str]) -> DuplicateFlags:
    """Core-valid groups outside of training that are near duplicates across partitions, and how surely."""
    valid = valid_groups(groups, assignment)
    found = None
    if valid:
        histories = Histories.of(of_groups(state, valid), of_groups(past_controls, valid), valid)
        found = duplicates_among(histories, assignment)
    return judged_flags(groups, valid, found, assignment)
