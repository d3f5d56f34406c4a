"""The raw layer as a builder reads it: verified against its manifest, judged by every rule on rows, and extracted.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from branchdrive.audit.engine import Progress, audit_shards, judge_files
from branchdrive.audit.extract.shard import Extract, merge
from branchdrive.audit.survey import Survey, take_survey
from branchdrive.audit.worker import Executor
from branchdrive.contract.catalogue import CATALOGUE
from branchdrive.contract.descriptor import Descriptor
from branchdrive.dataset.layout import MANIFEST_FILE, RAW_DIR, layer_of
from branchdrive.dataset.manifest import Manifest
from branchdrive.errors import DatasetError

__all__ = ["RawScan", "scan_raw"]

_RAW_LAYERS = ("raw", "media")
"""Layers that a builder reads and never writes."""


@dataclass(frozen=True)
class RawScan:
    """A verified raw layer.

    Attributes:
        root: The dataset folder.
        descriptor: The dataset's descriptor.
        digest: Digest of the raw layer.
        files: SHA-256 of every file of the raw layer and its media, by path.
        extract: What the derived layers take from it.
    """

    root: Path
    descriptor: Descriptor
    digest: str
    files: dict[str, str]
    extract: Extract


def scan_raw(root: Path, executor: Executor, progress: Progress | None = None) -> RawScan:
    """Read, verify and judge the raw layer of the dataset at `root`.

    Raises:
        DatasetError: There is no finished raw layer, it is damaged, or it breaks the format.
        UsageError: There is no dataset at all.
    """
    survey = take_survey(root)
    _check_finished(survey)
    results, errors = audit_shards(survey, frozenset(CATALOGUE), "rows and metamorphic steps", executor, progress)
    survey = survey.with_shards(tuple(results))
    for message in errors:
        place, reason = message.split(":", 1)[0], message.rsplit("\n", 1)[-1].strip()
        raise DatasetError(f"{root}: the tool failed on {place} ({reason}); run `branchdrive-validate` to see more")
    for problem in (*_damage(survey), *_breaches(survey)):
        raise DatasetError(f"{root}: {problem}; run `branchdrive-validate` and mend the raw layer first")
    assert survey.descriptor is not None  # noqa: S101  (checked above; for the type checker)
    lacking = next((shard.no_extract for shard in results if shard.extract is None), None)
    if lacking is not None:
        raise DatasetError(f"{root}: {lacking}; run `branchdrive-validate` and mend the raw layer first")
    files = {path: digest for path, digest in survey.digests.items() if layer_of(path) in _RAW_LAYERS}
    extract = merge([shard.extract for shard in results if shard.extract is not None])
    return RawScan(root, survey.descriptor, Manifest.of(files).layers[RAW_DIR], files, extract)


def _check_finished(survey: Survey) -> None:
    if survey.descriptor is None:
        raise DatasetError(f"{survey.root}: its descriptor cannot be used; run `branchdrive-validate`")
    if not survey.shard_folders:
        raise DatasetError(f"{survey.root}: holds no raw layer; build from the dataset that does")
    if survey.manifest is None:
        raise DatasetError(f"{survey.root}: has no {MANIFEST_FILE}: finish the collection before a release is built")


def _damage(survey: Survey) -> Iterator[str]:
    """Files of the raw layer that are not what the manifest says."""
    stated = survey.manifest.files if survey.manifest else {}
    stated = {path: digest for path, digest in stated.items() if layer_of(path) in _RAW_LAYERS}
    found = {path: digest for path, digest in survey.digests.items() if layer_of(path) in _RAW_LAYERS}
    for path in sorted(stated.keys() | found.keys()):
        if stated.get(path) != found.get(path):
            yield f"{path!r} is not the file that {MANIFEST_FILE} lists"
            return


def _breaches(survey: Survey) -> Iterator[str]:
    """Structure rules that the raw layer breaks."""
    for shard in survey.shards:
        for tally in shard.tallies.values():
            if tally.info.decides and tally.num_findings:
                yield f"{shard.folder} breaks {tally.rule_id} ({tally.info.title})"
                return
    for tally in judge_files(survey):
        if tally.info.decides and tally.num_findings and not tally.rule_id.startswith("BD-LAY"):
            yield f"breaks {tally.rule_id} ({tally.info.title})"
            return
