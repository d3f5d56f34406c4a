"""The stages of a build, each from the raw layer and the layers before it to the files of its own, part by part.

Source: paper, "Release Structure" and "Collection Integrity, Replay Fidelity, and Leakage";
spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.canonical.record import sum_of_counts
from branchdrive.contract.columns import table_schema
from branchdrive.contract.encoding import ENCODING_NAME
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.contract.layout import FILTERING_FILE, LEDGER_FILE, SOURCE_FILE
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import DatasetError, UsageError
from branchdrive.model.features import features_document
from branchdrive.model.near_duplicate import judged_flags, valid_groups
from branchdrive.model.normalisation import training
from branchdrive.model.normalisation_document import scalings_document
from branchdrive.model.rows import action_rows
from branchdrive.quality.fidelity import CRITERIA, fitting_groups, retention_document_of, threshold_document_of
from branchdrive.quality.filtering import filtering_document_of
from branchdrive.quality.ledger import Ledger, with_round
from branchdrive.quality.partition import (
    assignment_of,
    cluster_of_groups,
    draw_assignment,
    split_document,
    with_assignment,
)
from branchdrive.quality.population import frozen_groups, population_document
from branchdrive.quality.variants import Variant, variants_document
from branchdrive.release.part_task import (
    CanonicalTask,
    FittedTask,
    JudgedTask,
    ModelTask,
    canonical_part,
    fitted_part,
    judged_part,
    model_part,
)
from branchdrive.release.scan import RawPart, RawScan
from branchdrive.release.stage_work import StageWork, in_parts
from branchdrive.release.whole_task import duplicates_of_all, mean_shares_of_all, scalings_of_all
from branchdrive.statistics.split import TRAINING, Calibration
from branchdrive.tables.arrow import from_arrow
from branchdrive.tables.frame import Frame, concat, num_rows

__all__ = ["BuildOptions", "build_canonical", "build_model", "build_quality", "check_encoding"]

_SPLIT, _THRESHOLDS = "quality/split.json", "quality/thresholds.json"


@dataclass(frozen=True)
class BuildOptions:
    """What a builder decides.

    Attributes:
        seed: Seed of the split, of the intervals of retention and of the leakage audit.
        calibration: The least that a calibration partition must hold; ``None`` for no such partition.
        variants: Populations to declare beside the frozen one and `extended`.
        tables: Names of the optional tables that the model layer has.
    """

    seed: int = 0
    calibration: Calibration | None = None
    variants: Sequence[Variant] = ()
    tables: frozenset[str] = frozenset()


def build_canonical(work: StageWork) -> None:
    """One record for each group and action, and what became of every attempt."""
    scan, layers = work.scan, work.layers
    written = work.run(canonical_part, [CanonicalTask(part, work.store) for part in scan.parts])
    work.put_tables("canonical", (part.files for part in written))
    document: dict[str, Any] = {
        "spec_version": SPEC_VERSION,
        "raw_layer": scan.digest,
        "dataset_id": scan.descriptor.dataset_id,
        "dataset_version": scan.descriptor.dataset_version,
        **sum_of_counts([part.counts for part in written]),
    }
    layers.put_document(SOURCE_FILE, document)


def build_quality(work: StageWork, options: BuildOptions, ledger: Ledger | None) -> None:
    """Compliance, split, discrepancies, thresholds, then validation and test, and what is left.

    The split is drawn before any threshold is fitted, and thresholds are fixed before any other partition is
    looked at; the ledger records it.

    Args:
        work: The raw layer, and the canonical one.
        options: What the builder decides.
        ledger: The accesses of earlier builds, if there are any.

    Raises:
        DatasetError: There are too few groups for a split or for thresholds.
    """
    scan, layers = work.scan, work.layers
    routes = scan.rows["routes"]
    quality = [part.rows["group_quality"] for part in scan.parts]
    numbers = np.repeat(np.arange(len(quality)), [num_rows(rows) for rows in quality])
    groups: Frame = concat(quality)
    try:
        clusters = cluster_of_groups(routes["group_id"].tolist(), routes["town"].tolist(), routes["points"])
        assignment = draw_assignment(groups, clusters, seed=options.seed, calibration=options.calibration)
        groups = with_assignment(groups, clusters, assignment)
        split = split_document(assignment, clusters, seed=options.seed, calibration=options.calibration)
        fitted_on = {*fitting_groups(groups, assignment)}
        fitting = [sorted(fitted_on.intersection(rows["group_id"].tolist())) for rows in quality]
        tasks_to_fit = [FittedTask(part, among) for part, among in zip(scan.parts, fitting, strict=True)]
        fitted = work.run(fitted_part, tasks_to_fit)
        thresholds = threshold_document_of(fitted, split["digest"])
    except ValueError as error:
        less = ", or ask for fewer groups and clusters with `--calibration`" if options.calibration else ""
        raise DatasetError(f"{scan.dataset}: {error}; collect more groups, on other routes{less}") from error
    del routes, quality
    layers.put_document(_SPLIT, split)
    layers.put_document(_THRESHOLDS, thresholds)
    digests = {"split_digest": split["digest"], "thresholds_digest": layers.digest(_THRESHOLDS)}
    layers.put_document(LEDGER_FILE, with_round(ledger, **digests))

    rows = in_parts(groups, numbers, len(scan.parts))
    tasks = [
        JudgedTask(part, work.store, own, among, thresholds)
        for part, own, among in zip(scan.parts, rows, fitting, strict=True)
    ]
    judged = work.run(judged_part, tasks)
    valid = np.concatenate([part.valid for part in judged])
    groups = {**groups, **{f"{criterion}_valid": valid[:, i] for i, criterion in enumerate(CRITERIA)}}
    groups = {**groups, "near_duplicate": _near_duplicates(work, groups, numbers, assignment)}
    for number, part in enumerate(in_parts(groups, numbers, len(scan.parts))):
        judged[number].files.update(work.store.put("group_quality", part, scan.parts[number].number))
    work.put_tables("quality", (part.files for part in judged))
    homes = [*assignment_of(groups).values()]
    counts = np.concatenate([part.counts for part in judged])
    retention = retention_document_of(counts, homes, seed=options.seed, **digests)
    layers.put_document("quality/retention.json", retention)
    figures = [part.figures for part in judged]
    means = mean_shares_of_all(work, dict(enumerate(fitting)))
    layers.put_document(FILTERING_FILE, filtering_document_of(figures, means, thresholds, split["digest"]))
    num_policies = len(scan.descriptor.action_bank.policies)
    layers.put_document("quality/population.json", population_document(groups, num_policies=num_policies))
    layers.put_document("quality/variants.json", variants_document(groups, options.variants))


def _near_duplicates(
    work: StageWork, groups: Frame, numbers: NDArray[np.int64], assignment: Mapping[str, str]
) -> NDArray[np.bool_]:
    """Near duplicates among all groups, rows of `groups`, which has the place of the part of each in `numbers`."""
    valid = valid_groups(groups, assignment)
    found = duplicates_of_all(work, _by_part(valid, groups, numbers), assignment) if valid else None
    return judged_flags(groups, valid, found, assignment).flagged


def _by_part(chosen: Iterable[str], groups: Frame, numbers: NDArray[np.int64]) -> dict[int, list[str]]:
    """Groups by the place of their part, sorted in each."""
    place_of = dict(zip(groups["group_id"].tolist(), numbers.tolist(), strict=True))
    found: dict[int, list[str]] = {}
    for group in sorted(chosen):
        found.setdefault(place_of[group], []).append(group)
    return found


def check_encoding(scan: RawScan) -> None:
    """The encoding of the bank can be computed, or there is none.

    Raises:
        DatasetError: The bank has an encoding of its own.
    """
    encoding = scan.descriptor.action_encoding
    if encoding is not None and encoding.name != ENCODING_NAME:
        raise DatasetError(
            f"{scan.dataset}: the action encoding {encoding.name!r} is the dataset's own and cannot be computed; "
            f"declare {ENCODING_NAME!r} or no encoding"
        )


def build_model(work: StageWork, options: BuildOptions) -> None:
    """Inputs and targets of the frozen population.

    Args:
        work: The raw layer, and the layers before it.
        options: What the builder decides.

    Raises:
        DatasetError: The frozen population has no training group, or the bank has an encoding of its own.
    """
    scan, layers, descriptor = work.scan, work.layers, work.scan.descriptor
    check_encoding(scan)
    actions = action_rows(descriptor.action_bank, encoded=descriptor.action_encoding is not None)
    tables = tuple(
        name for name, table in LAYERS["model"].tables.items() if name in options.tables or not table.optional
    )
    quality = [_stored_groups(work, part) for part in scan.parts]
    tasks = [
        ModelTask(part, work.store, groups, layers.files[table_path("records", part=part.number)], actions, tables)
        for part, groups in zip(scan.parts, quality, strict=True)
        if num_rows(groups)
    ]
    written = work.run(model_part, tasks)
    work.put_tables("model", [*(part.files for part in written), work.store.put_whole("actions", actions)])
    layers.put_document("model/features.json", features_document(descriptor))
    groups = concat(quality)
    assignment, frozen = assignment_of(groups), groups["group_id"][frozen_groups(groups)].tolist()
    try:
        fitted_on = training(sorted(frozen), assignment)
        numbers = np.repeat(np.arange(len(quality)), [num_rows(rows) for rows in quality])
        chosen = (group for group in frozen if assignment[group] == TRAINING)
        scalings = scalings_of_all(work, _by_part(chosen, groups, numbers), fitted_on.split_digest)
    except ValueError as error:
        raise DatasetError(f"{scan.dataset}: {error}; collect more groups") from error
    layers.put_document("model/normalisation.json", scalings_document(scalings, int(fitted_on.rows.sum())))


def _stored_groups(work: StageWork, part: RawPart) -> Frame:
    """Rows of `group_quality` of a part, as they were stored.

    Raises:
        UsageError: They are not those of the groups of this part: shards were renumbered since.
    """
    layers, wanted = work.layers, part.rows["group_quality"]["group_id"].tolist()
    found = [
        layers.files[path].rows("group_quality")
        for path in [table_path("group_quality", part=part.number)]
        if path in layers.files
    ]
    groups = concat(found) if found else from_arrow(table_schema("group_quality").empty_table(), "group_quality")
    if {*groups["group_id"].tolist()} != {*wanted}:
        raise UsageError(
            f"{work.scan.dataset}: part {part.number} of the layers holds other groups than its shards; start with the "
            "stage 'canonical'"
        )
    return groups
