"""Media rules: the index of images, and which images of a window it has. Source: spec/05-raw-streams.md#media."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch, Mismatches
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.files.survey import Survey
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import EVIDENCE_OFFSETS


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
    found = (shard.media_mismatches for shard in survey.shards)
    yield Check.of_many(sum(shard.num_images for shard in survey.shards), _of_sound_files(survey, found))


@rule("BD-FRM-013")
def archives_hold_the_indexed_images(survey: Survey) -> Iterator[Check]:
    """Archives of media are plain, and hold the images of their rows under their names, and nothing else."""
    archives = [shard.archive_mismatches for shard in survey.shards]
    yield Check.of_many(sum(map(len, archives)), _of_sound_files(survey, archives))


def _of_sound_files(survey: Survey, found: Iterable[Mapping[str, Mismatches]]) -> Iterator[Mismatches]:
    """Mismatches of files that no other rule condemns."""
    for of_shard in found:
        yield from (mismatches for path, mismatches in of_shard.items() if not survey.is_condemned(path))


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


@rule("BD-FRM-007")
def cameras_keep_their_encoding(view: ShardView) -> Iterator[Check]:
    """All images of a camera in an attempt have one encoding."""
    if "frames" not in view:
        return
    frames = view.stream("frames")
    cameras, encodings = frames.categories("camera")[0], frames.categories("encoding")[0]
    order = np.lexsort((np.arange(len(frames)), cameras, frames.rollout))
    begins = np.ones(len(order), bool)
    begins[1:] = (np.diff(frames.rollout[order]) != 0) | (np.diff(cameras[order]) != 0)
    first = order[np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))] if len(order) else order
    differs = np.zeros(len(frames), bool)
    differs[order] = (encodings[order] != encodings[first]) & (frames.rollout[order] >= 0)
    of_first = np.empty(len(frames), np.int64)
    of_first[order] = first
    is_named = frames.valid("encoding")
    differs &= is_named & is_named[of_first]
    yield Check.of_rows(
        "frames",
        "encoding",
        len(frames),
        np.flatnonzero(differs),
        lambda row: (f"{frames['encoding'][of_first[row]]} as before", str(frames["encoding"][row])),
    )


@rule("BD-WIN-006")
def surround_views_are_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """An image of every surround camera at the saved observations of ``t_b - 75 .. t_b + 50``."""
    yield from _covered(view, subjects, STREAMS["rgb_surround"].cameras)


@rule("BD-FRM-004")
def other_views_are_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The same of all other cameras."""
    surround = STREAMS["rgb_surround"].cameras
    cameras = [camera.name for camera in view.descriptor.cameras if camera.name not in surround]
    if cameras:
        yield from _covered(view, subjects, cameras)


def _covered(view: ShardView, subjects: Mask, cameras: Sequence[str]) -> Iterator[Check]:
    """Images of some cameras at the saved observations of the window."""
    if "frames" not in view:
        return
    frames, rollouts = view.stream("frames"), np.flatnonzero(subjects & view.branched)
    ticks = view.branch_tick[rollouts][:, None] + np.asarray(EVIDENCE_OFFSETS)
    owners = np.broadcast_to(rollouts[:, None], ticks.shape)
    is_saved = view.observations.find(owners, ticks) >= 0
    key = (owners << 32) + ticks
    lacks = np.zeros((*ticks.shape, len(cameras)), bool)
    for place, name in enumerate(cameras):
        rows = frames.equals("camera", name) & (frames.rollout >= 0)
        lacks[..., place] = is_saved & ~np.isin(key, (frames.rollout[rows] << 32) + frames.tick[rows])
    judged, bad = (np.zeros(view.num_rollouts, bool) for _ in range(2))
    judged[rollouts] = is_saved.any(axis=1)
    bad[rollouts] = lacks.any(axis=(1, 2))
    place_of = {int(rollout): place for place, rollout in enumerate(rollouts)}

    def describe(i: int) -> Mismatch:
        own = lacks[place_of[i]]
        moment = int(np.argmax(own.any(axis=1)))
        names = [name for name, lacking in zip(cameras, own[moment], strict=True) if lacking]
        place: Location = {"table": "frames", "tick": int(ticks[place_of[i], moment])}
        return Mismatch(place, f"an image of {', '.join(names)}", "none", int(own.sum()))

    yield Check.of_subjects(judged, bad, describe)
