"""Fidelity rules: discrepancies, thresholds, validity, retention and ledger recompute.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/11-fidelity.md#pairs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.comparison import TOLERANCE, document_mismatches
from branchdrive.contract.layout import FILTERING_FILE, LEDGER_FILE
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.contract.text import percent
from branchdrive.driving.discrepancy import CORE, EXTENDED
from branchdrive.layers.compare import (
    columns_agree,
    differs,
    document_check,
    format_cell,
    frames_agree,
    place,
    rows_agree,
    text_mismatches,
)
from branchdrive.layers.view import ReleaseView
from branchdrive.quality.fidelity import (
    CRITERIA,
    Largest,
    PassingCounts,
    Validity,
    eligible_in_training,
    fitting_groups,
    largest_of,
    near_thresholds,
    one_bank,
    passing_counts,
    retention_document_of,
    threshold_document_of,
    thresholds_of,
    validity,
    with_passes,
)
from branchdrive.quality.filtering import FilterFigures, filtering_document_of, mean_share, shares_above
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses, release_mismatches
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.replay_frames import FRAMED
from branchdrive.quality.rules.split import SPLIT
from branchdrive.quality.threshold import VARIABLES, Thresholds
from branchdrive.statistics.split import split_digest
from branchdrive.tables.frame import Frame, distinct, num_rows, take

THRESHOLDS = "quality/thresholds.json"
RETENTION = "quality/retention.json"

COUNTED = ("tick_offset", "actor_count_share", "traffic_light_share")
"""Discrepancies that count, so that every machine gives the same number."""


def thresholds_digest(view: ReleaseView) -> str:
    """SHA-256 of the bytes of the stored thresholds."""
    view.document(THRESHOLDS)
    return hashlib.sha256(view.contents[THRESHOLDS]).hexdigest()


@rule("BD-FID-001")
def replays_have_a_pair(view: ReleaseView) -> Iterator[Check]:
    """One pair for every selected intervention and compliant nominal replay of an integrity-complete group."""
    yield from rows_agree(view, "pairs")


@rule("BD-FID-002")
def pairs_name_kind_and_action(view: ReleaseView) -> Iterator[Check]:
    """Group, kind and action of a pair are those of the attempt."""
    yield from columns_agree(view, "pairs", ("group_id", "kind", "action_key"))


@rule("BD-FID-003")
def core_discrepancies_recompute(view: ReleaseView) -> Iterator[Check]:
    """Largest differences of pose, speed, controls and branch tick before the branch."""
    yield from columns_agree(view, "pairs", [variable.name for variable in CORE], exact=COUNTED)


@rule("BD-FID-004")
def extended_discrepancies_recompute(view: ReleaseView) -> Iterator[Check]:
    """Differences of what surrounds the ego, and whether they can be compared."""
    masks = ("vehicle_comparable", "pedestrian_comparable", "has_pedestrian")
    yield from columns_agree(view, "pairs", (*masks, *(variable.name for variable in EXTENDED)), exact=COUNTED)


def _largest(view: ReleaseView) -> tuple[Any, ...]:
    """What thresholds are fitted on, as `Largest` has it."""
    pairs, groups = view.frame("pairs"), view.frame("group_quality")
    return (*largest_of(pairs, eligible_in_training(groups, assignment_of(groups))),)


@rule("BD-FID-005", _largest)
def thresholds_recompute(view: ReleaseView) -> Iterator[Check]:
    """The 99 % quantile, higher order statistic, over eligible training groups alone."""
    document, _ = view.document(THRESHOLDS), view.frame("pairs")
    groups = view.frame("group_quality")
    try:
        assignment = assignment_of(groups)
        fitting_groups(groups, assignment)
        digest = split_digest(assignment)
        expected = view.merged(_largest, lambda pieces: threshold_document_of([Largest(*p) for p in pieces], digest))
    except ValueError as error:
        yield document_check(THRESHOLDS, 1, [Mismatch({"pointer": "/"}, "thresholds of training groups", str(error))])
        return
    expected["split_digest"] = document["split_digest"]  # the next rule checks it
    yield document_check(THRESHOLDS, len(document["variables"]), document_mismatches(expected, document))


@rule("BD-FID-006")
def thresholds_carry_the_split(view: ReleaseView) -> Iterator[Check]:
    """The split digest of the thresholds and of the retention is that of the split."""
    digest = view.document(SPLIT)["digest"]
    for path in (THRESHOLDS, RETENTION):
        found = view.document(path)["split_digest"]
        yield document_check(path, 1, text_mismatches("/split_digest", digest, found))


@rule("BD-FID-007")
def pairs_pass_within_thresholds(view: ReleaseView) -> Iterator[Check]:
    """A pair passes exactly where every judged variable is within its threshold, exactly.

    Where the raw layer is available, what it gives instead of the stored discrepancies decides alike, unless last
    bits decide: a difference within the tolerance turns no pair around.
    """
    pairs = view.frame("pairs")
    try:
        thresholds = thresholds_of(view.document(THRESHOLDS))
        expected = with_passes(pairs, thresholds)
    except ValueError as error:
        raise PreconditionError(f"{THRESHOLDS}: {error}") from error
    rows = np.arange(num_rows(pairs))
    yield from frames_agree(view, "pairs", ("core_pass", "extended_pass"), expected, pairs, rows, rows)
    if view.raw.rows is not None:
        yield _turned_around(view, expected, thresholds)


def _turned_around(view: ReleaseView, stored: Frame, thresholds: Thresholds) -> Check:
    """Pairs whose stored discrepancies agree with raw and decide otherwise; they were examined before.

    Args:
        view: The derived layers, with the raw layer available.
        stored: Rows of `pairs` with the flags that the stored discrepancies give.
        thresholds: The stored ones.
    """
    found, pairs = view.frame("pairs"), view.aligned("pairs")
    raw, here = take(view.expected("pairs"), pairs.expected), take(found, pairs.found)
    recorded = take(stored, pairs.found)
    names = [variable.name for variable in VARIABLES]
    agree = ~np.any([differs(raw[name], here[name], exact=name in COUNTED) for name in names], axis=0)
    near, passed = near_thresholds(raw, thresholds, TOLERANCE), with_passes(raw, thresholds)
    mismatches: dict[int, Mismatch] = {}
    for criterion, num_variables in zip(CRITERIA, (len(CORE), len(VARIABLES)), strict=True):
        flag = f"{criterion}_pass"
        turned = (passed[flag] != here[flag]) & (recorded[flag] == here[flag]) & agree
        for i in np.flatnonzero(turned & ~near[:, :num_variables].any(axis=1)).tolist():
            where = place(view, "pairs", found, int(pairs.found[i]), flag)
            mismatches.setdefault(i, Mismatch(where, format_cell(passed[flag][i]), format_cell(here[flag][i])))
    return Check.of(0, mismatches.values())


def _validity(view: ReleaseView) -> tuple[Any, ...]:
    """Which groups are valid, rows as in `group_quality`, as `Validity` has it."""
    return (*validity(view.frame("group_quality"), view.frame("pairs")),)


def _validity_of_all(pieces: Sequence[tuple[Any, ...]]) -> Validity:
    parts = [Validity(*piece) for piece in pieces]
    one_bank(part.actions for part in parts)
    return Validity(np.concatenate([part.flags for part in parts]), ())


@rule("BD-FID-008", _validity)
def groups_are_valid_where_pairs_pass(view: ReleaseView) -> Iterator[Check]:
    """A group is valid exactly where it is eligible and all pairs of its bank pass."""
    groups = view.frame("group_quality")
    try:
        expected = view.merged(_validity, _validity_of_all).columns
    except ValueError as error:
        raise PreconditionError(f"quality/pairs: {error}") from error
    rows = np.arange(num_rows(groups))
    yield from frames_agree(view, "group_quality", ("core_valid", "extended_valid"), expected, groups, rows, rows)


def _passing(view: ReleaseView) -> tuple[Any, ...]:
    """Interventions that pass, of the groups that have a partition, as `PassingCounts` has it."""
    return (*passing_counts(view.frame("pairs"), [*assignment_of(view.frame("group_quality"))]),)


def _passing_of_all(pieces: Sequence[tuple[Any, ...]]) -> NDArray[np.int64]:
    parts = [PassingCounts(*piece) for piece in pieces]
    one_bank(part.actions for part in parts)
    return np.concatenate([part.values for part in parts if len(part.values)] or [parts[0].values])


@rule("BD-FID-009", _passing)
def retention_recomputes(view: ReleaseView) -> Iterator[Check]:
    """Shares and intervals of pairs and banks that pass, by partition."""
    document, _ = view.document(RETENTION), view.frame("pairs")
    homes = assignment_of(view.frame("group_quality"))
    digests = {"thresholds_digest": thresholds_digest(view), "split_digest": document["split_digest"]}
    try:
        counts = view.merged(_passing, _passing_of_all)
        expected = retention_document_of(counts, [*homes.values()], **digests, seed=int(document["seed"]))
    except ValueError as error:
        raise PreconditionError(f"quality/pairs: {error}") from error
    mismatches = document_mismatches(expected, document, tolerance=TOLERANCE)
    yield document_check(RETENTION, max(1, len(document["rows"])), mismatches)


def _figures(view: ReleaseView) -> tuple[Any, ...]:
    """Figures of groups as `FilterFigures` has them, shares of frames of training groups, and these groups."""
    pairs, groups, frames = view.frame("pairs"), view.frame("group_quality"), view.raw_rows["replay_frames"]
    assignment = assignment_of(groups)
    training = eligible_in_training(groups, assignment)
    above = shares_above(pairs, frames, training)
    figures = FilterFigures.of(pairs, frames, above, training, sorted(assignment), view.document(THRESHOLDS))
    return (*figures,), above, training


def _filtering_of_all(pieces: Sequence[tuple[Any, ...]], thresholds: Mapping[str, Any], digest: str) -> dict[str, Any]:
    figures, above, training = zip(*pieces, strict=True)
    order = np.argsort(np.array(distinct(training), object), kind="stable")
    shares = np.concatenate([shares for shares in above if len(shares)])[order]
    means = [mean_share(shares[:, i]) for i in range(len(FRAMED))]
    return filtering_document_of([FilterFigures(*part) for part in figures], means, thresholds, digest)


@rule("BD-FID-013", _figures)
def figures_beside_thresholds_recompute(view: ReleaseView) -> Iterator[Check]:
    """Shares of frames, variations, matched vehicles and counts of failing pairs, and which thresholds filter."""
    if FILTERING_FILE not in view.files:
        return
    document, _ = view.document(FILTERING_FILE), (view.raw_rows, view.frame("pairs"))
    groups = view.frame("group_quality")
    thresholds, assignment = view.document(THRESHOLDS), assignment_of(groups)
    try:
        fitting_groups(groups, assignment)
        digest = split_digest(assignment)
        expected = view.merged(_figures, lambda pieces: _filtering_of_all(pieces, thresholds, digest))
    except ValueError as error:
        raise PreconditionError(f"{FILTERING_FILE}: {error}") from error
    mismatches = document_mismatches(expected, document, tolerance=TOLERANCE)
    yield document_check(FILTERING_FILE, len(document["variables"]), mismatches)


@rule("BD-FID-010")
def ledger_records_accesses(view: ReleaseView) -> Iterator[Check]:
    """Thresholds are fixed, then validation is evaluated, then test is accessed, under the digests of the release."""
    ledger = view.document(LEDGER_FILE)
    digest = view.document(SPLIT)["digest"]
    mismatches = release_mismatches(ledger, split_digest=digest, thresholds_digest=thresholds_digest(view))
    yield document_check(LEDGER_FILE, max(1, len(ledger["entries"])), mismatches)


@rule("BD-FID-011")
def retention_reaches_its_targets(view: ReleaseView) -> Iterator[Check]:
    """Of the test partition, 98 % of the pairs and 90 % of the banks pass the core variables."""
    rows = [
        (i, row, "no share" if row["share"] is None else percent(row["share"]))
        for i, row in enumerate(view.document(RETENTION)["rows"])
        if row["criterion"] == "core" and row["partition"] == "test" and row["met"] is not None
    ]
    missed = [
        Mismatch({"pointer": f"/rows/{i}/share"}, f"at least {percent(row['target'], 0)} of {row['unit']}s", has)
        for i, row, has in rows
        if not row["met"]
    ]
    yield document_check(RETENTION, len(rows), missed)


@rule("BD-FID-012")
def test_was_accessed_once(view: ReleaseView) -> Iterator[Check]:
    """The ledger holds one access of the test partition for the release."""
    count = len(accesses(RELEASE_ACCESS, view.document(LEDGER_FILE)))
    many = Mismatch({"pointer": "/entries"}, "one test-set access", f"{count} accesses")
    yield document_check(LEDGER_FILE, 1, [many] if count > 1 else [])
