"""Defects and limits of the index of images, and of which images a window has."""

from __future__ import annotations

import hashlib
from base64 import b64decode
from typing import Any

from tests.synthetic import BRANCH_TICK, STRIDE, WINDOW_TICKS
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    SHARD_0,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import STREAMS
from branchdrive.testing.media import media_document, view

END = BRANCH_TICK + WINDOW_TICKS


EXTRA_FILE = "extra.bin"


LAST = "g1.brake_0.50.a2"
"""The attempt whose images end a file."""


AT_BRANCH = {"rollout_id": NOMINAL, "camera": "rear", "tick": BRANCH_TICK}
"""The image that most cases replace."""


JPEG = b64decode(
    "/9j/4AAQSkZJRgABAQAAAQABAAD/2wBDABQODxIPDRQSEBIXFRQYHjIhHhwcHj0sLiQySUBMS0dARkVQWnNiUFVtVkVGZIhlbXd7gYKBTmCN"
    "l4x9lnN+gXz/2wBDARUXFx4aHjshITt8U0ZTfHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHx8fHz/wAAR"
    "CAAEAAgDASIAAhEBAxEB/8QAFQABAQAAAAAAAAAAAAAAAAAAAAH/xAAYEAEBAAMAAAAAAAAAAAAAAAAABAUhI//EABQBAQAAAAAAAAAAAAAA"
    "AAAAAAD/xAAUEQEAAAAAAAAAAAAAAAAAAAAA/9oADAMBAAIRAxEAPwCz4iPXMAH/2Q=="
)
"""A baseline JPEG of the size of the cameras."""


def replace_image(
    d: Draft, content: bytes, encoding: str | None = None, *, file: str = EXTRA_FILE, **where: Any
) -> None:
    """Give images of the first shard other bytes, in a file of their own."""
    row = {
        "file": file, "offset_bytes": 0, "size_bytes": len(content),
        "checksum": hashlib.sha256(content).hexdigest()[:16], **({"encoding": encoding} if encoding else {}),
    }  # fmt: skip
    for column, value in row.items():
        d.set("frames", column, value, **where)
    d.before_seal(lambda root: (root / SHARD_0 / file).write_bytes(content))


def unseen(number: int = 0) -> bytes:
    """A sound image that no attempt has."""
    return view(5000 + number)


# BD-FRM-002


@mutant("BD-FRM-002", base="media", at={"table": "frames", "rollout_id": NOMINAL, "camera": "rear"})
def checksum_of_another_image(d: Draft) -> None:
    d.set("frames", "checksum", "0" * 16, **AT_BRANCH)


@mutant("BD-FRM-002", base="media", at={"table": "frames", "rollout_id": LAST, "tick": END})
def image_that_ends_behind_its_file(d: Draft) -> None:
    d.set("frames", "offset_bytes", lambda v: v + 1, rollout_id=LAST, camera="rear_right", tick=END)


@mutant("BD-FRM-002", base="media", at={"file": "raw/shard-00001/elsewhere.bin"})
def image_in_a_file_that_is_not_there(d: Draft) -> None:
    d.set("frames", "file", "elsewhere.bin", rollout_id="g2.nominal.a1", camera="rear", tick=BRANCH_TICK)


@mutant("BD-FRM-002", base="media", at={"file": f"{SHARD_0}/{EXTRA_FILE}"})
def images_that_overlap(d: Draft) -> None:
    content = bytes(range(200))
    for offset, camera in enumerate(("front", "rear", "rear_left")):
        where = {**AT_BRANCH, "camera": camera}
        replace_image(d, content, **where)
        d.set("frames", "offset_bytes", offset, **where)
        d.set("frames", "size_bytes", len(content) - 2, **where)


@boundary("BD-FRM-002", base="media")
def image_that_is_a_whole_file(d: Draft) -> None:
    replace_image(d, unseen(), **AT_BRANCH)


# BD-FRM-003


@mutant("BD-FRM-003", base="media", at={"table": "frames", "rollout_id": NOMINAL, "camera": "rear"})
def two_images_of_one_camera(d: Draft) -> None:
    d.duplicate("frames", **AT_BRANCH)


@mutant("BD-FRM-003", base="media", at={"table": "frames", "rollout_id": NOMINAL, "tick": 3, "camera": "rear"})
def image_between_observations(d: Draft) -> None:
    d.set("frames", "tick", 3, **AT_BRANCH)


@boundary("BD-FRM-003", base="media")
def image_at_the_first_observation(d: Draft) -> None:
    d.duplicate("frames", {"tick": 0}, **AT_BRANCH)


# BD-WIN-006


@mutant("BD-WIN-006", base="media", at={"rollout_id": NOMINAL, "table": "frames", "tick": BRANCH_TICK})
def one_view_missing_at_the_branch(d: Draft) -> None:
    d.drop("frames", **AT_BRANCH)


@mutant("BD-WIN-006", base="media", at={"rollout_id": BRAKE, "tick": END})
def no_view_at_the_last_frame(d: Draft) -> None:
    d.drop("frames", rollout_id=BRAKE, tick=END)


@mutant("BD-WIN-006", base="media", at={"rollout_id": BRAKE, "tick": BRANCH_TICK - 75})
def no_views_of_an_attempt(d: Draft) -> None:
    d.drop("frames", rollout_id=BRAKE)


@boundary("BD-WIN-006", base="media")
def views_beyond_the_window(d: Draft) -> None:
    d.duplicate("frames", {"tick": END + STRIDE}, rollout_id=NOMINAL, tick=END)


# BD-FRM-004


@mutant("BD-FRM-004", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK - 75}, findings=46)
def camera_from_above_without_images(d: Draft) -> None:
    d.descriptor["streams"].append("rgb_top_down")
    d.descriptor["cameras"] += media_document({"streams": []}, "rgb_top_down")["cameras"]


@boundary("BD-FRM-004", base="media")
def camera_from_above_in_every_frame(d: Draft) -> None:
    d.descriptor = {**d.descriptor, **media_document(d.descriptor, "rgb_top_down")}
    d.descriptor["streams"].remove("rgb_surround")
    d.set("frames", "camera", "top_down", camera="front")
    d.drop("frames", camera=list(STREAMS["rgb_surround"].cameras))


# BD-FRM-007


@mutant("BD-FRM-007", base="media", at={"table": "frames", "column": "encoding", "tick": BRANCH_TICK, "camera": "rear"})
def camera_that_changes_its_encoding(d: Draft) -> None:
    replace_image(d, JPEG, "jpeg", **AT_BRANCH)


@boundary("BD-FRM-007", "BD-FRM-005", "BD-FRM-008", base="media")
def cameras_with_encodings_of_their_own(d: Draft) -> None:
    replace_image(d, JPEG, "jpeg", camera="front", rollout_id=NOMINAL)


# BD-FRM-001


@mutant("BD-FRM-001", at={"table": "frames", "column": "camera", "rollout_id": NOMINAL}, base="media")
def camera_that_is_not_declared(d: Draft) -> None:
    d.set("frames", "camera", "drone", rollout_id=NOMINAL, camera="rear", tick=BRANCH_TICK)


# Several places: what violates a rule is counted


@mutant("BD-FRM-002", base="media", at={"rollout_id": FURTHER, "camera": "rear"}, findings=2)
def checksums_of_two_other_images(d: Draft) -> None:
    d.set("frames", "checksum", "0" * 16, rollout_id=BOTH, camera="rear", tick=BRANCH_TICK)
