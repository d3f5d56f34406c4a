"""Bytes as parts of other bytes: ranges ``[start, stop]`` of them, and base64 of what they do not hold."""

from __future__ import annotations

import base64
from collections.abc import Sequence

__all__ = ["parts_between", "spliced"]

Part = list[int] | str

_WINDOW = 16
"""Bytes that must be alike for a part to be taken."""


def spliced(content: bytes, parts: Sequence[Part]) -> bytes:
    """The bytes that parts of `content` make.

    Raises:
        ValueError: A range is not within the content.
    """
    made = []
    for part in parts:
        if isinstance(part, str):
            made.append(base64.b64decode(part))
            continue
        start, stop = part
        if not 0 <= start < stop <= len(content):
            raise ValueError(f"bytes {start} to {stop} are not within {len(content)}")
        made.append(content[start:stop])
    return b"".join(made)


def parts_between(old: bytes, new: bytes) -> list[Part]:
    """Parts of `old` that make `new`, found from its start to its end; after a part what follows it is tried first."""
    places: dict[bytes, int] = {}
    for start in range(len(old) - _WINDOW, -1, -1):
        places[old[start : start + _WINDOW]] = start
    parts: list[Part] = []
    own, place, follows = bytearray(), 0, 0
    while place < len(new):
        window = new[place : place + _WINDOW]
        start = follows if old[follows : follows + _WINDOW] == window else places.get(window, -1)
        if start < 0 or not window:
            own.append(new[place])
            place, follows = place + 1, follows + 1
            continue
        length = _shared(old, start, new, place)
        if own:
            parts.append(base64.b64encode(own).decode())
            own.clear()
        parts.append([start, start + length])
        place, follows = place + length, start + length
    if own:
        parts.append(base64.b64encode(own).decode())
    return parts


def _shared(old: bytes, start: int, new: bytes, place: int) -> int:
    """Bytes that are alike from two places on."""
    length, most = 0, min(len(old) - start, len(new) - place)
    while length < most:
        step = min(4096, most - length)
        if old[start + length : start + length + step] == new[place + length : place + length + step]:
            length += step
            continue
        while old[start + length] == new[place + length]:
            length += 1
        break
    return length
