"""A dataset in one file: a ZIP archive of stored members, read where it is, in a folder or a bucket.

No byte of an archive belongs to two members or to none, so that all programs see the same files in it: it begins with
the first member and ends with its only directory, members lie one behind the other without gaps and none is
compressed or encrypted. The directory then says where every member is, and nothing needs to be unpacked.

Source: spec/03-layout.md#archives, spec/09-security.md#paths.
"""

from __future__ import annotations

import stat
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import BinaryIO, Literal, NamedTuple, NoReturn, cast

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError
from branchdrive.formats.pinned import Pinned, PinnedStore, most_files
from branchdrive.formats.ranged_file import FIRST_BYTES, RangedFile
from branchdrive.formats.store import Store, size_of

__all__ = ["ARCHIVE_NAME", "Archive", "Member"]

ARCHIVE_NAME = ".zip"
"""How names of archives end."""

LOCAL = struct.Struct("<4s5H3L2H")
CENTRAL = struct.Struct("<4s6H3L5H2L")
END = struct.Struct("<4s4H2LH")
END_64 = struct.Struct("<4sQ2H2L4Q")
LOCATOR_64 = struct.Struct("<4sLQL")
EXTRA = struct.Struct("<2H")

LOCAL_MARK, CENTRAL_MARK, END_MARK, END_64_MARK, LOCATOR_64_MARK = (
    b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"PK\x06\x06", b"PK\x06\x07",
)  # fmt: skip

FULL_16, FULL_32 = 0xFFFF, 0xFFFFFFFF
"""What stands for a number that is in the 64-bit fields."""

EXTRA_64 = 1
_EXTRA_NAME = 0x7075
"""Another name of a member, which some programs take."""

FLAG_UTF8 = 1 << 11
FLAGS_ALLOWED = FLAG_UTF8
UNIX = 3
"""Whose attributes the upper half of a member's are."""

_ADVICE = "make the archive with `branchdrive pack`"


@dataclass(frozen=True)
class Member(Pinned):
    """One member.

    Attributes:
        header: Where its own header begins.
        start: Where its bytes begin.
        name: As it is written in the archive.
        crc: Checksum of its bytes, as the directory has it.
    """

    header: int = 0
    start: int = 0
    name: bytes = b""
    crc: int = 0


class _Listed(NamedTuple):
    """What the directory says of a member."""

    name: bytes
    path: str
    size: int
    header: int
    crc: int
    kind: Literal["file", "folder", "link", "special"]


@dataclass(frozen=True)
class Archive(PinnedStore):
    """The members of an archive, listed when it was opened.

    Attributes:
        home: Where the archive is.
        name: Its path there.
        members: Its files by path, below the one folder that holds all of them where there is one.
        version: What tells the archive that was listed from another under its name.
    """

    home: Store
    name: str
    members: Mapping[str, Member] = field(compare=False, repr=False)
    version: tuple[int, ...] = ()

    @classmethod
    def open_file(cls, home: Store, name: str) -> Archive:
        """The archive called `name` in a store, listed.

        Raises:
            DatasetError: There is none, or it is none that may be read.
        """
        where = home.place(name)
        with home.open(name) as stream:
            version = home.version_of(stream)
            directory = _Directory(stream, where)
            members = _placed(list(directory.members()), directory.start, where)
        return cls(home, name, _below_one_folder(members), version)

    @property
    def pinned(self) -> Mapping[str, Pinned]:
        """Members by path."""
        return self.members

    def place(self, path: str) -> str:
        """The archive, and a path in it."""
        whole = self.home.place(self.name)
        return f"{whole}/{path}" if path else whole

    def only(self, paths: Collection[str]) -> Archive:
        """The archive with these members alone."""
        found = {path: self.members[path] for path in paths if path in self.members}
        return replace(self, home=self.home.only([self.name]), members=found)

    def _opened(self, path: str, found: Pinned) -> BinaryIO:
        member = cast("Member", found)
        stream = self.home.open(self.name)
        try:
            if self.home.version_of(stream) != self.version:
                raise DatasetError(f"{self}: was changed after it was listed; read it again")
            stream.seek(member.header)
            header_size, first_size = member.start - member.header, min(member.size, FIRST_BYTES)
            content = stream.read(header_size + first_size)
            if len(content) != header_size + first_size or not _says_the_same(content[:header_size], member):
                raise DatasetError(f"{self}: {path!r} has a header of its own that is not as the directory; {_ADVICE}")
        except BaseException:
            stream.close()
            raise
        return cast("BinaryIO", _MemberFile(stream, member, content[header_size:], self.place(path)))


class _MemberFile(RangedFile):
    """The bytes of a member.

    Args:
        stream: The archive.
        member: The member.
        first: Its first bytes.
        where: How messages name it.
    """

    def __init__(self, stream: BinaryIO, member: Member, first: bytes, where: str) -> None:
        def fetch(start: int, stop: int) -> bytes:
            stream.seek(member.start + start)
            content = stream.read(stop - start)
            if len(content) != stop - start:
                raise DatasetError(f"{where}: the archive ends before it does")
            return content

        super().__init__(member.size, fetch, first)
        self._stream = stream

    def close(self) -> None:
        """Close the archive too."""
        self._stream.close()
        super().close()


class _Directory:
    """The directory of an archive.

    Args:
        stream: The archive.
        where: How messages name it.
    """

    def __init__(self, stream: BinaryIO, where: str) -> None:
        self._stream, self._where = stream, where
        self._size = size_of(stream)
        self._number, self._length, self.start = self._bounds()

    def members(self) -> Iterator[_Listed]:
        """What the directory lists, in its order.

        Raises:
            DatasetError: It is none, is not the only one, or lists what may not be read.
        """
        number, length = self._number, self._length
        limits = spec_limits()
        most = number * (CENTRAL.size + limits.max_path_bytes + 256)
        if number > most_files() or length > most:
            self._refuse(f"has a directory of {number} members and {length} bytes, more than a dataset can")
        content = self._read(self.start, length)
        place = 0
        for _ in range(number):
            if content[place : place + 4] != CENTRAL_MARK or place + CENTRAL.size > length:
                self._refuse("has a directory that is damaged")
            fields = CENTRAL.unpack_from(content, place)
            names = place + CENTRAL.size
            name_size, extra_size, comment_size = fields[10:13]
            end = names + name_size + extra_size + comment_size
            if end > length:
                self._refuse("has a directory that is damaged")
            extra = content[names + name_size : names + name_size + extra_size]
            yield self._listed(fields, content[names : names + name_size], extra)
            place = end
        if place != length:
            self._refuse("has a directory with more than it counts")

    def _listed(self, fields: tuple[int, ...], name: bytes, extra: bytes) -> _Listed:
        _, made_by, _, flags, method, _, _, crc, packed, size, *_, disk, _, attributes, header = fields
        shown = quote(name.decode("utf-8", "replace"))
        if flags & ~FLAGS_ALLOWED:
            self._refuse(f"has the member {shown} encrypted, or of a size that only its end tells")
        if method != 0:
            self._refuse(f"has the member {shown} compressed; store it")
        size, packed, header = self._wide((size, packed, header), extra, shown)
        if disk not in (0, FULL_16) or size != packed:
            self._refuse(f"has the member {shown} in other files, or of two sizes")
        try:
            path = name.decode("utf-8" if flags & FLAG_UTF8 else "ascii")
        except UnicodeDecodeError:
            self._refuse(f"has the member {shown}, whose name is no UTF-8")
        if "\0" in path:
            self._refuse(f"has the member {shown}, whose name ends earlier for some programs")
        kind = _kind(attributes >> 16 if made_by >> 8 == UNIX else 0, path)
        if kind == "folder" and size:
            self._refuse(f"has the folder {shown} with bytes of its own")
        return _Listed(name, path, size, header, crc, kind)

    def _wide(self, values: tuple[int, ...], extra: bytes, shown: str) -> list[int]:
        """Numbers of a member, those that are full replaced by the 64-bit ones."""
        fields = list(_extras(extra))
        if any(key == _EXTRA_NAME for key, _ in fields):
            self._refuse(f"has the member {shown} with two names")
        wide = [value for key, value in fields if key == EXTRA_64]
        if len(wide) > 1:
            self._refuse(f"has the member {shown} with two sets of sizes")
        rest = wide[0] if wide else b""
        found = []
        for value in values:
            if value != FULL_32:
                found.append(value)
                continue
            if len(rest) < 8:
                self._refuse(f"has the member {shown} without its size")
            found.append(int.from_bytes(rest[:8], "little"))
            rest = rest[8:]
        if rest:
            self._refuse(f"has the member {shown} with two sets of sizes")
        return found

    def _bounds(self) -> tuple[int, int, int]:
        """Members, bytes and beginning of the directory, which ends where the file's end begins."""
        if self._size < END.size:
            self._refuse("is no archive")
        mark, disk, first, here, number, length, start, comment = END.unpack(
            self._read(self._size - END.size, END.size)
        )
        if mark != END_MARK:
            self._refuse("is no archive, or does not end with its directory")
        end, numbers = self._size - END.size, (disk, first, here, number, length, start)
        if self._has_wide_end(end):
            end, wide = self._wide_bounds(end)
            full = (FULL_16, FULL_16, FULL_16, FULL_16, FULL_32, FULL_32)
            if any(one not in (other, most) for one, other, most in zip(numbers, wide, full, strict=True)):
                self._refuse("has two directories")
            numbers = wide
        disk, first, here, number, length, start = numbers
        if disk or first or here != number or comment:
            self._refuse("is a part of an archive, or has a comment")
        if start + length != end:
            self._refuse("has another directory, or bytes around it")
        return number, length, start

    def _has_wide_end(self, end: int) -> bool:
        """Whether a 64-bit end lies before the other, which most programs take whatever the other says."""
        place = end - LOCATOR_64.size
        return place >= END_64.size and self._read(place, 4) == LOCATOR_64_MARK

    def _wide_bounds(self, end: int) -> tuple[int, tuple[int, int, int, int, int, int]]:
        """Where the 64-bit end begins, right before the other, and what it says."""
        place = end - LOCATOR_64.size - END_64.size
        content = self._read(place, LOCATOR_64.size + END_64.size)
        mark, size, _, _, disk, first, here, number, length, start = END_64.unpack_from(content)
        located, _, where, disks = LOCATOR_64.unpack_from(content, END_64.size)
        if (mark, located) != (END_64_MARK, LOCATOR_64_MARK) or size != END_64.size - 12 or where != place or disks > 1:
            self._refuse("has a directory that is damaged")
        return place, (disk, first, here, number, length, start)

    def _read(self, start: int, size: int) -> bytes:
        self._stream.seek(start)
        content = self._stream.read(size)
        if len(content) != size:
            self._refuse("is cut off")
        return content

    def _refuse(self, why: str) -> NoReturn:
        raise DatasetError(f"{self._where}: {why}; {_ADVICE}")


def _placed(listed: Collection[_Listed], end: int, where: str) -> dict[str, Member]:
    """Members by path; each takes the bytes up to the next one, the last those up to the directory.

    Raises:
        DatasetError: Two have one name, or lie one in the other.
    """
    ordered = sorted(listed, key=lambda member: member.header)
    found: dict[str, Member] = {}
    if ordered and ordered[0].header:
        raise DatasetError(f"{where}: has bytes before its first member; {_ADVICE}")
    for member, behind in zip(ordered, [*(member.header for member in ordered[1:]), end], strict=True):
        start, shortest = behind - member.size, member.header + LOCAL.size + len(member.name)
        if not shortest <= start <= shortest + FULL_16:
            raise DatasetError(
                f"{where}: the member {quote(member.path)} overlaps another, or bytes follow it; {_ADVICE}"
            )
        path = member.path.removesuffix("/") if member.kind == "folder" else member.path
        if path in found:
            raise DatasetError(f"{where}: two members are called {quote(path)}; {_ADVICE}")
        found[path] = Member(member.size, member.kind, member.header, start, member.name, member.crc)
    return found


def _below_one_folder(members: Mapping[str, Member]) -> dict[str, Member]:
    """Members of a dataset that was packed with its folder, by their paths in it; of another, as they are."""
    tops = {path.partition("/")[0] for path in members}
    top = f"{min(tops, default='')}/"
    if len(tops) != 1 or not any(f"{top}{name}" in members for name in (DESCRIPTOR_FILE, MANIFEST_FILE)):
        return dict(members)
    return {path.removeprefix(top): member for path, member in members.items() if path.startswith(top)}


def _kind(mode: int, path: str) -> Literal["file", "folder", "link", "special"]:
    """What a member is, by its Unix mode and its name."""
    if path.endswith("/"):
        return "folder" if stat.S_IFMT(mode) in (0, stat.S_IFDIR) else "special"
    if stat.S_ISLNK(mode):
        return "link"
    return "file" if stat.S_IFMT(mode) in (0, stat.S_IFREG) else "special"


def _extras(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Extra fields of a member by number; what is cut off is none."""
    place = 0
    while place + EXTRA.size <= len(content):
        key, size = EXTRA.unpack_from(content, place)
        place += EXTRA.size
        yield key, content[place : place + size]
        place += size


def _says_the_same(header: bytes, member: Member) -> bool:
    """Whether the header of a member says what the directory says of it, and ends where its bytes begin."""
    mark, _, flags, method, _, _, crc, packed, size, name_size, extra_size = LOCAL.unpack_from(header)
    extra = header[LOCAL.size + name_size :]
    sizes = [size, packed]
    if FULL_32 in sizes:
        wide = [value for key, value in _extras(extra) if key == EXTRA_64]
        if len(wide) != 1 or len(wide[0]) < 16:
            return False
        sizes = [int.from_bytes(wide[0][at : at + 8], "little") for at in (0, 8)]
    return (
        mark == LOCAL_MARK
        and not flags & ~FLAGS_ALLOWED
        and method == 0
        and crc == member.crc
        and sizes == [member.size, member.size]
        and header[LOCAL.size : LOCAL.size + name_size] == member.name
        and len(extra) == extra_size
    )
