"""Layers of the synthetic release, built once, and what follows from them computed again after an edit.

A lie in a table or a document is a single defect only where all that honestly follows from it says the same;
`reseal` makes it so, with the functions of the builder.
"""

from __future__ import annotations

import hashlib
import pickle
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from tests import synthetic, synthetic_release
from tests.content_cache import kept, remembered
from tests.synthetic_release import RELEASE_SHARDS, SEED
from tests.validator.engine.rules.draft import Draft
from tests.validator.quality.whole import duplicate_flags, filtering_document, retention_document, threshold_document

from branchdrive.canonical.record import source_counts
from branchdrive.card.card import release_card
from branchdrive.card.licence import render_licence
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.layer import LAYERS, table_path, table_paths
from branchdrive.contract.layout import CARD_FILE, FILTERING_FILE, LEAKAGE_FILE, LICENCE_FILE
from branchdrive.contract.layout import LEDGER_FILE as LEDGER
from branchdrive.contract.layout import SOURCE_FILE as SOURCE
from branchdrive.engine.spool import Spool
from branchdrive.formats.folder import Folder
from branchdrive.leakage.classifier import Unavailable
from branchdrive.model.objects import OBJECTS
from branchdrive.quality.fidelity import (
    thresholds_of,
    with_passes,
    with_validity,
)
from branchdrive.quality.ledger import with_round
from branchdrive.quality.partition import assignment_of, calibration_of, clusters_of, split_document
from branchdrive.quality.population import population_document
from branchdrive.quality.variants import declared_of, variants_document
from branchdrive.release.built_layers import BuiltLayers, TableStore
from branchdrive.release.leakage import build_leakage
from branchdrive.release.scan import RawPart, RawScan, scan_raw
from branchdrive.release.stage import BuildOptions, build_canonical, build_model, build_quality
from branchdrive.release.stage_work import StageWork
from branchdrive.runtime.executor import in_process
from branchdrive.tables.arrow import from_arrow, to_arrow
from branchdrive.tables.frame import Frame, sort_rows, with_homes

__all__ = [
    "BUILT", "LEAKAGE", "LEDGER", "POPULATION", "RETENTION", "SOURCE", "SPLIT", "STEPS", "THRESHOLDS", "VARIANTS",
    "ReleaseDraft", "detached_draft", "release_draft",
]  # fmt: skip

SPLIT, THRESHOLDS, RETENTION, POPULATION, VARIANTS = (
    f"quality/{name}.json" for name in ("split", "thresholds", "retention", "population", "variants")
)
LEAKAGE = LEAKAGE_FILE

ENDINGS = "endings"

BUILT = ("canonical", "quality", "model")
"""Layers that the builder makes."""


@dataclass
class Built:
    """The raw layer and the layers that follow from it."""

    scan: RawScan
    rows: dict[str, Frame]
    documents: dict[str, Any]
    tables: dict[str, synthetic.Tables] = field(default_factory=dict)


@cache
def built() -> Built:
    """Layers of the synthetic release; shared by all callers, so never changed in place."""
    made = kept("release", _made)
    synthetic.shared(made.tables)
    return made


def _made() -> Built:
    with tempfile.TemporaryDirectory() as folder:
        raw = Draft(synthetic_release.raw_tables(), synthetic_release.raw_descriptor()).write(Path(folder) / "raw")
        with _work_on(scan_raw(Folder(raw), Spool(Path(folder)), in_process, optional=(ENDINGS, OBJECTS))) as work:
            options = BuildOptions(seed=SEED)
            _build(work, options)
            nobody = Unavailable("the tests train no network")
            build_leakage(work, Path(folder), seed=SEED, classifier=nobody)
            build_model(work, options)
            return Built(work.scan, dict(work.scan.rows), work.layers.documents, _arrow(work.layers))


@contextmanager
def _work_on(scan: RawScan) -> Iterator[StageWork]:
    """Stages of a build of no layer yet, whose tables are gone when the block is left."""
    with tempfile.TemporaryDirectory() as folder:
        yield StageWork(
            scan, BuiltLayers(), TableStore(Folder(Path(folder)), scan.descriptor.action_bank.keys), in_process
        )


def _build(work: StageWork, options: BuildOptions) -> None:
    """Canonical and quality layer, but for figures beside the thresholds; see `ReleaseDraft.add_filtering`."""
    build_canonical(work)
    build_quality(work, options, None)
    work.layers.drop(FILTERING_FILE)


def _arrow(layers: BuiltLayers) -> dict[str, synthetic.Tables]:
    there = {name: [table for table in LAYERS[name].tables if table_paths(table, layers.files)] for name in BUILT}
    return {name: {table: to_arrow(table, layers.rows(table)) for table in tables} for name, tables in there.items()}


class ReleaseDraft(Draft):
    """A release to edit: tables of all layers by name, documents by path, and the texts `README.md` and `LICENCE.txt`.

    `raw` is the dataset beside a detached release that holds its raw layer, a draft of its own.
    """

    def __init__(self, layers: list[str], raw: Draft | None = None) -> None:
        source = synthetic_release.raw_tables() if "raw" in layers else {}
        super().__init__({**source, **built().tables}, {**synthetic_release.raw_descriptor(), "layers": layers})
        self.raw = raw
        self.documents = pickle.loads(pickle.dumps(built().documents))
        self.reseal("card")

    def frame(self, table: str) -> Frame:
        """Rows of a derived table as columns."""
        (rows,) = (shard[table] for shard in self.tables.values() if table in shard)
        return from_arrow(rows, table)

    def put(self, table: str, frame: Frame) -> None:
        """Replace a derived table; its rows are sorted by key."""
        (folder,) = (folder for folder, shard in self.tables.items() if table in shard)
        keys = self.descriptor["action_bank"]["policies"]
        declared = LAYER_TABLES[table]
        orders = {"action_key": [policy["key"] for policy in keys], "partition": declared.partitions}
        ordered = sort_rows(frame, declared.order, orders)
        self.tables[folder][table] = to_arrow(table, ordered)

    def sort(self, table: str) -> None:
        """Bring the rows of a derived table into the order of their key."""
        self.put(table, self.frame(table))

    def digest(self, path: str) -> str:
        """SHA-256 of a document as it will be written."""
        return hashlib.sha256(remembered(dump_json)(self.documents[path])).hexdigest()

    def reseal(self, start: str, *, keep: Collection[str] = ()) -> None:
        """Compute again what follows from tables and documents as they are now.

        Args:
            start: The first of `STEPS` to take; all later ones follow.
            keep: Steps to leave out, because what they would compute is the lie.
        """
        names = list(STEPS)
        assert {start, *keep} <= set(names), (start, keep)
        for name in names[names.index(start) :]:
            if name not in keep:
                STEPS[name](self)

    def rebuild(self, options: BuildOptions | None = None) -> None:
        """Build all derived layers again from the raw tables as they are now, but for the audit of leakage."""
        raw = Draft({folder: self.tables[folder] for folder in RELEASE_SHARDS}, synthetic_release.raw_descriptor())
        options = options or BuildOptions(seed=SEED)
        with tempfile.TemporaryDirectory() as folder, Spool.temporary() as spool:
            scan = scan_raw(Folder(raw.write(Path(folder) / "raw")), spool, in_process, optional=options.tables)
            with _work_on(scan) as work:
                _build(work, options)
                build_model(work, options)
                self.tables.update(_arrow(work.layers))
                self.documents = work.layers.documents
        self.reseal("card")

    def add_endings(self) -> None:
        """Add what was recorded of whole drives, with the card that tells it."""
        self._add(ENDINGS)

    def add_objects(self) -> None:
        """Add what sensors tell of others, with the card that tells it."""
        self._add(OBJECTS)

    def _add(self, table: str) -> None:
        frame = with_homes(built().rows[table], dict(_homes(self)))
        self.tables["model"][table] = to_arrow(table, frame)
        self.sort(table)
        self.reseal("card")

    def add_filtering(self) -> dict[str, Any]:
        """Add the figures beside the thresholds, of the raw tables as they were built; the card follows later."""
        rows, thresholds = built().rows["replay_frames"], self.documents[THRESHOLDS]
        found = filtering_document(self.frame("pairs"), self.frame("group_quality"), rows, thresholds)
        self.documents[FILTERING_FILE] = found
        return found

    def raw_root(self, root: Path) -> Path | None:
        """Where the raw dataset of the release at `root` is, if it has one beside it."""
        return None if self.raw is None else root.with_name(f"{root.name}-raw")

    def write(self, root: Path) -> Path:
        """Write the release into the new folder `root`, and its raw dataset, if it has one, beside it."""
        beside = self.raw_root(root)
        if self.raw is not None and beside is not None:
            self.raw.write(beside)
        return super().write(root)


def _homes(d: ReleaseDraft) -> Iterator[tuple[str, str]]:
    contexts = d.frame("contexts")
    return zip(contexts["group_id"].tolist(), contexts["partition"].tolist(), strict=True)


def _source(d: ReleaseDraft) -> None:
    d.documents[SOURCE].update(source_counts(d.frame("records"), d.frame("attempts")))


def _split(d: ReleaseDraft) -> None:
    groups, before = d.frame("group_quality"), d.documents[SPLIT]
    assignment = assignment_of(groups)
    d.documents[SPLIT] = split_document(
        assignment, clusters_of(groups), seed=before["seed"], calibration=calibration_of(before)
    )


def _thresholds(d: ReleaseDraft) -> None:
    d.documents[THRESHOLDS] = {
        **threshold_document(d.frame("pairs"), d.frame("group_quality")),
        "split_digest": d.documents[SPLIT]["digest"],
    }


def _passes(d: ReleaseDraft) -> None:
    d.put("pairs", with_passes(d.frame("pairs"), thresholds_of(d.documents[THRESHOLDS])))


def _validity(d: ReleaseDraft) -> None:
    d.put("group_quality", with_validity(d.frame("group_quality"), d.frame("pairs")))


def _near_duplicates(d: ReleaseDraft) -> None:
    groups, raw = d.frame("group_quality"), built().rows
    flags = duplicate_flags(groups, raw["state"], raw["past_controls"], assignment_of(groups)).flagged
    d.put("group_quality", {**groups, "near_duplicate": flags})


def _digests(d: ReleaseDraft) -> dict[str, str]:
    return {"split_digest": d.documents[SPLIT]["digest"], "thresholds_digest": d.digest(THRESHOLDS)}


def _retention(d: ReleaseDraft) -> None:
    seed = d.documents[RETENTION]["seed"]
    d.documents[RETENTION] = retention_document(d.frame("pairs"), d.frame("group_quality"), seed=seed, **_digests(d))


def _population(d: ReleaseDraft) -> None:
    num_policies = len(d.descriptor["action_bank"]["policies"])
    d.documents[POPULATION] = population_document(d.frame("group_quality"), num_policies=num_policies)


def _variants(d: ReleaseDraft) -> None:
    d.documents[VARIANTS] = variants_document(d.frame("group_quality"), declared_of(d.documents[VARIANTS]))


def _ledger(d: ReleaseDraft) -> None:
    d.documents[LEDGER] = with_round(None, **_digests(d))


def _leakage(d: ReleaseDraft) -> None:
    """An audit of other groups or partitions would have to be made again, so the release goes without one."""
    now, before = d.frame("group_quality"), from_arrow(built().tables["quality"]["group_quality"], "group_quality")
    if any(now[name].tolist() != before[name].tolist() for name in ("group_id", "partition", "core_valid")):
        d.documents.pop(LEAKAGE, None)


def _model(d: ReleaseDraft) -> None:
    """Of the groups and records as they are now, and of the rest of the raw rows as they were."""
    with Spool.temporary() as spool:
        rows = {**built().rows, "group_quality": d.frame("group_quality")}
        for name, frame in rows.items():
            spool.put(f"every.{name}", frame)
        part = RawPart(0, spool, ("every",), tuple(rows))
        with _work_on(replace(built().scan, spool=spool, parts=(part,))) as work:
            for name in ("group_quality", "records"):
                work.layers.put_tables([name], work.store.put(name, d.frame(name), 0))
            build_model(work, BuildOptions(tables=frozenset(_optional(d))))
            for name in LAYERS["model"].tables:
                if table_paths(name, work.layers.files):
                    d.put(name, work.layers.rows(name))
            d.documents.update(work.layers.documents)
    d.documents["model/normalisation.json"]["split_digest"] = d.documents[SPLIT]["digest"]


def _optional(d: ReleaseDraft) -> list[str]:
    """Optional tables that the draft has."""
    return [table for table in d.tables.get("model", {}) if LAYER_TABLES[table].optional]


def _card(d: ReleaseDraft) -> None:
    descriptor = Descriptor.model_validate(d.descriptor)
    tables = [table_path(table, "test") for table in _optional(d)]
    d.texts[CARD_FILE] = release_card(descriptor, d.documents, tables)
    d.texts[LICENCE_FILE] = render_licence(descriptor.licence)


STEPS: dict[str, Callable[[ReleaseDraft], None]] = {
    "source": _source, "split": _split, "thresholds": _thresholds, "passes": _passes, "validity": _validity,
    "near_duplicates": _near_duplicates, "retention": _retention, "population": _population, "variants": _variants,
    "ledger": _ledger, "leakage": _leakage, "model": _model, "card": _card,
}  # fmt: skip
"""What follows from what, in the order of the builder."""


def release_draft() -> ReleaseDraft:
    """The release in place: raw layer with media, all derived layers, and an audit of leakage."""
    return ReleaseDraft(["raw", *BUILT])


def detached_draft(*, with_raw: bool) -> ReleaseDraft:
    """The release without its raw layer, which is a dataset beside it or not available."""
    raw = Draft(synthetic_release.raw_tables(), synthetic_release.raw_descriptor()) if with_raw else None
    return ReleaseDraft([*BUILT], raw)
