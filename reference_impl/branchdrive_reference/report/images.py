"""Camera images of a group as far as there is room: the branch first, then the nominal future, then the others.

Images travel as they are stored. Semantic maps are left out: their values are classes, which look black.
"""

from __future__ import annotations

import base64
from typing import Any, NamedTuple

import pyarrow.compute as pc

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.formats.image_header import disagreement, image_header
from branchdrive.raw.media.camera_frames import CameraFrames
from branchdrive.raw.media.media_folder import FRAMES
from branchdrive_reference.report.scene import Scene
from branchdrive_reference.report.shard_rows import ShardRows
from branchdrive_reference.study.label import sentence

__all__ = ["Images", "camera_images"]

_TICKS = (0, 50, 25, 100, -40, 75, 10, 40, 20, 30, 5, 15, 35, 45, 60, 70, 80, 90, 110, 120, 130, -20, -60, -75)
"""Ticks since the branch in the order in which images are taken."""

_MOST_CAMERAS = 8
_SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}


class Images(NamedTuple):
    """What is shown of the images of a scene.

    Attributes:
        found: Camera, candidate, tick since the branch and content of each.
        text: How many there are, and how many of them are here; empty where there is none.
        remarks: What cannot be shown.
    """

    found: list[dict[str, Any]]
    text: str
    remarks: list[str]


def camera_images(rows: ShardRows, scene: Scene, descriptor: Descriptor, most_bytes: int) -> Images:
    """Images of the futures of a scene.

    Args:
        rows: The shard of the scene.
        scene: The group.
        descriptor: Of the dataset.
        most_bytes: Of all images together, as text.
    """
    if FRAMES not in rows.tables:
        return Images([], "", [])
    media = rows.shard.media(descriptor)
    shown = [camera.name for camera in descriptor.cameras if camera.stream != SEMANTIC_STREAM][:_MOST_CAMERAS]
    if media is None or not shown:
        return Images([], "", ["Semantic maps are not shown here; `branchdrive show` draws them."])
    table = rows.tables[FRAMES]
    found: list[dict[str, Any]] = []
    remarks: list[str] = []
    num_images, num_bytes = 0, 0
    wanted = []
    for future in scene.futures:
        own = table.filter(pc.equal(table.column("rollout_id"), future.rollout_id))
        zero = next((tick for tick in _zero(rows, future.rollout_id)), 0)
        for camera in shown:
            frames = CameraFrames.of_rows(camera, own, media)
            num_images += len(frames)
            for place, tick in enumerate((frames.ticks.astype(int) - zero).tolist()):
                if tick in _TICKS and (future is scene.futures[0] or tick > 0):
                    order = (future is not scene.futures[0], _TICKS.index(tick), shown.index(camera))
                    wanted.append((order, future.policy.key, tick, frames[place]))
    for _, key, tick, frame in sorted(wanted, key=lambda one: one[0]):
        try:
            content = frame.read()
            mime = next((mime for start, mime in _SIGNATURES.items() if content.startswith(start)), None)
            if mime is None or disagreement(image_header(content), media.cameras[frame.camera]) is not None:
                raise DatasetError(f"an image of camera `{frame.camera}` has another size or form than its camera")
        except (DatasetError, DecodeError) as error:
            if not remarks:
                remarks.append(f"Some image is not shown: {sentence(error)}.")
            continue
        num_bytes += len(content) * 4 // 3
        if num_bytes > most_bytes:
            break
        uri = f"data:{mime};base64,{base64.b64encode(content).decode('ascii')}"
        found.append({"camera": frame.camera, "key": key, "tick": tick, "uri": uri})
    part = f"{len(found):,} of {num_images:,}"
    said = f"{part} camera images of these futures are in this file; the nearest in time is shown."
    return Images(found, said if num_images else "", remarks)


def _zero(rows: ShardRows, rollout_id: str) -> list[int]:
    """Branch tick of an attempt, in a list; empty where it has none."""
    table = rows.tables["rollouts"]
    ticks = table.filter(pc.equal(table.column("rollout_id"), rollout_id)).column("branch_tick").to_pylist()
    return [tick for tick in ticks[:1] if tick is not None]
