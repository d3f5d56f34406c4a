"""`MediaArchive`: USTAR files that other programs read, with equal bytes for equal images."""

from __future__ import annotations

import tarfile
from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.formats.media_archive import HEADER_BYTES, MAX_CAMERA_NAME, MediaArchive, holds_member, member_name

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


@pytest.mark.parametrize("form", [tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_members_of_archives_of_any_program_have_a_header(form: int) -> None:
    stream = BytesIO()
    member = tarfile.TarInfo("drive/" + "long/" * 40 + "000080.front.png")
    member.size = 700
    with tarfile.open(fileobj=stream, mode="w", format=form) as tar:
        tar.addfile(member, BytesIO(bytes(700)))
    content = stream.getvalue()
    with tarfile.open(fileobj=BytesIO(content)) as tar:
        offset = tar.getmembers()[0].offset_data
    header = content[offset - HEADER_BYTES : offset]
    assert holds_member(header, 700)
    assert not holds_member(header, 699)
    assert not holds_member(b"?" + header[1:], 700)
    assert not holds_member(header[1:], 700)


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.CHRTYPE])
def test_links_folders_and_devices_are_no_members_with_bytes(kind: bytes) -> None:
    member = tarfile.TarInfo("front.png")
    member.type, member.size = kind, 700
    assert not holds_member(member.tobuf(tarfile.USTAR_FORMAT), 700)
