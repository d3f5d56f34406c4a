"""Faults of cameras that a collection can inject where images are rendered, each with a rate that it declares.

An attempt has one of them at most: the first whose draw succeeds, in the order below. Draws are functions of the
collection's seed and of the identity of the attempt alone, so that images may be rendered later and again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import pairwise
from typing import TypeAlias

from branchdrive.contract.descriptor import Collection
from branchdrive.formats.image_header import read_header
from branchdrive_reference.noise import Purpose, uniform

__all__ = ["DESCRIPTIONS", "ImageFault", "Images", "drawn_image_fault", "with_drawn_fault", "with_image_fault"]

Images: TypeAlias = dict[tuple[int, str], bytes]
"""Encoded images of an attempt by tick and camera."""


class ImageFault(StrEnum):
    """Name of a fault, as the descriptor has it."""

    DROPPED = "image_dropped"
    DAMAGED = "image_damaged"
    LATE = "image_late"
    DUPLICATED = "image_duplicated"
    SWAPPED = "image_swapped"


DESCRIPTIONS: Mapping[ImageFault, str] = {
    ImageFault.DROPPED: "per attempt: one image of one camera is missing",
    ImageFault.DAMAGED: "per attempt: one image of one camera is cut short",
    ImageFault.LATE: "per attempt: from some observation on, one camera shows the observation before",
    ImageFault.DUPLICATED: "per attempt: one image of one camera is that of the observation before",
    ImageFault.SWAPPED: "per attempt: at one observation, two cameras show what the other sees",
}
"""What a rate counts, and what the fault does."""


def with_drawn_fault(images: Images, cameras: Sequence[str], rollout_id: str, collection: Collection) -> Images:
    """Images of an attempt as its cameras give them, with the fault that is drawn for it, if one is.

    Args:
        images: The images.
        cameras: Cameras with images of one size, of which a fault takes one; those without images take none.
        rollout_id: Identity of the attempt.
        collection: What the collection switched on: its seed and its rates.
    """
    fault = drawn_image_fault(rollout_id, collection.seed, collection.faults)
    own = tuple(camera for camera in cameras if any(name == camera for _, name in images))
    if fault is None or len(own) < 2:
        return images
    return with_image_fault(images, own, fault, rollout_id, collection.seed)


def drawn_image_fault(rollout_id: str, seed: int, rates: Mapping[str, float]) -> ImageFault | None:
    """The fault of an attempt; ``None`` if it has none.

    Args:
        rollout_id: Identity of the attempt.
        seed: Seed of the collection.
        rates: Rates by the name of a fault.
    """
    key = _key(rollout_id)
    for fault in ImageFault:
        rate = rates.get(fault, 0.0)
        if rate > 0 and uniform(seed, int(Purpose[f"FAULT_IMAGE_{fault.name}"]), key) < rate:
            return fault
    return None


def with_image_fault(images: Images, cameras: tuple[str, ...], fault: ImageFault, rollout_id: str, seed: int) -> Images:
    """Images of an attempt as a camera with the fault gives them; where and when is drawn.

    Args:
        images: The images.
        cameras: Cameras with images of one size, of which one is drawn; two at least.
        fault: The fault.
        rollout_id: Identity of the attempt.
        seed: Seed of the collection.
    """
    key = _key(rollout_id)
    ticks = sorted({tick for tick, camera in images if camera in cameras})
    if len(ticks) < 2:
        return images
    # The first observation has none before it.
    number = 1 + int(uniform(seed, int(Purpose.FAULT_IMAGE_TICK), key) * (len(ticks) - 1))
    place = int(uniform(seed, int(Purpose.FAULT_IMAGE_CAMERA), key) * len(cameras))
    return _EFFECTS[fault](images, ticks, number, cameras[place], cameras[(place + 1) % len(cameras)])


def _key(rollout_id: str) -> int:
    return int.from_bytes(hashlib.sha256(rollout_id.encode()).digest()[:7], "little")


def _dropped(images: Images, ticks: list[int], number: int, camera: str, _: str) -> Images:
    return {at: image for at, image in images.items() if at != (ticks[number], camera)}


def _damaged(images: Images, ticks: list[int], number: int, camera: str, _: str) -> Images:
    image = images[ticks[number], camera]
    kept = min(max(len(image) // 2, read_header(image).num_bytes), len(image) - 1)
    return {**images, (ticks[number], camera): image[:kept]}


def _late(images: Images, ticks: list[int], number: int, camera: str, _: str) -> Images:
    late = {(tick, camera): images[before, camera] for before, tick in pairwise(ticks[number - 1 :])}
    return {**images, **late}


def _duplicated(images: Images, ticks: list[int], number: int, camera: str, _: str) -> Images:
    return {**images, (ticks[number], camera): images[ticks[number - 1], camera]}


def _swapped(images: Images, ticks: list[int], number: int, camera: str, other: str) -> Images:
    at, of_other = (ticks[number], camera), (ticks[number], other)
    return {**images, at: images[of_other], of_other: images[at]}


_EFFECTS: Mapping[ImageFault, Callable[[Images, list[int], int, str, str], Images]] = {
    ImageFault.DROPPED: _dropped,
    ImageFault.DAMAGED: _damaged,
    ImageFault.LATE: _late,
    ImageFault.DUPLICATED: _duplicated,
    ImageFault.SWAPPED: _swapped,
}
