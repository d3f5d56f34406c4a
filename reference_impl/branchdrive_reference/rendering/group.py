"""The images of one branch group, as members of an archive and rows of its index.

A piece is the archive without its end, with positions from its own beginning.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.contract.columns import STREAMS, table_schema
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import ContractError
from branchdrive.formats.durable import durable_stream, replace_file
from branchdrive.formats.image_header import read_header
from branchdrive.formats.media_archive import MEDIA_FILE, MediaArchive, member_name
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import conform
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.raw.media.media_folder import FRAMES, image_checksum
from branchdrive.raw.reader import Dataset
from branchdrive.raw.rollout import MAP, Rollout
from branchdrive_reference.rendering.encoding import encoded
from branchdrive_reference.rendering.fault import Images, with_drawn_fault
from branchdrive_reference.rendering.patch import Town
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.renderer import Renderer
from branchdrive_reference.rendering.snapshot import Playback
from branchdrive_reference.town.recorded import recorded_elements

__all__ = ["GroupRenderer", "joined_pieces", "piece_paths"]

_COPIED_BYTES = 1 << 20
_SURROUND = STREAMS["rgb_surround"].cameras


def piece_paths(folder: Path, number: int) -> tuple[Path, Path]:
    """Archive and index of the piece with a number."""
    return folder / f"{number:08d}.tar", folder / f"{number:08d}.parquet"


class GroupRenderer:
    """Renders groups of one dataset, and keeps what they share.

    Args:
        dataset: The dataset, which has no media yet.
        plan: What is rendered.
    """

    _MOST_KEPT = 4

    def __init__(self, dataset: Dataset, plan: MediaPlan) -> None:
        self._dataset, self._plan = dataset, plan
        self._shards = {shard.index: shard for shard in dataset.shards}
        self._town = lru_cache(maxsize=self._MOST_KEPT)(self._make_town)
        self._renderer = lru_cache(maxsize=self._MOST_KEPT)(self._make_renderer)

    def _make_town(self, shard: int, name: str) -> Town:
        return Town(recorded_elements(self._shards[shard].table(MAP), name, self._dataset.descriptor))

    def _make_renderer(self, shard: int, town: str, environment: str) -> Renderer:
        return Renderer(self._town(shard, town), environment, self._plan.cameras)

    def write_piece(self, folder: Path, shard: int, number: int, group_id: str, between: Callable[[], None]) -> None:
        """Render a group into two files of a folder, the index last: a piece with an index is whole.

        Args:
            folder: Where pieces are.
            shard: Index of the shard of the group.
            number: Place of the group in the shard, which names the piece.
            group_id: The group.
            between: Called before every rollout; an exception from it leaves no piece.

        Raises:
            UsageError: What is recorded of the group cannot be drawn.
            DatasetError: A file of the dataset cannot be read.
        """
        archive_path, index_path = piece_paths(folder, number)
        rows: list[dict[str, Any]] = []
        with durable_stream(archive_path) as stream:
            archive = MediaArchive(stream)
            for rollout in sorted(self._dataset.group(group_id).rollouts, key=attrgetter("rollout_id")):
                between()
                rows += self._rollout_rows(rollout, shard, archive)
        index = pa.Table.from_pylist(rows, schema=table_schema(FRAMES))
        replace_file(index_path, encode_table(index))

    def _rollout_rows(self, rollout: Rollout, shard: int, archive: MediaArchive) -> Iterator[dict[str, Any]]:
        record = rollout.record
        renderer = self._renderer(shard, record["town"], record["environment"])
        recording = Playback(rollout)
        images: Images = {}
        for tick in recording.window(self._plan.offsets):
            seen = renderer.images(recording.at(tick))
            images |= {(tick, camera): encoded(seen[camera]) for camera in sorted(seen)}
        collection = self._dataset.descriptor.collection
        images = with_drawn_fault(images, _SURROUND, rollout.rollout_id, collection)
        for (tick, camera), image in images.items():
            encoding = read_header(image).encoding
            yield {
                "rollout_id": rollout.rollout_id,
                "tick": tick,
                "camera": camera,
                "file": MEDIA_FILE,
                "offset_bytes": archive.add(member_name(rollout.rollout_id, tick, camera, encoding), image),
                "size_bytes": len(image),
                "checksum": image_checksum(image),
                "encoding": encoding,
            }


def joined_pieces(folder: Path, numbers: Sequence[int], target: Path) -> pa.Table:
    """Write the archive of a shard from pieces; its index, without rows where there are no images and no archive.

    Raises:
        ContractError: The archive would be larger than the format allows.
    """
    tables = [table_schema(FRAMES).empty_table()]
    with durable_stream(target) as stream:
        archive = MediaArchive(stream)
        for number in numbers:
            archive_path, index_path = piece_paths(folder, number)
            rows = conform(decode_table(index_path.read_bytes(), FRAMES), FRAMES)
            place = rows.schema.get_field_index("offset_bytes")
            moved = pc.add(rows.column(place), archive.num_bytes).cast(pa.int64())
            tables.append(rows.set_column(place, rows.schema.field(place), moved))
            with archive_path.open("rb") as piece:
                shutil.copyfileobj(piece, stream, _COPIED_BYTES)
            archive.num_bytes += archive_path.stat().st_size
        archive.end()
    if archive.num_bytes > spec_limits().max_media_bytes:
        raise ContractError(
            f"{target.parent.name}: media of {archive.num_bytes:,} bytes, more than {spec_limits().max_media_bytes:,}; "
            "render smaller images or fewer streams"
        )
    index = pa.concat_tables(tables)
    if not index.num_rows:
        target.unlink()
    return index
