"""Archives of stored members: read where they are, and none of those that say two things."""

from __future__ import annotations

import contextlib
import pickle
import struct
import tempfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.bucket_server import serving, use
from tests.validator.formats.zip_file import END, Member, ZipFile

from branchdrive.errors import DatasetError
from branchdrive.formats import pinned
from branchdrive.formats.place import open_store
from branchdrive.formats.store import Entry


def written(folder: Path, archive: ZipFile | bytes) -> Path:
    """An archive in a folder."""
    path = folder / "set.zip"
    path.write_bytes(archive if isinstance(archive, bytes) else archive.content())
    return path


GOOD = ZipFile([Member("branchdrive.json", b"{}"), Member("raw/plain", b"content"), Member("raw/empty")])


def test_members_are_files(tmp_path: Path) -> None:
    store = open_store(written(tmp_path, GOOD))
    assert store.names("raw") == ["empty", "plain"]
    assert (store.read("raw/plain", 7), store.read("raw/empty", 7)) == (b"content", b"")
    assert (str(store), store.place("raw/plain")) == (str(tmp_path / "set.zip"), f"{tmp_path / 'set.zip'}/raw/plain")
    with store.open("raw/plain") as stream:
        stream.seek(3)
        assert stream.read(2) == b"te"
    travelled = pickle.loads(pickle.dumps(store)).only(["raw/plain"])
    assert (travelled.read("raw/plain", 7), list(travelled.pinned)) == (b"content", ["raw/plain"])


def test_an_archive_may_be_named_by_a_link(tmp_path: Path) -> None:
    (tmp_path / "alias.zip").symlink_to(written(tmp_path, GOOD))
    assert open_store(tmp_path / "alias.zip").read("raw/plain", 7) == b"content"


@pytest.mark.parametrize("prefix", ["", "drive/"])
@pytest.mark.parametrize("is_wide", [False, True])
def test_archives_of_other_programs_are_read(tmp_path: Path, prefix: str, is_wide: bool) -> None:
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as archive:
        if prefix:
            archive.writestr(zipfile.ZipInfo(prefix), b"")
        for name, content in (("branchdrive.json", b"{}"), ("raw/plain", b"content")):
            with archive.open(f"{prefix}{name}", "w", force_zip64=is_wide) as stream:
                stream.write(content)
    store = open_store(tmp_path / "set.zip")
    assert [entry.path for entry in store.entries()[1]] == ["branchdrive.json", "raw"]
    assert store.read("raw/plain", 7) == b"content"


def test_many_members_take_the_wide_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zipfile, "ZIP_FILECOUNT_LIMIT", 2)
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as archive:
        for number in range(3):
            archive.writestr(f"raw/{number}", b"content")
    assert b"PK\x06\x06" in (tmp_path / "set.zip").read_bytes()
    store = open_store(tmp_path / "set.zip")
    assert (store.names("raw"), store.read("raw/2", 7)) == (["0", "1", "2"], b"content")


def test_an_archive_in_a_bucket_is_read_by_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    big = bytes(range(256)) * (40 << 10)
    with serving() as server:
        use(server, monkeypatch)
        server.objects["data/set.zip"] = ZipFile([Member("a", big), Member("raw/plain", b"content")]).content()
        store = open_store("s3://bucket/data/set.zip")
        server.requests.clear()
        with store.open("a") as stream:
            stream.seek(5 << 20)
            assert stream.read(4) == big[:4]
        assert server.num("GET") == 2
        server.objects["data/set.zip"] = ZipFile([Member("a", big), Member("raw/plain", b"CONTENT")]).content()
        with pytest.raises(DatasetError, match="was changed after it was listed"):
            store.read("raw/plain", 7)


def test_an_archive_that_was_replaced_is_not_read(tmp_path: Path) -> None:
    store = open_store(written(tmp_path, GOOD))
    written(tmp_path, ZipFile([*GOOD.members[:1], Member("raw/plain", b"CONTENT"), Member("raw/empty")]))
    with pytest.raises(DatasetError, match="was changed after it was listed"):
        store.read("raw/plain", 7)


WIDE = (1 << 32) - 1


def wide_end(archive: ZipFile, number: int | None = None, mark: bytes = b"PK\x06\x06") -> bytes:
    """The 64-bit end of an archive, which says so of as many members, with what leads to it."""
    _, _, _, here, _, length, start, _ = END.unpack(archive.content()[-END.size :])
    count = here if number is None else number
    end = struct.pack("<4sQ2H2L4Q", mark, 44, 45, 45, 0, 0, count, count, length, start)
    return end + struct.pack("<4sLQL", b"PK\x06\x07", 0, start + length, 1)


def test_a_wide_end_that_says_the_same_is_read(tmp_path: Path) -> None:
    store = open_store(written(tmp_path, ZipFile(GOOD.members, between=wide_end(GOOD))))
    assert store.read("raw/plain", 7) == b"content"


@pytest.mark.parametrize(
    ("archive", "message"),
    [
        (b"", "is no archive"),
        (b"PK" * 40, "does not end with its directory"),
        (GOOD.content()[:-1], "does not end with its directory"),
        (GOOD.content() + b"\0", "does not end with its directory"),
        (ZipFile(GOOD.members, comment=b"x"), "does not end with its directory"),
        (ZipFile(GOOD.members, comment=GOOD.content()[-22:]), "another directory, or bytes around it"),
        (ZipFile(GOOD.members, between=b"x"), "another directory, or bytes around it"),
        (ZipFile(GOOD.members, between=wide_end(GOOD, number=2)), "two directories"),
        (ZipFile(GOOD.members, between=wide_end(GOOD, mark=b"PK\x06\x08")), "is damaged"),
        (ZipFile(GOOD.members, before=b"#!/bin/sh\n"), "bytes before its first member"),
        (ZipFile(GOOD.members, count=2), "more than it counts"),
        (ZipFile(GOOD.members, count=4), "is damaged"),
        (ZipFile(GOOD.members, count=65_535), "is damaged"),
        (ZipFile([Member("a", b"1"), Member("a", b"2")]), "two members are called 'a'"),
        (ZipFile([Member("a/", mode=0o40755), Member("a", b"2")]), "two members are called 'a'"),
        (ZipFile([Member("a", b"x" * 99), Member("b", b"2", header=0)]), "overlaps another"),
        (ZipFile([Member("a", b"x" * 99), Member("b", b"2", header=40)]), "overlaps another"),
        (ZipFile([Member("a", b"x", size=1 << 20), Member("b", b"2")]), "overlaps another"),
        (ZipFile([Member("a", b"x", gap=bytes(70_000)), Member("b", b"2")]), "or bytes follow it"),
        (ZipFile([Member("a", b"x", method=8)]), "'a' compressed"),
        (ZipFile([Member("a", b"x", flags=1)]), "'a' encrypted"),
        (ZipFile([Member("a", b"x", flags=8)]), "of a size that only its end tells"),
        (ZipFile([Member("a", b"x", packed=2)]), "of two sizes"),
        (ZipFile([Member("a", b"x", size=WIDE)]), "without its size"),
        (ZipFile([Member("a", b"", size=WIDE, extra=b"\1\0\x08\0" + bytes(8) + b"\1\0\x08\0" + bytes(8))]), "two sets"),
        (ZipFile([Member("a/", b"x", mode=0o40755)]), "with bytes of its own"),
        (ZipFile([Member("a", b"x", extra=b"\1\0\x08\0" + bytes(8))]), "two sets"),
        (ZipFile([Member("a", b"x", extra=b"up\x06\0\1" + bytes(4) + b"b")]), "with two names"),
        (ZipFile([Member("ä", b"x")]), "no UTF-8"),
        (ZipFile([Member("a\0b", b"x")]), "ends earlier for some programs"),
    ],
)
def test_archives_that_can_be_read_in_two_ways_are_refused(
    tmp_path: Path, archive: ZipFile | bytes, message: str
) -> None:
    with pytest.raises(DatasetError, match=message) as caught:
        open_store(written(tmp_path, archive))
    assert "branchdrive pack" in str(caught.value)


@pytest.mark.parametrize(
    "member",
    [
        Member("a", b"x", local_name="b"),
        Member("a", b"x", local_size=2),
        Member("a", b"x", crc=1),
        Member("a", b"x", gap=b"more"),
    ],
    ids=["name", "size", "checksum", "gap"],
)
def test_a_member_that_is_not_as_the_directory_says_is_not_read(tmp_path: Path, member: Member) -> None:
    store = open_store(written(tmp_path, ZipFile([member, Member("b", b"2")])))
    assert store.read("b", 1) == b"2"
    with pytest.raises(DatasetError, match="'a' has a header of its own that is not as the directory"):
        store.read("a", 9)


def test_names_and_kinds_that_no_dataset_may_have_stay_closed(tmp_path: Path) -> None:
    members = [
        Member("../up", b"x"), Member("/root", b"x"), Member("link", b"/etc/passwd", mode=0o120777),
        Member("device", mode=0o20644), Member("a", b"x"), Member("a/b", b"x"),
    ]  # fmt: skip
    store = open_store(written(tmp_path, ZipFile(members)))
    assert {entry.path: entry.kind for entry in store.entries()[1]} == {
        "../up": "file", "/root": "file", "a": "file_and_folder", "device": "special", "link": "link",
    }  # fmt: skip
    for name in ("../up", "/root", "link", "device", "a"):
        with pytest.raises(DatasetError):
            store.open(name)
    assert store.entries("a")[1] == [Entry("a/b", "file", 1, "a/b")]


def test_a_directory_of_too_many_members_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.formats.archive.most_files", lambda: 2)
    assert pinned.most_files() > 2
    with pytest.raises(DatasetError, match="a directory of 3 members"):
        open_store(written(tmp_path, GOOD))


@given(
    st.lists(
        st.tuples(st.integers(0, len(GOOD.content()) - 1), st.integers(0, 3), st.binary(min_size=1, max_size=4)),
        min_size=1,
        max_size=3,
    )
)
def test_what_is_read_of_a_damaged_archive_is_what_other_programs_read(edits: list[tuple[int, int, bytes]]) -> None:
    content = GOOD.content()
    for place, removed, added in edits:
        content = content[:place] + added + content[place + removed :]
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder), content)
        try:
            store = open_store(path)
        except DatasetError:
            return
        try:
            other = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, NotImplementedError):  # of a later version of the form, say
            return
        with other:
            assert {*store.pinned} == {*other.namelist()}
            for name in store.pinned:
                with contextlib.suppress(DatasetError, zipfile.BadZipFile, NotImplementedError):
                    assert store.read(name, 1 << 20) == other.read(name)
