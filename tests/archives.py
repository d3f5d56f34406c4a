"""Archives of media as other programs might write them, and as somebody might who wants to hide or to forge a member.

Each is made of the same named images; what an index says of them stays as it is, but for where they lie.
"""

from __future__ import annotations

import tarfile
from collections.abc import Callable, Sequence
from typing import TypeAlias

from branchdrive.formats.media_archive import BLOCK_BYTES, member_header

__all__ = ["FOREIGN", "HOSTILE", "Archive", "Images", "Writer", "plain"]

Images: TypeAlias = Sequence[tuple[str, bytes]]
"""Images and the names that their rows give them."""

Archive: TypeAlias = tuple[bytes, list[int]]
"""An archive, and the first byte of each of its images."""

Writer: TypeAlias = Callable[[Images], Archive]

_END = bytes(2 * BLOCK_BYTES)
_RECORD_BYTES = 20 * BLOCK_BYTES

_HIDDEN = b"#!/bin/sh\n" + bytes(500)
"""What a member holds that no row names."""


def _filled(content: bytes, size: int = BLOCK_BYTES) -> bytes:
    return content + bytes(-len(content) % size)


def _joined(pieces: Sequence[bytes], end: bytes = _END, size: int = _RECORD_BYTES) -> Archive:
    """Pieces one after the other, each a header with the bytes behind it; what is no header begins with ``(``."""
    content, offsets = b"", []
    for piece in pieces:
        if piece.startswith(_MARK):
            content += piece.removeprefix(_MARK)
        else:
            offsets.append(len(content) + BLOCK_BYTES)
            content += piece
    return _filled(content + end, size), offsets


_MARK = b"beside the images:"


def _beside(piece: bytes) -> bytes:
    return _MARK + piece


def _member(name: str, image: bytes) -> bytes:
    return member_header(name, len(image)) + _filled(image)


def _other(name: str, image: bytes = b"", form: int = tarfile.USTAR_FORMAT, **fields: object) -> bytes:
    """A member as `tarfile` writes it, with its extended headers, and other fields than those of a plain file."""
    info = tarfile.TarInfo(name)
    info.size = len(image)
    for field, value in fields.items():
        setattr(info, field, value)
    return info.tobuf(form) + _filled(image)


def _extended(header: bytes, name: str, image: bytes) -> list[bytes]:
    """A plain member behind an extended header."""
    return [_beside(header), _member(name, image)]


def _pax(**records: str) -> bytes:
    """An extended header of POSIX."""
    text = b""
    for key, value in records.items():
        line = f" {key}={value}\n"
        length = len(line) + len(str(len(line) + 2))
        text += f"{length}{line}".encode()
    return _other("././@PaxHeader", text, type=tarfile.XHDTYPE)


def _changed(header: bytes, at: int, value: bytes) -> bytes:
    """A header with other bytes at a place, and the checksum that they give."""
    header = header[:at] + value + header[at + len(value) :]
    checksum = sum(header[:148]) + sum(header[156:BLOCK_BYTES]) + 8 * 32
    return header[:148] + b"%06o\0 " % checksum + header[156:]


def plain(images: Images) -> Archive:
    """The archive that the writer makes."""
    return _joined([_member(name, image) for name, image in images])


def _first(change: Callable[[str, bytes], list[bytes]]) -> Writer:
    """The first image in another way, the others as they had to be."""

    def write(images: Images) -> Archive:
        (name, image), *others = images
        return _joined([*change(name, image), *(_member(*other) for other in others)])

    return write


def _renamed(new: Callable[[str], str]) -> Writer:
    return _first(lambda name, image: [_member(new(name), image)])


def _sparse(name: str, image: bytes) -> list[bytes]:
    header = _other(name, type=tarfile.GNUTYPE_SPARSE, size=len(image), form=tarfile.GNU_FORMAT)
    return [_changed(header, 386, b"%011o\0%011o\0" % (0, len(image))) + _filled(image)]


def _backwards(images: Images) -> Archive:
    content, offsets = plain(images[::-1])
    return content, offsets[::-1]


HOSTILE: dict[str, Writer] = {
    "an end before the first member": lambda images: _joined(
        [_beside(_END), *(_member(*one) for one in images)]
    ),
    "a path in an extended header": _first(lambda *one: _extended(_pax(path="../../../x"), *one)),
    "a size in an extended header": _first(lambda *one: _extended(_pax(size="7"), *one)),
    "an extended header for all": _first(
        lambda *one: _extended(_other("g", b"18 path=/etc/motd\n", type=tarfile.XGLTYPE), *one)
    ),
    "a sparse file of GNU": _first(_sparse),
    "a long name of GNU": _first(
        lambda *one: _extended(_other("././@LongLink", b"/etc/cron.d/x\0", type=tarfile.GNUTYPE_LONGNAME), *one)
    ),
    "a link with a file below it": _first(lambda name, image: [
        _beside(_other(name.partition("/")[0], type=tarfile.SYMTYPE, linkname="/tmp")), _member(name, image),
    ]),
    "a hard link": _first(lambda name, image: [
        _beside(_other("x", type=tarfile.LNKTYPE, linkname=name)), _member(name, image),
    ]),
    "a link as a member": _first(lambda *one: [_other(*one, type=tarfile.SYMTYPE, linkname="/etc/passwd")]),
    "a folder": _first(lambda name, image: [
        _beside(_other(name.partition("/")[0], type=tarfile.DIRTYPE)), _member(name, image),
    ]),
    "a member that no row names": _first(lambda *one: [_beside(_member("run.sh", _HIDDEN)), _member(*one)]),
    "a member of a name that comes again": _first(lambda name, image: [
        _beside(_member(name, _HIDDEN)), _member(name, image),
    ]),
    "a member behind the last image": lambda images: _joined(
        [*(_member(*one) for one in images), _beside(_member("run.sh", _HIDDEN))]
    ),
    "a name above the folder": _renamed(lambda name: "../../../x"),
    "a name from the root": _renamed(lambda name: "/etc/cron.d/x"),
    "the name of another attempt": _renamed(lambda name: "g1" + name[2:]),
    "the name of another tick": _renamed(lambda name: name.replace("/0000", "/0001")),
    "another suffix": _renamed(lambda name: name[:-3] + "bin"),
    "one name for all": lambda images: _joined([_member(images[0][0], image) for _, image in images]),
    "a header before POSIX": _first(lambda name, image: [
        _changed(member_header(name, len(image)), 257, bytes(8)) + _filled(image),
    ]),
    "a header of GNU": _first(lambda *one: [_other(*one, form=tarfile.GNU_FORMAT)]),
    "a header of star": _first(lambda name, image: [
        _changed(member_header(name, len(image)), 508, b"tar\0") + _filled(image),
    ]),
    "a size in base 256": _first(lambda name, image: [
        _changed(member_header(name, len(image)), 124, b"\x80" + len(image).to_bytes(11, "big")) + _filled(image),
    ]),
    "an owner that is no number": _first(lambda name, image: [
        _changed(member_header(name, len(image)), 108, b"nobody\0\0") + _filled(image),
    ]),
    "bytes behind a name": _first(lambda name, image: [
        _changed(member_header(name, len(image)), 90, b"hidden") + _filled(image),
    ]),
    "a header with another checksum": _first(lambda name, image: [b"?" + _member(name, image)[1:]]),
    "no header": _first(lambda name, image: [bytes(BLOCK_BYTES) + _filled(image)]),
    "a header of another size": _first(lambda name, image: [
        member_header(name, len(image) - 1) + _filled(image),
    ]),
    "bytes behind an image": _first(lambda name, image: [member_header(name, len(image)) + image + b"hidden" + bytes(
        -(len(image) + 6) % BLOCK_BYTES
    )]),
    "images in another order": _backwards,
    "no end": lambda images: _joined([_member(*one) for one in images], b"", BLOCK_BYTES),
    "half an end": lambda images: _joined([_member(*one) for one in images], bytes(BLOCK_BYTES), BLOCK_BYTES),
    "bytes behind the end": lambda images: _joined([_member(*one) for one in images], _END + _HIDDEN, BLOCK_BYTES),
    "an archive behind the end": lambda images: _joined(
        [*(_member(*one) for one in images), _beside(_END + _member("run.sh", _HIDDEN))]
    ),
    "zeros without end": lambda images: _joined([_member(*one) for one in images], bytes(2 * _RECORD_BYTES)),
    "a part of a block": lambda images: _joined([_member(*one) for one in images], _END + b"\0", 1),
}  # fmt: skip
"""Archives that programs read differently, or that hold more than the index says, of three images of one attempt."""

FOREIGN: dict[str, Writer] = {
    "of other owners and times": lambda images: _joined([
        _other(*one, mode=0o444, mtime=1_700_000_000, uid=1000, gid=1000, uname="me", gname="us") for one in images
    ]),
    "with blanks behind numbers": lambda images: _joined([
        _changed(_changed(member_header(name, len(image)), 135, b" "), 107, b" ") + _filled(image)
        for name, image in images
    ]),
    "of two blocks at its end": lambda images: _joined([_member(*one) for one in images], _END, BLOCK_BYTES),
    "of devices that are zero": lambda images: _joined([
        _changed(member_header(name, len(image)), 329, b"0000000\0" * 2) + _filled(image) for name, image in images
    ]),
    "with folders apart from names": lambda images: _joined([
        _changed(_changed(member_header(name, len(image)), 0, name.partition("/")[2].encode().ljust(100, b"\0")),
                 345, name.partition("/")[0].encode()) + _filled(image)
        for name, image in images
    ]),
}  # fmt: skip
"""Archives that are as sound as the writer's, of other programs."""
