"""Media rules: the index of images. Source: spec/05-raw-streams.md#media."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.audit.check import RowCheck, shard_rule
from branchdrive.audit.finding import quote
from branchdrive.audit.view import ShardView


@shard_rule("BD-FRM-001")
def cameras_are_declared(view: ShardView) -> Iterator[RowCheck]:
    """Every image names a camera of the descriptor."""
    if "frames" in view:
        frames = view.stream("frames")
        codes, words = frames.words("camera")
        declared = {camera.name for camera in view.descriptor.cameras}
        unknown = np.array([word not in declared for word in words] + [False])
        yield RowCheck(
            "frames", "camera", len(frames), np.flatnonzero(unknown[codes]),
            lambda row: (f"one of {sorted(declared)}", quote(frames["camera"][row])),
        )  # fmt: skip
