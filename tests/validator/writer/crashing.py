"""Collections that are killed before a file operation, or at a random moment as a process of their own.

Run as a program: ``python -m tests.validator.writer.crashing sweep FOLDER STEP`` or ``... collect ROOT``.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path

from tests.validator.writer.invented import ATTEMPTS, CAMERAS, make_descriptor, write_group, write_rollout

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, parse_manifest
from branchdrive.raw.media.camera_frames import CameraFrame
from branchdrive.raw.reader import open_dataset
from branchdrive.writer.writer import DatasetWriter

DESCRIPTOR = make_descriptor(has_evidence=False, has_media=True)
FRAME_TICKS = (10, 0, 5)
NAME_EVENTS = {"os.mkdir", "os.rename", "os.remove", "os.rmdir"}
"""Audit events of operations that change which names there are."""


def collect(root: Path, num_groups: int = 2) -> str:
    """Collect or resume a dataset of two groups a shard, one rollout a group; its identity."""
    with DatasetWriter(root, DESCRIPTOR, groups_per_shard=2) as writer:
        for index in range(num_groups):
            if not writer.is_closed(f"g{index}"):
                with writer.begin_group(f"g{index}", index=index) as group:
                    write_group(group, ATTEMPTS[:1], has_evidence=False, frame_ticks=FRAME_TICKS)
            writer.commit()
        return writer.finalize()


def retry(root: Path) -> str:
    """Add a second attempt to a committed group of a finished dataset, or resume doing so."""
    with DatasetWriter(root, DESCRIPTOR, groups_per_shard=2) as writer:
        with writer.begin_group("g0") as group:
            if group.find("nominal", "nominal", attempt=2) is None:
                write_rollout(group, "nominal", "nominal", has_evidence=False, frame_ticks=FRAME_TICKS)
        return writer.finalize()


def check_visible(root: Path) -> None:
    """Raise unless everything visible in a possibly unfinished dataset is whole."""
    if not (root / "branchdrive.json").exists():
        return
    dataset = open_dataset(root)
    for name in dataset.descriptor.tables:
        dataset.table(name).read()
    for group_id in dataset.groups:
        for rollout in dataset.group(group_id).rollouts:
            for camera in CAMERAS:
                list(map(CameraFrame.read, rollout.frames(camera.name)))
    if (root / MANIFEST_FILE).exists():
        manifest, problems = parse_manifest((root / MANIFEST_FILE).read_bytes())
        if problems or manifest != build_manifest(Folder(root)):
            raise RuntimeError(f"visible manifest is not that of the files: {problems}")


def sweep(folder: Path, work: Callable[[Path], str], start: Path | None, step: int) -> dict[str, object]:
    """Resume `work` from what is left where it is killed before every `step`-th of its name operations.

    What a kill leaves is a copy of the files before the operation: one uninterrupted run gives them all, and the
    identity and manifest that every resumed one must come to.
    """
    folder.mkdir()
    root, left = folder / "expected", folder / "left"
    left.mkdir()
    if start is not None:
        shutil.copytree(start, root)
    kills: list[Path] = []
    is_watched, seen = True, count()

    def keep(event: str, args: tuple[object, ...]) -> None:
        nonlocal is_watched
        if is_watched and event in NAME_EVENTS and next(seen) % step == 0:
            is_watched = False  # a copy changes names, too
            kills.append(left / str(len(kills) + 1))
            if root.exists():
                shutil.copytree(root, kills[-1])
            is_watched = True

    sys.addaudithook(keep)
    identity = work(root)
    is_watched = False
    manifest = (root / MANIFEST_FILE).read_bytes()
    differing = []
    for number, killed in enumerate(kills, start=1):
        check_visible(killed)
        if work(killed) != identity or (killed / MANIFEST_FILE).read_bytes() != manifest:
            differing.append(number)
    return {"num_kills": len(kills), "differing": differing}


def main() -> None:
    mode, folder = sys.argv[1], Path(sys.argv[2])
    if mode == "collect":
        sys.stdout.write("begins\n")
        sys.stdout.flush()
        collect(folder, num_groups=8)
        return
    finished = folder / "finished"
    collect(finished)
    for name, work, start in (("collect", collect, None), ("retry", retry, finished)):
        sys.stdout.write(json.dumps({"name": name, **sweep(folder / name, work, start, int(sys.argv[3]))}) + "\n")


if __name__ == "__main__":
    main()
