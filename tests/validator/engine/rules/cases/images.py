"""Defects and limits of what images are by their bytes and pixels."""

from __future__ import annotations

from typing import Any
from zlib import compress, crc32

import numpy as np
from tests.synthetic import BRANCH_TICK, STRIDE
from tests.validator.engine.rules.case import ACCELERATE, BRAKE, NOMINAL, boundary, mutant
from tests.validator.engine.rules.cases.media import AT_BRANCH, END, JPEG, replace_image
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.media import IMAGE_PX, png


def repeat_image(d: Draft, of: dict[str, Any], **where: Any) -> None:
    """Let images of the first shard be those that another row has."""
    (row,) = d.take("frames", **of).to_pylist()
    for column in ("offset_bytes", "checksum"):
        d.set("frames", column, row[column], **where)


# BD-FRM-005

SIDE_PX = (IMAGE_PX[1], IMAGE_PX[0])


COLOURS = np.arange(3 * SIDE_PX[0] * SIDE_PX[1], dtype=np.uint8).reshape(*SIDE_PX, 3)


@mutant("BD-FRM-005", base="media", at={"table": "frames", "tick": BRANCH_TICK, "rollout_id": NOMINAL})
def image_of_another_size(d: Draft) -> None:
    replace_image(d, png(np.repeat(COLOURS, 2, axis=0)), **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"table": "frames", "tick": BRANCH_TICK, "rollout_id": NOMINAL})
def encoding_that_is_not_the_indexed_one(d: Draft) -> None:
    d.set("frames", "encoding", "jpeg", rollout_id=NOMINAL, camera="rear")
    d.drop("frames", rollout_id=NOMINAL, camera="rear", tick=range(BRANCH_TICK))
    d.drop("frames", rollout_id=NOMINAL, camera="rear", tick=range(BRANCH_TICK + 1, END + 1))


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def text_in_place_of_an_image(d: Draft) -> None:
    replace_image(d, b"a picture of the road ahead", **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def image_that_claims_to_be_huge(d: Draft) -> None:
    content = png(COLOURS)
    replace_image(d, content[:16] + (2**31 - 1).to_bytes(4, "big") * 2 + content[24:], **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def grey_image_of_a_colour_camera(d: Draft) -> None:
    replace_image(d, png(COLOURS[..., 0]), **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK})
def jpeg_of_a_thousand_scans(d: Draft) -> None:
    scan = JPEG[JPEG.index(b"\xff\xda") : -2]
    _jpeg_at_branch(d, JPEG[:-2] + scan * 999 + JPEG[-2:])


def _with_chunk(kind: bytes, body: bytes) -> bytes:
    """A sound PNG with one more chunk behind its header."""
    whole = png(COLOURS)
    chunk = len(body).to_bytes(4, "big") + kind + body + crc32(kind + body).to_bytes(4, "big")
    return whole[:33] + chunk + whole[33:]


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def image_with_an_unknown_critical_chunk(d: Draft) -> None:
    replace_image(d, _with_chunk(b"ABCD", b"what no decoder knows"), **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def image_that_is_animated(d: Draft) -> None:
    replace_image(d, _with_chunk(b"acTL", bytes(8)), **AT_BRANCH)


def _turned(order: str = "little") -> bytes:
    """EXIF that says nothing but that the first column is on the right: orientation 2."""
    magic = b"II" if order == "little" else b"MM"
    entry = b"".join(value.to_bytes(size, order) for value, size in ((0x0112, 2), (3, 2), (1, 4), (2, 2), (0, 2)))
    first = (42).to_bytes(2, order) + (8).to_bytes(4, order)
    return magic + first + (1).to_bytes(2, order) + entry + bytes(4)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def image_that_some_readers_mirror(d: Draft) -> None:
    replace_image(d, _with_chunk(b"eXIf", _turned("big")), **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def image_with_exif_in_a_text(d: Draft) -> None:
    profile = compress(b"\nexif\n      26\n" + (b"Exif\0\0" + _turned()).hex().encode())
    replace_image(d, _with_chunk(b"zTXt", b"Raw profile type exif\0\0" + profile), **AT_BRANCH)


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def jpeg_that_some_readers_mirror(d: Draft) -> None:
    exif = b"Exif\0\0" + _turned()
    _jpeg_among_others(d, JPEG[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + JPEG[2:])


@mutant("BD-FRM-005", base="media", at={"tick": BRANCH_TICK, "camera": "rear"})
def jpeg_with_xmp_behind_its_frame(d: Draft) -> None:
    note = b"http://ns.adobe.com/xap/1.0/\0<x tiff:Orientation='3'/>"
    scan = JPEG.index(b"\xff\xda")
    _jpeg_among_others(d, JPEG[:scan] + b"\xff\xe1" + (len(note) + 2).to_bytes(2, "big") + note + JPEG[scan:])


@boundary("BD-FRM-005", "BD-FRM-006", "BD-FRM-008", base="media")
def image_with_a_note_that_unpacks_to_megabytes(d: Draft) -> None:
    replace_image(d, _with_chunk(b"zTXt", b"note\0\0" + compress(bytes(3_000_000), 9)), **AT_BRANCH)


@boundary("BD-FRM-005", "BD-FRM-006", "BD-FRM-008", base="media")
def image_whose_note_speaks_of_exif(d: Draft) -> None:
    replace_image(d, _with_chunk(b"tEXt", b"Comment\0exif, xmp, eXIf: Raw profile type exif"), **AT_BRANCH)


@boundary("BD-FRM-005", "BD-FRM-006", "BD-FRM-008", base="media")
def jpeg_with_a_colour_profile(d: Draft) -> None:
    profile = b"ICC_PROFILE\0\1\1" + bytes(16)
    content = JPEG[:2] + b"\xff\xe2" + (len(profile) + 2).to_bytes(2, "big") + profile + JPEG[2:]
    replace_image(d, content, "jpeg", camera="front", rollout_id=NOMINAL)


@boundary("BD-FRM-005", "BD-FRM-006", "BD-FRM-008", base="media")
def sound_image_in_a_file_of_its_own(d: Draft) -> None:
    replace_image(d, png(COLOURS), **AT_BRANCH)


# BD-FRM-006


@mutant(
    "BD-FRM-006", base="media", at={"table": "frames", "rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"}
)
def image_cut_in_half(d: Draft) -> None:
    replace_image(d, png(COLOURS)[:90], **AT_BRANCH)


@mutant("BD-FRM-006", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def bit_of_an_image_flipped(d: Draft) -> None:
    content = bytearray(png(COLOURS))
    content[80] ^= 1
    replace_image(d, bytes(content), **AT_BRANCH)


@mutant("BD-FRM-006", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def bytes_behind_an_image(d: Draft) -> None:
    replace_image(d, png(COLOURS) + b"more", **AT_BRANCH)


def _jpeg_at_branch(d: Draft, content: bytes) -> None:
    """Let the camera have this one image."""
    replace_image(d, content, "jpeg", camera="rear", rollout_id=NOMINAL)
    d.drop("frames", rollout_id=NOMINAL, camera="rear", tick=range(BRANCH_TICK))
    d.drop("frames", rollout_id=NOMINAL, camera="rear", tick=range(BRANCH_TICK + 1, END + 1))


def _jpeg_among_others(d: Draft, content: bytes) -> None:
    """Let the camera have this image among sound ones of its encoding."""
    replace_image(d, JPEG, "jpeg", file="sound.bin", camera="rear", rollout_id=NOMINAL)
    replace_image(d, content, "jpeg", **AT_BRANCH)


@mutant("BD-FRM-006", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def jpeg_without_a_scan(d: Draft) -> None:
    _jpeg_among_others(d, JPEG[: JPEG.index(b"\xff\xda")] + JPEG[-2:])


@mutant("BD-FRM-006", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def jpeg_with_another_behind_it(d: Draft) -> None:
    _jpeg_among_others(d, JPEG + JPEG)


@boundary("BD-FRM-006", "BD-FRM-008", base="media")
def jpeg_with_an_end_marker_in_its_comment(d: Draft) -> None:
    replace_image(
        d, JPEG[:2] + b"\xff\xfe\x00\x04\xff\xd9" + JPEG[2:] + bytes(2), "jpeg", camera="front", rollout_id=NOMINAL
    )


# BD-FRM-008


@mutant(
    "BD-FRM-008", base="media", at={"table": "frames", "rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"}
)
def image_with_too_few_rows(d: Draft) -> None:
    whole = png(COLOURS[:2])
    replace_image(d, png(COLOURS)[:33] + whole[33:], **AT_BRANCH)


# BD-FRM-010


@mutant("BD-FRM-010", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def image_of_the_observation_before(d: Draft) -> None:
    repeat_image(d, {**AT_BRANCH, "tick": BRANCH_TICK - STRIDE}, **AT_BRANCH)


@mutant("BD-FRM-010", base="media", at={"rollout_id": NOMINAL})
def camera_that_froze(d: Draft) -> None:
    frozen = {**AT_BRANCH, "tick": range(BRANCH_TICK, END + 1)}
    repeat_image(d, {**AT_BRANCH, "tick": BRANCH_TICK - STRIDE}, **frozen)


@mutant("BD-FRM-010", base="media", at={"tick": END - 4 * STRIDE, "camera": "front"})
def image_of_another_candidate(d: Draft) -> None:
    seen = {"camera": "front", "tick": END - 4 * STRIDE}
    repeat_image(d, {"rollout_id": BRAKE, **seen}, rollout_id=ACCELERATE, **seen)


# BD-FRM-011


@mutant("BD-FRM-011", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def black_image(d: Draft) -> None:
    replace_image(d, png(np.zeros_like(COLOURS)), **AT_BRANCH)


@mutant("BD-FRM-011", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def image_of_one_colour(d: Draft) -> None:
    replace_image(d, png(np.full_like(COLOURS, (10, 200, 30))), **AT_BRANCH)


@mutant("BD-FRM-011", base="media", at={"rollout_id": NOMINAL, "tick": BRANCH_TICK, "camera": "rear"})
def image_of_another_camera(d: Draft) -> None:
    repeat_image(d, {**AT_BRANCH, "camera": "front"}, **AT_BRANCH)


@boundary("BD-FRM-010", "BD-FRM-011", base="media")
def nearly_dark_image(d: Draft) -> None:
    dark = np.zeros_like(COLOURS)
    dark[0, 0, 1] = 3
    replace_image(d, png(dark), **AT_BRANCH)


@boundary("BD-FRM-010", "BD-FRM-011", base="media")
def body_that_fills_what_a_camera_sees(d: Draft) -> None:
    beside = {"rollout_id": ACCELERATE, "camera": "rear", "tick": range(END - STRIDE, END + 1)}
    replace_image(d, png(np.full_like(COLOURS, (10, 200, 30))), **beside)
