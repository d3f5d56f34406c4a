"""Archives of stored members, byte by byte: right ones, and ones that lie."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

LOCAL, CENTRAL, END = struct.Struct("<4s5H3L2H"), struct.Struct("<4s6H3L5H2L"), struct.Struct("<4s4H2LH")


@dataclass
class Member:
    """One member; what is not given follows from the others."""

    name: str
    content: bytes = b""
    flags: int = 0
    method: int = 0
    mode: int = 0o100644
    header: int | None = None
    local_name: str | None = None
    local_size: int | None = None
    size: int | None = None
    packed: int | None = None
    crc: int | None = None
    extra: bytes = b""
    gap: bytes = b""


@dataclass
class ZipFile:
    """An archive; what is not given follows from its members."""

    members: list[Member] = field(default_factory=list)
    before: bytes = b""
    between: bytes = b""
    comment: bytes = b""
    count: int | None = None

    def content(self) -> bytes:
        """Its bytes."""
        body, central = self.before, b""
        for one in self.members:
            header, size = len(body), len(one.content)
            crc = zlib.crc32(one.content)
            name = (one.local_name or one.name).encode()
            local = size if one.local_size is None else one.local_size
            body += LOCAL.pack(b"PK\x03\x04", 20, one.flags, one.method, 0, 33, crc, local, local, len(name), 0)
            body += name + one.content + one.gap
            size = size if one.size is None else one.size
            name = one.name.encode()
            central += CENTRAL.pack(
                b"PK\x01\x02", 3 << 8 | 20, 20, one.flags, one.method, 0, 33, crc if one.crc is None else one.crc,
                size if one.packed is None else one.packed, size, len(name), len(one.extra), 0, 0, 0, one.mode << 16,
                header if one.header is None else one.header,
            ) + name + one.extra  # fmt: skip
        number = len(self.members) if self.count is None else self.count
        end = END.pack(b"PK\x05\x06", 0, 0, number, number, len(central), len(body), len(self.comment))
        return body + central + self.between + end + self.comment
