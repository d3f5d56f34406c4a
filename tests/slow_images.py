"""JPEGs of a few kilobytes that cost a decoder as much as whole films: progressive, of one colour, in many scans."""

from __future__ import annotations

import struct

__all__ = ["slow_jpeg"]


def _segment(marker: int, body: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def _coefficients(num_blocks: int, component: int, high: int, low: int) -> bytes:
    """A scan of all coefficients but the first of a component, all of them zero: runs of up to 32,767 blocks."""
    runs = [*([2**14 - 1] * (num_blocks // (2**15 - 1))), 0]  # what is more than 16,384 blocks, in 14 bits
    bits = "".join(f"0{run:014b}" for run in runs)
    bits += "1" * (-len(bits) % 8)
    data = int(bits, 2).to_bytes(len(bits) // 8, "big").replace(b"\xff", b"\xff\x00")
    return _segment(0xDA, bytes([1, component, 0, 1, 63, high << 4 | low])) + data


def slow_jpeg(width_px: int, height_px: int, num_scans: int, number: int = 0) -> bytes:
    """A progressive JPEG of one colour.

    Args:
        width_px: Columns.
        height_px: Rows.
        num_scans: Its scans, one at least.
        number: Stands in a comment, so that images of different numbers have different bytes.
    """
    num_blocks = -(-width_px // 8) * -(-height_px // 8)
    parts = [
        b"\xff\xd8", _segment(0xFE, b"%d" % number), _segment(0xDB, bytes([0]) + bytes([1]) * 64),
        _segment(0xC2, struct.pack(">BHHB", 8, height_px, width_px, 3) + bytes([1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0])),
        _segment(0xC4, bytes([0, 1, *bytes(15), 0])), _segment(0xC4, bytes([0x10, 1, 1, *bytes(14), 0xE0, 0x00])),
        _segment(0xDA, bytes([3, 1, 0, 2, 0, 3, 0, 0, 0, 0])) + bytes(-(-3 * num_blocks // 8)),
    ]  # fmt: skip
    low = dict.fromkeys((1, 2, 3), 14)
    for scan in range(num_scans - 1):
        component = scan % 3 + 1
        high, low[component] = low[component] % 14, max(low[component] - 1, 0)
        parts.append(_coefficients(num_blocks, component, high, low[component]))
    return b"".join([*parts, b"\xff\xd9"])
