"""Image rules: what images are by their bytes and pixels, and whether they show what is recorded beside them.

What pixels say is judged on the images that were decoded; where these are not all, a rule says so and has not passed.
Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.raw.media.images import Images
from branchdrive.raw.motion.contact import bodies_within
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import demand_strips
from branchdrive.tables.view import StreamView

Index = NDArray[np.int64]


def _images(view: ShardView) -> Images:
    """Facts of the images of the shard.

    Raises:
        PreconditionError: They were not read.
    """
    if view.images is None:
        raise PreconditionError("the media files were not read")
    return view.images


def _found_in(view: ShardView, stored_rows: Iterable[int]) -> Mask:
    """Rows of the view that are among rows of the stored index."""
    marked = np.zeros(len(view.stream("frames")), bool)
    marked[[*stored_rows]] = True
    return marked[view.stream("frames").position]


def _place(frames: StreamView, row: int) -> Location:
    """Place of an image."""
    return {"table": "frames", "tick": int(frames.tick[row]), "camera": str(frames["camera"][row])}


def _may_be_filled(view: ShardView) -> Mask:
    """Images at whose observation a recorded body is so near that its side may be all that a camera sees."""
    frames = view.stream("frames")
    found = np.zeros(len(frames), bool)
    if "actors" in view:
        at = view.observations.find(frames.rollout, frames.tick)
        moments, moment = np.unique(at[at >= 0], return_inverse=True)
        is_near = np.zeros(len(moments), bool)
        is_near[bodies_within(view, moments, physical_bounds().filled_m)[0]] = True
        found[at >= 0] = is_near[moment]
    return found


def _is_of_map(view: ShardView) -> Mask:
    """Rows of cameras of semantic maps."""
    codes, names = view.stream("frames").categories("camera")
    of_maps = {camera.name for camera in view.descriptor.cameras if camera.stream == "semantic_bev"}
    return np.array([name in of_maps for name in names] + [False])[codes]


def _demand_all(images: Images, of: Mask) -> None:
    """Let a rule end here where not all pixels that it judges were looked at.

    Raises:
        PreconditionError: They were not.
    """
    if images.unjudged and (of & images.is_read & ~images.is_decoded).any():
        raise PreconditionError(images.unjudged)


@rule("BD-FRM-005")
def images_have_their_form(view: ShardView) -> Iterator[Check]:
    """Encoding, channels and size of every image are those of its index and camera."""
    if "frames" not in view:
        return
    images, frames = _images(view), view.stream("frames")
    yield Check.of_rows(
        "frames",
        None,
        int(images.is_read.sum()),
        np.flatnonzero(_found_in(view, images.form)),
        lambda row: images.form[int(frames.position[row])],
    )


@rule("BD-FRM-006")
def images_are_whole(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Every image of an attempt has all of its bytes."""
    if "frames" not in view:
        return
    images, frames = _images(view), view.stream("frames")
    has_images = frames.by_rollout(images.is_read[frames.position]).any
    damaged = frames.by_rollout(_found_in(view, images.damaged))

    def describe(i: int) -> Mismatch:
        row = int(damaged.first_row[i])
        return Mismatch(_place(frames, row), *images.damaged[int(frames.position[row])], int(damaged.count[i]))

    yield Check.of_subjects(subjects & has_images, subjects & damaged.any, describe, damaged.stretch)


@rule("BD-FRM-008")
def images_decode(view: ShardView) -> Iterator[Check]:
    """No decoder raises an error over an image; one of JPEG fills lost data with grey and raises none."""
    if "frames" not in view:
        return
    images, frames = _images(view), view.stream("frames")
    yield Check.of_rows(
        "frames",
        None,
        int(images.is_decoded.sum()),
        np.flatnonzero(_found_in(view, images.undecodable)),
        lambda row: ("an image that a decoder reads without an error", images.undecodable[int(frames.position[row])]),
    )
    _demand_all(images, np.ones(len(frames), bool))


def _against(view: ShardView, subject: str) -> Iterator[Check]:
    """What semantic maps contradict of a subject, as `Images.maps` has it."""
    if "frames" not in view:
        return
    images, frames = _images(view), view.stream("frames")
    comparison = images.maps[subject]
    contradicted = comparison.contradicted
    yield Check.of_rows(
        "frames",
        None,
        int(comparison.is_compared.sum()),
        np.flatnonzero(_found_in(view, contradicted)),
        lambda row: contradicted[int(frames.position[row])],
    )
    of_maps = np.zeros(len(frames), bool)
    of_maps[frames.position] = _is_of_map(view)
    _demand_all(images, of_maps)


@rule("BD-FRM-009")
def maps_show_recorded_vehicles(view: ShardView) -> Iterator[Check]:
    """Vehicles of semantic maps are the recorded ones, and their classes are those that there are."""
    yield from _against(view, "vehicles")


@rule("BD-FRM-012")
def maps_show_recorded_ground(view: ShardView) -> Iterator[Check]:
    """Semantic maps show the road and the route that are recorded."""
    yield from _against(view, "ground")
    if "frames" in view and "map" in view:
        demand_strips(view)


@rule("BD-FRM-016")
def maps_show_recorded_people(view: ShardView) -> Iterator[Check]:
    """People of semantic maps are the recorded ones."""
    yield from _against(view, "people")


@rule("BD-FRM-017")
def maps_show_recorded_signs(view: ShardView) -> Iterator[Check]:
    """Lights and stop signs of semantic maps are at recorded ones, and that of the ego's lane has its colour."""
    yield from _against(view, "signs")


@rule("BD-FRM-010")
def images_follow_the_drive(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No image of a camera is repeated in its group where the ego stands elsewhere and nothing fills its view."""
    if "frames" not in view:
        return
    frames = view.stream("frames")
    at = view.observations.find(frames.rollout, frames.tick)
    is_view = (at >= 0) & ~_is_of_map(view) & ~_may_be_filled(view)
    rows = np.flatnonzero(is_view)
    x, y = (view.observations[name][at[rows]].astype(np.float64) for name in ("x_m", "y_m"))
    group = view.group[frames.rollout[rows]]
    camera, checksum = (frames.categories(name)[0][rows] for name in ("camera", "checksum"))
    order = np.lexsort((frames.rollout[rows], frames.tick[rows], checksum, camera, group))
    first = order[_first_of_equal(group[order], camera[order], checksum[order])]
    moved = np.hypot(x[order] - x[first], y[order] - y[first]) >= physical_bounds().moved_m
    original = dict(zip(rows[order[moved]].tolist(), rows[first[moved]].tolist(), strict=True))
    repeated = np.zeros(len(frames), bool)
    repeated[[*original]] = True
    summary, has_images = frames.by_rollout(repeated), frames.by_rollout(is_view).any

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        of = original[row]
        place = _place(frames, row)
        where = f"tick {frames.tick[of]} of {view.rollout_ids[frames.rollout[of]]}"
        expected = f"another image of {frames['camera'][row]} than at {where}, elsewhere"
        found = "the same bytes: one of the two shows another place"
        return Mismatch(place, expected, found, int(summary.count[i]))

    yield Check.of_subjects(subjects & has_images, subjects & summary.any, describe, summary.stretch)


def _first_of_equal(*keys: NDArray[np.integer]) -> Index:
    """Place of the first of each run of equal keys ``[rows]``."""
    begins = np.ones(len(keys[0]), bool)
    begins[1:] = np.logical_or.reduce([key[1:] != key[:-1] for key in keys])
    return np.maximum.accumulate(np.where(begins, np.arange(len(begins)), 0))


@rule("BD-FRM-011")
def images_show_something_of_their_own(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No image is of one colour, and none is that of another camera then, where nothing fills a view."""
    if "frames" not in view:
        return
    frames, of_maps = view.stream("frames"), _is_of_map(view)
    is_view = ~of_maps & ~_may_be_filled(view)
    rows = np.flatnonzero((frames.rollout >= 0) & is_view)
    checksum = frames.categories("checksum")[0][rows]
    order = np.lexsort((checksum, frames.tick[rows], frames.rollout[rows]))
    first = order[_first_of_equal(frames.rollout[rows][order], frames.tick[rows][order], checksum[order])]
    is_copy = order != first
    copies = dict(zip(rows[order[is_copy]].tolist(), rows[first[is_copy]].tolist(), strict=True))
    flat = _found_in(view, _images(view).flat) if view.images else np.zeros(len(frames), bool)
    bad = flat & is_view
    bad[[*copies]] = True
    summary, has_images = frames.by_rollout(bad), frames.by_rollout(is_view).any

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        place = _place(frames, row)
        found = "one colour" if flat[row] else f"the image of {frames['camera'][copies[row]]}"
        return Mismatch(place, f"what {frames['camera'][row]} sees", found, int(summary.count[i]))

    yield Check.of_subjects(subjects & has_images, subjects & summary.any, describe, summary.stretch)
    stored = np.zeros(len(frames), bool)
    stored[frames.position] = ~of_maps
    _demand_all(_images(view), stored)
