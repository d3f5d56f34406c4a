"""`MediaArchive`: USTAR files that other programs read, with equal bytes for equal images."""

from __future__ import annotations

import tarfile
from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.formats.media_archive import (
    MAX_CAMERA_NAME,
    MediaArchive,
    Member,
    block_text,
    member_header,
    member_name,
    read_member,
)

names = st.builds(
    member_name,
    st.from_regex(r"[a-z0-9][a-z0-9._-]{0,127}", fullmatch=True),
    st.integers(0, 1_000_000),
    st.from_regex(rf"[a-z0-9][a-z0-9._-]{{0,{MAX_CAMERA_NAME - 1}}}", fullmatch=True),
    st.sampled_from(["jpeg", "png"]),
)


def archived(images: dict[str, bytes]) -> tuple[bytes, list[int]]:
    stream = BytesIO()
    archive = MediaArchive(stream)
    offsets = [archive.add(name, image) for name, image in images.items()]
    archive.end()
    assert archive.num_bytes == len(stream.getvalue())
    return stream.getvalue(), offsets


@given(st.dictionaries(names, st.binary(max_size=1500), max_size=5))
def test_every_member_is_read_back_and_lies_where_it_was_said(images: dict[str, bytes]) -> None:
    content, offsets = archived(images)
    with tarfile.open(fileobj=BytesIO(content), mode="r:") as tar:
        members = tar.getmembers()
        assert [member.name for member in members] == list(images)
        assert [member.offset_data for member in members] == offsets
        assert all((m.mtime, m.uid, m.gid, m.mode, m.uname, m.gname) == (0, 0, 0, 0o644, "", "") for m in members)
    for offset, image in zip(offsets, images.values(), strict=True):
        assert content[offset : offset + len(image)] == image


def test_bytes_depend_on_the_members_alone() -> None:
    images = {member_name("g0.nominal.a1", 80, "front", "jpeg"): b"a" * 700}
    assert archived(images) == archived(images)


def test_members_of_an_observation_are_one_sample_of_webdataset() -> None:
    both = [member_name("g0.nominal.v1.a1", 80, camera, "png") for camera in ("front", "rear_left")]
    assert both == ["g0.nominal.v1.a1/000080.front.png", "g0.nominal.v1.a1/000080.rear_left.png"]
    assert len({name.rpartition("/")[2].partition(".")[0] for name in both}) == 1


def test_longer_names_of_cameras_do_not_fit() -> None:
    with pytest.raises(ValueError, match="too long"):
        MediaArchive(BytesIO()).add(member_name("a" * 128, 1_000_000, "c" * (MAX_CAMERA_NAME + 1), "jpeg"), b"")


@pytest.mark.parametrize("form", [tarfile.USTAR_FORMAT, tarfile.PAX_FORMAT])
def test_members_of_archives_of_other_programs_are_plain(form: int) -> None:
    member = tarfile.TarInfo("g0.nominal.a1/000080.front.png")
    member.size, member.mtime, member.uid, member.uname = 700, 1_700_000_000, 1000, "me"
    header = member.tobuf(form)
    assert read_member(header) == Member(member.name, 700)
    assert read_member(b"?" + header[1:]) is None
    assert read_member(header[1:]) is None


@given(names, st.integers(0, 2**33 - 1))
def test_the_header_of_a_member_is_that_of_python(name: str, num_bytes: int) -> None:
    member = tarfile.TarInfo(name)
    member.size = num_bytes
    header = member_header(name, num_bytes)
    assert header == member.tobuf(tarfile.USTAR_FORMAT)
    assert read_member(header) == Member(name, num_bytes)


@given(st.binary(min_size=512, max_size=512), st.integers(0, 511))
def test_any_block_is_a_plain_member_or_none(block: bytes, place: int) -> None:
    assert read_member(block) is None
    header = member_header("g0.nominal.a1/000080.front.png", 700)
    changed = header[:place] + block[:1] + header[place + 1 :]
    assert (read_member(changed) is None) == (changed != header)
    for one in (block, changed, b"", bytes(512)):
        assert block_text(one).isprintable()
