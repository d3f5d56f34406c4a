"""Images that are written are read back, whatever the order, the kills and the restarts; wrong ones are refused."""

from __future__ import annotations

import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.formats.image_files import jpeg, noise, png
from tests.validator.writer.invented import (
    ATTEMPTS,
    CAMERAS,
    branch_fields,
    fill,
    identity_fields,
    image_of,
    make_descriptor,
    result_fields,
    write_group,
    write_rollout,
)

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.validate import validate
from branchdrive.errors import ContractError, UsageError
from branchdrive.formats.manifest import parse_manifest
from branchdrive.raw.reader import open_dataset
from branchdrive.writer.rollout_writer import RolloutWriter
from branchdrive.writer.staging import snapshot
from branchdrive.writer.writer import DatasetWriter

DESCRIPTOR = make_descriptor(has_evidence=False, has_media=True)
TICKS = (0, 5, 10)
OPTIONS: dict[str, Any] = {"has_evidence": False, "frame_ticks": TICKS}
TOP_DOWN, BEV = CAMERAS


def collect(root: Path, num_groups: int = 2, **options: Any) -> str:
    with DatasetWriter(root, DESCRIPTOR, groups_per_shard=2) as writer:
        for index in range(num_groups):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group, **{**OPTIONS, **options})
        return writer.finalize()


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("media") / "dataset"
    collect(folder)
    return folder


class Images:
    """Any images of the cameras at saved observations, in any order; a camera keeps its encoding."""

    strategy = st.lists(
        st.tuples(st.sampled_from(TICKS), st.sampled_from(CAMERAS), st.integers(0, 255)),
        unique_by=lambda image: (image[0], image[1].name),
    )

    def __init__(self, drawn: list[tuple[int, Any, int]]) -> None:
        is_jpeg = bool(drawn) and drawn[0][2] % 2 == 1
        self.encoded = {
            (tick, camera.name): jpeg(noise(seed, 4, 5, 3))
            if camera is TOP_DOWN and is_jpeg
            else image_of(camera, tick, seed)
            for tick, camera, seed in drawn
        }


def write_images(root: Path, images: dict[tuple[int, str], bytes]) -> str:
    with DatasetWriter(root, DESCRIPTOR) as writer:
        with writer.begin_group("g0") as group:
            rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
            for (tick, camera), image in images.items():
                rollout.append_frame(tick, camera, image)
            fill(rollout, (), num_ticks=12, is_active=False, has_evidence=False)
            finished = rollout.finish(**result_fields(), **branch_fields("g0.nominal.v1.a1"))
            for camera in CAMERAS:
                assert [frame.read() for frame in finished.frames(camera.name)] == of_camera(images, camera.name)
        return writer.finalize()


def of_camera(images: dict[tuple[int, str], bytes], camera: str) -> list[bytes]:
    return [image for (_, name), image in sorted(images.items()) if name == camera]


@settings(max_examples=5, deadline=None)
@given(Images.strategy.map(Images))
def test_any_images_are_read_back_and_their_order_leaves_no_trace(drawn: Images) -> None:
    images = drawn.encoded
    with TemporaryDirectory() as folder:
        roots = [Path(folder) / name for name in ("one", "other")]
        write_images(roots[0], images)
        write_images(roots[1], dict(reversed(images.items())))
        assert (roots[0] / MANIFEST_FILE).read_bytes() == (roots[1] / MANIFEST_FILE).read_bytes()
        rollout = open_dataset(roots[0]).group("g0").nominal
        for camera in CAMERAS:
            frames = rollout.frames(camera.name)
            assert frames.ticks.tolist() == sorted(tick for tick, name in images if name == camera.name)
            assert [frame.read() for frame in frames] == of_camera(images, camera.name)


def test_a_shard_has_one_archive_in_the_order_of_its_rollouts(root: Path) -> None:
    with tarfile.open(root / "raw" / "shard-00000" / "media.tar", "r:") as tar:
        members = tar.getmembers()
        contents = [tar.extractfile(member) for member in members]
    rows = open_dataset(root).table("frames").read().to_pylist()
    suffixes = [f"{row['rollout_id']}/{row['tick']:06d}.{row['camera']}.png" for row in rows]
    assert [member.name for member in members] == suffixes
    assert [(member.offset_data, member.size) for member in members] == [
        (row["offset_bytes"], row["size_bytes"]) for row in rows
    ]
    assert len(contents) == 2 * len(ATTEMPTS) * len(TICKS) * len(CAMERAS)


def test_the_validator_finds_nothing_wrong_with_the_media(root: Path) -> None:
    report = validate(root)
    statuses = {tally.rule_id: tally.status for tally in report.tallies}
    assert {statuses[f"BD-FRM-00{number}"] for number in (1, 2, 3)} == {"pass"}
    assert statuses["BD-LAY-009"] == "pass"


def test_identity_does_not_cover_media(root: Path, tmp_path: Path) -> None:
    identity = collect(tmp_path / "others", frame_ticks=(5,))
    manifests = [parse_manifest((folder / MANIFEST_FILE).read_bytes())[0] for folder in (root, tmp_path / "others")]
    assert manifests[0] is not None
    assert manifests[1] is not None
    assert manifests[0].identity == manifests[1].identity == identity
    assert manifests[0] != manifests[1]


def test_committed_groups_take_further_attempts_with_the_same_bytes(root: Path, tmp_path: Path) -> None:
    once, twice = tmp_path / "once", tmp_path / "twice"
    with DatasetWriter(once, DESCRIPTOR, groups_per_shard=2) as writer:
        for index in range(2):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group, **OPTIONS)
                if index == 0:
                    write_rollout(group, *ATTEMPTS[0], **OPTIONS)
        writer.finalize()
    shutil.copytree(root, twice)
    with DatasetWriter(twice, DESCRIPTOR, groups_per_shard=2) as writer:
        with writer.begin_group("g0") as group:
            assert [len(rollout.frames("bev")) for rollout in group.rollouts] == [len(TICKS)] * len(ATTEMPTS)
            write_rollout(group, *ATTEMPTS[0], **OPTIONS)
        writer.finalize()
    assert (once / MANIFEST_FILE).read_bytes() == (twice / MANIFEST_FILE).read_bytes()


def test_what_is_staged_can_be_looked_into_with_its_images(tmp_path: Path) -> None:
    folder = tmp_path / "dataset"
    with DatasetWriter(folder, DESCRIPTOR, groups_per_shard=1) as writer:
        for index in range(2):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group, **OPTIONS)
            if index == 0:
                writer.commit()
        with snapshot(folder) as copied:
            groups = [open_dataset(copied).group(f"g{index}") for index in range(2)]
            for group in groups:
                assert all(len(rollout.frames("bev").pixels()) == len(TICKS) for rollout in group.rollouts)


def test_a_shard_without_an_image_has_no_archive(tmp_path: Path) -> None:
    collect(tmp_path / "dataset", num_groups=1, frame_ticks=())
    assert not (tmp_path / "dataset" / "raw" / "shard-00000" / "media.tar").exists()
    assert len(open_dataset(tmp_path / "dataset").group("g0").nominal.frames("bev")) == 0


@pytest.fixture
def rollout(tmp_path: Path) -> Iterator[RolloutWriter]:
    with DatasetWriter(tmp_path / "dataset", DESCRIPTOR) as writer:
        group = writer.begin_group("g0")
        yield group.begin_rollout(**identity_fields("nominal", "nominal", None))
        group.release()


def finished_frames(rollout: RolloutWriter, **options: Any) -> list[tuple[int, str]]:
    fill(rollout, (), num_ticks=12, is_active=False, has_evidence=False, **options)
    frames = rollout.finish(**result_fields(), **branch_fields("g0.nominal.v1.a1")).tables["frames"]
    return list(zip(frames.column("tick").to_pylist(), frames.column("camera").to_pylist(), strict=True))


def test_frames_outside_the_wanted_ticks_are_left_out(rollout: RolloutWriter) -> None:
    rollout.append_frame(0, "bev", image_of(BEV))
    rollout.append_frame(5, "bev", image_of(BEV))
    rollout.keep_frames([5, 10])
    rollout.append_frame(0, "top_down", image_of(TOP_DOWN))
    assert finished_frames(rollout) == [(0, "top_down"), (5, "bev")]


def test_an_abandoned_rollout_leaves_no_image_behind(rollout: RolloutWriter, tmp_path: Path) -> None:
    rollout.append_frame(0, "bev", image_of(BEV))
    assert [path.name for path in tmp_path.rglob("*.media")] == [f".{rollout.rollout_id}.media"]
    rollout.abandon()
    assert not list(tmp_path.rglob("*.media"))


def test_images_of_a_rollout_go_to_a_file_and_not_into_memory(rollout: RolloutWriter, tmp_path: Path) -> None:
    large = png(noise(1, 4, 5), note=bytes(2**20))
    rollout.append_frame(0, "bev", large)
    rollout.append_frame(5, "bev", large)
    (staged,) = tmp_path.rglob("*.media")
    assert staged.stat().st_size > 2**20


RGB, GREY = image_of(TOP_DOWN), image_of(BEV)

WRONG: dict[str, tuple[tuple[Any, Any, Any], type[Exception], str]] = {
    "camera": ((0, "front", RGB), UsageError, r"declares the cameras \['bev', 'top_down'\]"),
    "tick between": ((3, "bev", GREY), UsageError, "tick 3: observations are saved at ticks 0, 5, 10"),
    "tick before": ((-5, "bev", GREY), UsageError, "tick -5"),
    "tick of no number": (("0", "bev", GREY), UsageError, "tick '0'"),
    "twice": ((5, "top_down", RGB), UsageError, "has an image of this observation already"),
    "pixels": ((0, "bev", np.zeros((4, 5), np.uint8)), UsageError, "found ndarray; encode it as PNG or JPEG"),
    "nothing": ((0, "bev", b""), ContractError, "neither a PNG nor a JPEG"),
    "cut off": ((0, "bev", GREY[:-4]), ContractError, "cut short"),
    "damaged": ((0, "bev", GREY[:45] + b"?" + GREY[46:]), ContractError, "does not have its checksum"),
    "size": ((0, "bev", png(noise(1, 5, 4))), ContractError, "expected 5 x 4 pixels, .* found 4 x 5 pixels"),
    "colours": ((0, "bev", RGB), ContractError, "expected a PNG of one channel of 8 bits, found .* rgb"),
    "lossy map": ((0, "bev", jpeg(noise(1, 4, 5))), ContractError, "expected a PNG of one channel"),
    "grey": ((0, "top_down", GREY), ContractError, "expected three channels of 8 bits, found .* grey"),
}


@pytest.mark.parametrize(("frame", "error", "message"), WRONG.values(), ids=WRONG)
def test_wrong_frames_are_refused_at_the_call(
    rollout: RolloutWriter, frame: tuple[Any, Any, Any], error: type[Exception], message: str
) -> None:
    rollout.append_frame(5, "top_down", RGB)
    with pytest.raises(error, match=message):
        rollout.append_frame(*frame)
    assert finished_frames(rollout) == [(5, "top_down")]


def test_an_image_without_its_observation_is_refused_at_the_end(rollout: RolloutWriter) -> None:
    with pytest.raises(ContractError, match="BD-FRM-003"):
        finished_frames(rollout, frame_ticks=(15,))
