"""The raw layer as a builder reads it: verified against its manifest, judged by every rule on rows, and extracted.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import part_of
from branchdrive.contract.layout import MANIFEST_FILE, layer_of
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.reading import Progress, read_dataset
from branchdrive.engine.shard import ShardResult, spooled_name
from branchdrive.engine.spool import Spool, SpooledFrames
from branchdrive.engine.validate import judge_files
from branchdrive.errors import DatasetError
from branchdrive.files.survey import NOT_READ, Survey, take_survey
from branchdrive.formats.manifest import read_manifest
from branchdrive.formats.store import Store
from branchdrive.raw.content import raw_content
from branchdrive.runtime.executor import Executor

__all__ = ["RawPart", "RawScan", "check_unchanged", "scan_raw"]

_RAW_LAYERS = ("raw", "media")
"""Layers that a builder reads and never writes."""


@dataclass(frozen=True)
class RawPart:
    """Rows of the shards of one part.

    Attributes:
        number: Its number.
        spool: Where they wait.
        shards: Prefixes of the shards in the spool.
        names: Names of the frames of each.
    """

    number: int
    spool: Spool
    shards: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def rows(self) -> SpooledFrames:
        """Rows by table, each read when it is asked for."""
        return SpooledFrames(self.spool, self.shards, self.names)

    def put_array(self, name: str, values: NDArray[np.float64]) -> None:
        """Keep an array that was computed of them."""
        self.spool.put_array(f"part-{self.number}.{name}", values)

    def array(self, name: str) -> NDArray[np.float64]:
        """An array that was kept; it lies in its file until it is read."""
        return self.spool.array(f"part-{self.number}.{name}")


@dataclass(frozen=True)
class RawScan:
    """A verified raw layer.

    Attributes:
        dataset: Where it is.
        descriptor: The dataset's descriptor.
        digest: Digest of the content of the raw layer.
        files: SHA-256 of every file of the raw layer and its media, by path.
        spool: Where rows wait that it gives for the derived layers.
        parts: Its parts, in order of their numbers.
        num_groups: Its groups.
    """

    dataset: Store
    descriptor: Descriptor
    digest: str
    files: dict[str, str]
    spool: Spool
    parts: tuple[RawPart, ...]
    num_groups: int

    @property
    def rows(self) -> SpooledFrames:
        """Rows of all parts by table, each read when it is asked for."""
        shards = [shard for part in self.parts for shard in part.shards]
        return SpooledFrames(self.spool, shards, self.parts[0].names)


def scan_raw(
    dataset: Store,
    spool: Spool,
    executor: Executor,
    progress: Progress | None = None,
    *,
    optional: Collection[str] = (),
) -> RawScan:
    """Read, verify and judge the raw layer of a dataset.

    Args:
        dataset: The dataset.
        spool: Where its rows wait for who builds from them.
        executor: How shards are read.
        progress: Called after every shard.
        optional: Optional tables that are to be built.

    Raises:
        DatasetError: There is no finished raw layer, it is damaged, or it breaks the format.
        UsageError: There is no dataset at all.
    """
    survey = take_survey(dataset)
    descriptor = _finished(survey)
    reading = read_dataset(survey, frozenset(CATALOGUE), executor, progress, spool=spool, optional=optional)
    results = reading.shards
    for message in reading.errors:
        place, reason = message.split(":", 1)[0], message.rsplit("\n", 1)[-1].strip()
        raise DatasetError(f"{dataset}: the tool failed on {place} ({reason}); run `branchdrive-validate` to see more")
    for problem in (*_damage(reading.source), *_breaches(reading.source, results)):
        raise DatasetError(f"{dataset}: {problem}; run `branchdrive-validate` and correct the raw layer first")
    lacking = next((shard.no_frames for shard in results if not shard.frames), None)
    if lacking is not None:
        raise DatasetError(f"{dataset}: {lacking}; run `branchdrive-validate` and correct the raw layer first")
    digest = raw_content(results)
    if digest is None:
        raise DatasetError(f"{dataset}: its attempts have no identity; run `branchdrive-validate`")
    num_groups = sum(len(shard.group_ids) for shard in results)
    files = _raw_files(reading.source.digests)
    return RawScan(dataset, descriptor, digest, files, spool, _parts(spool, results), num_groups)


def _parts(spool: Spool, results: Sequence[ShardResult]) -> tuple[RawPart, ...]:
    shards: dict[int, list[str]] = {}
    for shard in results:
        shards.setdefault(part_of(shard.folder), []).append(spooled_name(shard.folder))
    return tuple(RawPart(number, spool, tuple(own), results[0].frames) for number, own in sorted(shards.items()))


def _finished(survey: Survey) -> Descriptor:
    """Descriptor of a dataset whose collection is finished."""
    if survey.descriptor is None:
        raise DatasetError(f"{survey.folder}: its descriptor cannot be used; run `branchdrive-validate`")
    if survey.excess:
        raise DatasetError(f"{survey.folder}: {NOT_READ}; run `branchdrive-validate`")
    if not survey.shard_folders:
        raise DatasetError(f"{survey.folder}: holds no raw layer; build from the dataset that does")
    if survey.descriptor.is_of_drives:
        raise DatasetError(f"{survey.folder}: holds drives, which are in no branch group; nothing is derived from them")
    if survey.manifest is None:
        raise DatasetError(f"{survey.folder}: has no {MANIFEST_FILE}: finish the collection before a release is built")
    return survey.descriptor


def check_unchanged(scan: RawScan) -> None:
    """The manifest on disk lists the raw layer that was read: it has not been changed since.

    Raises:
        DatasetError: It does not, or is gone.
    """
    listed: dict[str, str] = {}
    if scan.dataset.status(MANIFEST_FILE) is not None:
        manifest, _ = read_manifest(scan.dataset)
        listed = _raw_files(manifest.files)
    if listed != scan.files:
        raise DatasetError(f"{scan.dataset}: its raw layer was changed while it was built from; build again afterwards")


def _raw_files(digests: Mapping[str, str]) -> dict[str, str]:
    """Digests of the raw layer and its media alone, by path."""
    return {path: digest for path, digest in digests.items() if layer_of(path) in _RAW_LAYERS}


def _damage(survey: Survey) -> Iterator[str]:
    """Files of the raw layer that are not what the manifest says."""
    listed = _raw_files(survey.manifest.files if survey.manifest else {})
    found = _raw_files(survey.digests)
    for path in sorted(listed.keys() | found.keys()):
        if listed.get(path) != found.get(path):
            yield f"{path!r} is not the file that {MANIFEST_FILE} lists"
            return


def _breaches(survey: Survey, results: Sequence[ShardResult]) -> Iterator[str]:
    """Structure rules that the raw layer breaks."""
    for shard in results:
        for tally in shard.tallies.values():
            if tally.info.decides and tally.num_findings:
                yield f"{shard.folder} breaks {tally.rule_id} ({tally.info.title})"
                return
    for tally in judge_files(survey):
        if tally.info.decides and tally.num_findings and not tally.rule_id.startswith("BD-LAY"):
            yield f"breaks {tally.rule_id} ({tally.info.title})"
            return
