"""Images of a dataset as users read them: lazily, by ticks, from archives and loose files, and never from elsewhere."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.validator.formats.image_files import noise, png
from tests.validator.writer.invented import (
    BRANCH_TICK,
    CAMERAS,
    WHOLE_TICKS,
    image_of,
    make_descriptor,
    write_rollout,
)

from branchdrive.contract.columns import table_schema
from branchdrive.contract.timing import HISTORY_OFFSETS, WINDOW_OFFSETS
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.folder import BufferedReader, Folder
from branchdrive.formats.parquet import encode_table
from branchdrive.raw.media import media_folder
from branchdrive.raw.media.camera_frames import CameraFrames
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import Rollout
from branchdrive.writer.writer import DatasetWriter

TICKS = tuple(BRANCH_TICK + offset for offset in WINDOW_OFFSETS)
TOP_DOWN, BEV = CAMERAS


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frames") / "dataset"
    options: dict[str, Any] = {"num_ticks": WHOLE_TICKS, "has_evidence": False}
    with DatasetWriter(folder, make_descriptor(has_evidence=False, has_media=True)) as writer:
        with writer.begin_group("g0") as group:
            write_rollout(group, "nominal", "nominal", frame_ticks=TICKS, **options)
            write_rollout(group, "intervention", "brake_0.50", frame_ticks=TICKS[1:], **options)
        writer.finalize()
    return folder


@pytest.fixture
def copied(root: Path, tmp_path: Path) -> Path:
    shutil.copytree(root, tmp_path / "copy")
    return tmp_path / "copy"


def nominal(root: Path, **options: Any) -> Rollout:
    return open_dataset(root, **options).group("g0").nominal


def image(tick: int, camera: Any = BEV) -> bytes:
    return image_of(camera, ("g0", "nominal", "nominal", 1), tick)


def test_frames_are_read_back_by_tick(root: Path) -> None:
    for camera in CAMERAS:
        frames = nominal(root).frames(camera.name)
        assert frames.ticks.tolist() == list(TICKS)
        assert [(frame.tick, frame.read()) for frame in frames] == [(tick, image(tick, camera)) for tick in TICKS]


def test_the_history_is_a_window_of_ticks_from_the_branch(root: Path) -> None:
    rollout = nominal(root)
    history = rollout.frames("bev", HISTORY_OFFSETS)
    assert history.ticks.tolist() == [BRANCH_TICK + offset for offset in HISTORY_OFFSETS]
    assert history.pixels().shape == (16, 4, 5)
    assert rollout.frames("top_down", HISTORY_OFFSETS).pixels().shape == (16, 4, 5, 3)
    assert rollout.frames("bev", [0, -75]).ticks.tolist() == [BRANCH_TICK, BRANCH_TICK - 75]


def test_pixels_are_those_of_the_image(root: Path) -> None:
    frames = nominal(root).frames("top_down")[:3]
    assert isinstance(frames, CameraFrames)
    for frame, pixels in zip(frames, frames.pixels(), strict=True):
        assert png(pixels) == frame.read()
        assert (frame.pixels() == pixels).all()


def test_nothing_is_read_before_it_is_asked_for_and_each_image_by_itself(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[tuple[int, int]] = []

    class Watched(BufferedReader):
        def read(self, size: int | None = -1, /) -> bytes:
            reads.append((self.tell(), size or 0))
            return super().read(size)

    plain = Folder.open

    def opened(folder: Folder, path: str) -> BufferedReader:
        stream = plain(folder, path)
        return Watched(stream.detach()) if path.endswith(".tar") else stream

    monkeypatch.setattr(Folder, "open", opened)
    frames = nominal(root).frames("bev")
    frame = frames[7]
    assert not reads
    size = len(frame.read())
    row = nominal(root).tables["frames"].to_pylist()[2 * 7]
    assert reads == [(row["offset_bytes"], size)]


def test_a_missing_image_is_named(root: Path) -> None:
    (intervention,) = open_dataset(root).group("g0").interventions["brake_0.50"]
    with pytest.raises(UsageError, match=r"camera `bev` lacks or repeats images at ticks \[5\]"):
        intervention.frames("bev", WINDOW_OFFSETS)


@pytest.mark.parametrize("camera", ["front", "BEV", ""])
def test_a_camera_that_is_not_declared_is_named(root: Path, camera: str) -> None:
    with pytest.raises(UsageError, match=rf"no camera '{camera}' in this dataset; it has `bev`, `top_down`"):
        nominal(root).frames(camera)


def test_a_dataset_without_media_has_no_frames(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "plain", make_descriptor(has_evidence=False)) as writer:
        with writer.begin_group("g0") as group:
            write_rollout(group, "nominal", "nominal", has_evidence=False)
        writer.finalize()
    with pytest.raises(UsageError, match="it has no media"):
        nominal(tmp_path / "plain").frames("front")


def edit(root: Path, change: Callable[[list[dict[str, Any]]], None]) -> None:
    """Change the rows of the index."""
    path = root / "raw" / "shard-00000" / "frames.parquet"
    rows = open_dataset(root).table("frames").read().to_pylist()
    change(rows)
    path.write_bytes(encode_table(pa.Table.from_pylist(rows, schema=table_schema("frames"))))


def test_loose_files_work_too(copied: Path) -> None:
    shard = copied / "raw" / "shard-00000"

    def loosen(rows: list[dict[str, Any]]) -> None:
        content = (shard / "media.tar").read_bytes()
        for number, row in enumerate(rows):
            start = row["offset_bytes"]
            (shard / f"image-{number}.png").write_bytes(content[start : start + row["size_bytes"]])
            row.update(file=f"image-{number}.png", offset_bytes=0)

    edit(copied, loosen)
    (shard / "media.tar").unlink()
    assert [frame.read() for frame in nominal(copied).frames("bev")] == [image(tick) for tick in TICKS]
    assert len(nominal(copied).frames("top_down").pixels()) == len(TICKS)


HOSTILE: dict[str, tuple[dict[str, Any], str]] = {
    "parent": ({"file": "../../../secret"}, "no plain file name"),
    "absolute": ({"file": "/etc/passwd"}, "no plain file name"),
    "folder": ({"file": "sub/secret"}, "no plain file name"),
    "hidden": ({"file": ".secret"}, "no plain file name"),
    "newline": ({"file": "media.tar\n"}, "no plain file name"),
    "missing": ({"file": "elsewhere.tar"}, "does not exist"),
    "before": ({"offset_bytes": -1}, "an image has 1 .. "),
    "beyond": ({"offset_bytes": 2**40}, "the file ends before the image does"),
    "huge": ({"size_bytes": 2**62}, "an image has 1 .. "),
    "nothing": ({"size_bytes": 0}, "an image has 1 .. "),
    "moved": ({"offset_bytes": 0}, "not that of its checksum"),
    "other": ({"checksum": "0" * 16}, "not that of its checksum '0000"),
}


@pytest.mark.parametrize(("change", "message"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_entries_stay_in_the_shard_and_are_refused(copied: Path, change: dict[str, Any], message: str) -> None:
    (copied.parent / "secret").write_bytes(b"secret")
    drive = nominal(copied)
    edit(copied, lambda rows: next(row for row in rows if row["rollout_id"] == drive.rollout_id).update(change))
    index = open_dataset(copied).table("frames").read().to_pylist()
    frames = nominal(copied).frames(next(row["camera"] for row in index if row["rollout_id"] == drive.rollout_id))
    with pytest.raises(DatasetError, match=message):
        frames[0].read()
    assert len(frames[1].read()) > 0


def test_a_link_is_followed_only_on_request(copied: Path, tmp_path: Path) -> None:
    archive = copied / "raw" / "shard-00000" / "media.tar"
    target = tmp_path / "blobs" / "media"
    target.parent.mkdir()
    archive.rename(target)
    archive.symlink_to(target)
    with pytest.raises(DatasetError, match="without following links"):
        nominal(copied).frames("bev")[0].read()
    followed = nominal(copied, follow_links=True, allow=[target.parent]).frames("bev")
    assert followed[0].read() == image(TICKS[0])


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        (png(noise(1, 300, 300)), "expected 5 x 4 pixels, as camera `bev` is declared, found 300 x 300"),
        (png(noise(1, 4, 5, 3)), "expected a PNG of one channel of 8 bits"),
        (b"x" * 100, "neither a PNG nor a JPEG"),
    ],
)
def test_an_image_of_no_such_camera_is_never_decoded(copied: Path, replaced: bytes, message: str) -> None:
    (copied / "raw" / "shard-00000" / "other.png").write_bytes(replaced)
    place = {"file": "other.png", "offset_bytes": 0, "size_bytes": len(replaced)}
    place["checksum"] = media_folder.image_checksum(replaced)
    edit(copied, lambda rows: [row.update(place) for row in rows if row["camera"] == "bev"][:0])
    frames = nominal(copied).frames("bev")
    assert frames[0].read() == replaced
    for read in (frames[0].pixels, frames.pixels):
        with pytest.raises(DatasetError, match=message):
            read()


def test_frames_show_what_they_are(root: Path) -> None:
    frames = nominal(root).frames("bev")
    assert repr(frames) == "CameraFrames('bev', 26 images)"
    assert repr(frames[0]).startswith("CameraFrame('bev', tick 5, ")
    assert isinstance(frames.at(np.array([5, 10])), CameraFrames)
