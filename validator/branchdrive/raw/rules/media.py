"""Media rules: the index of images. Source: spec/05-raw-streams.md#media."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.mismatch import Check
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.files.survey import Survey
from branchdrive.raw.shard_view import ShardView


@rule("BD-FRM-001")
def cameras_are_declared(view: ShardView) -> Iterator[Check]:
    """Every image names a camera of the descriptor."""
    if "frames" in view:
        frames = view.stream("frames")
        codes, cameras = frames.categories("camera")
        declared = {camera.name for camera in view.descriptor.cameras}
        unknown = np.array([camera not in declared for camera in cameras] + [False])
        yield Check.of_rows(
            "frames",
            "camera",
            len(frames),
            np.flatnonzero(unknown[codes]),
            lambda row: (f"one of {sorted(declared)}", quote(frames["camera"][row])),
        )


@rule("BD-FRM-002")
def images_are_where_the_index_says(survey: Survey) -> Iterator[Check]:
    """File, offset, size and checksum of every indexed image; a condemned file is not blamed twice."""
    found = [
        mismatch
        for shard in survey.shards
        for mismatch in shard.media_mismatches
        if not survey.is_condemned(str(mismatch.location["file"]))
    ]
    yield Check.of(sum(shard.num_images for shard in survey.shards), tuple(found))


@rule("BD-FRM-003")
def images_belong_to_observations(view: ShardView) -> Iterator[Check]:
    """One image per camera and saved observation."""
    if "frames" in view:
        frames = view.stream("frames")
        has_rollout = frames.rollout >= 0
        orphan = has_rollout & (view.observations.find(frames.rollout, frames.tick) < 0)
        camera = np.unique(frames["camera"], return_inverse=True)[1]
        repeated = frames.repeats_with(camera) & has_rollout
        yield Check.of_rows(
            "frames",
            None,
            len(frames),
            np.flatnonzero(orphan | repeated),
            lambda row: ("one image per camera, at an observation", "none" if orphan[row] else "a second image"),
        )
