"""What is rendered: which cameras, at which observations, and the descriptor of the dataset that has their images."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import STREAMS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.timing import WINDOW_OFFSETS
from branchdrive.errors import UsageError
from branchdrive_reference.rendering.encoding import JPEG_QUALITY
from branchdrive_reference.rendering.opencv import OPENCV_VERSION

__all__ = ["MediaPlan", "Window", "check_renderable", "plan_text", "with_media"]

Window = Literal["branch", "all"]
"""The observations around the branch that models read, or every one."""

_NEEDED = {"map": "where roads are", "actor_risk_evidence": "who is around the ego"}


@dataclass(frozen=True)
class MediaPlan:
    """What is rendered of every rollout.

    Attributes:
        cameras: The cameras.
        window: At which observations.
    """

    cameras: tuple[Camera, ...]
    window: Window = "branch"

    @property
    def offsets(self) -> Sequence[int] | None:
        """Ticks of the observations since the branch; ``None`` for every observation."""
        return WINDOW_OFFSETS if self.window == "branch" else None

    def document(self) -> bytes:
        """The plan as JSON: images of another plan are not those of this one."""
        cameras = [camera.model_dump(mode="json") for camera in self.cameras]
        versions = {"branchdrive": version("branchdrive"), "opencv": OPENCV_VERSION}
        return dump_json({"cameras": cameras, "jpeg_quality": JPEG_QUALITY, "window": self.window, **versions})


def plan_text(document: bytes) -> str:
    """What `MediaPlan.document` says, in a line; what follows the document is passed over."""
    try:
        plan, _ = json.JSONDecoder().raw_decode(document.decode())
        cameras = ", ".join(f"{c['name']} {c['width_px']}x{c['height_px']}" for c in plan["cameras"])
        settings = f"window {plan['window']}, JPEG quality {plan['jpeg_quality']}, OpenCV {plan['opencv']}"
        return f"{cameras} ({settings}, branchdrive {plan['branchdrive']})"
    except (ValueError, KeyError, TypeError, RecursionError):
        return "a plan that cannot be read"


def check_renderable(descriptor: Descriptor) -> None:
    """Refuse a dataset of which nothing can be rendered.

    Raises:
        UsageError: It lacks a stream that images are drawn from, or holds no raw layer.
    """
    if not descriptor.has_raw:
        raise UsageError(
            f"{descriptor.dataset_id!r} holds no raw layer, which images are drawn from; render the raw one"
        )
    for stream, meaning in _NEEDED.items():
        if stream not in descriptor.streams:
            raise UsageError(
                f"{descriptor.dataset_id!r} claims no stream `{stream}`, which tells {meaning}: nothing can be drawn "
                "without it; let the collector record it"
            )


def with_media(descriptor: Descriptor, plan: MediaPlan) -> Descriptor:
    """The descriptor with the streams and cameras of the plan.

    Raises:
        UsageError: It has media already, or layers that were built without them.
    """
    claimed = [name for name in descriptor.streams if STREAMS[name].cameras]
    if claimed:
        raise UsageError(
            f"{descriptor.dataset_id!r} has media already: {', '.join(claimed)}; they stay as they are; "
            "for others, render the dataset without media into another folder with `--output DIR`"
        )
    added = {camera.stream for camera in plan.cameras}
    streams = [name for name in STREAMS if name in descriptor.streams or name in added]
    document = descriptor.model_dump(mode="json")
    cameras = [camera.model_dump(mode="json") for camera in plan.cameras]
    return Descriptor.model_validate({**document, "streams": streams, "cameras": cameras})
