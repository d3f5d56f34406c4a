"""Media for a whole dataset: groups become pieces, pieces become shards, and all shards appear with the descriptor.

Until everything is rendered, the dataset stays as it is, and what is finished waits in its staging area: media of a
shard are final as soon as all of its groups are rendered. Then the manifest goes, media and descriptor take their
places, and a new manifest comes last. A killed run is gone on with by the same call, at any point.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import (
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    MANIFEST_FILE,
    RAW_DIR,
    STAGING_DIR,
    layer_of,
    shard_name,
)
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import ContractError, DatasetError, PlatformError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.durable import delete, durable_stream, make_dir, move, partial_path, replace_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import (
    Manifest,
    build_manifest,
    check_against_manifest,
    read_manifest,
    write_manifest,
)
from branchdrive.formats.media_archive import MEDIA_FILE
from branchdrive.formats.parquet import encode_table
from branchdrive.raw.media.media_folder import FRAMES
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.raw.shard import Shard, find_shards
from branchdrive.release.publish import RENDER_DIR, staging
from branchdrive.runtime.elsewhere import unseen_error
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.progress import unwatched
from branchdrive_reference.rendering.group import joined_pieces, piece_paths
from branchdrive_reference.rendering.plan import MediaPlan, check_renderable, plan_text, with_media
from branchdrive_reference.rendering.work import Task, render_groups

__all__ = ["RenderReport", "finished_media", "render_dataset"]

_AREA = f"{STAGING_DIR}/{RENDER_DIR}/{FRAMES}"
_PLAN_FILE, _READY_FILE = "plan.json", "ready.txt"

_IMAGE_BYTES, _PIXEL_BYTES = 1800, 0.04
"""Bytes of an image and its place in an archive, and more for each pixel. Measured: 2.3 kB at 160 x 90, 60 kB at
1600 x 900."""


@dataclass(frozen=True)
class RenderReport:
    """What was rendered.

    Attributes:
        root: The dataset.
        identity: Its identity, which media do not change.
        num_images: Images of the dataset.
        num_bytes: Bytes of its archives.
        num_found: Groups that were rendered before.
        num_groups: All groups.
    """

    root: Path
    identity: str
    num_images: int
    num_bytes: int
    num_found: int
    num_groups: int


def finished_media(dataset: Folder) -> dict[str, str]:
    """Media of shards that are final, and wait until all are: their places in the folder by path in the dataset."""
    return {path: place for shard in find_shards(dataset) for path, place in _finished_media(dataset, shard).items()}


def _finished_media(dataset: Folder, shard: Shard) -> dict[str, str]:
    folder, index = f"{_AREA}/{shard_name(shard.index)}", TABLES[FRAMES].file_name
    names = dataset.names(folder)
    final = [name for name in (MEDIA_FILE, index) if name in names] if index in names else []
    return {f"{shard.prefix}/{name}": f"{folder}/{name}" for name in final}


def render_dataset(
    root: Path,
    plan: MediaPlan,
    *,
    output: Path | None = None,
    jobs: int = 1,
    executor: Executor | None = None,
    watch: Callable[[int, int], None] = unwatched,
    note_shard: Callable[[Mapping[str, str]], None] = unwatched,
) -> RenderReport:
    """Add media to the dataset at `root`, or go on where a run was interrupted.

    Args:
        root: A finished dataset without media.
        plan: What is rendered.
        output: Folder of a copy of the raw layer that gets them instead; of `root` nothing is changed then.
        jobs: Worker processes; 1 works in this process.
        executor: What renders groups instead of these; the dataset's folder is on all of its machines.
        watch: Called with the numbers of finished and of all groups.
        note_shard: Called for every shard whose media are final, with their places in the folder by path in the
            dataset.

    Raises:
        UsageError: There is no finished dataset, it has media or derived layers, it lacks what images are drawn from,
            another command works on it, an interrupted run of another plan left finished groups, or the output holds
            something else.
        DatasetError: A file cannot be read, or differs from the manifest.
        ContractError: The media of a shard would be larger than the format allows.
        PlatformError: The media do not fit on the disk.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    dataset = Folder.at(root)
    if output is not None and output.resolve() != root.resolve():
        source, dataset = dataset, Folder.at(output)
        _copy(source, dataset)
    return _Rendering(dataset, plan, partial(render_groups, jobs=jobs, executor=executor), watch, note_shard).run()


def _manifest(dataset: Folder) -> Manifest:
    if not (dataset.root / MANIFEST_FILE).is_file():
        raise UsageError(f"{str(dataset)!r} holds no finished dataset: there is no {MANIFEST_FILE!r}")
    return read_manifest(dataset)[0]


class _Rendering:
    """One run over a dataset."""

    def __init__(
        self,
        dataset: Folder,
        plan: MediaPlan,
        render: Callable[[Path, MediaPlan, Sequence[Task]], Iterable[Task]],
        watch: Callable[[int, int], None],
        note_shard: Callable[[Mapping[str, str]], None],
    ) -> None:
        self._dataset, self._plan, self._render_groups = dataset, plan, render
        self._watch, self._note_shard = watch, note_shard
        self._root = dataset.root
        self._num_found = self._num_groups = 0

    def run(self) -> RenderReport:
        if not (self._root / DESCRIPTOR_FILE).is_file():
            raise UsageError(f"{str(self._root)!r} holds no dataset: there is no {DESCRIPTOR_FILE!r}")
        descriptor = read_descriptor(self._dataset)
        check_renderable(descriptor)
        self._refuse_another_plan()
        with staging(self._root, create=False, folder=RENDER_DIR) as work:
            area = work / FRAMES
            is_installing = (area / _READY_FILE).exists() and not (self._root / MANIFEST_FILE).exists()
            if not is_installing:
                if (self._root / MANIFEST_FILE).is_file() and self._is_done(descriptor):
                    return self._report()
                self._prepare(area, descriptor)
            self._install(area)
            delete(area)
        if is_installing and not self._is_done(read_descriptor(self._dataset)):
            raise UsageError(
                f"{str(self._root)!r}: an interrupted run was installing other media than these; they are complete "
                "now, and stay as they are"
            )
        return self._report()

    def _refuse_another_plan(self) -> None:
        """Refuse to start over where another plan has finished groups, which may have taken hours."""
        area = self._root / _AREA
        is_begun = (area / _PLAN_FILE).exists() and any(area.rglob("*.parquet"))
        if not is_begun or not (self._root / MANIFEST_FILE).exists():
            return
        found = self._dataset.read(f"{_AREA}/{_PLAN_FILE}", spec_limits().max_document_bytes)
        if not found.startswith(self._plan.document()):
            there, wanted = plan_text(found), plan_text(self._plan.document())
            raise UsageError(
                f"{str(area)!r} holds what an interrupted run has rendered of {there}; asked for is "
                f"{wanted}; give the options of that run, under its versions, to go on with it, or delete the "
                "folder to start over"
            )

    def _is_done(self, descriptor: Descriptor) -> bool:
        """Whether the dataset has the media of this plan already, or more of them.

        An image may be missing as a fault of a camera; the others have their images of the observation all the same.
        """
        if descriptor.cameras != self._plan.cameras:
            return False
        if self._plan.offsets is not None:
            return True
        return all(_num_filmed(shard) >= _num_observations(shard, self._plan) for shard in find_shards(self._dataset))

    def _prepare(self, area: Path, descriptor: Descriptor) -> None:
        """Render what is missing; the area then holds everything that is to be installed."""
        manifest = _manifest(self._dataset)
        claimed = with_media(descriptor, self._plan)
        derived = sorted({layer_of(path) or "" for path in manifest.files} - {"", "raw"})
        if derived:
            raise UsageError(
                f"{str(self._root)!r} has the layers {', '.join(derived)}, which were built without media; pass "
                "`--output DIR` for a copy of its raw layer with media"
            )
        check_against_manifest(self._dataset)
        content = self._plan.document() + manifest.identity.encode()
        if area.exists() and (not (area / _PLAN_FILE).exists() or (area / _PLAN_FILE).read_bytes() != content):
            delete(area)
        self._check_room(area)
        make_dir(area)
        replace_file(area / _PLAN_FILE, content)
        for shard in find_shards(self._dataset):
            make_dir(area / shard_name(shard.index))
        self._render(area)
        replace_file(area / DESCRIPTOR_FILE, render_descriptor(claimed))
        replace_file(area / _READY_FILE, manifest.identity.encode())

    def _check_room(self, area: Path) -> None:
        """Refuse media that do not fit into an archive or on the disk, before hours of work.

        While an archive is made of its pieces, both are on the disk.
        """
        one = _observation_bytes(self._plan)
        sizes = {shard: _num_observations(shard, self._plan) * one for shard in find_shards(self._dataset)}
        largest = max((size for shard, size in sizes.items() if not _index_path(area, shard).exists()), default=0.0)
        if largest > spec_limits().max_media_bytes:
            raise ContractError(
                f"{self._root}: a shard has media of about {largest / 1e9:,.1f} GB, more than "
                f"{spec_limits().max_media_bytes:,} bytes; render smaller images or fewer streams"
            )
        needed = sum(sizes.values()) + largest
        there = sum(path.stat().st_size for path in area.rglob("*.tar"))
        free = shutil.disk_usage(self._root).free
        if needed - there > free:
            raise PlatformError(
                f"{self._root}: media need about {needed / 1e9:,.1f} GB until they are complete; this disk has "
                f"{free / 1e9:,.1f} GB free; make room, or render smaller images or fewer streams"
            )

    def _render(self, area: Path) -> None:
        """Render missing groups; a shard whose groups are all there gets its files at once."""
        shards = {shard.index: shard for shard in find_shards(self._dataset)}
        tasks = [
            Task(area / shard_name(shard.index), shard.index, number, group_id)
            for shard in shards.values()
            for number, group_id in enumerate(_groups(shard))
            if not _index_path(area, shard).exists()
        ]
        missing = [task for task in tasks if not piece_paths(task.folder, task.number)[1].exists()]
        num_missing = Counter(task.shard for task in missing)
        self._num_groups = sum(len(_groups(shard)) for shard in shards.values())
        self._num_found = self._num_groups - len(missing)
        self._watch(self._num_found, self._num_groups)
        for shard in shards.values():
            if not num_missing[shard.index]:
                self._join(area, shard)
        for done, task in enumerate(self._render_groups(self._root, self._plan, missing), start=1):
            if not piece_paths(task.folder, task.number)[1].exists():
                raise unseen_error(f"{self._root}: media of group {task.group_id!r}")
            num_missing[task.shard] -= 1
            if not num_missing[task.shard]:
                self._join(area, shards[task.shard])
            self._watch(self._num_found + done, self._num_groups)

    def _join(self, area: Path, shard: Shard) -> None:
        """Make the files of a shard of its pieces, the index last."""
        index_path = _index_path(area, shard)
        if not index_path.exists():
            folder = index_path.parent
            numbers = range(len(_groups(shard)))
            replace_file(index_path, encode_table(joined_pieces(folder, numbers, folder / MEDIA_FILE)))
            for number in numbers:
                for path in piece_paths(folder, number):
                    path.unlink()
        self._note_shard(_finished_media(self._dataset, shard))

    def _install(self, area: Path) -> None:
        """Put everything in its place; after an interruption at any point it can be done again."""
        identity = (area / _READY_FILE).read_text()
        if (self._root / MANIFEST_FILE).is_file():
            check_against_manifest(self._dataset)  # the last moment at which a refusal leaves the dataset as it is
            self._dataset.remove(MANIFEST_FILE)
        for shard in find_shards(self._dataset):
            for name in (MEDIA_FILE, TABLES[FRAMES].file_name):
                source = area / shard_name(shard.index) / name
                if source.exists():
                    move(source, shard.folder / name)
        if (area / DESCRIPTOR_FILE).exists():
            move(area / DESCRIPTOR_FILE, self._root / DESCRIPTOR_FILE)
        manifest = build_manifest(self._dataset)
        if manifest.identity != identity:
            raise DatasetError(
                f"{self._root}: files of the raw layer differ from what the manifest said when rendering began; "
                "restore them, and render again"
            )
        write_manifest(self._dataset, manifest)

    def _report(self) -> RenderReport:
        shards = find_shards(self._dataset)
        num_images = sum(shard.table(FRAMES).num_rows for shard in shards)
        archives = [shard.folder / MEDIA_FILE for shard in shards]
        num_bytes = sum(path.stat().st_size for path in archives if path.exists())
        num_groups = self._num_groups or sum(len(_groups(shard)) for shard in shards)
        num_found = self._num_found if self._num_groups else num_groups
        return RenderReport(self._root, _manifest(self._dataset).identity, num_images, num_bytes, num_found, num_groups)


def _index_path(area: Path, shard: Shard) -> Path:
    """Where the index of a shard's images waits, once they are all in one archive."""
    return area / shard_name(shard.index) / TABLES[FRAMES].file_name


def _groups(shard: Shard) -> list[str]:
    """Groups of a shard in the order of its rows."""
    groups: list[str] = shard.decode(ROLLOUTS).column("group_id").unique().to_pylist()
    return groups


def _num_observations(shard: Shard, plan: MediaPlan) -> int:
    """Observations of a shard that are rendered, at most."""
    rollouts = shard.decode(ROLLOUTS)
    if plan.offsets is None:
        return int(sum(rollouts.column("num_observations").to_pylist()))
    return int(len(plan.offsets) * (len(rollouts) - rollouts.column("branch_tick").null_count))


def _num_filmed(shard: Shard) -> int:
    """Observations of a shard with images."""
    return int(shard.table(FRAMES).group_by(["rollout_id", "tick"]).aggregate([]).num_rows)


def _observation_bytes(plan: MediaPlan) -> float:
    """About what the images of an observation take in an archive."""
    return sum(_IMAGE_BYTES + _PIXEL_BYTES * camera.width_px * camera.height_px for camera in plan.cameras)


def _copy(source: Folder, target: Folder) -> None:
    """Make `target` a dataset of the raw layer of `source`, unless it is one already."""
    manifest, output = _manifest(source), target.root
    descriptor = read_descriptor(source)
    check_renderable(descriptor)
    names = {path.name for path in output.iterdir() if not path.name.startswith(".")} if output.exists() else set()
    if names and DESCRIPTOR_FILE not in names:
        raise UsageError(f"{str(output)!r} is not empty and holds no dataset; choose another folder")
    if names and read_descriptor(target).dataset_id != descriptor.dataset_id:
        raise UsageError(f"{str(output)!r} holds another dataset; choose another folder")
    raw = {path: digest for path, digest in manifest.files.items() if layer_of(path) == RAW_DIR}
    is_finished = (output / MANIFEST_FILE).is_file()
    if is_finished or (output / STAGING_DIR).exists():
        found = _manifest(target) if is_finished else build_manifest(target)
        if {path: digest for path, digest in found.files.items() if layer_of(path) == RAW_DIR} != raw:
            raise UsageError(f"{str(output)!r} has another raw layer than {str(source)!r}; choose another folder")
        return
    output.mkdir(parents=True, exist_ok=True)
    document = {**descriptor.model_dump(mode="json"), "layers": ["raw"]}
    target.replace(DESCRIPTOR_FILE, render_descriptor(Descriptor.model_validate(document)))
    copied = raw | {path: digest for path, digest in manifest.files.items() if path == LICENCE_FILE}
    for path in copied:
        _copy_file(source, target, path)
    found = build_manifest(target)
    differing = sorted(path for path, digest in copied.items() if found.files[path] != digest)
    if differing:
        raise DatasetError(f"{source}: {differing[:5]} differ from {MANIFEST_FILE}; restore the files first")
    write_manifest(target, found)


def _copy_file(source: Folder, target: Folder, path: str) -> None:
    """Copy a file, durably, and none that a link leads to.

    Raises:
        DatasetError: It is no regular file of the dataset.
    """
    place = target.root / path
    place.parent.mkdir(parents=True, exist_ok=True)
    partial = partial_path(place)
    with source.open(path) as content, durable_stream(partial) as stream:
        shutil.copyfileobj(content, stream)
    move(partial, place)
