"""Archives followed from their first byte to their last: sound ones of any program pass, others have a finding."""

from __future__ import annotations

from io import BufferedReader, BytesIO

from hypothesis import given
from hypothesis import strategies as st
from tests.archives import FOREIGN, HOSTILE, Images, Writer, plain
from tests.each import each

from branchdrive.contract.mismatch import Mismatch, Mismatches
from branchdrive.formats.file_part import FilePart
from branchdrive.formats.media_archive import member_name
from branchdrive.raw.media.archive_walk import ArchiveWalk
from branchdrive.raw.media.image_claims import ImageKey

PATH = "raw/shard-00000/media.tar"
KEYS = [ImageKey("g0.nominal.a1", tick, camera) for tick in (75, 80) for camera in ("front", "rear")]
IMAGES: Images = [(member_name(*key, "png"), bytes([place + 1]) * 300 * place) for place, key in enumerate(KEYS, 1)]


def walked(content: bytes, offsets: list[int], images: Images = IMAGES, *, is_hashed: bool = True) -> list[Mismatch]:
    """What is found in an archive of images of `KEYS`."""
    found = Mismatches()
    walk = ArchiveWalk(PATH, FilePart(BufferedReader(BytesIO(content)), is_hashed), found)  # type: ignore[type-var]
    for offset, key, (_, image) in sorted(zip(offsets, KEYS, images, strict=True)):
        walk.member(offset, len(image), [key], "png")
    walk.end(len(content))
    assert found.num == len(found.first)
    return found.first


@each("write", [plain, *FOREIGN.values()], ids=["plain", *FOREIGN])
def test_sound_archives_of_any_program_pass(write: Writer) -> None:
    assert walked(*write(IMAGES)) == walked(*write(IMAGES), is_hashed=False) == []


@each("write", HOSTILE.values(), ids=HOSTILE)
def test_whatever_programs_read_differently_is_found(write: Writer) -> None:
    content, offsets = write(IMAGES)
    assert all(content[at:].startswith(image) for at, (_, image) in zip(offsets, IMAGES, strict=True))
    found = walked(content, offsets)
    assert found
    assert found == walked(content, offsets, is_hashed=False)
    assert all(one.location["file"] == PATH and one.expected != one.found for one in found)


@given(st.data())
def test_every_byte_of_an_archive_but_those_of_images_is_accounted_for(data: st.DataObject) -> None:
    content, offsets = plain(IMAGES)
    inside = [range(at, at + len(image)) for at, (_, image) in zip(offsets, IMAGES, strict=True)]
    place = data.draw(st.integers(0, len(content) - 1).filter(lambda at: not any(at in one for one in inside)))
    value = data.draw(st.integers(1, 255))
    assert walked(content[:place] + bytes([content[place] ^ value]) + content[place + 1 :], offsets)


@given(st.integers(0, 20_000), st.integers(-3, 40))
def test_an_archive_ends_in_two_blocks_and_at_a_record(cut: int, more: int) -> None:
    content, offsets = plain(IMAGES)
    needed = len(content.rstrip(b"\0"))
    needed += -needed % 512 + 1024
    size = min(needed + cut, len(content)) if more < 0 else len(content) + 512 * more
    is_sound = needed <= size <= len(content) and size % 512 == 0
    assert (not walked(content[:size] + bytes(max(size - len(content), 0)), offsets)) == is_sound


def test_images_that_overlap_are_found_once_each() -> None:
    content, offsets = plain(IMAGES)
    found = walked(content, [offsets[0], offsets[0] + 1, *offsets[2:]])
    assert [one.found for one in found][:1] == [f"one from {offsets[0] + 1}"]
