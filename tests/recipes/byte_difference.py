"""The parts of bytes that make other bytes: the inverse of `splice.spliced`."""

from __future__ import annotations

import base64

from branchdrive_conformance.splice import Part

__all__ = ["parts_between"]

_WINDOW = 16
"""Bytes that must be alike for a part to be taken."""


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
