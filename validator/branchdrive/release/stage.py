"""The stages of a build, each a function from the raw scan and the layers before it to the files of its own.

Source: paper, "Release Structure" and "Collection Integrity, Replay Fidelity, and Leakage";
spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from branchdrive.canonical.record import source_counts
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.encoding import ENCODING_NAME
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import FILTERING_FILE, LEDGER_FILE, SOURCE_FILE
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import pack_arrays
from branchdrive.model.features import features_document
from branchdrive.model.near_duplicate import near_duplicate_flags
from branchdrive.model.normalisation_document import normalisation_document
from branchdrive.model.rows import action_rows, context_rows
from branchdrive.quality.fidelity import (
    retention_document,
    threshold_document,
    thresholds_of,
    with_passes,
    with_validity,
)
from branchdrive.quality.filtering import filtering_document
from branchdrive.quality.ledger import Ledger, with_round
from branchdrive.quality.partition import (
    assignment_of,
    cluster_of_groups,
    draw_partitions,
    split_document,
    with_partitions,
)
from branchdrive.quality.population import population_document
from branchdrive.quality.variants import Variant, variants_document
from branchdrive.release.built_layers import BuiltLayers
from branchdrive.release.scan import RawScan
from branchdrive.statistics.split import Calibration
from branchdrive.tables.frame import with_homes

__all__ = ["BuildOptions", "build_canonical", "build_model", "build_quality", "check_encoding"]

_SPLIT, _THRESHOLDS = "quality/split.json", "quality/thresholds.json"


@dataclass(frozen=True)
class BuildOptions:
    """What a builder decides.

    Attributes:
        seed: Seed of the split, of the intervals of retention and of the leakage audit.
        calibration: The least that a calibration partition must hold; ``None`` for no such partition.
        variants: Populations to declare beside the frozen one and `extended`.
        endings: Whether the model layer has the table `endings`.
    """

    seed: int = 0
    calibration: Calibration | None = None
    variants: Sequence[Variant] = ()
    endings: bool = False


def build_canonical(scan: RawScan, layers: BuiltLayers) -> None:
    """One record for each group and action, and what became of every attempt."""
    for name in LAYERS["canonical"].tables:
        layers.put_table(name, scan.rows[name])
    document: dict[str, Any] = {
        "spec_version": SPEC_VERSION,
        "raw_layer": scan.digest,
        "dataset_id": scan.descriptor.dataset_id,
        "dataset_version": scan.descriptor.dataset_version,
        **source_counts(layers.frames["records"], layers.frames["attempts"]),
    }
    layers.put_document(SOURCE_FILE, document)


def build_quality(scan: RawScan, layers: BuiltLayers, options: BuildOptions, ledger: Ledger | None) -> None:
    """Compliance, split, discrepancies, thresholds, then validation and test, and what is left.

    The split is drawn before any threshold is fitted, and thresholds are fixed before any other partition is
    looked at; the ledger records it.

    Args:
        scan: The raw layer.
        layers: The canonical layer.
        options: What the builder decides.
        ledger: The accesses of earlier builds, if there are any.

    Raises:
        DatasetError: There are too few groups for a split or for thresholds.
    """
    rows = scan.rows
    quality, routes = rows["group_quality"], rows["routes"]
    try:
        clusters = cluster_of_groups(routes["group_id"].tolist(), routes["town"].tolist(), routes["points"])
        assignment = draw_partitions(quality, clusters, seed=options.seed, calibration=options.calibration)
        groups = with_partitions(quality, clusters, assignment)
        split = split_document(assignment, clusters, seed=options.seed, calibration=options.calibration)
        thresholds = threshold_document(rows["pairs"], groups)
    except ValueError as error:
        less = ", or ask for fewer groups and clusters with `--calibration`" if options.calibration else ""
        raise DatasetError(f"{scan.dataset}: {error}; collect more groups, on other routes{less}") from error
    layers.put_document(_SPLIT, split)
    layers.put_document(_THRESHOLDS, thresholds)
    digests = {"split_digest": split["digest"], "thresholds_digest": layers.digest(_THRESHOLDS)}
    layers.put_document(LEDGER_FILE, with_round(ledger, **digests))

    pairs = with_passes(rows["pairs"], thresholds_of(thresholds))
    groups = with_validity(groups, pairs)
    groups["near_duplicate"] = near_duplicate_flags(groups, rows["state"], rows["past_controls"], assignment)
    layers.put_table("attempt_quality", rows["attempt_quality"])
    layers.put_table("pairs", pairs)
    layers.put_table("group_quality", groups)
    # From the tables as they are stored, as a validator recomputes it.
    pairs, groups = layers.frames["pairs"], layers.frames["group_quality"]
    layers.put_document("quality/retention.json", retention_document(pairs, groups, seed=options.seed, **digests))
    filtering = filtering_document(pairs, groups, rows["replay_frames"], thresholds)
    layers.put_document(FILTERING_FILE, filtering)
    num_policies = len(scan.descriptor.action_bank.policies)
    layers.put_document("quality/population.json", population_document(groups, num_policies=num_policies))
    layers.put_document("quality/variants.json", variants_document(groups, options.variants))


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


def build_model(scan: RawScan, layers: BuiltLayers, options: BuildOptions) -> None:
    """Inputs and targets of the frozen population.

    Args:
        scan: The raw layer.
        layers: The layers before it.
        options: What the builder decides.

    Raises:
        DatasetError: The frozen population has no training group, or the bank has an encoding of its own.
    """
    descriptor: Descriptor = scan.descriptor
    check_encoding(scan)
    contexts = context_rows(layers.frames["group_quality"], layers.frames["records"])
    groups = contexts["group_id"].tolist()
    homes = dict(zip(groups, contexts["partition"].tolist(), strict=True))
    assignment = assignment_of(layers.frames["group_quality"])
    layers.put_table("contexts", contexts)
    layers.put_table("actions", action_rows(descriptor.action_bank, encoded=descriptor.action_encoding is not None))
    for name, table in LAYERS["model"].tables.items():
        if table.optional and not options.endings:
            layers.drop_table(name)
        elif name not in ("contexts", "actions"):
            layers.put_table(name, with_homes(scan.rows[name], homes))
    layers.put_document("model/features.json", features_document(descriptor))
    arrays = pack_arrays(layers.frames, groups, descriptor.action_bank.keys)
    try:
        document = normalisation_document(arrays, assignment)
    except ValueError as error:
        raise DatasetError(f"{scan.dataset}: {error}; collect more groups") from error
    layers.put_document("model/normalisation.json", document)
